"""A deadline binds a planner and every planner that it calls; by a clock that ticks when read."""

import ast
from dataclasses import fields, replace

import numpy as np
import pytest

from agents.benchmarks.entrants import with_iterations
from planners import PLANNERS, make_planner
from planners.problem import Status
from planners.registries import FIRST_PLANNERS
from planners.swarm.planner import SwarmPlanner
from tests.conftest import ROOT, python
from tests.planners.conftest import TICK
from tests.planners.swarm_worlds import among_blocks
from wheelchair_gym.compiled.clock import clock as planning_clock
from wheelchair_gym.compiled.clock import standing_still

DEADLINE = 0.05  # s
MANY = 100_000  # iterations: some seconds' worth
LATE = 10  # looks: to end two stages, and to tell how long each took


def with_first(name):
    limit = {} if name == "a_star" else {"iterations": MANY}
    return SwarmPlanner(first={"name": name, **limit}, iterations=MANY)


UNLIMITED = {
    **{name: with_iterations(make_planner(name), MANY) for name in sorted(PLANNERS)},
    **{f"swarm after {name}": with_first(name) for name in sorted(FIRST_PLANNERS)},
}


@pytest.mark.parametrize("name", UNLIMITED)
def test_nobody_works_on_when_time_is_over(name, clock):
    plan = UNLIMITED[name].plan(among_blocks(), np.random.default_rng(0), DEADLINE)
    assert clock.now <= TICK + DEADLINE + LATE * TICK
    assert plan.status in (Status.SOLVED, Status.EXHAUSTED, Status.STUCK)
    for what in ("iterations", "first_iterations", "nodes"):
        assert plan.counters.get(what, 0) < MANY / 10, what


def limited_to(planner, iterations, first=None):
    """The planner with other iterations: its own, or its tree's or lattice's where it has none.

    `first` are those of the planner of its first path, where it has one that counts them.
    """
    names = {field.name for field in fields(planner)}
    if first is not None and "tree" in names:
        planner = replace(planner, tree=replace(planner.tree, iterations=first))
    elif first is not None:
        named = {"name": planner.first} if isinstance(planner.first, str) else planner.first
        planner = replace(planner, first={**named, "iterations": first})
    if "iterations" in names:
        return replace(planner, iterations=iterations)
    (part,) = names & {"tree", "lattice"}
    return replace(planner, **{part: replace(getattr(planner, part), iterations=iterations)})


def counts(plan):
    return {name: count for name, count in plan.counters.items() if not name.endswith("_s")}


# That one counts the iterations of three stages: tests/planners/test_trees.py.
@pytest.mark.parametrize("name", sorted(set(UNLIMITED) - {"se2_rrt_star_woa"}))
def test_iterations_replay_a_plan_made_under_a_deadline(name, clock, monkeypatch):
    monkeypatch.setattr("planners.graphs.roadmap.CHUNK", 3)  # so that searches are cut short
    plan = UNLIMITED[name].plan(among_blocks(), np.random.default_rng(1), DEADLINE)
    if "iterations" not in plan.counters:
        return
    made, first = plan.counters["iterations"], plan.counters.get("first_iterations")
    known = limited_to(UNLIMITED[name], made, first)
    again = known.plan(among_blocks(), np.random.default_rng(1))
    assert again.status == plan.status
    np.testing.assert_array_equal(again.path, plan.path)
    np.testing.assert_array_equal(again.tree, plan.tree)
    assert counts(again) == counts(plan)


def test_a_planner_hands_its_deadline_on():
    calls, asked = 0, ("plan", "solve")
    for path in sorted((ROOT / "planners").rglob("*.py")):
        for function in ast.walk(ast.parse(path.read_text())):
            if not isinstance(function, ast.FunctionDef) or function.name != "solve":
                continue
            for call in ast.walk(function):
                if isinstance(call, ast.Call) and getattr(call.func, "attr", "") in asked:
                    calls += 1
                    said = f"{path.name}, line {call.lineno}: {ast.unparse(call)}"
                    assert len(call.args) == 3, said
    assert calls >= 5


def test_the_clock_stands_still_while_kernels_are_loaded(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("wheelchair_gym.compiled.clock.perf_counter", lambda: now[0])
    shown = planning_clock()
    with standing_still():
        now[0] += 0.2
        with standing_still():
            now[0] += 0.2
            within = planning_clock()
    assert within - shown == pytest.approx(0.0, abs=1e-9)
    assert planning_clock() - shown == pytest.approx(0.0, abs=1e-9)
    now[0] += 0.1
    assert planning_clock() - shown == pytest.approx(0.1)


FIRST_CALL = """
import numpy as np
from numba.core import event
from planners import make_planner
from tests.planners.swarm_worlds import among_blocks
from wheelchair_gym.compiled import clock

now = 0.0  # s: a look at the clock takes a microsecond, to load a kernel a minute

def look():
    global now
    now += 1e-6
    return now

class Slow(event.Listener):
    def on_start(self, event):
        global now
        now += 60.0
    def on_end(self, event):
        pass

clock.perf_counter = look
event.register("numba:compiler_lock", Slow())
plan = make_planner("rrt_connect").plan(among_blocks(), np.random.default_rng(0), 0.3)
print(plan.status, now > 60.0)
"""


def test_a_first_call_has_as_much_time_as_all_others():
    done = python(FIRST_CALL)
    assert done.stdout.split() == ["solved", "True"], done.stderr
