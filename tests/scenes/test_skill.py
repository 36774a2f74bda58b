"""Laws of the courses of driving skills: each can be driven, and widths are those stated."""

import dataclasses
import json
import math
import re

import numpy as np
import pytest

from planners import make_planner
from planners.collision.space import Space
from planners.judge import plan_faults
from planners.problem import Problem, Status
from tests.scenes.test_footprints import CHAIRS
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.geometry.planar import compose
from wheelchair_gym.maps import bottleneck
from wheelchair_gym.recording.topics import EPISODE, FIELDS
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.scenes.arena import FOOTPRINT, is_free_pose
from wheelchair_gym.scenes.skill import COURSES
from wheelchair_gym.task.rewards import reached_pose
from wheelchair_gym.types import Arrival, Episode

SEEDS = range(4)


def drawn(course, seed, footprint=FOOTPRINT):
    scene = make_scene({"name": "skill", "course": course})
    return scene.sample(np.random.default_rng(seed), footprint)


@pytest.mark.parametrize("course", COURSES)
def test_the_chair_can_drive_each_course(course):
    """The exact lattice planner finds a way of the outline to the goal's pose."""
    for seed in SEEDS:
        episode = drawn(course, seed)
        space = Space.from_map(episode.map, episode.walls, episode.discs)
        problem = Problem(space, episode.start, episode.goal, FOOTPRINT.half_width)
        plan = make_planner("lattice").plan(problem, np.random.default_rng(0))
        assert plan.status is Status.SOLVED
        assert not plan_faults(plan, problem, FOOTPRINT)


@pytest.mark.parametrize("course", COURSES)
def test_other_seeds_give_other_courses(course):
    starts = np.array([drawn(course, seed).start for seed in range(8)])
    assert len(np.unique(starts, axis=0)) == 8
    # Every drawn start lies within the stated offsets, on either side.
    given = COURSES[course]
    off = np.abs(np.abs(starts[:, 1]) - abs(given.start[1]))
    assert (off <= math.hypot(*given.around[:2]) + 1e-9).all()


@pytest.mark.parametrize(
    ("course", "width"),
    [("door_100", 1.0), ("door_90", 0.9), ("door_80", 0.8), ("door_80_oblique", 0.8),
     ("corner_120", 1.2), ("corner_100", 1.0), ("corner_90", 0.9), ("lift", 0.9)],
)  # fmt: skip
def test_the_narrowest_place_is_as_wide_as_stated(course, width):
    assert re.search(f"{width:.2f} m", COURSES[course].dimensions)
    for seed in SEEDS:
        episode = drawn(course, seed)
        found = 2.0 * bottleneck(episode.map, episode.start[:2], episode.goal[:2])
        assert width - 0.11 < found < width + 0.01  # centres of cells of 5 cm


def test_courses_are_mirrored_and_lengths_differ():
    goals = np.array([drawn("corner_90", seed).goal for seed in range(20)])
    assert {-1, 1} == set(np.sign(goals[:, 1]).astype(int))
    assert len(np.unique(np.round(goals[:, 0], 3))) > 3


@pytest.mark.parametrize("name", CHAIRS)
@pytest.mark.parametrize("course", COURSES)
def test_other_chairs_stand_free_or_are_refused_in_one_line(course, name):
    refused = ""
    try:
        episode = drawn(course, 0, CHAIRS[name])
    except InputError as error:
        refused = str(error)
    if refused:
        assert name not in ("default", "child")
        assert str(CHAIRS[name]) in refused
        return
    for pose in (episode.start, episode.goal):
        assert is_free_pose(pose, episode.walls, episode.discs, CHAIRS[name], 0.0)


def test_a_docked_chair_of_any_length_is_as_near_the_desk():
    for name in ("default", "child", "scooter"):
        outline, episode = CHAIRS[name], drawn("dock", 1, CHAIRS[name])
        desk = 3.5 + (episode.map.bounds[2] - 0.1 - 4.5)
        assert desk - (episode.goal[0] + outline.front) == pytest.approx(0.1)


ARRIVAL = Arrival(0.05, 0.10, math.radians(5.0), 0.1)


@pytest.mark.parametrize(
    ("pose", "speed", "less", "arrives"),
    [
        ((0.04, 0.09, 0.08), 0.09, 0.0, True),
        ((0.06, 0.0, 0.0), 0.0, 0.0, False),
        ((0.0, -0.11, 0.0), 0.0, 0.0, False),
        ((0.0, 0.0, -0.09), 0.0, 0.0, False),
        ((0.0, 0.0, 0.0), -0.11, 0.0, False),
        ((0.0, 0.08, 0.0), 0.0, 0.03, False),
        ((0.02, 0.04, 0.0), 0.0, 9.0, True),  # half the tolerance is left
        ((0.03, 0.0, 0.0), 0.0, 9.0, False),
    ],
)
@pytest.mark.parametrize("turn", [0.0, 1.0, math.pi])
def test_a_chair_has_arrived_within_the_rectangle_slowly_and_in_line(
    pose, speed, less, arrives, turn
):
    goal = np.array([3.0, -2.0, turn])
    assert reached_pose(compose(goal, pose), speed, goal, np.array(ARRIVAL), less) == arrives


def test_recordings_keep_the_arrival():
    kind, episode = FIELDS[EPISODE]["arrival"], drawn("dock", 0)
    stored = json.loads(json.dumps(kind.write(episode.arrival)))
    again = Episode(episode.map, episode.start, episode.goal, arrival=kind.read(stored))
    assert again.arrival == episode.arrival == ARRIVAL
    assert kind.write(None) is kind.read(None) is None


def test_a_skill_without_a_person_gets_the_pose_and_must_reach_it():
    env = NavigationEnv({"name": "skill", "course": "dock"}, beams=64, split="test")
    env.reset(seed=0)
    assert env.mission.goal.shape == (3,)
    assert env.mission.tolerance == 0.05
    docked = env.episode.goal
    for away, arrives in ((0.0, True), (0.12, False)):
        start = docked + np.array([0.0, 0.0, away])
        episode = dataclasses.replace(env.episode, start=start)
        env.reset(options={"episode": episode})
        *_, terminated, _, info = env.step(np.zeros(2))
        assert (terminated, info["is_success"]) == (arrives, arrives)
