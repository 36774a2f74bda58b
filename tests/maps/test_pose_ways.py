"""Ways of poses, and tightness of places, beside limits that are known exactly."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from tests.conftest import long_but
from wheelchair_gym import maps
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv
from wheelchair_gym.envs.guidance import PoseGuidance
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.geometry.outline import Footprint, best_clearance_heading, footprint_clearance
from wheelchair_gym.geometry.planar import to_world, wrap_angle
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid
from wheelchair_gym.maps import cost_to_go as costs
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.scenes.arena import Doorway, check_passable
from wheelchair_gym.types import Episode, no_discs

POSED = {
    "scene": "clutter",
    "split": "test",
    "beams": 32,
    "guidance": "poses",
    "bank": {"size": 3, "turnover": 0.0},
    "config": {"rate": 5.0, "task": {"aim": "time", "last_action": True, "privileged": True}},
}


@pytest.mark.parametrize("scene", ["clutter", "floor_plan", "doorway"])
def test_ways_lead_to_the_goal_and_the_outline_fits(scene):
    for seed in range(3):
        episode = make_scene(scene).sample(np.random.default_rng(seed))
        ways = costs.cost_to_go(episode.map, episode.goal, Footprint(), Limits(), tolerance=0.2)
        path = ways.path(episode.start)
        assert np.hypot(*(path[0] - episode.start)[:2]) < 0.3
        assert np.hypot(*(path[-1] - episode.goal)[:2]) <= 0.2 + 0.005
        outline = Footprint().array
        for x, y, yaw in path:
            gap = footprint_clearance(x, y, yaw, outline, episode.walls, episode.discs, 1.0)
            assert gap > 0.0
        times = ways.time_to_goal(path)
        assert (np.diff(times) < 0.1).all()  # to change over between states costs a little
        assert times[-1] < 0.1
        # No quicker than at full speed along the straight.
        far = np.hypot(*(episode.goal - episode.start)[:2])
        assert float(ways.time_to_goal(episode.start)) >= (far - 0.3) / Limits().forward


def test_the_time_to_go_is_the_least_over_the_states_around():
    """As a plain search finds it: the state's time, and that of driving and turning to it."""
    episode = make_scene("clutter").sample(np.random.default_rng(2))
    ways = costs.cost_to_go(episode.map, episode.goal, Footprint(), Limits())
    states, cell = ways.packed_states, ways.cell
    rng, step = np.random.default_rng(0), 2.0 * np.pi / states.shape[2]
    times, place = states >> costs.TIME, np.indices(states.shape)
    x = place[1] * cell + ((states >> costs.X_BITS) & (costs.UNITS - 1)) / costs.UNITS * cell
    y = place[0] * cell + (states & (costs.UNITS - 1)) / costs.UNITS * cell
    known = 0
    for _ in range(200):
        px, py = rng.uniform(0.3, 1.0, 2) * np.array(states.shape[1::-1]) * cell
        yaw = rng.uniform(-7.0, 7.0)
        turn = np.abs(wrap_angle(place[2] * step - yaw))
        total = times / costs.TICKS + 2.0 * np.hypot(x - px, y - py) + turn
        row, col, middle = int(py // cell), int(px // cell), int(np.floor(yaw / step + 0.5))
        near = (np.abs(place[0] - row) <= 1) & (np.abs(place[1] - col) <= 1) & (times < costs.FAR)
        near &= np.isin(place[2], np.arange(middle - 1, middle + 2) % states.shape[2])
        if near.any():
            known += 1
            pose = [*to_world(np.array([px, py]), ways.origin), yaw + ways.origin[2]]
            assert float(ways.time_to_goal(pose)) == pytest.approx(total[near].min(), abs=1e-9)
    assert known > 50


@pytest.mark.parametrize("slack", [None, 3.0])
@pytest.mark.parametrize(("scene", "seed"), [("clutter", 1), ("floor_plan", 10)])
def test_each_step_of_a_way_is_one_a_chair_can_drive(scene, seed, slack):
    """Between two poses the chair goes along its heading or turns: it never goes aside."""
    episode = make_scene(scene).sample(np.random.default_rng(seed))
    ways = costs.cost_to_go(
        episode.map, episode.goal, Footprint(), Limits(), starts=[episode.start], slack=slack
    )
    path = ways.path(episode.start)
    steps, turns = np.diff(path[:, :2], axis=0), wrap_angle(np.diff(path[:, 2]))
    middle = path[:-1, 2] + 0.5 * turns
    aside = steps[:, 1] * np.cos(middle) - steps[:, 0] * np.sin(middle)
    assert np.abs(aside).max() < 2.0 * ways.cell / 64


def test_moves_may_cost_more_than_a_thousand_ticks():
    episode = make_scene("doorway").sample(np.random.default_rng(0))
    config = costs.CostToGoSettings(obstacle_weight=12.0, reverse_factor=10.0)
    found = costs.cost_to_go(episode.map, episode.goal, Footprint(), Limits(), config=config)
    path = found.path(episode.start)
    assert np.hypot(*(path[-1] - episode.goal)[:2]) <= found.cell


def test_a_door_that_is_too_narrow_is_no_way_and_slimmer_outlines_find_one():
    cells = np.zeros((60, 120), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = OCCUPIED, OCCUPIED
    cells[:, 60], cells[24:36, 60] = OCCUPIED, 0  # 0.6 m; the chair is 0.62 m wide
    grid, start, goal = OccupancyGrid(cells, 0.05), np.array([1.0, 1.5, 0.0]), (5.0, 1.5)
    shut = costs.cost_to_go(grid, goal, Footprint(), Limits())
    assert np.isnan(shut.time_to_goal(start))
    assert len(shut.path(start)) == 0
    assert np.isfinite(shut.time_to_goal([4.0, 1.5, 0.0]))
    slim = costs.cost_to_go(grid, goal, Footprint(), Limits(), starts=[start])
    assert np.isfinite(slim.time_to_goal(start))


@pytest.mark.parametrize("scene", ["clutter", "floor_plan", "barn"])
def test_ways_from_one_start_are_as_quick_and_fewer_are_looked_at(scene):
    for seed in range(3):
        episode = make_scene(scene).sample(np.random.default_rng(seed))
        frame = np.array([1.0, -2.0, 0.4 * seed])
        grid = dataclasses.replace(episode.map, origin=tuple(frame))
        start, goal = (
            np.append(to_world(pose[:2] - episode.map.origin[:2], frame), pose[2] + frame[2])
            for pose in (episode.start, episode.goal)
        )
        every, some = (
            costs.cost_to_go(grid, goal, Footprint(), Limits(), starts=[start], slack=slack)
            for slack in (None, 3.0)
        )
        way = some.path(start)
        assert some.time_to_goal(start) == pytest.approx(every.time_to_goal(start), abs=0.4)
        assert np.hypot(*(way[-1] - goal)[:2]) < 0.05
        left = every.time_to_goal(start) - every.time_to_goal(way)
        # Its end is at the goal by the other's clock.
        assert left.max() > every.time_to_goal(start) - 0.4
        # A little beside the way, ways are known, too.
        aside = np.add(way[:-5], [0.0, 0.0, 0.1])
        assert np.isfinite(some.time_to_goal(aside)).all()
        known = [np.mean(ways.packed_states >> costs.TIME != costs.FAR) for ways in (every, some)]
        assert known[1] < known[0]
    with pytest.raises(ValueError, match="slack"):
        costs.cost_to_go(grid, goal, Footprint(), Limits(), slack=1.0)


def test_ways_turn_with_the_map():
    episode = make_scene("clutter").sample(np.random.default_rng(2))
    turned = dataclasses.replace(episode.map, origin=(2.0, -1.0, 0.7))
    frame = np.array(turned.origin)
    goal = to_world(episode.goal[:2], frame)
    start = np.array([*to_world(episode.start[:2], frame), episode.start[2] + frame[2]])
    here = costs.cost_to_go(episode.map, episode.goal, Footprint(), Limits())
    there = costs.cost_to_go(turned, goal, Footprint(), Limits())
    assert float(there.time_to_goal(start)) == pytest.approx(
        float(here.time_to_goal(episode.start)), abs=0.3
    )
    ends = there.path(start)[[0, -1]]
    assert ends[0, :2] == pytest.approx(start[:2], abs=0.3)
    assert ends[1, :2] == pytest.approx(goal, abs=0.05)


def test_a_policy_sees_poses_ahead_and_the_reward_is_time_won():
    env = NavigationEnv(**POSED)
    observation, _ = env.reset(seed=0)
    ways = env._prepared.cost_to_go
    for k in range(8):
        assert env.observation_space.contains(observation)
        pose = env.task.reading.pose
        assert observation["privileged"][0] == pytest.approx(
            float(ways.time_to_goal(pose)), abs=1e-3
        )
        ahead = observation["path"].reshape(-1, 4)
        assert np.hypot(ahead[:, 2], ahead[:, 3]) == pytest.approx(1.0, abs=1e-5)
        spots = to_world(ahead[:, :2], pose)
        yaws = pose[2] + np.arctan2(ahead[:, 3], ahead[:, 2])
        left = ways.time_to_goal(np.column_stack([spots, yaws]))
        assert (np.diff(left) < 0.05).all()
        assert env.points_ahead == pytest.approx(spots)
        before = float(ways.time_to_goal(pose))
        action = np.array([0.6, 0.1 * k], np.float32)
        observation, _, _, _, info = env.step(action)
        assert observation["action"] == pytest.approx(action)
        won = before - float(ways.time_to_goal(env.task.reading.pose))
        assert info["reward_terms"]["progress"] == pytest.approx(
            env.settings.task.reward.progress * won, abs=1e-6
        )


def test_starts_are_drawn_within_a_time_of_the_goal_alike_in_one_and_in_many():
    near = {**POSED, "config": {**POSED["config"], "starts_within": 4.0}}
    many, one = NavigationVectorEnv(4, **near), NavigationEnv(**near)
    seen = set()
    observations, _ = many.reset(seed=3)
    for i in range(4):
        observation, _ = one.reset(seed=3 + i)
        for key, value in observation.items():
            assert np.array_equal(value, observations[key][i])
        assert 1.0 <= observation["privileged"][0] <= 4.2
        assert np.array_equal(one.chair.truth.pose[:2], one.episode.start[:2])
        seen.add(one.episode.start.tobytes())
    assert len(seen) == 4


def test_a_map_told_less_than_well_is_the_same_each_time_and_guides_elsewhere(monkeypatch):
    monkeypatch.setattr("wheelchair_gym.envs.guidance._PATCH_DENSITY", 0.2)
    episode = make_scene("floor_plan").sample(np.random.default_rng(5))
    env = NavigationEnv("floor_plan", guidance="poses")
    env.reset(options={"episode": episode})
    worse = PoseGuidance(degraded_share=1.0)
    assert NavigationEnv(guidance={"call": worse}).task.has_poses
    first, again = worse(env.task), worse(env.task)
    assert np.array_equal(first.packed_states, again.packed_states)
    assert first.origin == again.origin != episode.map.origin
    assert not np.array_equal(first.packed_states, PoseGuidance()(env.task).packed_states)


def test_a_map_is_degraded_all_over_its_cells_however_its_frame_is_turned(monkeypatch):
    monkeypatch.setattr("wheelchair_gym.envs.guidance._PATCH_DENSITY", 0.2)
    grid = make_scene("clutter").sample(np.random.default_rng(0)).map
    worse = PoseGuidance(degraded_share=1.0)
    ends = {"start": np.array([900.0, 0.0, 0.0]), "goal": np.array([900.0, 1.0, 0.0])}
    found = [
        worse._map_of(SimpleNamespace(map=OccupancyGrid(grid.cells, 0.05, (3.0, 1.0, yaw)), **ends))
        for yaw in (0.0, 0.6, 2.0)
    ]
    assert (found[0].cells != grid.cells).any()
    assert all((each.cells == found[0].cells).all() for each in found)


OUTLINE = Footprint()
BOX = np.array([(0, 0, 6, 0), (6, 0, 6, 4), (6, 4, 0, 4), (0, 4, 0, 0)], dtype=float)


@pytest.mark.parametrize("wide", [6, 9, 20])
def test_the_bottleneck_is_half_the_narrowest_gap(wide):
    cells = np.full((60, 100), maps.FREE)
    cells[:, 50:52] = maps.OCCUPIED
    cells[20 : 20 + wide, 50:52] = maps.FREE
    grid = maps.OccupancyGrid(cells, 0.05)
    half = wide / 2 * 0.05
    found = maps.bottleneck(grid, (1.0, 1.5), (4.0, 1.5))
    assert half - 0.026 <= found <= half + 1e-6
    cells[:, 50:52] = maps.OCCUPIED
    assert maps.bottleneck(maps.OccupancyGrid(cells, 0.05), (1.0, 1.5), (4.0, 1.5)) == -math.inf


@pytest.mark.parametrize("angle", [0.3, 0.5, 0.8, 1.1, 1.3])
def test_a_slanted_door_has_a_route_of_the_radius_that_passes(angle):
    """Cells that touch at a corner only may join the widest disc's way, and never a route."""
    x, y = np.meshgrid(0.05 * np.arange(100) - 2.5, 0.05 * np.arange(100) - 2.5)
    along, across = to_world(np.stack([x, y], axis=-1), (0.0, 0.0, -angle)).transpose(2, 0, 1)
    walled = (np.abs(across) < 0.05) & (np.abs(along) > 0.34)
    grid = OccupancyGrid(np.where(walled, OCCUPIED, maps.FREE), 0.05)
    ends = to_world(np.array([(0.0, -1.5), (0.0, 1.5)]), (2.5, 2.5, angle))
    start, goal = np.column_stack([ends, [angle, angle]])
    radius = check_passable(Episode(grid, start, goal), OUTLINE)
    assert OUTLINE.half_width - 0.05 < radius <= maps.bottleneck(grid, start[:2], goal[:2])
    assert maps.geodesic(grid, goal[:2], radius).at(start[:2]) < 4.0


@pytest.mark.parametrize("gap", long_but((0.56, 0.66, 0.70, 0.76, 0.82, 1.2), (0.56, 0.70, 0.82)))
@pytest.mark.parametrize("round_", [False, True])
def test_between_posts_an_outline_may_grow_by_half_the_play(gap, round_):
    low, high = 2.0 - 0.5 * gap, 2.0 + 0.5 * gap
    walls = np.vstack([BOX, [(3, 0, 3, low - 0.2), (3, high + 0.2, 3, 4)]])
    posts = np.array([(3, low - 0.15, 0.15), (3, high + 0.15, 0.15)])
    if not round_:
        walls = np.vstack([BOX, [(3, 0, 3, low), (3, high, 3, 4)]])
        posts = no_discs()
    found = maps.footprint_margin(walls, posts, (1.0, 2.0, 0.0), (5.0, 2.0), OUTLINE)
    exact = min(0.10, 0.5 * gap - OUTLINE.half_width)
    assert exact - 0.0201 <= found <= exact + 0.0101


@pytest.mark.parametrize(
    ("door", "corridor"),
    long_but([(0.85, 0.9), (0.8, 1.05), (0.9, 1.0), (0.7, 0.8)], [(0.85, 0.9), (0.7, 0.8)]),
)
def test_turns_count(door, corridor):
    scene = Doorway(door_width=door, corridor_width=corridor)
    small = Footprint(0.2, 0.2, 0.2)  # the scene refuses a chair that does not get round its corner
    world = scene.sample(np.random.default_rng(0), small)
    assert scene.margin() < 0.5 * min(door, corridor) - OUTLINE.half_width
    found = maps.footprint_margin(world.walls, world.discs, world.start, world.goal, OUTLINE)
    assert scene.margin() - 0.0201 <= found <= scene.margin() + 0.0101


def test_where_no_way_leads_the_least_is_said():
    walls = np.vstack([BOX, [(3, 0, 3, 4)]])
    assert maps.footprint_margin(walls, no_discs(), (1.0, 2.0, 0.0), (5.0, 2.0), OUTLINE) == -0.05
    assert maps.footprint_margin(walls, no_discs(), (1.0, 2.0, 0.0), (2.0, 2.0), OUTLINE) == 0.10


@pytest.mark.parametrize(("place", "yaw"), [((0.45, 2.0), 0.0), ((5.55, 2.0), math.pi)])
def test_in_a_lane_the_roomiest_heading_is_along_it_with_the_back_to_the_wall(place, yaw):
    lane = np.vstack([BOX, [(0, 1.5, 6, 1.5), (0, 2.5, 6, 2.5)]])
    found, room = best_clearance_heading(place, OUTLINE, lane, no_discs())
    assert found == pytest.approx(yaw)
    assert room == pytest.approx(0.45 - OUTLINE.rear)
    assert best_clearance_heading((0.1, 2.0), OUTLINE, lane, no_discs())[1] <= 0.0


@pytest.mark.parametrize("side", [1, 4, 5])
def test_open_floor_is_made_of_free_squares(side):
    cells = np.where(np.random.default_rng(3).random((40, 50)) < 0.06, maps.OCCUPIED, maps.FREE)
    cells[:, 44:] = maps.UNKNOWN
    expected = np.zeros(cells.shape, bool)
    for row in range(41 - side):
        for column in range(51 - side):
            square = np.s_[row : row + side, column : column + side]
            expected[square] |= (cells[square] == maps.FREE).all()
    grid = maps.OccupancyGrid(cells.astype(np.int8), 0.05)
    assert 0.1 < expected.mean() < 0.9
    assert (maps.open_floor(grid, 0.05 * side) == expected).all()
    assert (maps.open_floor(grid, 0.01) == (grid.cells == maps.FREE)).all()  # at least a cell
