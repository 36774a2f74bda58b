"""Exact tracking of plans where they turn close to obstacles, with a chair on paper."""

import numpy as np
import pytest

from agents.control import make_follower
from agents.control.followers import Situation
from agents.control.local_map import LocalMap
from agents.control.rollout import ChairState, ReferencePath
from agents.policies.search import Search
from planners.problem import Plan, Status
from tests.agents.fakes import PaperWorld
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid


def box(length, width):
    """A map of a room about (0, 0), free within, with walls around."""
    rows, cols = round(width / 0.05) + 8, round(length / 0.05) + 8
    cells = np.full((rows, cols), OCCUPIED, np.int8)
    cells[4:-4, 4:-4] = FREE
    return OccupancyGrid(cells, 0.05, (-0.025 * cols, -0.025 * rows, 0.0))


def manoeuvre(begin, stretches):
    """Poses (n, 3) of stretches (way [m], turn [rad]) from a pose on, some 4 cm apart."""
    poses = [np.array(begin)]
    for way, turn in stretches:
        steps = max(1, round(max(abs(way), 0.4 * abs(turn)) / 0.04))
        for _ in range(steps):
            poses.append(np.array(arc_step(*poses[-1], way / steps, turn / steps, 1.0)))
    return np.array(poses)


def driven(path, room, seconds, follower, actors=None):
    """Poses (n, 3) of a chair that follows a path from its first pose on, among actors."""
    world = PaperWorld(room, path[0], path[-1])
    local_map = LocalMap(world.mission)
    chair = ChairState(world.mission.limits, world.mission.footprint, world.mission.period)
    reference, follower = ReferencePath(path, path[0]), make_follower(follower).make()
    poses = [world.pose]
    while world.time < seconds and not reference.ended:
        local_map.update(world.seen)
        if actors is not None:
            local_map.actors = actors
        reference.advance(local_map.pose)
        twist = follower.twist(Situation(local_map, reference, chair))
        twist = np.zeros(2) if twist is None else twist
        chair.command(twist)
        world.drive(twist / (world.mission.limits.forward, world.mission.limits.turn))
        poses.append(world.pose)
    return np.array(poses)


# Ahead, a quarter turn in place, back, and ahead round a bend.
ROOM = box(3.4, 1.5)
PATH = manoeuvre((-0.8, 0.0, 0.0), [(0.4, 0.0), (0.0, -0.7), (-0.2, 0.3), (0.0, 0.4), (0.7, 0.0)])


FOLLOWERS = pytest.mark.parametrize("name", ["window", "whales"])


@FOLLOWERS
def test_a_manoeuvre_close_to_walls_is_driven_as_planned(name):
    poses = driven(PATH, ROOM, 20.0, {"name": name})
    turned = int(poses[:, 2].argmin())
    back = turned + int(poses[turned:, 0].argmin())  # from there on it has room
    off = np.hypot(*(poses[:back, None, :2] - PATH[None, :, :2]).T).min(axis=0)
    assert off.max() < 0.025  # 2 cm of which lie between two poses
    # Each stretch is driven to its end before the next one begins.
    assert poses[turned, 2] == pytest.approx(PATH[:, 2].min(), abs=0.06)
    place = PATH[PATH[:, 2].argmin()]
    assert poses[turned, :2] == pytest.approx(place[:2], abs=0.03)
    assert poses[back, 0] == pytest.approx(PATH[PATH[:, 2].argmin() :, 0].min(), abs=0.05)


@FOLLOWERS
def test_what_has_room_is_left_to_the_follower(name, monkeypatch):
    def begun(room, tight):
        monkeypatch.setattr("agents.control.tight_places.TIGHT", tight)
        return driven(PATH, room, 3.0, {"name": name})

    wide = box(8.0, 6.0)
    assert np.array_equal(begun(wide, 0.1), begun(wide, 0.0))
    assert not np.array_equal(begun(ROOM, 0.1), begun(ROOM, 0.0))


class UpTo:
    """A planner that finds a way up to a clearance."""

    def __init__(self, widest):
        self.widest, self.asked = widest, []

    def plan(self, problem, rng, **_):
        self.asked.append(round(problem.clearance, 3))
        found = problem.clearance <= self.widest
        path = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]) if found else np.empty((0, 3))
        return Plan(Status.SOLVED if found else Status.EXHAUSTED, path)


@pytest.mark.parametrize(("widest", "got"), [(0.5, 0.4), (0.37, 0.36), (0.345, 0.34), (0.33, 0.32)])
def test_the_widest_plan_is_sought_by_half_steps_where_little_is_left(widest, got):
    planner, rng = UpTo(widest), np.random.default_rng(0)
    search = Search(planner, 0.40, 0.28, rng, np.zeros(3), [])
    _, clearance = search.widest(box(4.0, 2.0), np.array([1.0, 0.0]), np.inf)
    assert clearance == pytest.approx(got)
