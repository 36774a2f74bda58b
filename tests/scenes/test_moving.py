"""Laws of scenes where something moves: what is drawn has room, and settings mean what they say."""

import math

import cv2
import numpy as np
import pytest
import shapely
from scipy import ndimage
from scipy.spatial.distance import pdist

from agents.evaluation.compare import suite
from agents.evaluation.evaluate import without_labels
from tests.conftest import long_but
from tests.sim.worlds import wall_gaps
from wheelchair_gym import maps
from wheelchair_gym.actors import records
from wheelchair_gym.actors.records import door
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.geometry.outline import footprint_clearance
from wheelchair_gym.geometry.planar import path_length
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.scenes.arena import FOOTPRINT, WALL, Doorway, is_free_pose, passing_radius
from wheelchair_gym.scenes.crowd import leaves_that_let_pass
from wheelchair_gym.scenes.pedestrians import WALKING_RADIUS, free_area
from wheelchair_gym.scenes.raster import CELL
from wheelchair_gym.scenes.statistics import scene_statistics
from wheelchair_gym.types import Episode

RADIUS = passing_radius(FOOTPRINT)


def drawn(count=8, first=0, **spec):
    scene = make_scene(spec)
    return [scene.sample(np.random.default_rng(first + k)) for k in range(count)]


def test_no_leaf_stands_open_across_the_only_way():
    """The chair starts in a nook whose opening a leaf would close."""
    cells = np.full((60, 100), maps.FREE, np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = (maps.OCCUPIED,) * 4
    cells[22:24, :40] = cells[:24, 38:40] = maps.OCCUPIED  # a nook 1.0 m high, x 0.1 to 1.9 m,
    cells[2:22, 38:40] = maps.FREE  # open to the right
    grid = maps.OccupancyGrid(cells, 0.05, (0.0, 0.0, 0.0))
    episode = Episode(grid, np.array([0.9, 0.6, 0.0]), np.array([4.0, 2.0, 0.0]))
    across = door((2.1, 0.1), 0.0, 1.0, 0.5 * math.pi, near=3.0)
    beside = door((3.0, 1.5), 0.0, 0.5, 0.5 * math.pi, near=3.0)
    for leaves in ([across, beside], [beside]):
        assert [one is beside for one in leaves_that_let_pass(leaves, episode, 0.3)] == [True]


def test_a_crowd_begins_apart_from_the_chair_and_from_everything():
    doors = people = 0
    for episode in drawn(leaf_share=0.7, name="crowd", furniture_density=0.03):
        rows = episode.actors.rows
        discs, _ = records.actor_shapes(episode.actors, rows["pose"])
        round_ones = rows[rows["size"][:, 1] == 0.0]
        assert len(discs) == len(round_ones)
        for k, (x, y, radius) in enumerate(discs):
            gaps = np.hypot(discs[:, 0] - x, discs[:, 1] - y) - discs[:, 2] - radius
            assert np.delete(gaps, k).min(initial=1.0) > 0.0
        assert (wall_gaps(discs[:, :2], episode.walls) > discs[:, 2]).all()
        for row in rows[rows["kind"] == records.PERSON]:
            assert math.dist(row["pose"][:2], episode.start[:2]) >= 2.0
        for row in rows[rows["kind"] == records.FURNITURE]:
            corners = records.actor_outline(row, *row["pose"])
            gap = episode.map.distance()[tuple(episode.map.to_cell(corners).T)]
            assert gap.min() > 2 * FOOTPRINT.half_width - 0.2  # the chair gets past
            assert math.dist(row["pose"][:2], episode.goal[:2]) >= 1.1  # and to its goal
        doors += (rows["kind"] == records.DOOR).sum()
        people += (rows["kind"] == records.PERSON).sum()
    assert doors >= 5
    assert people >= 20


def test_people_walk_ways_that_keep_off_walls():
    for episode in drawn(name="crowd", people={"crossing_share": 0.3}):
        rows = episode.actors.rows
        free = episode.map.distance()
        for k in np.flatnonzero(rows["kind"] == records.PERSON):
            route = episode.actors.route(int(k))
            assert path_length(route) >= 3.0 - 0.2
            dense = shapely.segmentize(shapely.LineString(route), 0.05)
            cells = episode.map.to_cell(shapely.get_coordinates(dense))
            # A step may lead across a cell's corner.
            assert free[tuple(cells.T)].min() > WALKING_RADIUS - 0.11
            np.testing.assert_array_equal(rows["pose"][k, :2], route[0])


def test_leaves_shut_their_doorways_and_open_them_fully():
    """Shut, a leaf spans from wall to wall; open, a slid one is inside the wall."""
    slid = swung = 0
    scene = make_scene({"name": "crowd", "place": "building", "leaf_share": 1.0})
    for seed in range(8):
        layout, episode = scene.sample_building(np.random.default_rng(seed))
        for row in episode.actors.rows[episode.actors.rows["kind"] == records.DOOR]:
            ends = records.leaf_line(row, *row["pose"])
            assert (wall_gaps(ends, episode.walls) < 1e-6).all()
            x, y, heading = row["pose"]
            if row["swings"]:
                swung += 1
                assert abs(row["travel"]) == pytest.approx(math.pi / 2)
                tip = records.leaf_line(row, x, y, heading + row["travel"])[1] / CELL
                for x0, y0, x1, y1 in layout.corridors:  # it would bar that
                    assert not (x0 < tip[0] < x1 and y0 < tip[1] < y1)
            else:
                slid += 1
                c, s = math.cos(heading), math.sin(heading)
                open_ends = records.leaf_line(
                    row, x + c * row["travel"], y + s * row["travel"], heading
                )
                shares = np.linspace(0.02, 0.98, 20)[:, None]
                inside = open_ends[0] + shares * np.diff(open_ends, axis=0)
                assert (episode.map.cells[tuple(episode.map.to_cell(inside).T)] == 100).all()
    assert min(slid, swung) >= 2


@pytest.mark.long
@pytest.mark.parametrize("name", ["corridor", "crossing", "lift", "lobby"])
def test_suites_among_people_can_be_solved(name):
    """A free way, closed walls, and people who begin and walk clear of walls and of the chair."""
    for spec in (without_labels(scene) for scene in suite(name).scenes):
        for episode in drawn(3, **spec) + drawn(3, 1_000_000, **spec):
            free = maps.geodesic(episode.map, episode.goal[:2], RADIUS)
            assert math.isfinite(free.at(episode.start[:2]))
            ends = episode.start, episode.goal, FOOTPRINT
            assert maps.footprint_margin(episode.walls, episode.discs, *ends) > 0.0
            for pose in ends[:2]:
                assert is_free_pose(pose, episode.walls, episode.discs, FOOTPRINT, 0.15)
            rows = episode.actors.rows
            assert len(rows) >= 1
            assert (rows["kind"] == records.PERSON).all()
            places = rows["pose"][:, :2]
            assert (np.hypot(*(places - episode.start[:2]).T) >= 2.0).all()
            assert (wall_gaps(places, episode.walls) > 0.25).all()
            assert (pdist(places) > 0.5).all()

            # Nobody gets out: the border of the map is solid, and walls are closed lines.
            rim = np.ones(episode.map.shape, bool)
            rim[1:-1, 1:-1] = False
            assert (episode.map.cells[rim] == maps.OCCUPIED).all()
            ends = np.round(episode.walls.reshape(-1, 2), 6)
            assert (np.unique(ends, axis=0, return_counts=True)[1] % 2 == 0).all()
            regions, count = ndimage.label(episode.map.cells == maps.FREE)
            assert count == 1
            inside = episode.map.to_cell(np.vstack([places, episode.actors.routes]))
            assert (regions[tuple(inside.T)] == 1).all()


def test_people_of_passages_walk_both_ways_through_them():
    directions = []
    for episode in drawn(8, name="crowd", place="corridor", people={"density": (0.1, 0.1)}):
        for k, row in enumerate(episode.actors.rows[episode.actors.rows["kind"] == records.PERSON]):
            route = episode.actors.route(k)
            assert path_length(route) >= 14.0 - 2 * 0.6 - 1e-9
            assert route[0, 1] == route[1, 1] == row["pose"][1]  # on their own lane
            directions.append(np.sign(route[0, 0] - row["pose"][0]))
    assert 0.25 < np.mean(np.array(directions) > 0.0) < 0.75


def test_people_come_out_of_a_lift_and_stay_out():
    """The chair waits: people inside walk out by the door, past it, and do not return."""
    scene = {"name": "crowd", "place": "lift", "people": {"density": (0.6, 0.6)}}
    for seed in range(3):
        env = NavigationEnv(scene, pose_source="truth", bank=0, split="test")
        env.reset(seed=seed)
        low = 2.0 * env.episode.start[1] + WALL  # where the cabin begins
        people = env.episode.actors.rows["kind"] == records.PERSON
        assert people.any()
        for step in range(200):
            env.step(np.zeros(2, np.float32))
            inside = env.chair.truth.actor_poses[people, 1] > low
            assert inside.all() or step > 0
            assert not inside.any() or step < 120
        env.close()


def test_numbers_of_people_follow_their_density():
    for density in ((0.0, 0.0), (0.05, 0.05)):
        for episode in drawn(4, name="crowd", people={"density": density}):
            expected = density[0] * free_area(episode.map)
            kinds = episode.actors.rows["kind"]
            assert (kinds == records.PERSON).sum() == pytest.approx(
                expected, abs=0.2 * expected + 0.5
            )
    for episode in drawn(3, name="crowd", place="hall", people={"crossing_share": 1.0}):
        rows = episode.actors.rows
        assert (rows["avoids"][rows["kind"] == records.PERSON] == records.NOBODY).all()


def test_the_scene_of_all_people_has_every_kind_in_each_episode():
    for episode in drawn(12, name="people"):
        rows = episode.actors.rows
        people = rows[rows["kind"] == records.PERSON]
        assert set(people["behaviour"]) == set(range(len(records.BEHAVIOURS)))
        assert set(people["reaction"]) == set(range(len(records.REACTIONS)))
        assert (people["leader"] > 0).any()
        assert (rows["leader"][rows["kind"] == records.FURNITURE] == 1).any()
        for k in np.flatnonzero(rows["leader"] > 0):
            leader = rows[k - rows["leader"][k]]
            assert leader["kind"] == records.PERSON
            assert math.dist(rows["pose"][k, :2], leader["pose"][:2]) == pytest.approx(
                np.hypot(*rows["offset"][k])
            )
        assert (wall_gaps(rows["pose"][:, :2], episode.walls) > 0.2).all()


def test_who_walks_without_a_trolley_weighs_what_a_person_does():
    pushing = {"density": (0.6, 0.6), "behaviours": {"trolleys": 1.0}}
    alone = 0
    for episode in drawn(10, name="crowd", place="lift", people=pushing):
        rows = episode.actors.rows
        pushes = np.append(rows["leader"][1:] == 1, False)
        people = rows["kind"] == records.PERSON
        assert (rows["mass"][people] == np.where(pushes[people], 95.0, 75.0)).all()
        alone += (people & ~pushes).sum()
    assert alone


def test_shares_are_spread_evenly():
    shares = {"pauses": 0.25, "children": 0.25}
    for episode in drawn(6, name="crowd", place="hall", people={"behaviours": shares}):
        people = episode.actors.rows[episode.actors.rows["kind"] == records.PERSON]
        for behaviour in ("pauses", "runs"):
            count = (people["behaviour"] == records.BEHAVIOURS.index(behaviour)).sum()
            assert abs(count - 0.25 * len(people)) <= 1.0


def test_what_appears_lies_on_the_way():
    count = 0
    for episode in drawn(name="temporary"):
        path = maps.geodesic(episode.map, episode.goal[:2], RADIUS).path(episode.start[:2])
        for row in episode.actors.rows:
            assert row["kind"] == records.OBSTACLE
            gap = shapely.distance(shapely.LineString(path), shapely.Point(row["pose"][:2]))
            assert gap <= 0.15 * math.sqrt(2) + 1e-9
            assert row["minimum"] >= 1.2
            assert row["near"] > row["minimum"]
            count += 1
    assert count >= 8


@pytest.mark.parametrize("door", [1.00, 0.95, 0.90, 0.85, 0.80])
@pytest.mark.parametrize("corridor", [1.20, 1.05, 0.90])
def test_a_doorway_is_as_wide_as_it_says(door, corridor):
    for episode in drawn(4, name="doorway", door_width=door, corridor_width=corridor):
        wide = 2 * maps.bottleneck(episode.map, episode.start[:2], episode.goal[:2])
        # The way ends in the corridor's middle, which the start is in: the door and that count.
        assert wide == pytest.approx(min(door, corridor), abs=0.051)
        assert footprint_clearance(
            *episode.start, FOOTPRINT.array, episode.walls, episode.discs, 1.0
        ) == pytest.approx(0.5 * corridor - FOOTPRINT.half_width, abs=1e-9)
    label = f"door {door:.2f} corridor {corridor:.2f} margin"
    assert sum(scene["label"].startswith(label) for scene in suite("doors").scenes) == 1


def turns(door, corridor, grown):
    """Return True if the grown footprint gets into the room: a flood of poses on 1 cm."""
    cell, across = 0.01, 0.5 * door
    x, y = np.meshgrid(np.arange(-1.3, 1.3, cell), np.arange(0.0, corridor + 1.4, cell))
    solid = (y > corridor) & (y < corridor + 0.1) & (np.abs(x) > across)
    solid = np.pad(solid, 150, constant_values=False).astype(np.float32)
    solid[:150] = 1  # the far wall
    free = []
    half = np.array([0.5 * (FOOTPRINT.front + FOOTPRINT.rear), FOOTPRINT.half_width]) + grown
    at = np.arange(-75, 76) * cell
    u, v = np.meshgrid(at, at)
    for yaw in np.radians(np.arange(0.0, 91.0, 1.5)):
        c, s = math.cos(yaw), math.sin(yaw)
        inside = (np.abs(c * u + s * v) <= half[0]) & (np.abs(c * v - s * u) <= half[1])
        # Of as many cells, faster than cv2.dilate: by Fourier transforms.
        hit = cv2.filter2D(solid, -1, inside.astype(np.float32), borderType=cv2.BORDER_CONSTANT)
        free.append(hit[150:-150, 150:-150] < 0.5)
    free = np.array(free)
    found, _ = ndimage.label(free, ndimage.generate_binary_structure(3, 2))
    middle = x.shape[1] // 2
    low, high = round(0.5 * corridor / cell), free.shape[1] - 15
    begin, end = found[0, low, 5], found[-1, high, middle]
    return bool(begin > 0 and begin == end)


@pytest.mark.parametrize(
    ("door", "corridor"),
    long_but(
        [(1.0, 1.2), (0.85, 0.9), (0.8, 0.8), (0.7, 1.3), (0.95, 1.0)], [(0.85, 0.9), (0.7, 1.3)]
    ),
)
def test_the_margin_round_a_corner_is_what_a_flood_of_poses_finds(door, corridor):
    margin = Doorway(door_width=door, corridor_width=corridor).margin()
    assert margin < 0.5 * min(door, corridor) - FOOTPRINT.half_width
    assert turns(door, corridor, margin - 0.015)
    assert not turns(door, corridor, margin + 0.015)


def test_distributions_tell_how_wide_the_ways_are_and_what_moves():
    figures = scene_statistics(make_scene("floor_plan"), range(3))
    assert {"door width [m]", "corridor width [m]", "density"} <= figures.keys()
    assert min(figures["bottleneck margin [m]"]) > 0.1
    figures = scene_statistics(make_scene("crowd"), range(6))
    for name in ("people", "people per free m2", "walking speed [m/s]", "density"):
        assert len(figures[name]) >= 6
    assert "obstacles that appear" not in figures
    assert "stay of these [s]" in scene_statistics(make_scene("temporary"), range(2))
    found = scene_statistics(make_scene("doorway"), range(2))["margin round the corner [m]"]
    assert found == pytest.approx([Doorway().margin()] * 2)
    assert "people" not in scene_statistics(make_scene("clutter"), range(1))
    assert scene_statistics(make_scene({"name": "skill", "course": "people"}), [0])["people"] == [3]
    mixed = {"name": "mixture", "scenes": ["mixture", "floor_plan"], "weights": [0.0, 1.0]}
    assert scene_statistics(make_scene(mixed), range(2))["door width [m]"]
    figures = scene_statistics(make_scene("people"), range(4))
    for name in ("people in groups", "trolleys", "people: reads phone", "people: wary"):
        assert min(figures[name]) >= 1
