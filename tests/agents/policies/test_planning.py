"""Laws of planning beside driving: no plan holds the loop up, whichever clock it goes by."""

import dataclasses
import sys
import threading
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from agents.evaluation.evaluate import drive_episode, make_env
from agents.policies import make_policy
from agents.policies.planning import SWITCH, Planning, Thinking
from planners import make_planner
from tests.agents.fakes import PaperWorld, corridor
from tests.agents.policies.test_behaviours import begun
from tests.conftest import PATIENCE, at_start, long_but, until
from wheelchair_gym.geometry.planar import to_world

PERIOD = 0.1  # s


def arrived(planning, taken):
    for k in range(1, 1000):
        assert until(lambda: planning._made)  # beside the loop, in real time
        planning.step(at_rest=True)
        if taken:
            return k
    return None


@pytest.mark.parametrize("real_time", [False, True])
def test_one_plan_at_a_time_is_taken_once(real_time):
    planning, taken = Planning(PERIOD, 1.0, 0.3, real_time), []
    for number in range(3):
        planning.ask(lambda end, number=number: number, taken.append)
        assert planning.busy
        with pytest.raises(AssertionError):
            planning.ask(lambda end: None, taken.append)
        assert arrived(planning, taken) is not None
        assert not planning.busy
        planning.step(at_rest=True)
        assert taken == [number]
        taken.clear()
    assert len(planning.figures.times) == 3


@pytest.mark.parametrize("real_time", [False, True])
def test_what_a_planner_raises_is_raised_in_the_loop(real_time):
    planning = Planning(PERIOD, 1.0, 0.1, real_time)
    planning.ask(Mock(side_effect=ValueError("no map")), lambda plan: None)
    with pytest.raises(ValueError, match="no map"):
        arrived(planning, [])
    assert not planning.busy


@pytest.mark.parametrize(
    ("planning_time", "steps"), [(0.01, 1), (0.1, 1), (0.3, 3), (0.31, 4), (2.0, 20)]
)
def test_in_simulated_time_a_plan_takes_as_many_periods_as_it_is_told(planning_time, steps):
    planning, taken = Planning(PERIOD, 1.0, planning_time, False), []
    planning.ask(lambda end: end, taken.append)
    assert arrived(planning, taken) == steps
    assert taken == [np.inf]  # it searches without a clock
    assert planning.figures.late == (steps > 10)


def test_in_real_time_the_loop_goes_on_while_a_plan_is_made():
    allowed, deadlines = threading.Event(), []

    def plan(problem, rng, deadline=None):
        deadlines.append(deadline)
        allowed.wait(PATIENCE)
        return make_planner("a_star").plan(problem, rng)

    policy = make_policy({"name": "planned", "planner": {"name": "a_star"}, "deadline": 0.5})
    policy._made = SimpleNamespace(plan=plan)
    world = PaperWorld(corridor(12.0, 3.2), (1.0, 0.0, 0.0), (11.0, 0.0, 0.0))
    policy.reset(dataclasses.replace(world.mission, real_time=True))
    assert sys.getswitchinterval() <= 1.01 * SWITCH
    for _ in range(9):
        command = world.step(policy)
        assert command.shown.status == "waits: for a plan"
        assert not command.twist.any()
    assert policy.planning.figures.late == 1
    assert until(lambda: deadlines)
    assert 0.0 <= deadlines[0] <= 0.5
    allowed.set()
    assert until(lambda: policy.planning._made)
    assert world.step(policy).shown.status == "follows"
    assert policy.planning.figures.stood == pytest.approx(0.9)
    while world.pose[0] < 4.0:
        world.step(policy)
    allowed.clear()
    policy.replan()
    before, begun = policy._path, world.pose[0]
    for _ in range(5):
        world.step(policy)
    assert policy.planning.busy
    assert world.pose[0] > begun + 0.02  # it goes on by the old path
    assert policy._path is before
    allowed.set()
    assert until(lambda: policy.planning._made)
    world.step(policy)
    assert policy._path is not before
    assert policy.planning.figures.followed > 0.4


def thinking(planning_time, place=lambda t: None):
    """A world, and a policy whose plans take a time there, once it has the first."""
    world, policy = begun(place, goal=(11.0, 0.0, 0.0), planning_time=planning_time)
    while policy._follower is None:
        world.step(policy)
    return world, policy


def test_what_stands_on_the_first_plan_is_planned_round_before_it_drives():
    world, policy = thinking(1.2, lambda t: (3.0, 0.2))
    assert policy.planning.figures.discarded == 1
    assert world.pose[0] < 1.002  # the first step of the drive
    assert np.hypot(*(policy._path.path - (3.0, 0.2)).T).min() > 0.5


def test_a_plan_that_no_longer_fits_is_discarded_and_the_chair_stands_until_the_next():
    appears = [np.inf]
    world, policy = thinking(1.5, lambda t: (5.8, 0.2) if t >= appears[0] else None)
    while world.pose[0] < 3.0:
        world.step(policy)
    policy.replan()
    appears[0] = world.time  # on the way that is planned just now
    statuses, asked = [], None
    while "goes round" not in statuses:
        statuses.append(world.step(policy).shown.status)
        if policy.planning.figures.discarded and policy.planning.state is Thinking.STANDS:
            asked = world.pose.copy() if asked is None else asked
    first, last = statuses.index("waits: for a plan"), statuses.index("goes round")
    assert 10 <= first <= 15
    assert set(statuses[first:last]) == {"waits: for a plan"}
    assert np.hypot(*(world.pose - asked)[:2]) < 0.05  # the next is asked for at rest, and fits
    assert policy.planning.figures.discarded == 1


def test_it_plans_for_the_outline_of_the_chair():
    env = at_start(make_env("empty", {"config": {"chair": {"footprint": {"half_width": 0.33}}}}))
    policy = make_policy("lattice+window")
    policy.reset(env.unwrapped.mission)
    assert policy._planner.footprint.half_width == 0.33


def test_it_stands_before_an_obstacle_while_it_plans_round_it():
    """It reaches the goal without contact, as it does without planning time."""
    for planning_time in (0.0, 2.0):
        world, policy = thinking(planning_time, lambda t: (5.0, 0.2) if t > 3.0 else None)
        gaps = []
        while world.time < 60.0 and np.hypot(*(world.pose[:2] - world.mission.goal[:2])) > 0.3:
            world.step(policy)
            at = to_world(policy._mission.footprint.corners, world.pose)
            if world.time > 3.0:
                gaps.append(np.hypot(*(at - (5.0, 0.2)).T).min() - 0.25)
        assert world.time < 60.0
        assert min(gaps) > 0.0
        assert (policy.planning.figures.stood > 0.0) == (planning_time > 0.0)
        assert policy.planning.figures.late == (planning_time > 1.0) * len(
            policy.planning.figures.times
        )


@pytest.mark.parametrize("policy", long_but(["lattice+window", "explore"], ["lattice+window"]))
def test_drives_with_planning_time_repeat_and_their_records_tell_what_it_cost(policy):
    settings = {"pose_source": "slam"} if policy == "explore" else {}
    records = []
    for planning_time in (0.0, 0.4, 0.4):
        env = make_env("floor_plan" if policy == "explore" else "temporary", settings)
        spec = {"name": policy, "planning_time": planning_time}
        records.append(drive_episode(env, make_policy(spec), 3 if policy == "explore" else 8))
        env.close()
    timed = [{k: v for k, v in r.items() if "_ms" not in k} for r in records]
    assert timed[1] == timed[2]
    assert timed[0] != timed[1]
    at_once, thought = records[:2]
    assert at_once["thinking_drove_s"] == at_once["thinking_stood_s"] == 0.0
    assert thought["thinking_stood_s"] >= 0.4
    assert thought["late_plans"] == 0
    assert 0.0 < thought["plans_ms_p50"] <= thought["plans_ms_p95"] <= thought["plans_ms_max"]
