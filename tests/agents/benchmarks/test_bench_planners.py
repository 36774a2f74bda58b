"""Laws of the planner benchmark: one judge, nothing computed twice, nothing lost."""

import json
import re
from dataclasses import dataclass
from typing import ClassVar
from unittest.mock import DEFAULT, Mock

import numpy as np
import pytest

from agents import cli
from agents.benchmarks import entrants, planner_benchmark
from agents.benchmarks.planner_benchmark import COLD, FREE, ranking, summarise
from agents.evaluation.metrics import path_figures, printed_turning, turning
from agents.studies import experiments
from planners import PLANNERS, Plan, Problem, Space, Status, make_planner
from tests.conftest import put
from tests.copies import differences
from wheelchair_gym.base.settings import dump

HALL = {"name": "hall", "size": 5, "rects": [[2, 1.5, 3, 2.5]], "start": [1, 2], "goal": [4, 2]}
OPEN = {"name": "open", "size": 5, "rects": [], "start": [1, 2], "goal": [4, 2]}


@dataclass(frozen=True)
class Ghost:
    """A peer that walks through walls, and counts how often it is asked."""

    asked: ClassVar[list] = []  # a setting would make it another peer each time

    def plan(self, problem, rng, deadline=None):
        self.asked.append(deadline)
        path = np.array([problem.start[:2], problem.goal[:2]])
        return Plan(Status.SOLVED, path, timings={"first_path_s": 1e-9})


@dataclass(frozen=True)
class Clumsy:
    """A peer that fails where there is anything solid."""

    def plan(self, problem, rng, deadline=None):
        if problem.name == "small" or problem.space.solid.is_empty:
            return Plan(Status.EXHAUSTED)
        raise ZeroDivisionError("no room")


@pytest.fixture
def problems(tmp_path):
    return put(tmp_path / "problems.json", [HALL | {"optimum": 3.23606797}, OPEN])


@pytest.fixture
def ghost(monkeypatch):
    found = Ghost()
    monkeypatch.setitem(entrants.PEERS, "numpy_ghost", found)
    return found


def bench(*arguments, out, code=0, peers="numpy_ghost"):
    wanted = f"rrt_connect,visibility,{peers}".rstrip(",")
    given = ["bench", "planners", "--quiet", "--seeds", "1", "--deadlines", "60", "--out", out]
    assert cli.main([str(a) for a in [*given, "--planners", wanted, *arguments]]) == code


def test_results_say_all_and_resume_computes_nothing_twice(problems, ghost, tmp_path, capsys):
    out, plot = tmp_path / "out", tmp_path / "p.png"
    bench("--problems", problems, "--plot", plot, out=out)
    said = capsys.readouterr().out
    assert "numpy_ghost (INVALID: 3 of 6 paths)" in said
    assert "wheelchair: " not in said  # what is not installed is no concern of one who did not ask
    heads = next(line for line in said.splitlines() if line.startswith("planner "))
    assert len(re.split(" {2,}", heads)) <= 8
    assert said.endswith(f"all columns: {out / 'planners.md'}\n")
    every = (out / "planners.md").read_text()
    assert "valid at 60s [%]" in every
    assert "of it computing [ms]" in every
    assert plot.read_bytes()[:4] == b"\x89PNG"
    result = json.loads((out / "planners.json").read_text())
    assert {"settings", "commit", "machine", "versions"} <= set(result["provenance"])
    assert result["provenance"]["settings"]["seeds"] == [0]
    optima = {problem["name"]: problem["optimum_m"] for problem in result["problems"]}
    assert optima == {"hall": 3.23606797, "open": pytest.approx(3.0)}
    rows = {(row["planner"], row["problem"]): row for row in result["rows"]}
    assert set(rows) == {
        (planner, problem)
        for planner in ("rrt_connect", "visibility", "numpy_ghost")
        for problem in ("all", "hall", "open")
    }
    # Who goes through the wall has no path there, and no place among the others.
    assert rows["numpy_ghost", "hall"]["success"] == 0.0
    assert rows["numpy_ghost", "hall"]["invalid"] == 3
    assert rows["numpy_ghost", "hall"]["ratio"] is None
    assert rows["numpy_ghost", "open"]["success"] == 1.0
    assert rows["numpy_ghost", "open"]["first_path_s"] == 1e-9
    assert rows["visibility", "all"]["ratio"] == pytest.approx(1.0, abs=1e-6)
    assert result["anytime"] == {"60s": ["visibility", "rrt_connect"]}

    before = len(ghost.asked)
    bench("--problems", problems, "--resume", out / "planners.json", out=tmp_path / "no")
    assert json.loads((out / "planners.json").read_text())["records"] == result["records"]
    assert ghost.asked[before:] == [None]  # it is only asked what it calls
    assert not (tmp_path / "no").exists()

    # What is not asked for this time is kept for the next.
    bench("--problems", problems, "--resume", out / "planners.json", out=tmp_path / "no", peers="")
    less = json.loads((out / "planners.json").read_text())
    assert '"numpy_ghost"' in (out / "planners.jsonl").read_text()
    assert {row["planner"] for row in less["rows"]} == {"rrt_connect", "visibility"}
    capsys.readouterr()
    store = out / "planners.jsonl"
    before = store.read_bytes()
    for more in (("--json", store), ("--resume", out / "planners.json", "--json", store)):
        bench("--problems", problems, *more, out=tmp_path / "no", code=2)
        assert "planners.jsonl: runs and tables end so" in capsys.readouterr().err
    assert store.read_bytes() == before
    another = "--json", tmp_path / "other.json"
    bench("--problems", problems, "--resume", out / "planners.json", *another, out=tmp_path / "no")
    for file in (out / "planners.json", tmp_path / "other.json"):
        assert json.loads(file.read_text())["records"] == result["records"]
    assert capsys.readouterr().out.startswith("## all problems")


def test_ctrl_c_keeps_what_is_done(problems, ghost, tmp_path, capsys, monkeypatch):
    stops = [DEFAULT, DEFAULT, DEFAULT, KeyboardInterrupt]
    made = Mock(wraps=planner_benchmark.run_once, side_effect=stops)
    monkeypatch.setattr(planner_benchmark, "run_once", made)
    bench("--problems", problems, out=tmp_path, code=130)
    assert "stopped; 3 of " in capsys.readouterr().err
    assert len(json.loads((tmp_path / "planners.json").read_text())["records"]) == 3


def test_a_first_path_is_that_of_a_run_that_ends_with_it(problems):
    (case,) = entrants.stored_cases(problems, ["hall"])
    planner = make_planner({"name": "rrt_star", "iterations": 30_000})
    record = planner_benchmark.run_once(planner, case, 0, FREE)
    assert record["first_path_s"] > 0.0
    cut = make_planner({"name": "rrt_star", "return_on_first_path": True})
    plan = cut.plan(case.problem, np.random.default_rng(0))
    assert record["first_path_length_m"] == plan.length


def test_equal_problems_of_two_names_are_two_problems(ghost, tmp_path):
    twins = put(tmp_path / "twins.json", [OPEN, OPEN | {"name": "twin"}])
    bench("--problems", twins, out=tmp_path)
    result = json.loads((tmp_path / "planners.json").read_text())
    numbers = {(row["planner"], row["problem"]): row["runs"] for row in result["rows"]}
    assert all(numbers["rrt_connect", name] == 1 for name in ("open", "twin"))


def test_a_crash_of_one_planner_ends_nothing(problems, tmp_path, monkeypatch):
    monkeypatch.setitem(entrants.PEERS, "numpy_clumsy", Clumsy())
    bench("--problems", problems, out=tmp_path, peers="numpy_clumsy")
    result = json.loads((tmp_path / "planners.json").read_text())
    (row,) = (r for r in result["rows"] if (r["planner"], r["problem"]) == ("numpy_clumsy", "hall"))
    assert row["crashed"] == 3
    assert row["why"] == "ZeroDivisionError: no room"


@pytest.mark.long
@pytest.mark.parametrize("name", entrants.PEERS)
def test_a_peer_that_is_installed_solves_and_keeps_to_a_deadline(name, problems):
    if not entrants.installed(entrants.package_of(name)):
        pytest.skip(f"{entrants.package_of(name)} is not installed")
    (case,) = entrants.stored_cases(problems, ["hall"])
    ready = entrants.prepare(entrants.PEERS[name], case)
    for deadline in (None, 0.05):
        plan = ready.plan(case.problem, np.random.default_rng(0), deadline)
        assert plan.status == Status.SOLVED
        assert not case.judge.faults(plan.path, case.problem.start, case.problem.goal)


def test_a_missing_package_is_one_line_that_names_the_extra(monkeypatch):
    monkeypatch.setattr(entrants, "installed", lambda package: package == "mealpy")
    here, lines = entrants.select_peers(None)
    assert here == ["mealpy_woa", "mealpy_pso"]
    assert len(lines) == len(set(map(entrants.package_of, entrants.PEERS))) - 1
    assert all("pip install 'wheelchair_gym[peers]'" in line for line in lines)
    with pytest.raises(entrants.InputError, match="ompl is not installed: pip install"):
        entrants.select_peers(["ompl_bit_star"])


@pytest.mark.parametrize("name", PLANNERS)
def test_a_deadline_lifts_limits_of_iterations_and_nothing_else(name):
    planner = make_planner(name)
    lifted = differences(dump(planner), dump(entrants.with_iterations(planner, entrants.UNLIMITED)))
    changes = dict(line.split(": ") for line in lifted)  # of each key: the value before and after
    assert all(key.endswith(".iterations") and "whales" not in key for key in changes)
    assert {change.split(", ")[1] for change in changes.values()} <= {f"{entrants.UNLIMITED}"}
    assert ".iterations" in changes or not hasattr(planner, "iterations")


def test_hybrids_are_those_that_call_another_planner():
    assert entrants.called_planners(make_planner("rrt_star_woa_global")) == ("rrt_star",)
    assert entrants.called_planners(make_planner("rrt_star")) == ()
    # It lends the tree's settings and calls nobody.
    assert entrants.called_planners(make_planner("rrt_star_woa_local")) == ()


def test_hybrids_and_late_answers_do_not_rank(problems):
    cases = entrants.stored_cases(problems, ["hall"])
    record = {
        "problem": "hall", "seed": 0, "status": "solved", "length_m": 3.3, "faults": 0,
        "nodes": 1, "turning_rad": 0.1, "printed_turning": 1.0, "clearance_min_m": 0.0,
        "clearance_mean_m": 0.1, "first_path_s": None,
        "cpu_s": 0.1,
    }  # fmt: skip
    runners = [
        entrants.Entrant("ours", None, None),
        entrants.Entrant("hybrid", None, None, calls=("ours",)),
        entrants.Entrant("late", None, None),
        entrants.Entrant("slow", None, None, timed=False),
    ]
    walls = {"ours": 0.1, "hybrid": 0.1, "late": 0.2, "slow": 0.11}
    records = [
        record | {"planner": name, "budget": budget, "wall_s": wall}
        for name, wall in walls.items()
        for budget in (COLD, FREE, 0.1)
    ]
    rows = summarise(runners, {case.name: case.optimum for case in cases}, records, [0.1])
    assert [row["planner"] for row in ranking(rows, 0.1)] == ["ours"]
    assert [row["late_0.1s"] for row in rows] == [0, 0, 1, 1]
    assert [row["success"] for row in rows] == [1.0] * 4


def test_problems_of_scenes_are_for_a_disc_as_wide_as_the_chair():
    (case,) = entrants.scene_cases(["clutter"])
    assert case.problem.clearance == pytest.approx(0.31 + entrants.MARGIN)
    assert case.optimum_source == "visibility"
    assert not case.judge.faults([case.problem.start, case.problem.start])


def test_figures_of_a_path_are_those_of_the_drawing_board():
    space = Space.from_rectangles([(4, 4, 6, 6)], (0, 0, 10, 10))
    problem = Problem(space, np.array([1.0, 3.0]), np.array([7.0, 6.0]))
    path = [(1, 3), (1, 3), (7, 3), (7, 3), (7, 6)]  # a swarm lets way points coincide
    figures = path_figures(path, problem)
    assert figures["length_m"] == pytest.approx(9.0)
    assert figures["clearance_min_m"] == pytest.approx(1.0)
    assert figures["turning_rad"] == turning(path) == pytest.approx(np.pi / 2)
    A, B = 6.0, np.hypot(6.0, 3.0)
    assert figures["printed_turning"] == pytest.approx((A * A + B * B) / (2 * A * B) / 2)
    assert printed_turning(path[:2]) == turning(path[1:3]) == 0.0
    assert (experiments.turning, experiments.printed_turning) == (turning, printed_turning)
    # Along y = 3 from x = 1 to 7 the border and then the block are nearest; then the block's side.
    assert 1.0 < figures["clearance_mean_m"] < 2.0
