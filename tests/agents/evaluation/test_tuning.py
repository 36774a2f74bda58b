"""Searches for settings: read strictly, the same however often stopped, judged honestly."""

import json

import numpy as np
import pytest
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from agents import StoppedError
from agents.cli.arguments import spec
from agents.evaluation.evaluate import evaluate
from agents.evaluation.tuning import Drives, covers, read_range, tune, value_at
from agents.policies import make_policy
from tests.conftest import output_of
from wheelchair_gym.base.settings import InputError, with_values

NAME = "a_star+pure_pursuit"
RANGES = {
    "follower.lookahead": FloatDistribution(0.2, 5.0, log=True),
    "follower.lookahead_time": CategoricalDistribution((0.3, 0.7, 2.0)),
}
SEEDS, OTHERS = range(3), range(50, 53)
trials = []


def judge(spec, seeds):
    """Score a lookahead of 1 m and a short time highest, and seeds by their number."""
    make_policy(spec)
    trials.append(spec)
    follower = {"lookahead": 0.45, "lookahead_time": 0.7}
    follower |= {} if isinstance(spec, str) else spec["follower"]
    score = -abs(np.log(follower["lookahead"])) - follower["lookahead_time"]
    return [score + 0.1 * seed for seed in seeds]


def struck(spec, seeds):
    if len(trials) == 3:
        raise KeyboardInterrupt
    return judge(spec, seeds)


def search(folder, judge=judge, ranges=RANGES, **options):
    options = {"trials": 6, "folder": folder, "progress": False, **options}
    return tune(NAME, ranges, judge, SEEDS, OTHERS, **options)


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    folder = tmp_path_factory.mktemp("once")
    return folder, search(folder)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a.b=0.1:2", ("a.b", FloatDistribution(0.1, 2.0))),
        ("n=10:2000:log", ("n", IntDistribution(10, 2000, log=True))),
        ("x=1.0:9", ("x", FloatDistribution(1.0, 9.0))),
        ("kind=left,right,3", ("kind", CategoricalDistribution(("left", "right", 3)))),
    ],
)
def test_ranges_are_read_as_they_are_written(text, expected):
    assert read_range(text) == expected


def test_values_take_the_places_of_dotted_keys():
    before = {"name": "p", "a": {"b": 1, "c": 2}}
    assert with_values(before, {"a.b": 7, "d": 8}) == {"name": "p", "a": {"b": 7, "c": 2}, "d": 8}
    assert before["a"]["b"] == 1
    assert value_at({"a": {"b": 1}}, "a.b") == 1


def test_a_search_begins_with_what_is_set_and_judges_the_best_on_others(once):
    folder, found = once
    rows = [line.split(",") for line in (folder / "trials.csv").read_text().splitlines()]
    assert rows[1][3:] == ["0.45", "0.7"]
    scores = [float(row[1]) for row in rows[1:]]
    assert len(scores) == 6
    assert found["best"]["score"] == max(scores)
    assert len({tuple(row[3:]) for row in rows[1:]}) > 3
    best = spec(f"{folder / 'best.json'}:{NAME}")
    assert found["others"]["best"] == np.mean(judge(best, OTHERS))
    assert found["others"]["before"] == np.mean(judge(NAME, OTHERS))
    low, high = found["others"]["gain_interval"]
    assert low - 1e-9 <= found["others"]["best"] - found["others"]["before"] <= high + 1e-9


def test_a_search_is_the_same_when_stopped(once, tmp_path):
    trials.clear()
    with pytest.raises(StoppedError, match="3 of 6 trials"):
        search(tmp_path, struck)
    assert search(tmp_path) == once[1]
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
    wrong = {"follower.lookahead": CategoricalDistribution((0.45, 0.6, -1.0))}
    found = search(tmp_path, ranges=wrong)
    assert found["best"]["settings"] == {"follower.lookahead": 0.6}
    assert "fail" in (tmp_path / "trials.csv").read_text()


@pytest.mark.parametrize(
    ("what", "value"),
    [("a=1:3", 1.5), ("a=1:3", 4), ("a=0.5:3", None), ("a=0,1", True), ("a=true,false", 1)],
)
def test_a_range_without_the_current_value_is_refused_before_any_trial(what, value, tmp_path):
    _, each = read_range(what)
    assert not covers(each, value)
    assert covers(each, each.choices[0] if what.count(",") else 2.0)
    with pytest.raises(InputError, match=r"lookahead: the range lacks the current value 0\.45"):
        search(tmp_path / "none", ranges={"follower.lookahead": each}, trials=2)
    assert not (tmp_path / "none").exists()


def test_policies_are_judged_by_driving(tmp_path):
    ranges = dict([read_range("follower.objective.horizon=0.3,1.5")])
    env = {"pose_source": "truth", "shield": False}
    judge = Drives(["empty"], env, "sct", tmp_path, 1)
    found = tune(
        "a_star+window", ranges, judge, [1], [2, 3], trials=3, folder=tmp_path, progress=False
    )
    assert found["best"]["settings"] == {"follower.objective.horizon": 1.5}
    records = evaluate(
        [spec(f"{tmp_path / 'best.json'}:a_star+window")], ["empty"], [2, 3],
        env=env, folder=tmp_path, progress=False,
    )  # fmt: skip
    assert found["others"]["best"] == np.mean([record["sct"] for record in records])
    assert 0.2 < found["others"]["best"] <= 1.0


@pytest.mark.parametrize("episodes", [1, 2])
def test_the_command_says_what_it_found(episodes, tmp_path, capsys):
    words = f"tune {NAME} --vary follower.lookahead=0.4:2.0 --trials 2 --episodes {episodes}"
    more = ["--scenes", "empty", "--jobs", "1", "--quiet", "--out", tmp_path]
    said = output_of([*words.split(), *more], capsys)
    assert "the best of 2 trials" in said
    assert f"on {episodes} other episodes" in said
    found = json.loads(output_of([*words.split(), *more, "--json", "-"], capsys))["others"]
    assert found["gain"] == pytest.approx(found["best"] - found["before"])
    assert (None in found["gain_interval"]) == ("no interval" in said) == (episodes == 1)
    assert NAME in json.loads((tmp_path / "best.json").read_text())
