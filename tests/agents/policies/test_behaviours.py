"""Laws of what stands and what moves: told apart from scans alone, and behaved to accordingly."""

import ast
import dataclasses
import inspect
import math

import numpy as np
import pytest

from agents.control.followers import Situation
from agents.control.local_map import LocalMap
from agents.control.rollout import ChairState, ReferencePath
from agents.evaluation.compare import suite
from agents.evaluation.evaluate import drive_episode, env_settings, make_env
from agents.evaluation.metrics import backing
from agents.policies import make_policy, planned
from agents.policies.planned import TRANSITIONS, Event, PlannedDriver, State
from agents.policies.recoveries import RETRY_TIME, BackUp, Spin, place_aside
from agents.policies.search import Answer, Search, clearest_place
from planners.problem import Plan, Status
from tests.agents.fakes import PaperWorld, corridor
from tests.agents.policies.test_unknown import Drawn
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from wheelchair_gym.task.settings import TaskSettings as Task
from wheelchair_gym.types import Command

ROUND = np.linspace(0.0, 2.0 * np.pi, 17)


def post(x, y, radius=0.25):
    """Walls (16, 4) round a disc."""
    rim = np.stack([x + radius * np.cos(ROUND), y + radius * np.sin(ROUND)], axis=-1)
    return np.hstack([rim[:-1], rim[1:]])


class Peopled(PaperWorld):
    """A chair on paper, and one thing round that the map does not show: where it is at a time."""

    def __init__(self, place, *args, **more):
        self.place, self.mapped = place, None
        super().__init__(*args, **more)

    def reading(self):
        if self.mapped is None:
            self.mapped = self.walls
        there = self.place(self.time)
        self.walls = self.mapped if there is None else np.vstack([self.mapped, post(*there)])
        return super().reading()


def begun(place=lambda t: None, start=(1.0, 0.0, 0.0), goal=(9.0, 0.0, 0.0), width=3.2, **spec):
    """A corridor with one thing in it or none, and a policy that begins to drive there."""
    world = Peopled(place, corridor(goal[0] + 1.0, width), start, goal)
    policy = make_policy({"name": "a_star+window"} | spec)
    policy.reset(world.mission)
    return world, policy


def watched(place, seconds, v=0.0, given=True):
    """The surroundings of a chair that watches something for a while; given: it has a map."""
    world = Peopled(place, corridor(12.0, 4.0), (1.0, 0.0, 0.0), (11.0, 0.0, 0.0))
    mission = world.mission
    if not given:
        reading = world.seen._replace(map=mission.map)
        mission = dataclasses.replace(mission, map=None, reading=reading)
    local_map = LocalMap(mission)
    for _ in range(round(seconds / world.mission.period)):
        world.drive(np.array([v, 0.0]))
        local_map.update(world.seen)
    return world, local_map


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("v", [0.0, 0.6])
@pytest.mark.parametrize("velocity", [(-0.8, 0.0), (0.0, 0.9), (0.4, -0.3)])
def test_what_moves_is_tracked_whether_the_chair_stands_or_drives(velocity, v, given):
    def place(t):
        return 4.5 + velocity[0] * t, -1.0 * math.copysign(velocity[1] != 0, velocity[1]) + (
            velocity[1] * t
        )

    world, local_map = watched(place, 1.8, v, given)
    assert len(local_map.actors) == 1
    x, y, vx, vy, radius = local_map.actors[0, :5]
    there = place(world.time)
    assert np.hypot(world.pose[0] + x - there[0], world.pose[1] + y - there[1]) < 0.12
    assert np.hypot(vx - velocity[0], vy - velocity[1]) < 0.3
    assert 0.15 < radius < 0.35
    assert not len(local_map.temporary.points)
    hits = local_map.points[:, :2] + world.pose[:2]
    assert np.hypot(*(hits - there).T).min() > 0.3  # it is no obstacle that stands


@pytest.mark.parametrize("v", [0.0, 0.5])
def test_what_stands_is_temporary_and_the_map_static(v):
    world, local_map = watched(lambda t: (4.5, 0.3), 3.0, v)
    assert len(local_map.actors) == 0
    stood = local_map.temporary.points
    assert len(stood)
    assert np.hypot(*(stood - (4.5, 0.3)).T).max() < 0.45
    changed = local_map.temporary.painted().cells != world.mission.map.cells
    assert 0 < changed.sum() < 60


def test_what_is_gone_is_forgotten_once_it_is_seen_to_be():
    _, local_map = watched(lambda t: (3.5, 0.0) if t < 2.5 else None, 2.3)
    assert len(local_map.temporary.points)
    _, local_map = watched(lambda t: (3.5, 0.0) if t < 2.5 else None, 3.0)
    assert not len(local_map.temporary.points)


def test_a_standing_person_out_of_sight_is_soon_forgotten():
    """Somebody walks up and stands; the chair drives by, and they go on behind it."""

    def place(t):
        return 2.6, -1.3 + min(0.8, 0.5 * t)

    world, local_map = watched(place, 7.0)
    assert np.hypot(*(local_map.temporary.points - (2.6, -0.5)).T).min() < 0.3
    for k in range(75):
        gone = world.pose[0] > 3.5
        world.place = (lambda t: None) if gone else place
        world.drive(np.array([0.8 * (not gone), 0.3 * (k < 12) - 0.3 * (12 <= k < 24)]))
        local_map.update(world.seen)
    assert world.pose[0] > 3.5
    assert not len(local_map.temporary.points)
    at = to_world(local_map.hits, world.pose)
    assert np.hypot(*(at - (2.6, -0.5)).T).min() > 0.4


def test_a_plan_that_leads_nowhere_does_not_put_off_backing_out():
    world, policy = begun(start=(2.0, 0.0, 0.0), goal=(9.0, 0.0), width=1.6, name="lattice+window")
    for status, stalled in ((Status.START_OCCUPIED, 3.0), (Status.SOLVED, 0.0)):
        policy._progress.stalled_time = 3.0
        plan = Plan(status, path=np.array([(2.0, 0.0), (9.0, 0.0)]))
        policy._receive_plan(Answer(plan, 0.3, world.pose, 1))
        assert policy._progress.stalled_time == stalled


def test_there_is_room_away_from_what_blocks():
    grid = corridor(10.0, 3.2)
    blocking = np.array([(4.0, y) for y in np.linspace(-0.8, 0.8, 9)])
    aside = place_aside(grid, np.array([3.0, 0.0]), blocking)
    assert np.hypot(*(blocking - aside).T).min() > 1.6
    assert math.dist(aside, (3.0, 0.0)) < 3.0
    assert place_aside(grid, np.array([1.0, 0.0]), blocking) is None  # there is room already


def test_a_chair_before_a_powered_leaf_that_it_holds_makes_room_and_arrives():
    building = next(scene for scene in suite("crowd").scenes if scene["label"] == "building")
    env = make_env(building, env_settings(pose_source="truth"))
    shown = []
    follow = lambda env: shown.append(env.unwrapped.shown.status)  # noqa: E731
    record = drive_episode(env, make_policy("lattice+window"), 1_000_014, follow)
    env.close()
    assert "makes room" in shown
    assert record["success"]


def states(place, goal=(9.0, 0.0, 0.0), seconds=30.0, width=3.2):
    """States shown on a drive down a corridor, its poses, and the world."""
    world, policy = begun(place, goal=goal, width=width)
    said, poses = [], []
    while world.time < seconds and np.hypot(*(world.pose[:2] - world.mission.goal[:2])) > 0.3:
        said.append(world.step(policy).shown.status.partition(":")[0])
        poses.append(world.pose)
    return said, np.array(poses), world


def test_a_temporary_obstacle_is_planned_round():
    said, poses, world = states(lambda t: (5.0, 0.0))
    assert "goes round" in said
    assert np.hypot(*(poses[-1][:2] - world.mission.goal[:2])) <= 0.3
    assert np.hypot(*(poses[:, :2] - (5.0, 0.0)).T).min() > 0.5


def test_a_chair_halts_for_a_person_and_goes_on():
    """Somebody walks up the middle of a corridor too narrow for two, and back again."""

    def place(t):
        return (8.0 - 0.8 * t, 0.0) if t < 4.0 else (4.8 + 0.8 * (t - 4.0), 0.0)

    said, poses, world = states(lambda t: place(t) if t < 9.0 else None, width=1.5)
    assert {"halts", "gives way"} & set(said)
    assert said[-1] == "follows"
    assert np.hypot(*(poses[-1][:2] - world.mission.goal[:2])) <= 0.3
    gaps = [
        place(0.1 * (k + 1))[0] - 0.25 - (pose[0] + 0.70) for k, pose in enumerate(poses) if k < 89
    ]
    assert min(gaps) > 0.0


def test_a_blocked_goal_is_waited_for_and_told():
    said, poses, _ = states(lambda t: (9.0, 0.0), seconds=25.0)
    assert "waits" in said
    assert (np.hypot(*(poses[:, :2] - (9.0, 0.0)).T) > 0.5).all()


def test_a_goal_beside_which_something_stands_is_reached_within_its_tolerance():
    _, poses, world = states(lambda t: (9.0, 0.45), goal=(9.0, 0.0), seconds=40.0)
    assert np.hypot(*(poses[-1][:2] - world.mission.goal)) <= 0.3
    assert np.hypot(*(poses[:, :2] - (9.0, 0.45)).T).min() > 0.5


def test_the_place_beside_a_goal_is_near_it_and_has_the_clearance_asked_for_if_any_has():
    grid = corridor(10.0, 2.0)
    goal = np.array([5.0, 0.8])  # 0.2 m from a wall
    beside = clearest_place(grid, goal, 0.4, 0.5)
    assert abs(beside[1] - 0.6) <= 1.01 * grid.resolution
    assert abs(beside[0] - goal[0]) <= grid.resolution
    assert clearest_place(grid, goal, 0.4, 0.1)[1] == pytest.approx(0.7, abs=grid.resolution)
    assert (clearest_place(grid, goal, 0.4, 0.0) == goal).all()


def test_where_backing_out_did_not_help_it_is_done_for_longer():
    backup, here, durations = BackUp(1.0), np.array([1.0, 0.0]), []
    for place in (here, here, here, here, here, here + 1.5):
        backup.begin(place, crawls=False)
        durations.append(backup.left)
    assert durations == [1, 2, 3, 4, 4, 1]


@pytest.mark.parametrize(("peopled", "maximum"), [(True, 0.042), (False, 0.1)])
def test_no_part_backs_fast_enough_among_people_to_harm_them(peopled, maximum, monkeypatch):
    monkeypatch.setattr(BackUp, "twist", lambda *_: np.array([-0.15, 0.3]))
    world, policy = begun(start=(5.0, 0.0, 0.0))
    policy._surroundings._met_actors, corner = peopled, policy._mission.footprint.corners
    policy.state, policy._backup.left = State.BACKS_OUT, 2.5
    fastest = []
    for _ in range(12):
        world.step(policy)
        v, w = world.seen.twist
        fastest.append(np.hypot(v - w * corner[:, 1], w * corner[:, 0])[corner[:, 0] < 0].max())
    assert 0.5 * maximum < max(fastest) <= maximum


@pytest.mark.parametrize(("longer", "backs"), [(0.5, False), (5.0, True)])
def test_no_long_way_round_is_taken_for_want_of_progress_before_it_has_backed_out(longer, backs):
    world, policy = begun()
    way = np.array([(1.0, 0.0), (1.0 + policy._path.left + longer, 0.0)])
    answer = Answer(Plan(Status.SOLVED, way), 0.3, world.pose, 1)
    policy.replan = lambda: policy._receive_plan(answer)
    policy.dare()
    assert (policy.state is State.BACKS_OUT) == backs


def test_where_nothing_is_left_to_go_round_the_straight_way_is_planned_again():
    world, policy = begun(lambda t: (5.0, 0.3) if t < 5.0 else None)
    longer = []  # than straight on
    for _ in range(80):
        world.step(policy)
        x, y = policy._path.rows[:, 0], policy._path.rows[:, 1]
        straight = math.hypot(x[-1] - x[0], y[-1] - y[0])
        longer.append(np.hypot(np.diff(x), np.diff(y)).sum() / straight - 1.0)
    assert max(longer) > 0.02  # planned round it
    assert longer[-1] < 0.2 * max(longer)


def test_a_plan_that_led_nowhere_is_tried_again_now_and_then(monkeypatch):
    world, policy = begun(start=(1.0, -1.2, 0.0), goal=(9.0, -1.2, 0.0), width=4.0)
    before, planned = policy._path, []

    def nowhere(*_):
        planned.append(world.time)
        return Plan(Status.EXHAUSTED), 0.28

    monkeypatch.setattr(Search, "widest", nowhere)
    world.pose[1] = 1.2  # beside its path, farther than it may stray
    for _ in range(60):
        policy.act(world.seen)
        world.time += world.mission.period  # and there it stays
        world.seen = world.reading()
    assert 2 <= len(planned) <= 3
    assert min(np.diff(planned)) > 0.9 * RETRY_TIME
    assert policy._path is before


def test_for_a_metre_after_no_progress_room_costs_nothing():
    world, policy = begun(name="lattice+window")
    places, costs = [], []
    for k in range(90):
        if k == 15:
            policy.dare()
        world.step(policy)
        places.append(world.pose[0])
        costs.append(policy._follower._follower.config.objective.clearance)
    bold = np.flatnonzero(np.array(costs) == 0.0)
    assert bold[0] == 15
    assert np.all(np.diff(bold) == 1)
    assert 0.75 < places[bold[-1]] - places[bold[0]] < 1.3
    assert costs[-1] == costs[0] > 0.0


def test_a_way_in_reverse_is_planned_once_more_with_less_clearance():
    env = make_env("barn", env_settings(pose_source="truth"))
    env.reset(seed=1_000_002)
    policy = make_policy("lattice+window")
    policy.reset(env.unwrapped.mission)
    assert policy.answer.solved
    assert backing(policy.answer.plan.path) < 0.3
    env.close()


def test_a_search_in_vain_leaves_the_clearance_of_the_path_that_is_kept():
    _, policy = begun(goal=(9.0, 0.0), width=3.0)
    found, checked = policy.answer, []
    policy._surroundings.blocks_now = lambda path, clearance: checked.append(clearance)
    for receive in (policy._receive_plan, policy._receive_detour):
        receive(found._replace(plan=Plan(Status.EXHAUSTED), clearance=0.28))
        policy._detours.unchecked, policy._detours.pause = 1.0, 0.0
        policy.is_blocked()
    assert checked == [found.clearance] * 2 == [0.40] * 2


def test_backing_is_the_way_against_the_heading():
    path = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.0, 1.0), (0.4, 0.0, 0.0)]
    assert backing(path) == pytest.approx(0.6 * math.cos(1.0))
    assert backing([(0.0, 0.0), (1.0, 0.0)]) == 0.0


def test_a_path_beside_an_occupied_goal_ends_where_an_estimated_pose_arrives():
    assert planned.INSIDE * Task().tolerance < Task().tolerance - Task().arrival_margin


def name(row):
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
