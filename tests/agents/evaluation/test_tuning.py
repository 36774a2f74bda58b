"""Searches for settings: read strictly, the same however often stopped, judged honestly."""

from __future__ import annotations

import json

import numpy as np
import pytest

from agents import StoppedError
from agents.cli import main
from agents.cli.arguments import spec
from agents.evaluation.evaluate import evaluate
from agents.evaluation.tuning import Drives, Plans, Range, read_range, tune, value_at
from planners import make_planner
from tests.conftest import long_but
from wheelchair_gym.config import InputError, with_values

RANGES = [Range("step", 0.5, 5.0, log=True), Range("goal_bias", choices=(0.0, 0.05, 0.2))]
SEEDS, OTHERS = range(3), range(50, 53)


class Struck(Plans):
    """A judge whom Ctrl-C strikes at a trial."""

    def __call__(self, spec, seeds):
        trials.append(spec)
        if len(trials) == 4:
            raise KeyboardInterrupt
        return super().__call__(spec, seeds)


trials = []


def search(folder, judge=Plans, jobs=1, **options):
    own = judge(["clutter"], None, folder, jobs)
    options = {"trials": 6, "folder": folder, "progress": False, **options}
    return tune("rrt_star", RANGES, own, SEEDS, OTHERS, **options)


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    folder = tmp_path_factory.mktemp("once")
    return folder, search(folder)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a.b=0.1:2", Range("a.b", 0.1, 2)),
        ("n=10:2000:log", Range("n", 10, 2000, True)),
        ("kind=left,right,3", Range("kind", choices=("left", "right", 3))),
        ("a", "expected KEY=LOW:HIGH"),
        ("a=", "expected KEY=LOW:HIGH"),
        ("a=3", "expected LOW:HIGH"),
        ("a=2:1", "expected LOW < HIGH"),
        ("a=0:1:log", "LOW > 0"),
        ("a=x:1", "'x' is not a finite number"),
        ("a=0:1:lin", "expected LOW:HIGH"),
    ],
)
def test_ranges_are_read_strictly(text, expected):
    if isinstance(expected, str):
        with pytest.raises(InputError, match=expected):
            read_range(text)
    else:
        assert read_range(text) == expected


def test_whole_bounds_stand_for_whole_numbers():
    assert type(read_range("n=1:9").distribution).__name__ == "IntDistribution"
    assert type(read_range("x=1.0:9").distribution).__name__ == "FloatDistribution"


def test_values_take_the_places_of_dotted_keys():
    before = {"name": "p", "a": {"b": 1, "c": 2}}
    assert with_values(before, {"a.b": 7, "d": 8}) == {"name": "p", "a": {"b": 7, "c": 2}, "d": 8}
    assert before["a"]["b"] == 1
    assert value_at({"a": {"b": 1}}, "a.b") == 1
    for key, says in (("a.x", "x is not a setting"), ("a", "holds several settings")):
        with pytest.raises(InputError, match=says):
            value_at({"a": {"b": 1}}, key)


def test_a_search_begins_with_what_is_set_and_judges_the_best_on_others(once):
    folder, found = once
    rows = [line.split(",") for line in (folder / "trials.csv").read_text().splitlines()]
    assert rows[1][3:] == ["4.0", "0.05"]
    scores = [float(row[1]) for row in rows[1:]]
    assert len(scores) == 6
    assert found["best"]["score"] == max(scores)
    assert len({tuple(row[3:]) for row in rows[1:]}) > 3
    again = Plans(["clutter"], None, folder, 1)
    best = spec(f"{folder / 'best.json'}:rrt_star")
    make_planner(best)
    assert found["others"]["best"] == np.mean(again(best, OTHERS))
    assert found["others"]["before"] == np.mean(again("rrt_star", OTHERS))
    low, high = found["others"]["gain_interval"]
    assert low <= found["others"]["best"] - found["others"]["before"] <= high


@pytest.mark.parametrize("jobs", long_but([1, 2], [2]))
def test_a_search_is_the_same_when_stopped_and_whoever_plans(once, jobs, tmp_path):
    trials.clear()
    with pytest.raises(StoppedError, match="3 of 6 trials"):
        search(tmp_path, Struck, jobs)
    assert search(tmp_path, Plans, jobs) == once[1]
    assert (tmp_path / "trials.csv").read_text() == (once[0] / "trials.csv").read_text()


def test_more_trials_go_on_and_another_search_is_refused(once, tmp_path):
    search(tmp_path, trials=2)
    assert search(tmp_path) == once[1]
    with pytest.raises(InputError, match="another search"):
        search(tmp_path, seed=1)
    (tmp_path / "trials.log").write_text("nonsense\n")
    with pytest.raises(InputError, match=r"trials\.log: not the journal"):
        search(tmp_path)


def test_settings_that_do_not_go_together_are_no_trials(tmp_path):
    wrong = [Range("step", choices=(4.0, -1.0))]
    judge = Plans(["clutter"], None, tmp_path, 1)
    found = tune("rrt_star", wrong, judge, SEEDS, OTHERS, trials=6, folder=tmp_path, progress=False)
    assert found["best"]["settings"] == {"step": 4.0}
    assert "fail" in (tmp_path / "trials.csv").read_text()


def test_policies_are_judged_by_driving(tmp_path):
    ranges = [read_range("follower.objective.progress=0.0,1.0")]
    env = {"pose_source": "truth", "shield": False}
    judge = Drives(["empty"], env, "sct", tmp_path, 1)
    found = tune(
        "a_star+window", ranges, judge, [1], [2, 3], trials=3, folder=tmp_path, progress=False
    )
    assert found["best"]["settings"] == {"follower.objective.progress": 1.0}
    records = evaluate(
        [spec(f"{tmp_path / 'best.json'}:a_star+window")], ["empty"], [2, 3],
        env=env, folder=tmp_path, progress=False,
    )  # fmt: skip
    assert found["others"]["best"] == np.mean([record["sct"] for record in records])
    assert 0.2 < found["others"]["best"] <= 1.0


def test_the_command_says_what_it_found(tmp_path, capsys):
    words = "tune rrt --vary step=0.5:5.0 --trials 2 --episodes 2 --scenes clutter --jobs 1 --quiet"
    assert main([*words.split(), "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "the best of 2 trials" in said
    assert "on 2 other episodes" in said
    assert "rrt" in json.loads((tmp_path / "best.json").read_text())
