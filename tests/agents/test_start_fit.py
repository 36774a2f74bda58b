"""Laws of the check of a start: true starts pass, those that are far off are refused."""

import itertools
import math

import numpy as np
import pytest

from agents.deploy import _preselected, check_start, start_fit
from tests.benchmarks.starts import beside
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.geometry.planar import wrap
from wheelchair_gym.perception.monte_carlo import make_likelihood_field
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair

LASER = SensorSettings().laser
SCENES = ("floor_plan", "clutter", "crowd", "doorway", "empty", "temporary", "map_file")


def fits(scene, seed, way, turn):
    """Fit a scan to a start that is off by a distance [m] and a turn [rad], in a free direction."""
    episode = make_scene(scene).sample(np.random.default_rng(1000 + seed))
    ranges, rng = SimulatedChair().reset(episode, seed).laser, np.random.default_rng(seed)
    start = beside(episode.map, episode.start, way, turn, rng)
    return start_fit(episode.map, start, LASER, ranges)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("off", [(0.0, 0.0), (0.1, math.radians(3.0)), (0.25, math.radians(-8.0))])
def test_a_true_start_passes_with_its_usual_error(scene, off):
    found = fits(scene, 3, *off)
    assert found.wrong == ""
    assert found.fit > 0.6
    assert found.ambiguous == (scene == "empty")  # others have no twin place


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("off", [(1.5, 0.0), (0.0, 0.5 * math.pi), (1.5, -0.5 * math.pi)])
def test_a_start_far_off_is_refused_and_the_right_one_named(scene, off):
    found = fits(scene, 3, *off)
    assert "it fits" in found.wrong
    assert found.better > found.fit + 0.15


def test_a_laser_that_sees_nothing_is_refused():
    episode = make_scene("empty").sample(np.random.default_rng(0))
    blind = np.full(LASER.beams, np.inf, np.float32)
    assert "0% of the laser's beams" in start_fit(episode.map, episode.start, LASER, blind).wrong


def test_the_twin_places_of_a_symmetric_room_are_told_and_have_to_be_confirmed():
    env, told = NavigationEnv("empty"), []
    env.reset(seed=0)
    grid, start = env.episode.map, env.episode.start
    middle = grid.from_lattice(0.5 * np.array(grid.shape[::-1]))
    twin = np.array([*(2.0 * middle - start[:2]), start[2] + math.pi])
    for given, other in ((start, twin), (twin, start)):
        found = start_fit(grid, given, LASER, env.task.reading.laser)
        assert found.ambiguous
        assert np.hypot(*(found.elsewhere - other)[:2]) < 0.1
        assert abs(wrap(found.elsewhere[2] - other[2])) < 0.05
        with pytest.raises(InputError, match=r"cannot tell these places apart.*--force-start"):
            check_start(env, given, False, told.append)
        check_start(env, given, True, told.append)
        assert "driven all the same" in told[-1]


def test_the_places_compared_with_a_start_outside_the_map_are_apart():
    grid = make_scene("floor_plan").sample(np.random.default_rng(0)).map
    field = make_likelihood_field(grid, 0.1)
    found = _preselected(grid, field, np.array([900.0, 0.0, 0.0]), np.eye(2))
    for one, other in itertools.combinations(found, 2):
        turn = math.degrees(abs(wrap(one[2] - other[2])))
        assert math.dist(one[:2], other[:2]) >= 1.0 or turn >= 29.9
