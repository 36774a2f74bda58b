"""Laws of localisation: scans fit where they were taken; a chair finds itself, and again."""

import math
from dataclasses import replace
from itertools import islice, pairwise

import gymnasium as gym
import numpy as np
import pytest

from agents.policies import GymPolicy, make_policy
from tests.agents.fakes import infos_of
from tests.conftest import at_start
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.geometry.planar import to_world, wrap, wrap_angle
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.perception.localized_chair import LocalizedChair
from wheelchair_gym.perception.monte_carlo import (
    LocalizationSettings,
    MonteCarloLocalizer,
    log_likelihood,
    make_likelihood_field,
)
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair

NAVIGATION = "wheelchair_gym/Navigation-v1"
PLANNED = "visibility+window"
LASER = SensorSettings().laser


def navigation(**settings):
    return gym.make(NAVIGATION, disable_env_checker=True, **settings, split="test")


def off(estimate, pose):
    """Return the error of an estimate: [m] and [rad]."""
    return np.hypot(*(estimate - pose)[:2]), abs(wrap(estimate[2] - pose[2]))


@pytest.fixture(scope="module")
def home():
    return make_scene("floor_plan").sample(np.random.default_rng((3, 0)))


def scan(episode, pose):
    """An exact scan (beams,) from a pose, and its ends in the chair's frame."""
    chair = SimulatedChair(sensors=SensorSettings(noise=False))
    ranges = chair.reset(replace(episode, start=np.asarray(pose, float)), 0).laser
    met = np.isfinite(ranges)
    return ranges, (LASER.x, LASER.y) + ranges[met, None] * LASER.directions[met]


@pytest.mark.parametrize("turned", [0.0, 0.7])
def test_a_scan_fits_best_where_it_was_taken(home, turned):
    """Also when the map, and the pose with it, is turned."""
    rng = np.random.default_rng(0)
    grid = home.map
    x, y, _ = grid.origin
    place = np.array([*to_world([x, y], (1.0, -2.0, turned)), turned])
    field = make_likelihood_field(OccupancyGrid(grid.cells, grid.resolution, tuple(place)), 0.06)
    _, ends = scan(home, home.start)

    def fit(pose):
        there = [*to_world(pose[:2], (1.0, -2.0, turned)), pose[2] + turned]
        return math.exp(log_likelihood(field, *there, ends))

    best = fit(home.start)
    assert best > 0.97
    for _ in range(50):
        aside = rng.normal(0.0, (0.2, 0.2, 0.1))
        assert fit(home.start + aside) < best - 1e-3


def test_a_chair_knows_where_it_is():
    """Full noise, floor plans, from its own pose: RMS below 5 cm and 1.5 degrees, p99 15 cm."""
    env, errors = navigation(pose_source="mcl"), []
    for seed in range(3):
        env.reset(seed=seed)
        errors += [off(info["pose_estimate"], info["pose"]) for info in infos_of(env, PLANNED)]
    metres, radians = np.array(errors).T
    assert len(metres) > 300
    assert np.sqrt((metres**2).mean()) < 0.05
    assert np.degrees(np.sqrt((radians**2).mean())) < 1.5
    assert np.quantile(metres, 0.99) < 0.15


def test_what_no_map_shows_leads_nobody_astray(home):
    cells = np.argwhere(home.map.traversable(0.9))
    rng = np.random.default_rng(1)
    discs = [(*home.map.to_world(cells[k]), 0.2) for k in rng.permutation(len(cells))]
    env = at_start(navigation(pose_source="mcl"), None, options={"episode": home})
    path = GymPolicy(make_policy(PLANNED), env)
    path.reset()
    path.act(env.unwrapped.task.observation)
    way = env.unwrapped.shown.path
    ends = [np.linspace(a, b, 50) for a, b in pairwise(way)]
    aside = [d for d in discs if np.hypot(*(np.vstack(ends) - d[:2]).T).min() > 1.1]
    env.reset(seed=0, options={"episode": replace(home, discs=np.array(aside[:12]))})
    errors = [off(info["pose_estimate"], info["pose"])[0] for info in infos_of(env, PLANNED)]
    assert len(errors) > 50
    assert np.quantile(errors, 0.99) < 0.10


def test_a_crowd_is_no_sign_of_being_lost():
    """People hide most walls for seconds on end."""
    env, errors = navigation(scene="crowd", pose_source="mcl"), []
    for seed in (3, 5):  # both were lost when people counted as bad fit
        env.reset(seed=seed)
        for info in infos_of(env, PLANNED):
            errors.append(off(info["pose_estimate"], info["pose"])[0])
            assert not env.unwrapped.chair.localizer.lost
    assert len(errors) > 150
    assert max(errors) < 0.10


LATER = [pytest.param(seed, marks=pytest.mark.long) for seed in range(5, 20)]


@pytest.mark.parametrize("carried", [False, True])
@pytest.mark.parametrize("seed", [*range(5), *LATER])
def test_a_lost_chair_finds_itself(seed, carried):
    """Started anywhere, or carried from its start to its goal while it looks away."""
    env = at_start(navigation(pose_source="truth"), seed)
    task, episode = env.unwrapped.task, env.unwrapped.episode
    localiser = MonteCarloLocalizer(LocalizationSettings(), LASER)
    localiser.start(episode.map, episode.start if carried else None, seed)

    def errors(steps):
        for info in islice(infos_of(env, PLANNED), steps):
            v, w = task.reading.twist / 10.0
            moved = np.array([v * math.cos(0.5 * w), v * math.sin(0.5 * w), w])
            yield off(localiser.update(moved, task.reading.laser), info["pose"])

    if carried:
        assert max(metres for metres, _ in errors(20)) < 0.15
        back = replace(episode, start=episode.goal, goal=episode.start, tolerance=None)
        env.reset(options={"episode": back})
    metres, radians = np.array([*errors(60)][35:]).T  # after 3.5 s
    assert metres.max() < 0.15
    assert radians.max() < 0.05
    assert not localiser.lost
    assert localiser.count < 1000


def test_what_a_chair_believes_depends_on_its_key_alone(home):
    """Not on other chairs; another key gives other particles."""
    chairs = [
        LocalizedChair(SimulatedChair(), MonteCarloLocalizer(LocalizationSettings(), LASER))
        for _ in range(3)
    ]
    keys, poses = (5, 5, 6), []
    for chair, key in zip(chairs, keys, strict=True):
        chair.reset(home, key)
    for _ in range(20):
        poses.append([chair.drive(np.array([0.3, 0.1])).pose for chair in chairs])
    one, same, other = np.moveaxis(np.array(poses), 1, 0)
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()
    np.testing.assert_array_equal(chairs[0].localizer.poses, chairs[1].localizer.poses)


def test_a_silent_laser_leaves_dead_reckoning(home):
    localiser = MonteCarloLocalizer(LocalizationSettings(), LASER)
    localiser.start(home.map, home.start, 0)
    silent = np.full(LASER.beams, np.nan, np.float32)
    silent[::3], silent[1::3] = np.inf, -np.inf
    for _ in range(10):
        pose = localiser.update(np.array([0.05, 0.0, 0.0]), silent)
    ahead = home.start[:2] + 0.5 * np.array([np.cos(home.start[2]), np.sin(home.start[2])])
    assert np.hypot(*(pose[:2] - ahead)) < 0.05
    assert abs(wrap_angle(pose[2] - home.start[2])) < 0.05


def test_nowhere_to_be_is_an_error():
    solid = OccupancyGrid(np.full((4, 4), 100, np.int8), 0.05)
    with pytest.raises(ValueError, match="no free cell"):
        MonteCarloLocalizer(LocalizationSettings(), LASER).start(solid, np.zeros(3), 0)


def test_misuse_is_named_and_changes_nothing(home):
    localiser, seen = MonteCarloLocalizer(LocalizationSettings(), LASER), np.ones(LASER.beams)
    localiser.start(home.map, home.start, 0)
    for increment, ranges, said in (
        ([np.nan, 0.0, 0.0], seen, "three finite numbers"),
        ([0.0, 0.0], seen, "three finite numbers"),
        ([0.0, 0.0, 0.0], seen[:10], r"shape \(10,\)"),
    ):
        with pytest.raises(InputError, match=said):
            localiser.update(np.array(increment), ranges)
    assert np.isfinite(localiser.poses).all()
