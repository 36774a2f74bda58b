"""The state machine of planned policies: every transition is taken in a drive, and no other is."""

import ast
import inspect

import numpy as np
import pytest

from agents.control.followers import Situation
from agents.control.local_map import LocalMap
from agents.control.rollout import ChairState, ReferencePath
from agents.policies import make_policy, planned
from agents.policies.planned import TRANSITIONS, Event, PlannedDriver, State
from agents.policies.recoveries import Spin
from tests.agents.fakes import PaperWorld, corridor
from tests.agents.policies.test_behaviours import Peopled
from tests.agents.policies.test_unknown import Drawn
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from wheelchair_gym.task.settings import TaskSettings as Task
from wheelchair_gym.types import Command


def test_a_path_beside_an_occupied_goal_ends_where_an_estimated_pose_arrives():
    assert planned.INSIDE * Task().tolerance < Task().tolerance - Task().arrival_margin


def name(row):
    """A transition by its state, its condition or event, and the next state."""
    cause = row.condition.__name__ if row.condition else row.event.name
    return f"{row.state.name} {cause} {row.next.name}"


def blocked(width, until=np.inf):
    """A corridor with a post in the middle that the map does not show, for some seconds."""
    place = lambda t: (4.5, 0.0) if t < until else None  # noqa: E731
    return Peopled(place, corridor(10.0, width), (1.0, 0.0, 0.0), (9.0, 0.0, 0.0))


def drawn(known, goal, *walls):
    """A map that the chair draws: what is known, and occupied parts of it; it starts at (0, 0)."""
    cells = np.full((200, 120), UNKNOWN, np.int8)
    cells[known] = FREE
    for wall in walls:
        cells[wall] = OCCUPIED
    return Drawn(OccupancyGrid(cells, 0.05, (-3.0, -3.0, 0.0)), (0.0, 0.0, 0.0), goal)


def corner():
    """It may turn, but not see behind it; the goal is to the left."""
    walls = np.s_[45:75, 82], np.s_[45, 40:82]
    return drawn(np.s_[46:73, 56:82], (0.0, 5.0), *walls)


def shift(world, policy):
    world.pose[1] = 1.2


def hold(world, policy):
    world.pose[:] = 2.0, 0.0, 0.0


def show(world, policy):
    world.map.cells[50:190, 56:82] = FREE  # to the left
    world.map = OccupancyGrid(world.map.cells, 0.05, world.map.origin)


def turn(world, policy):
    policy._spin.turned = 6.3  # rad


def lengthen(world, policy):
    """No progress, and what was left of the path was shorter than any that is planned now."""
    if policy.planning.state is planned.Thinking.DRIVES:
        policy._progress.left_before = min(policy._progress.left_before, 3.0)
    hold(world, policy)


def held():
    return PaperWorld(corridor(10.0, 3.0), (1.0, 0.0, 0.0), (9.0, 0.0))


DRIVES = {  # world, what happens from the first second on, and transitions that are then taken
    "off its path": (
        lambda: PaperWorld(corridor(10.0, 4.0), (1.0, -1.2, 0.0), (9.0, -1.2)), shift,
        {"FOLLOWS is_astray FOLLOWS"},
    ),
    "held": (
        held, hold,
        {"FOLLOWS is_stalled FOLLOWS", "FOLLOWS may_plan FOLLOWS", "FOLLOWS STALL BACKS_OUT",
         "BACKS_OUT has_backed_out FOLLOWS"},
    ),
    "no shorter path": (held, lengthen, {"FOLLOWS is_plan_longer FOLLOWS"}),
    "blocked for a while": (
        lambda: blocked(1.4, 24.0), None,
        {"FOLLOWS is_blocked FOLLOWS", "FOLLOWS is_by_obstacle FOLLOWS", "FOLLOWS ASIDE MAKES_ROOM",
         "MAKES_ROOM has_made_room FOLLOWS", "FOLLOWS is_clear_again FOLLOWS"},
    ),
    "nowhere aside": (lambda: blocked(0.85), None, {"FOLLOWS NO_ASIDE BACKS_OUT"}),
    "shown": (
        corner, show,
        {"FOLLOWS must_look LOOKS_ROUND", "LOOKS_ROUND is_plan_due LOOKS_ROUND",
         "LOOKS_ROUND is_plan_in_view FOLLOWS"},
    ),
    "turned": (corner, turn, {"LOOKS_ROUND has_turned FOLLOWS"}),
    "between walls": (
        lambda: drawn(
            np.s_[53:67, 56:82], (-3.0, 0.0), np.s_[45:75, 82], np.s_[52, 40:82], np.s_[67, 40:82]
        ), None, {"LOOKS_ROUND BLOCKED FOLLOWS"},
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", DRIVES)
def test_a_transition_is_taken(case, monkeypatch):
    make, happens, expected = DRIVES[case]
    taken, world = set(), make()

    def noted(row):
        def action(driver):
            taken.add(name(row))
            assert driver.state is row.next
            if row.action is not None:
                row.action(driver)

        return row._replace(action=action)

    monkeypatch.setattr(planned, "TRANSITIONS", tuple(map(noted, TRANSITIONS)))
    planning_time = 0.3 if happens is lengthen else 0.0
    policy = make_policy({"name": "a_star+window", "planning_time": planning_time})
    policy.reset(world.mission)
    while world.time < 40.0 and not expected <= taken:
        world.step(policy)
        if happens is not None and world.time > 1.0:
            happens(world, policy)
            world.seen = world.reading()
    assert expected <= taken


def test_a_chair_looks_round_only_until_it_knows_a_way():
    """The space behind the chair stays unseen; a whole turn would take 31 s."""
    policy, world, turns = make_policy("a_star+window"), corner(), 0
    policy.reset(world.mission)
    while world.time < 20.0 and world.pose[1] < 1.0:
        if world.time > 3.0:
            show(world, policy)
        world.step(policy)
        turns += policy.state is State.LOOKS_ROUND
    assert 30 < turns < 60
    assert world.pose[1] > 1.0


def test_a_chair_that_cannot_turn_round_gives_up_after_both_sides():
    world = PaperWorld(corridor(6.0, 1.0), (3.0, 0.0, 0.0), (5.0, 0.0))
    local_map, footprint = LocalMap(world.mission), world.mission.footprint
    chair = ChairState(world.mission.limits, footprint, world.mission.period)
    path = ReferencePath(np.array([(3.0, 0.0), (5.0, 0.0)]), world.pose)
    spin, turns = Spin(), []
    spin.begin(world.pose, world.mission.goal)
    while (twist := spin.twist(Situation(local_map, path, chair))) is not None:
        turns.append(twist[1])
        world.drive(Command(twist).as_action(world.mission.limits))
        local_map.update(world.seen)
        chair.measured(world.seen.twist)
        chair.command(twist)
        assert world.time < 15.0
    assert min(turns) < 0.0 < max(turns)


def test_every_transition_is_taken_by_a_drive_and_nothing_else_changes_the_state():
    names = [name(row) for row in TRANSITIONS]
    assert sorted(names) == sorted(set().union(*(drive[-1] for drive in DRIVES.values())))
    writers = [
        function.name
        for function in ast.walk(ast.parse(inspect.getsource(planned)))
        if isinstance(function, ast.FunctionDef)
        for node in ast.walk(function)
        if isinstance(node, ast.Attribute) and node.attr == "state"
        if isinstance(node.ctx, ast.Store)
    ]
    assert writers == ["reset", "_fire"]
    fired = inspect.getsource(PlannedDriver)
    assert all(
        row.event is Event.PERIOD or f"Event.{row.event.name}" in fired for row in TRANSITIONS
    )
    assert {row.state for row in TRANSITIONS} == {row.next for row in TRANSITIONS} == set(State)
