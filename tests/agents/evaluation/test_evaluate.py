"""Evaluation: what is stored is not computed again, workers change nothing, every key is real."""

import json
import subprocess

import numpy as np
import pytest

from agents.evaluation import evaluate as module
from agents.evaluation import provenance
from agents.evaluation.compare import COLUMNS, RESULTS, Suite, compare, markdown, write_report
from agents.evaluation.evaluate import STORE, evaluate, picture_name
from agents.evaluation.metrics import TIMING
from agents.evaluation.runs import read_store
from agents.evaluation.tuning import METRICS
from agents.learning.folder import RESULT_KEYS, _results
from agents.people.drive import Stand
from agents.policies.planned import Planned
from agents.policies.scripted import StraightPolicy
from wheelchair_gym.base.settings import InputError, setting, settings
from wheelchair_gym.scenes.map_file import example_map
from wheelchair_gym.types import Command

SHORT = {"config": {"task": {"time_base": 2.0, "time_factor": 0.0}}, "beams": 45}
WHAT = (["random", "straight"], ["floor_plan"], [0, 1])


def timeless(records):
    return [{k: v for k, v in record.items() if k not in TIMING} for record in records]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Records made in one go, in one process."""
    folder = tmp_path_factory.mktemp("whole")
    return folder, evaluate(*WHAT, env=SHORT, folder=folder, progress=False)


def test_records_come_in_order_with_pictures_of_failures(whole):
    folder, records = whole
    order = [(r["policy"], r["scene"], r["seed"]) for r in records]
    assert order == [(p, "floor_plan", s) for p in WHAT[0] for s in WHAT[2]]
    for record in records:
        assert record["outcome"] in ("timeout", "collision")
        assert (folder / record["picture"]).read_bytes()[:4] == b"\x89PNG"


def test_only_what_is_missing_is_driven_and_other_settings_are_other_episodes(whole, monkeypatch):
    """Resuming of stopped runs is a law of all stores: see test_runs.py."""
    folder, records = whole
    calls = []
    empty = {"policy": "x", "picture": None}
    monkeypatch.setattr(module, "run_episode", lambda job, **o: calls.append(job) or empty)
    assert evaluate(*WHAT, env=SHORT, folder=folder, progress=False) == records
    assert not calls
    evaluate(*WHAT, env=SHORT | {"pose_source": "odometry"}, folder=folder, progress=False)
    assert len(calls) == 4


def test_two_workers_find_the_same(whole, tmp_path):
    records = evaluate(*WHAT, env=SHORT, folder=tmp_path, jobs=2, progress=False)
    assert timeless(records) == timeless(whole[1])
    json.dumps(records, allow_nan=False)


@settings
class Turning:
    turn: float = setting(default=0.5)

    def make(self):
        return self

    def reset(self, mission):
        pass

    def act(self, reading):
        return Command(np.array([0.0, self.turn]))


def test_policies_may_be_objects(tmp_path):
    """Settings of ours or of anybody, beside names; a store knows each again by its values."""
    own = Planned(planner={"name": "a_star"}, follower={"name": "pure_pursuit"})
    policies = ("straight", StraightPolicy(), own, Turning(), Turning(turn=-0.5))
    suite = Suite("Objects", policies[:-1], ("empty",), 1, env=SHORT)
    made = compare(suite, tmp_path, progress=False)
    assert made["policies"] == ["straight", "a_star+pure_pursuit", "Turning"]
    assert [record["policy"] for record in made["records"]] == made["policies"]
    assert (tmp_path / "report.html").stat().st_size > 10_000
    keys = set(read_store(tmp_path / STORE))
    assert len(keys) == 3  # a name and its settings are one policy
    evaluate(policies[-1:], ["empty"], [0], env=SHORT, folder=tmp_path, progress=False)
    assert len(set(read_store(tmp_path / STORE))) == 4


@pytest.mark.parametrize(
    ("policies", "message"),
    [
        (["nobody"], "nobody"),
        ([Stand()], "expected a name, an object or policy settings"),
        ([Turning(), Turning(turn=-0.5)], "'Turning': several policies have this name; give each"),
        ([{"name": "a_star"}, {"name": "a_star", "seed": 1}], "'a_star': several policies have"),
    ],
)
def test_wrong_policies_and_scenes_are_refused_before_anything_runs(tmp_path, policies, message):
    with pytest.raises(InputError, match=message):
        evaluate(policies, ["empty"], [0], env=SHORT, folder=tmp_path, progress=False)
    with pytest.raises(InputError, match="nowhere"):
        evaluate(["random"], ["nowhere"], [0], folder=tmp_path, progress=False)
    assert not (tmp_path / STORE).exists()


def test_a_label_names_a_policy_in_its_film_too(tmp_path):
    policy = {"name": "straight", "label": "ahead"}
    suite = Suite("One", (policy,), (example_map(),), 1, env=SHORT)
    made = compare(suite, tmp_path, progress=False)
    assert made["video"]["policy"] == "ahead"
    assert made["scenes"] == ["clinic"]


def test_a_planner_that_finds_no_path_is_filmed_and_results_need_no_film(tmp_path, monkeypatch):
    for name in ("GROWTH", "SWARM", "DRIVE"):
        monkeypatch.setattr(f"agents.studies.plan_pictures.{name}", 12)
    trees = {"short": {"iterations": 1}, "long": {"iterations": 400}}
    whales = {"name": "rrt_star_woa_global+window"}
    both = [whales | {"label": one, "planner": {"tree": tree}} for one, tree in trees.items()]
    suite = Suite("Two", both, ("clutter",), 1, env=SHORT, film=(*trees,))
    made = compare(suite, tmp_path, progress=False)
    assert made["video"]["policy"] == "short, long"  # the first has neither whales nor commands

    def fails(*_):
        raise ZeroDivisionError

    monkeypatch.setattr("agents.evaluation.compare.film", fails)
    for name in (RESULTS, "table.md", "report.html"):
        (tmp_path / name).unlink()
    with pytest.raises(ZeroDivisionError):
        compare(suite, tmp_path, progress=False)
    assert json.loads((tmp_path / RESULTS).read_text())["video"] is None
    assert (tmp_path / "table.md").is_file()
    assert (tmp_path / "report.html").is_file()


def test_the_name_of_a_failures_picture_is_one_of_a_file_in_its_folder():
    scene = {"name": "map_file", "label": "plan, mcl"}
    assert picture_name("mine:Policy", scene, 3) == "pictures/mine_Policy-plan,_mcl-3.png"
    assert picture_name({"label": r"../a\b?*"}, "c+d", 3) == "pictures/.._a_b__-c+d-3.png"


def test_an_installed_copy_has_no_commit_of_the_repository_that_it_lies_in(tmp_path, monkeypatch):
    own = tmp_path / "site-packages" / "agents" / "evaluation" / "provenance.py"
    own.parent.mkdir(parents=True)
    own.touch()
    (tmp_path / "agents").mkdir()
    (tmp_path / "agents" / "a.py").touch()

    def git(*words):
        who = ("-c", "user.name=n", "-c", "user.email=e", "-c", "commit.gpgsign=false")
        subprocess.run(["git", *who, *words], cwd=tmp_path, check=True, capture_output=True)

    monkeypatch.setattr(provenance, "__file__", str(own))
    git("init")
    for tracked in ("agents", "."):
        git("add", tracked)
        git("commit", "-m", "x")
        found = provenance.provenance()
        assert (found["commit"] is None) == (found["trees"]["agents"] is None) == (tracked != ".")


OPTIONAL = {"kinds", "authority"}  # older results have none; drives without a person have none


class Strict(dict):
    """A mapping in which a key that is missing is an error, also for `get`."""

    def get(self, key, default=None):
        return super().get(key, default) if key in OPTIONAL else self[key]


def strict(value):
    if isinstance(value, dict):
        return Strict({key: strict(item) for key, item in value.items()})
    return [strict(item) for item in value] if isinstance(value, list) else value


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("keys")
    suite = Suite("Keys", ("straight", "random"), ("empty", "temporary"), 1)
    return folder, compare(suite, folder, progress=False)


def test_columns_metrics_and_cards_read_what_is_written(evaluated):
    folder, evaluation = evaluated
    record, rows = set(evaluation["records"][0]), evaluation["summary"]
    assert {*METRICS, *TIMING} <= record
    for row in rows:
        for column in COLUMNS:
            ends = (
                ("", "_low", "_high") if column.interval and row[column.key] is not None else ("",)
            )
            assert {column.key + end for end in ends} <= set(row)
    assert set(RESULT_KEYS) <= set(next(row for row in rows if row["wide"] is not None))
    assert _results(folder / "results.json", {"straight": "0"}, "name")


def test_reports_are_written_of_nothing_but_keys_that_exist(evaluated, tmp_path):
    evaluation = strict(evaluated[1])
    assert not all(record["success"] for record in evaluation["records"])
    write_report(evaluation, tmp_path)
    assert markdown(evaluation)
