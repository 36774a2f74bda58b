"""The notebooks are those of the tutorials, and run."""

import runpy

import pytest

from tests.conftest import ROOT, long_but

nbformat = pytest.importorskip("nbformat", reason="nbclient is not installed (extra: dev)")
CONTENTS = runpy.run_path(str(ROOT / "docs" / "notebooks.py"))["contents"]()


def test_notebooks_are_written_from_the_tutorials():
    for path, text in CONTENTS.items():
        assert path.read_text(encoding="utf-8") == text, "run: python docs/notebooks.py"


# tests/test_docs.py runs the same programs on the pages that the notebooks are made from.
@pytest.mark.parametrize(
    "path",
    long_but(CONTENTS, [p for p in CONTENTS if p.stem == "own_planner"]),
    ids=lambda p: p.stem,
)
def test_a_notebook_runs(path, tmp_path):
    from nbclient import NotebookClient

    for name in ("configs", "wheelchair_gym", "examples"):
        (tmp_path / name).symlink_to(ROOT / name)
    resources = {"metadata": {"path": str(tmp_path)}}
    NotebookClient(nbformat.reads(CONTENTS[path], 4), timeout=600, resources=resources).execute()
