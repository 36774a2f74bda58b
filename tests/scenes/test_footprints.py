"""Laws of every scene for chairs of every size."""

import pytest
import shapely

from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs.settings import EnvSettings, env_settings
from wheelchair_gym.envs.world_banks import WorldBank
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.scenes import SCENES
from wheelchair_gym.scenes.raster import CELL
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.task.task import Task

CHAIRS = {
    "default": Footprint(),
    "child": Footprint(0.55, 0.25, 0.25),
    "bariatric": Footprint(0.80, 0.40, 0.42),
    "scooter": Footprint(0.95, 0.30, 0.29),
    "stretcher": Footprint(1.40, 0.70, 0.65),
}


def worlds(scene, footprint):
    own = EnvSettings(scene=scene, chair=ChairSettings(footprint=footprint))
    return WorldBank(own, Task(own.task, own.chair, own.sensors, 0.1), "test")


def solid(walls, discs):
    round_ones = [shapely.Point(x, y).buffer(r, 64) for x, y, r in discs]
    return [*shapely.linestrings(walls.reshape(-1, 2, 2)), *round_ones]


@pytest.mark.parametrize("name", CHAIRS)
@pytest.mark.parametrize("scene", sorted(SCENES))
def test_worlds_are_made_for_the_chair_or_refused(scene, name):
    footprint = CHAIRS[name]
    made = worlds(scene, footprint)
    for seed in range(2):
        course = refused = None
        try:
            course = made.episode(seed, 0)
        except InputError as error:
            refused = str(error)
        if course is None:
            assert name == "stretcher"
            assert str(footprint) in refused
            return
        episode = course.episode
        stands = shapely.Polygon(to_world(footprint.corners, episode.start))
        things = solid(episode.walls, episode.discs)
        assert not shapely.intersects(stands, things).any()
        way = shapely.LineString(course.geodesic.path(episode.start[:2]))
        gap = shapely.distance(way, things).min()
        # Ways join centres of cells, and a cell is solid whose centre is.
        assert gap > footprint.half_width - 1.5 * CELL


def test_a_start_in_a_wall_and_a_way_through_one_are_refused():
    tight = {"name": "doorway", "door_width": 0.8, "corridor_width": 0.9}
    with pytest.raises(InputError, match="does not turn from a corridor"):
        worlds(tight, Footprint(0.7, 0.3, 0.39)).episode(0, 0)
    with pytest.raises(
        InputError, match=r"thesis_3: .* does not pass from start to goal; .* 1\.\d"
    ):
        worlds("thesis_3", Footprint(0.9, 0.6, 0.8)).episode(0, 0)
    with pytest.raises(InputError, match="none of 200 worlds"):
        worlds("barn", Footprint(half_width=2.6)).episode(0, 0)
    with pytest.raises(InputError, match="does not fit at the start"):
        worlds("chaotic_pso", Footprint(1.4, 1.1, 0.4)).episode(0, 0)


def test_sensors_outside_the_outline_and_ultrasonics_behind_it_are_warned_of():
    for front, half_width, told in (
        (0.5, 0.31, r"laser at \(0\.66, 0\), ultrasonic 0 at \(0\.7, 0\.12\)"),
        (0.7, 0.4, r"ultrasonic 7 at \(0\.4, -0\.31\)"),
    ):
        footprint = {"front": front, "rear": 0.3, "half_width": half_width}
        with pytest.warns(UserWarning, match=told):
            env_settings({"chair": {"footprint": footprint}})
    lasers = [{"x": -0.5, "beams": 181}]
    with pytest.warns(UserWarning, match=r"more_lasers\[0\] at \(-0.5, 0\)") as caught:
        env_settings({"sensors": {"more_lasers": lasers}})
    assert "laser at" not in str(caught[0].message)
    env_settings(None)  # warns of nothing: warnings of our own code are errors here
