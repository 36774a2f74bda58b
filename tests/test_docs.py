"""The documentation agrees with the code, and its examples run."""

import argparse
import inspect
import re
import shlex
import sys
from typing import NamedTuple

import pytest

from agents import cli
from agents.cli import COMMANDS, GROUPS, _add_options, parser
from tests.conftest import ROOT, modules
from tests.hardware.conftest import build_twin
from wheelchair_gym.base.registry import imported
from wheelchair_gym.safety.stops import as_table
from wheelchair_gym.sim.state import SENSED
from wheelchair_gym.task.rewards import TERM_VALUES
from wheelchair_gym.types import Command, Mission, Reading, Shown

PAGES = sorted(
    path
    for path in [*ROOT.glob("docs/**/*.md"), ROOT / "README.md", *ROOT.glob("[a-z]*/**/README.md")]
    if not {"generated", "build", "dist"} & set(path.relative_to(ROOT).parts)
)
# Commands that are run, not only parsed, unless a word in SLOW is among theirs.
QUICK = {"plan", "scenes", "settings", "simulate"}
SLOW = ("--live", "--window", "--video", "--chair", "--record", "slam", "--samples")


class Block(NamedTuple):
    """A block of code of a page."""

    page: str
    line: int
    language: str
    # Comments before it: `continues`, `needs PACKAGE`; `file NAME`: it is a file's content;
    # `writes files`: it is run before each command and each other block of its page.
    marks: str
    text: str


def blocks_of(page):
    text = page.read_text(encoding="utf-8")
    found = re.finditer(r"((?:^<!-- [^\n]* -->\n+)*)^```(\w+)\n(.*?)^```", text, re.M | re.S)
    name = page.relative_to(ROOT).as_posix()
    for one in found:
        line = text.count("\n", 0, one.start(2)) + 1
        yield Block(name, line, one[2], one[1], one[3])


BLOCKS = [block for page in PAGES for block in blocks_of(page)]


def chains():
    """Blocks of Python, each with those that continue it."""
    found: list[list[Block]] = []
    for block in BLOCKS:
        if block.language != "python" or "file " in block.marks:
            continue
        if "continues" in block.marks:
            assert found, f"{block.page}:{block.line} continues nothing"
            assert found[-1][0].page == block.page, f"{block.page}:{block.line} continues nothing"
            found[-1].append(block)
        else:
            found.append([block])
    return found


def commands():
    """Commands in shell blocks: line -> page."""
    found: dict[str, str] = {}
    for block in BLOCKS:
        if block.language == "sh":
            for line in block.text.replace("\\\n", " ").splitlines():
                if line.startswith("wheelchair "):
                    found.setdefault(line.partition("  #")[0].strip(), block.page)
    return found


def mentions():
    """Commands in running text, which may be shortened: line -> page."""
    found: dict[str, str] = {}
    for page in PAGES:
        for line in re.findall(r"`(wheelchair [^`\n]*)`", page.read_text(encoding="utf-8")):
            found.setdefault(line, page.relative_to(ROOT).as_posix())
    return found


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder that looks like a clone, in which examples may leave what they write."""
    for name in ("configs", "wheelchair_gym"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def page_files(folder, monkeypatch):
    """Writes the files that a page has its reader write, to the folder."""
    before = set(sys.modules)

    def write(page):
        for block in BLOCKS:
            if block.page != page:
                continue
            if name := re.search(r"<!-- file (\S+) -->", block.marks):
                (folder / name[1]).write_text(block.text)
            elif "writes files" in block.marks:
                exec(block.text, {})

    yield write
    imported.cache_clear()
    for name in set(sys.modules) - before:
        if getattr(sys.modules[name], "__file__", None) and str(folder) in str(
            sys.modules[name].__file__
        ):
            del sys.modules[name]
    sys.path[:] = [place for place in sys.path if place != str(folder)]


def test_no_block_is_overlooked():
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert len(re.findall(r"^```\w", text, re.M)) == len([*blocks_of(page)]), page


@pytest.mark.parametrize("chain", chains(), ids=lambda c: f"{c[0].page}:{c[0].line}")
def test_a_pages_python_runs(chain, page_files):
    page_files(chain[0].page)
    for needed in re.findall(r"needs (\w+)", chain[0].marks):
        if needed == "emulator":
            build_twin()
        else:
            pytest.importorskip(needed, reason=f"{needed} is not installed: see the page")
    run: dict[str, object] = {}
    for block in chain:
        # Errors name the page's own line.
        code = "\n" * block.line + block.text
        exec(compile(code, block.page, "exec"), run)


@pytest.mark.parametrize("line", commands(), ids=str)
def test_a_pages_command_is_understood_and_quick_ones_run(line, folder, page_files):
    page_files(commands()[line])
    words = shlex.split(line)[1:]
    if words == ["--version"]:
        return
    given = parser().parse_all(words)
    files = [word for word in words if word.endswith((".json", ".mcap"))]
    exist = all((folder / word).exists() for word in files)
    if given.command in QUICK and exist and not any(word in line for word in SLOW):
        assert cli.run(given) == 0


@pytest.mark.parametrize("line", mentions(), ids=str)
def test_a_command_in_a_sentence_exists_with_its_options(line):
    words = shlex.split(line)[1:]
    rows = {command.name: command for command in COMMANDS}
    name = " ".join(words[:2]) if " ".join(words[:2]) in rows else words[0]
    if name in GROUPS or name.startswith("-"):  # `wheelchair hardware`, `wheelchair --help`
        return
    own = argparse.ArgumentParser()  # which adds `--help`
    _add_options(own, rows[name].options)
    known = {option for action in own._actions for option in action.option_strings}
    assert {word.partition("=")[0] for word in words if word.startswith("--")} <= known


def test_the_table_of_messages_is_that_of_the_code():
    assert as_table() in (ROOT / "docs" / "chair" / "messages.md").read_text()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page):
    for link in re.findall(r"\]\(([^)#]+)", page.read_text()):
        if "://" not in link:
            assert (page.parent / link).exists(), link


def test_the_page_of_rewards_lists_every_field():
    text = (ROOT / "docs" / "tutorials" / "own_reward.md").read_text()
    for record, fields in (("terms", TERM_VALUES), ("sensed", SENSED)):
        assert re.findall(rf"^\| `{record}\.(\w+)` \|", text, re.M) == list(fields.names or ())


@pytest.mark.parametrize("cls", [Reading, Mission, Shown, Command], ids=lambda c: c.__name__)
def test_help_describes_every_field_of_what_policies_get_and_give(cls):
    described = re.findall(r"^    (\w+): \S", (inspect.getdoc(cls) or ""), re.M)
    assert described == list(inspect.get_annotations(cls))


def test_the_page_of_the_architecture_names_every_folder():
    text = (ROOT / "docs" / "concepts" / "architecture.md").read_text()
    rows = re.findall(r"^\| `([a-z_/]+)/` \|", text, re.M)
    folders = {
        path.parent.relative_to(ROOT).as_posix()
        for _, path in modules()
        if "build" not in path.parts
    }
    assert {row for row in rows if "firmware" not in row} == folders
