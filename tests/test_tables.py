"""Figures in pages are those of the result files, and these count what comparisons found."""

import json
import re
import runpy

import pytest

from agents.benchmarks.tracks import TRACKS, read_result
from agents.evaluation.compare import BEST, Suite, compare
from tests.conftest import ROOT
from wheelchair_gym.base.settings import InputError

TABLES = runpy.run_path(str(ROOT / "docs" / "tables.py"))
FILES = sorted(TABLES["DATA"].glob("*.json"))


def test_pages_show_the_figures_of_the_result_files():
    for path, text in TABLES["contents"]().items():
        assert path.read_text(encoding="utf-8") == text, "run: python docs/tables.py"


def test_every_table_stands_on_a_page_and_no_other_page_has_one():
    shown = {
        path.relative_to(ROOT).as_posix(): names
        for path in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]
        if (names := re.findall(r"<!-- figures: (\S+) -->", path.read_text(encoding="utf-8")))
    }
    assert set(shown) == set(TABLES["PAGES"])
    assert {name for names in shown.values() for name in names} == set(TABLES["FIGURES"])


def test_an_unknown_table_is_named():
    text = "a\n<!-- figures: barn_61 -->\n<!-- end -->\n"
    with pytest.raises(InputError, match=r"page\.md: figures 'barn_61' are unknown; known: .*barn"):
        TABLES["filled"](text, "page.md")


def test_results_of_other_code_than_the_release_are_named(monkeypatch, capsys):
    assert TABLES["stale"]() == []
    monkeypatch.setitem(TABLES["WORDS"], "released", {"agents": "0" * 12})
    monkeypatch.setitem(TABLES["WORDS"], "excepted", {"league": "takes hours"})
    assert TABLES["stale"]() == [path.stem for path in FILES if path.stem != "league"]
    monkeypatch.setitem(TABLES["WORDS"], "excepted", dict.fromkeys("abcdef"))
    with pytest.raises(InputError, match="excepted: expected at most 5 names"):
        TABLES["stale"]()
    assert TABLES["main"](["run", "leage"]) == 2
    assert "result file 'leage' is unknown; known: agreement" in capsys.readouterr().err


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_result_file_says_how_it_was_measured(path):
    found = json.loads(path.read_text(encoding="utf-8"))
    assert found["command"].startswith("wheelchair ")
    assert re.fullmatch(r"[0-9a-f]{12}", found["commit"]), "measured with files that differ"
    assert set(found["machine"]) == {"cpu", "cores"}
    assert path.stat().st_size < (100_000 if path.stem == "verdicts" else 21_000)


def test_entries_of_the_benchmark_are_of_the_episodes_that_count():
    for path in (TABLES["DATA"].parent / "entries").glob("*.json"):
        entry = read_result(path)
        assert entry["worlds"] == TRACKS[entry["track"]]["digests"]["test"], path


def test_a_result_file_counts_what_a_comparison_found(tmp_path):
    scenes = [
        {"name": "empty", "label": f"empty, {pose}", "env": {"pose_source": pose}}
        for pose in ("modelled", "odometry")
    ]
    what = Suite("two", (BEST, "straight", "random"), tuple(scenes), 3, env={}, video=False)
    evaluation = compare(what, tmp_path, progress=False)
    found = TABLES["condensed"](json.loads((tmp_path / "results.json").read_text()))
    assert found["seeds"] == [0, 2]
    assert len(found["rows"]) == 6
    for row in found["rows"]:
        of = [
            record
            for record in evaluation["records"]
            if record["policy"] == row["policy"] and record["scene"] == f"empty, {row['pose']}"
        ]
        assert row["episodes"] == len(of) == 3
        assert row["success"] == row["scenes"]["empty"] == sum(r["success"] for r in of)
        assert row["contact"] == sum(r["contact"] for r in of)
    best, straight, random = (row for row in found["rows"] if row["pose"] == "modelled")
    assert best["success"] > random["success"]
    assert "beside_best" not in best
    assert random["beside_best"]["best_alone"] == best["success"] - random["success"]
    low, ratio, high = (straight["beside_best"]["time_ratio"][k] for k in (1, 0, 2))
    assert low < ratio < high


def test_a_result_file_holds_the_rates_of_a_benchmark():
    rate = {"what": "one env", "beams": 64, "envs": 1, "threads": 1, "rate": 9e3, "ratio": 30.0}
    found = TABLES["condensed"]({
        "command": "wheelchair bench env --beams 64 --out runs/mine", "commit": "0" * 12,
        "machine": {"cpu": "fast", "cores": 2, "system": "Linux", "load": 0.1}, "versions": {},
        "rows": [{"what": "memory of an env", "value": 3.0, "unit": "kB"}, rate],
    })  # fmt: skip
    assert found["command"] == "wheelchair bench env --beams 64"
    assert found["machine"] == {"cpu": "fast", "cores": 2}
    assert found["rows"] == [rate]


def test_files_of_something_else_are_refused(tmp_path, capsys):
    (tmp_path / "plan.json").write_text('{"path": []}')
    for name in ("plan.json", "none.json"):
        assert TABLES["main"](["take", "mine", str(tmp_path / name)]) == 2
        message = capsys.readouterr().err
        assert name in message
        assert message.count("\n") == 1
    assert not (TABLES["DATA"] / "mine.json").exists()
