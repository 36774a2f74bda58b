"""Worlds that the chair does not know: it draws them, finds its goal, and sees no truth."""

from collections import defaultdict
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from scipy import ndimage

from agents.control import local_map
from agents.evaluation.evaluate import make_env
from agents.evaluation.map_evaluation import map_by_driving, map_quality
from agents.policies import make_policy
from agents.policies.scripted import Manual
from agents.policies.search import Search
from planners import make_planner
from tests.agents.fakes import PaperWorld, infos_of
from tests.conftest import at_start, long_but, output_of
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

ONE = {"slam": {"particles": 1}}


def unknown(scene="floor_plan", config=ONE):
    return make_env(scene, {"pose_source": "slam", "config": config or {}})


def drive(env, policy, seed, episode=None, steps=10_000):
    """Poses (n, 3) that the chair believes, and the last info."""
    options = {} if episode is None else {"episode": episode}
    infos = [env.reset(seed=seed, options=options)[1], *islice(infos_of(env, policy), steps)]
    return np.array([info["pose_estimate"] for info in infos]), infos[-1]


@pytest.mark.parametrize("policy", long_but(["lattice+window", "explore"], ["lattice+window"]))
def test_a_goal_in_an_unknown_home_is_found(policy):
    env = unknown()
    _, info = drive(env, policy, 5)
    assert info["is_success"]
    off = np.subtract(info["pose_estimate"], info["pose"])
    assert np.hypot(*off[:2]) < 0.10
    assert (env.unwrapped.task.map.cells == OCCUPIED).sum() > 500


def test_a_chair_without_a_map_backs_where_it_stood_before():
    """It drives into a dead end of a home and out again; without the memory it ran out of time."""
    corridors = {"door_width": (0.9, 1.1), "corridor_width": (1.1, 1.6)}
    env = unknown({"name": "floor_plan", "kind": "home", **corridors}, None)
    _, info = drive(env, "lattice+window", 2)
    assert info["is_success"]


def test_a_door_in_which_something_stood_is_tried_again():
    """The other ways are long; a chair that looks for one runs out of time."""
    env = make_env("temporary", {"pose_source": "slam", "shield": True})
    _, info = drive(env, "lattice+window", 11)
    assert info["is_success"]


def test_no_map_is_looked_at_where_the_world_is_unknown():
    """The same world with a map that lies is driven in the same way, to the bit."""
    env = unknown()
    true, _ = drive(env, "lattice+window", 6, steps=60)
    episode = env.unwrapped.episode
    lie = OccupancyGrid(
        np.zeros_like(episode.map.cells), episode.map.resolution, episode.map.origin
    )
    told, _ = drive(env, "lattice+window", 6, replace(episode, map=lie, time_limit=60.0), steps=60)
    np.testing.assert_array_equal(told, true)


@pytest.mark.long
def test_exploring_draws_a_true_map_and_comes_to_an_end():
    env = unknown({"name": "floor_plan", "kind": "home", "building_size": (9.0, 9.0)})
    made = map_by_driving(env, make_policy({"name": "explore", "seek": False}), 6, 600.0)
    assert made.ended == "done"
    of = made.figures
    assert of["right"] > 0.98
    assert of["wall_p95"] < 0.10
    assert of["floor_seen"] > 0.85
    assert of["pose_rms_m"] < 0.05
    assert of["heading_rms_deg"] < 1.5


def test_exploring_leaves_a_room_whose_door_is_seen_edge_on():
    """In a door of 1.0 m the frontier on which a disc of 0.36 m can stand is 0.28 m long."""
    wide = {"door_width": (1.0, 1.4), "corridor_width": (1.5, 2.4), "building_size": (13.9, 14.0)}
    env = unknown({"name": "floor_plan", "kind": "clinic", "path_length": (5.0, 300.0), **wide})
    made = map_by_driving(env, make_policy({"name": "explore", "seek": False}), 0, 32.0)
    assert made.ended == "time"
    assert made.true[-1, 0] < 10.0  # the wall with the door is at 10.9 m


def test_a_false_map_is_called_false():
    """The measure can fail: the outlines of the truth, turned by 3 degrees or moved."""
    env = at_start(unknown(), 5)
    episode, told = env.unwrapped.episode, env.unwrapped.episode.map
    cells = np.where(told.solid(), UNKNOWN, FREE).astype(np.int8)
    cells[told.solid() & ndimage.binary_dilation(~told.solid())] = OCCUPIED
    x, y, _ = told.origin
    found = [
        map_quality(OccupancyGrid(cells, told.resolution, origin), episode, 0.31)
        for origin in (told.origin, (x, y, np.radians(3.0)), (x + 0.2, y, 0.0))
    ]
    assert found[0].wall_p95 < 0.06
    assert found[0].right > 0.99
    assert all(wrong.wall_p95 > 0.10 for wrong in found[1:])
    assert all(wrong.right < 0.98 for wrong in found[1:])


def test_what_is_assumed_of_the_unseen():
    cells = np.full((100, 100), UNKNOWN, np.int8)
    cells[:, 50:] = FREE
    known, pose = OccupancyGrid(cells, 0.1), np.array([5.0, 5.0, 0.0])
    stands, turns, anywhere = local_map.assumed_maps(known, pose, Footprint())
    assert anywhere is known
    for careful, minimum in ((stands, 0.30), (turns, 0.43)):
        row = careful.cells[50]
        assert (row[:30] == UNKNOWN).all()
        assert (row[37:44] == OCCUPIED).all()
        assert (row[46:] == FREE).all()
        solid = careful.to_world(np.argwhere(careful.cells == OCCUPIED))
        assert minimum < np.hypot(*(solid - pose[:2]).T).min() < minimum + 0.25
    assert (local_map.with_free_footprint(known, pose, Footprint()).cells[50, 43:] == FREE).all()
    assert (known.cells[50, :50] == UNKNOWN).all()
    way = [(6.0, 5.0), (6.0, 9.0)]
    assert not local_map.walls_block(known, way, 0.4)
    cells[70, 60] = OCCUPIED
    assert local_map.walls_block(
        OccupancyGrid(cells, 0.1), [(6.0, y) for y in np.arange(5.0, 9.0, 0.05)], 0.4
    )


def test_the_floor_that_the_chair_stood_on_is_free_and_nothing_else_changes():
    footprint, floor = Footprint(), local_map.FloorMemory(Footprint())
    area = (footprint.front + footprint.rear) * 2.0 * footprint.half_width
    cells = np.full((60, 120), UNKNOWN, np.int8)
    cells[30, 40] = OCCUPIED  # under the chair: what was seen counts
    grid = OccupancyGrid(cells, 0.05, (-3.0, -1.5, 0.0))
    floor.with_stood_cells_free(grid, np.array([-1.0, 0.0, 0.0]))
    marked = floor.with_stood_cells_free(grid, np.array([1.0, 0.0, 0.0]))
    freed = (marked.cells == FREE).sum() * grid.resolution**2
    assert freed == pytest.approx(2.0 * area, rel=0.15)
    assert marked.cells[30, 40] == OCCUPIED
    assert (grid.cells == cells).all()
    assert floor.with_stood_cells_free(grid, np.array([1.0, 0.0, 0.0])) is marked


def test_floor_is_kept_over_a_long_way_in_maps_that_grow_and_move():
    footprint, rng = Footprint(), np.random.default_rng(4)
    floor, pose, stood = local_map.FloorMemory(footprint), np.zeros(3), set()
    low, high = footprint.corners[0], footprint.corners[2]
    under = np.stack(np.meshgrid(*map(np.arange, low, high, (0.025, 0.025))), -1).reshape(-1, 2)
    for _ in range(200):
        pose += np.array([0.3 * np.cos(pose[2]), 0.3 * np.sin(pose[2]), rng.normal(0.0, 0.4)])
        stood |= set(map(tuple, np.floor(to_world(under, pose) / 0.05).astype(int)))
        left, bottom = rng.integers(-300, 100, 2)
        cells = rng.choice([UNKNOWN, FREE, OCCUPIED], rng.integers(40, 400, 2)).astype(np.int8)
        expected = cells.copy()
        for x, y in stood:
            row, column = y - bottom, x - left
            inside = 0 <= row < cells.shape[0] and 0 <= column < cells.shape[1]
            if inside and cells[row, column] == UNKNOWN:
                expected[row, column] = FREE
        grid = OccupancyGrid(cells, 0.05, (0.05 * left, 0.05 * bottom, 0.0))
        assert (floor.with_stood_cells_free(grid, pose).cells == expected).all()


def test_what_was_open_floor_once_may_be_free_again():
    floor, pose = local_map.FloorMemory(Footprint()), np.zeros(3)
    before = np.full((60, 80), UNKNOWN, np.int8)
    before[10:50, 10:70], before[30, 10:30], before[30, 50:70] = FREE, OCCUPIED, OCCUPIED
    before[5, 5:9] = FREE  # a gap between walls
    floor.with_stood_cells_free(OccupancyGrid(before, 0.05, (-2.0, -1.5, 0.0)), pose)
    after = np.full((400, 400), UNKNOWN, np.int8)  # the same place in a map that has grown
    after[210:270, 210:290] = before
    after[240, 240:260] = OCCUPIED  # something stands in the door, from jamb to jamb
    after[230, 240] = OCCUPIED  # and in the open
    after[215, 215:219] = OCCUPIED
    grid = OccupancyGrid(after, 0.05, (-12.5, -12.0, 0.0))
    marked = floor.with_stood_cells_free(grid, pose)
    reopened = floor.reopened(marked).cells
    assert (reopened[240, 240:260] == FREE).all()
    assert reopened[230, 240] == FREE
    assert (reopened != marked.cells).sum() == 21
    assert (marked.cells == after)[after != UNKNOWN].all()
    floor.forget_open()
    assert floor.reopened(marked) is marked


def searched(grid, reopened, detour=2.0):
    search = Search(
        make_planner({"name": "a_star"}), 0.4, 0.28, np.random.default_rng(0), np.zeros(3), [grid],
        drawn=Footprint(), beyond=0.5, reopened=reopened, detour=detour,
    )  # fmt: skip
    return search.plan(np.array([4.0, 0.0]), np.inf)


def room(**columns):
    """A drawn hall with a wall across it, and which rows of the wall stand."""
    cells = np.full((160, 140), FREE, np.int8)
    cells[50:70, :30] = UNKNOWN  # behind the chair
    cells[0] = cells[-1] = cells[:, 0] = cells[:, -1] = OCCUPIED
    for rows in columns.values():
        cells[rows, 80] = OCCUPIED
    return OccupancyGrid(cells, 0.05, (-2.0, -3.0, 0.0))


def test_a_way_that_was_free_once_is_taken_where_none_is_left_or_the_other_is_long():
    shut, open_door = room(wall=np.s_[:]), room(low=np.s_[:50], high=np.s_[70:85])
    closed = room(wall=np.s_[:85])  # the way round its end is 1 m longer
    nothing = searched(shut, None)
    assert not nothing.solved
    assert nothing.length == np.inf
    assert nothing.unseen
    assert nothing.searched == 3
    way = searched(shut, open_door)
    assert way.reopens
    assert not way.unseen  # the first of its three maps leads there
    assert way.searched == 4
    stands = local_map.assumed_maps(shut, np.zeros(3), Footprint())[0]
    assert (way.walls.cells == stands.cells).all()  # the follower sees what is there
    round_it = searched(closed, None)
    assert round_it.solved
    assert not round_it.reopens
    assert round_it.length > way.length + 0.6
    assert searched(closed, open_door, detour=0.3).reopens
    assert not searched(closed, open_door, detour=10.0).reopens


class Drawn(PaperWorld):
    """Its map is drawn by the chair, and always true."""

    def __init__(self, grid, start, goal):
        self.map = grid
        super().__init__(grid, start, goal)
        self.mission = replace(self.mission, map=None)

    def reading(self):
        self.walls = self.map.walls()
        return super().reading()._replace(map=self.map)


@pytest.mark.parametrize("planning_time", [0.0, 0.3])
def test_a_chair_waits_at_a_door_until_the_way_round_is_worth_it(planning_time):
    policy = make_policy({"name": "a_star+window", "planning_time": planning_time})
    world = Drawn(room(low=np.s_[:50], high=np.s_[70:130]), (0.0, 0.0, 0.0), (4.0, 0.0))
    policy.reset(world.mission)
    reopens, places = [], []
    while world.time < 60.0 and np.hypot(*(world.pose[:2] - (4.0, 0.0))) > 0.3:
        if world.time > 1.0:
            world.map = room(wall=np.s_[:130])  # the way round is 9 m longer
        world.step(policy)
        reopens.append(policy._path.reopens)
        places.append(world.pose[:2])
    waits = np.flatnonzero(reopens)
    assert 50 < len(waits) == waits[-1] - waits[0] + 1  # without turning back once it has given up
    assert np.max(np.array(places)[waits, 0]) > 1.0
    assert world.time < 60.0


def test_space_behind_a_wall_is_not_unseen_space_behind_the_chair():
    footprint = Footprint()
    cells = np.full((80, 80), UNKNOWN, np.int8)
    cells[20:60, 40:] = FREE
    grid = OccupancyGrid(cells, 0.05, (-2.0, -2.0, 0.0))
    near = np.array([footprint.rear + 0.1, 0.0, 0.0])
    assert local_map.blind_behind(grid, near, footprint)
    cells[20:60, 39] = OCCUPIED
    grid = OccupancyGrid(cells, 0.05, (-2.0, -2.0, 0.0))
    assert not local_map.blind_behind(grid, near, footprint)


def test_what_cannot_be_done_in_an_unknown_world_is_refused():
    with pytest.raises(InputError, match="window"):
        Manual().make().reset(None)


def test_a_person_drives_with_keys(monkeypatch):
    import pygame

    env, held = at_start(NavigationEnv("empty", split="test")), set()
    mission, reading = env.mission, env.reading
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame.display.init()
    try:
        pressed = lambda: defaultdict(bool, dict.fromkeys(held, True))  # noqa: E731
        monkeypatch.setattr(pygame.key, "get_pressed", pressed)
        driver = Manual().make()
        driver.reset(mission)
        assert not driver.act(reading).twist.any()
        held |= {pygame.K_UP, pygame.K_LEFT}
        fast = driver.act(reading).twist
        assert (fast > 0.0).all()
        held |= {pygame.K_LSHIFT}
        assert (np.abs(driver.act(reading).twist) < fast).all()
        held -= {pygame.K_UP, pygame.K_LEFT}
        held |= {pygame.K_s, pygame.K_d}
        assert (driver.act(reading).twist < 0.0).all()
    finally:
        pygame.display.quit()
    held.add(pygame.K_UP)
    assert driver.act(reading).done
    assert not driver.act(reading).twist.any()


def test_a_map_is_drawn_by_driving(tmp_path, capsys):
    out, picture = tmp_path / "map", tmp_path / "map.png"
    words = ["map", "--scene", "floor_plan", "--seed", "6", "--time", "3", "--particles", "1"]
    assert "time after 3.0 s" in output_of([*words, "--out", out, "--picture", picture], capsys)
    assert (out / "map.yaml").exists()
    assert picture.exists()
