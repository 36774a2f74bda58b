"""Fixtures for every test."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of maps, problems and logs that lies beside the project, or a skip."""
    folder = Path(os.environ.get("WHEELCHAIR_SHARED", ROOT.parent / "shared"))
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent; set WHEELCHAIR_SHARED to the folder of maps and problems")
    return folder
