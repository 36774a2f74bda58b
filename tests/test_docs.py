"""What the documentation says of the code is what the code says."""

from __future__ import annotations

import re

import pytest

from tests.conftest import ROOT
from wheelchair_gym.hardware.boards.protocol import Fault
from wheelchair_gym.safety.stops import STOPS, as_table

PAGES = sorted([*ROOT.glob("docs/*.md"), ROOT / "README.md", *ROOT.glob("[a-z]*/**/README.md")])


def test_the_table_of_messages_is_that_of_the_code():
    assert as_table() in (ROOT / "docs" / "messages.md").read_text()


def test_every_fault_of_the_drive_board_has_a_meaning_and_something_to_do():
    assert {fault.name for fault in Fault} <= {stop.name for stop in STOPS}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page):
    for link in re.findall(r"\]\(([^)#]+)", page.read_text()):
        if "://" not in link:
            assert (page.parent / link).exists(), link


def test_the_page_of_the_architecture_names_every_folder():
    rows = re.findall(
        r"^\| `([a-z_/]+)/` \|", (ROOT / "docs" / "architecture.md").read_text(), re.M
    )
    folders = {
        path.parent.relative_to(ROOT).as_posix()
        for package in ("wheelchair_gym", "planners", "agents")
        for path in (ROOT / package).rglob("*.py")
        if "build" not in path.parts
    }
    assert {row for row in rows if "firmware" not in row} == folders
