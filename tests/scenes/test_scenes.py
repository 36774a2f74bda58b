"""Laws of every scene, over the whole registry."""

import math

import numpy as np
import pytest
import shapely
from PIL import Image

from tests.conftest import put
from tests.copies import COPIERS, differences
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled.random import numpy_integer, numpy_stream, numpy_uniform
from wheelchair_gym.geometry.outline import footprint_clearance
from wheelchair_gym.maps import FREE, OCCUPIED, bottleneck, geodesic
from wheelchair_gym.scenes import SCENES, make_scene
from wheelchair_gym.scenes.arena import FOOTPRINT, passing_radius
from wheelchair_gym.scenes.layout import JAMB, generate_layout
from wheelchair_gym.scenes.published import GREY_WOLF_GOALS

RADIUS = passing_radius(FOOTPRINT)

WORLDS = [
    {"world": 3, "start": [-2.0, 1.0, 1.57], "goal": [-2.0, 6.0], "circles": [[-2.0, 3.0, 0.2]]},
    {"world": 8, "start": [0.0, 1.0, 1.57], "goal": [0.0, 6.0], "circles": [[0.5, 3.0, 0.075]]},
]


@pytest.fixture(scope="session")
def worlds(tmp_path_factory):
    return put(tmp_path_factory.mktemp("barn") / "worlds.json", WORLDS)


@pytest.fixture(params=[*sorted(SCENES), "barn of a file"])
def scene(request, worlds):
    name, *of_a_file = request.param.split(" of ")
    return make_scene({"name": name, **({"path": str(worlds)} if of_a_file else {})})


def episodes(scene, count=4):
    return [scene.sample(np.random.default_rng(seed)) for seed in range(count)]


def test_start_and_goal_stand_free_and_a_way_joins_them(scene):
    for episode in episodes(scene):
        for pose in (episode.start, episode.goal):
            gap = footprint_clearance(*pose, FOOTPRINT.array, episode.walls, episode.discs, 1.0)
            assert gap > 0.05
            assert pose.shape == (3,)
            assert episode.map.inside(pose[:2])
        length = geodesic(episode.map, episode.goal, RADIUS).at(episode.start[:2])
        direct = math.dist(episode.start[:2], episode.goal[:2])
        assert direct - 0.1 <= length < math.inf


def test_the_same_generator_state_gives_the_same_episode_also_of_a_copy(scene):
    found = [
        [(vars(one) | {"map": one.map.cells}) for one in episodes(each, 2)]
        for each in (scene, scene, *(copied(scene) for copied in COPIERS))
    ]
    for other in found[1:]:
        assert not list(differences(found[0], other))


def test_walls_are_closed_loops_and_the_map_is_what_they_and_the_discs_say(scene):
    for episode in episodes(scene, 2):
        begins, ends = (np.rint(episode.walls[:, k : k + 2] * 1e6) for k in (0, 2))
        assert sorted(map(tuple, begins)) == sorted(map(tuple, ends))
        grid = episode.map
        centres = grid.to_world(np.argwhere(np.ones(grid.shape, dtype=bool)))
        sides = shapely.linestrings(episode.walls.reshape(-1, 2, 2))
        solid = shapely.contains_xy(shapely.build_area(shapely.multilinestrings(sides)), centres)
        spots, discs = shapely.points(centres), shapely.points(episode.discs[:, :2])
        rims = shapely.distance(spots[:, None], discs) - episode.discs[:, 2]
        solid |= (rims < 0.0).any(axis=1)
        occupied = (grid.cells == OCCUPIED).ravel()
        assert (occupied >= solid).all()  # nothing solid is missing
        # Round and turned things may take a cell more at their rims, never farther out.
        extra = occupied & ~solid
        turned = sides[(episode.walls[:, :2] != episode.walls[:, 2:]).all(axis=1)]
        gaps = np.hstack([shapely.distance(spots[extra, None], turned), rims[extra]])
        assert (gaps.min(axis=1, initial=math.inf) < 1.5 * grid.resolution).all()


@pytest.mark.parametrize("kind", ["home", "clinic"])
def test_floor_plans_are_as_wide_as_they_say(kind):
    scene = make_scene({"name": "floor_plan", "kind": kind})
    walls = []
    for seed in range(6):
        layout, episode = scene.sample_building(np.random.default_rng(seed))
        doors = layout.opening_widths[layout.is_door]
        assert all(1.0 - 1e-9 <= width <= 1.2 + 1e-9 for width in doors)
        assert all(1.2 - 1e-9 <= width <= 1.8 + 1e-9 for width in layout.corridor_widths)
        # The way is as wide as the narrowest door; half a cell is lost to centres.
        assert bottleneck(episode.map, episode.start[:2], episode.goal[:2]) >= 0.46
        for is_door, opening, zone in zip(
            layout.is_door, layout.openings, layout.zones, strict=True
        ):
            x0, y0, x1, y1 = opening if is_door else zone
            assert (episode.map.cells[y0:y1, x0:x1] != OCCUPIED).any()
        ways = geodesic(episode.map, episode.goal, RADIUS)
        for room in layout.rooms:  # no room is shut
            x0, y0, x1, y1 = room
            part = ways.field[y0:y1, x0:x1]
            assert np.isfinite(part).any()
        walls.append(len(episode.walls))
    assert 60 < np.mean(walls) < 180


@pytest.mark.parametrize("home", [True, False])
@pytest.mark.parametrize(
    ("size", "corridor", "door"),
    [
        ((10.0, 18.0), (1.2, 1.8), (1.0, 1.2)),
        ((9.2, 9.2), (4.0, 4.0), (2.0, 2.0)),
        ((9.0, 12.0), (0.8, 1.2), (2.0, 2.0)),
        ((13.5, 15.0), (4.0, 4.0), (1.5, 2.0)),
    ],
)
def test_every_door_lies_in_the_side_of_a_room_also_of_wide_corridors(home, size, corridor, door):
    for seed in range(150):
        rng = np.random.default_rng(seed)
        layout = generate_layout(numpy_stream(rng), home, *rng.uniform(*size, 2), door, corridor)
        rooms, corridors, doors = (
            np.array(rects.tolist()).reshape(-1, 4)
            for rects in (layout.rooms, layout.corridors, layout.openings[layout.is_door])
        )
        for rects in (rooms, corridors, doors):
            assert (rects[:, :2] < rects[:, 2:]).all()
            assert (rects[:, :2] >= 4).all()  # inside the outer walls
            assert (rects[:, 2:] <= np.array([layout.width, layout.height]) - 4).all()
        for along_x, opening in zip(layout.along_x[layout.is_door], doors, strict=True):
            a, b = (0, 1) if along_x else (1, 0)  # along the wall, and across
            inside = (rooms[:, a] + JAMB <= opening[a]) & (opening[a + 2] <= rooms[:, a + 2] - JAMB)
            beside = (rooms[:, b + 2] == opening[b]) | (rooms[:, b] == opening[b + 2])
            assert (inside & beside).any()


def test_furniture_leaves_a_passage_between_door_and_room():
    scene = make_scene({"name": "floor_plan", "furniture_density": 0.6})
    for seed in range(4):
        layout, episode = scene.sample_building(np.random.default_rng(seed))
        gap = episode.map.distance()
        for zone in layout.zones[layout.is_door]:
            for room in layout.rooms:
                low = np.maximum(zone.tolist()[:2], room.tolist()[:2])
                (x0, y0), (x1, y1) = low, np.minimum(zone.tolist()[2:], room.tolist()[2:])
                if x0 < x1 and y0 < y1:
                    assert (episode.map.cells[y0:y1, x0:x1] == FREE).all()
        assert gap.max() > 0.6


@pytest.mark.parametrize("seed", range(20))
def test_a_stream_draws_what_its_generator_would(seed):
    drawn, plan = numpy_stream(np.random.default_rng(seed)), np.random.default_rng(seed + 1)
    rng = np.random.default_rng(seed)
    for _ in range(300):
        if plan.random() < 0.5:
            assert numpy_uniform(drawn, -2.0, 3.5) == rng.uniform(-2.0, 3.5)
        else:
            count = int(plan.integers(1, 400))
            assert numpy_integer(drawn, count) == rng.integers(count)


def test_a_stream_never_runs_dry():
    drawn = numpy_stream(np.random.default_rng(0))
    many = [numpy_uniform(drawn, 0.0, 1.0) for _ in range(4000)]
    assert len(set(many)) == len(many)
    assert np.mean(many) == pytest.approx(0.5, abs=0.02)


def test_papers_worlds_are_exact():
    rng = np.random.default_rng(0)
    world = make_scene("chaotic_pso").sample(rng)
    assert world.discs.sum() == pytest.approx(41.5 + 41.5 + 3.86)
    assert world.start[:2].tolist() == [1.0, 1.0]
    assert world.goal[:2].tolist() == [9.0, 9.0]
    for name, goal in GREY_WOLF_GOALS.items():
        world = make_scene({"name": "grey_wolf", "goal": name}).sample(rng)
        assert tuple(world.goal[:2]) == goal
        assert tuple(world.start[:2]) == (0.0, 0.0)
        assert world.discs[:, 2].tolist() == [5.5, 3.33, 3.0]


@pytest.mark.parametrize("number", range(1, 6))
def test_thesis_maps_have_ways_of_about_35_m_and_gaps_as_set(number, monkeypatch):
    for gap in (1.2, 1.6):
        monkeypatch.setattr("wheelchair_gym.scenes.published._GAP", gap)
        world = make_scene(f"thesis_{number}").sample(np.random.default_rng(0))
        assert 31.0 < geodesic(world.map, world.goal, RADIUS).at(world.start[:2]) < 42.0
        assert bottleneck(world.map, world.start[:2], world.goal[:2]) >= gap / 2 - 0.08


@pytest.mark.parametrize(
    ("spec", "clearance"),
    [
        *(({"name": f"lab_{number}"}, RADIUS) for number in (1, 2, 3)),
        *(({"name": "design_lab", "path": path}, 0.4) for path in (1, 2)),
    ],
)
def test_labs_have_a_way_round_at_their_clearance(spec, clearance):
    world = make_scene(spec).sample(np.random.default_rng(0))
    start, goal = world.start[:2], world.goal[:2]
    way = geodesic(world.map, goal, clearance).at(start)
    assert math.dist(start, goal) * 1.01 < way < math.inf  # not straight, not shut
    assert bottleneck(world.map, start, goal) >= clearance


def test_a_world_that_a_barn_file_has_not_is_refused(worlds):
    scene = make_scene({"name": "barn", "path": str(worlds), "world": 5})
    with pytest.raises(InputError, match="has no world 5"):
        scene.sample(np.random.default_rng(0))


def test_published_barn_worlds_can_be_passed(shared):
    for world in (0, 100, 295):
        scene = make_scene(
            {"name": "barn", "path": str(shared / "maps" / "barn_60.json"), "world": world}
        )
        episode = scene.sample(np.random.default_rng(0))
        assert (episode.tolerance, episode.time_limit) == (1.0, 100.0)
        assert 9.9 < geodesic(episode.map, episode.goal, RADIUS).at(episode.start[:2]) < 20.0


@pytest.mark.parametrize("end", ["start", "goal"])
def test_what_is_drawn_lies_some_metres_from_what_is_given(end, tmp_path):
    given = {"name": "map_file", end: (2.0, 2.0, 0.0)}
    for seed in range(8):
        episode = make_scene(given).sample(np.random.default_rng(seed))
        assert (getattr(episode, end) == given[end]).all()
        assert geodesic(episode.map, episode.goal, RADIUS).at(episode.start[:2]) > 2.9
    # On a map without 3 m of way, it lies in the half that is farther away.
    Image.new("L", (60, 60), "white").save(tmp_path / "small.png")
    small = {"path": str(tmp_path / "small.png"), "resolution": 0.05, end: (0.8, 0.8, 0.78)}
    for seed in range(8):
        episode = make_scene({**given, **small}).sample(np.random.default_rng(seed))
        assert np.hypot(*(episode.goal - episode.start)[:2]) > 0.7


def test_given_poses_are_taken(worlds):
    drawn = make_scene("map_file").sample(np.random.default_rng(0))
    poses = {"start": tuple(drawn.start), "goal": tuple(drawn.goal)}
    for seed in range(2):
        again = make_scene({"name": "map_file", **poses}).sample(np.random.default_rng(seed))
        assert (again.start == drawn.start).all()
        assert (again.goal == drawn.goal).all()
    room = {"name": "empty", "start": (1.0, 1.0, 0.0), "goal": (5.0, 2.0, 1.0)}
    assert make_scene(room).sample(np.random.default_rng(0)).start.tolist() == [1.0, 1.0, 0.0]
    beside_wall = make_scene({"name": "empty", "start": (1.0, 0.4, 0.0)})
    assert beside_wall.sample(np.random.default_rng(0)).start.tolist() == [1.0, 0.4, 0.0]
