"""Laws of invariance: frames, order and overlap of the input change no answer."""

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from planners import PLANNERS, Problem, Space, Status, make_planner
from planners.collision.polygon_tests import point_free
from planners.judge import plan_faults
from tests.conftest import long_but
from tests.planners.test_planners import on, quick
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import polygon_edges, to_frame, to_world
from wheelchair_gym.maps import OCCUPIED, OccupancyGrid, geodesic
from wheelchair_gym.scenes.arena import is_free_pose
from wheelchair_gym.types import no_discs

SCENES = 100  # of a batch of random polygons
CLEARANCE = 0.36  # m


def random_polygon(rng):
    """A star-shaped polygon, counter-clockwise, anywhere in 10 m x 8 m or a little beyond."""
    k = int(rng.integers(3, 9))
    angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, k)) + rng.uniform(0.0, 2.0 * math.pi)
    radii = rng.uniform(0.3, 3.0, (k, 1))
    around = rng.uniform((-1.0, -1.0), (11.0, 9.0))
    polygon = around + radii * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ring = shapely.Polygon(polygon)
    return polygon if ring.exterior.is_ccw and ring.is_valid else None


@pytest.mark.parametrize("batch", long_but(range(20), (0, 1)))
def test_polygons_are_united_in_any_order_and_frame(batch):
    rng = np.random.default_rng(batch)
    cells = np.zeros((8, 10), np.int8)
    for _ in range(SCENES):
        drawn = [random_polygon(rng) for _ in range(rng.integers(1, 7))]
        polygons = [polygon for polygon in drawn if polygon is not None]
        rng.shuffle(polygons)
        frame = (*rng.uniform(-20.0, 20.0, 2), rng.choice([0.0, rng.uniform(-3.1, 3.1)]))
        grid = OccupancyGrid(cells, 1.0, frame)
        walls = [to_world(polygon_edges(p).reshape(-1, 2), frame).reshape(-1, 4) for p in polygons]
        space = Space.from_map(grid, np.vstack([np.empty((0, 4)), *walls]))
        solid = shapely.union_all([shapely.Polygon(polygon) for polygon in polygons])
        free = shapely.difference(shapely.box(0.0, 0.0, 10.0, 8.0), solid)
        points = rng.uniform((-0.5, -0.5), (10.5, 8.5), (40, 2))
        sure = shapely.distance(shapely.boundary(free), shapely.points(points)) > 1e-9
        for at, world in zip(points[sure], to_world(points[sure], frame), strict=True):
            inside = bool(shapely.contains_xy(free, *at))
            assert point_free(space.arrays, *world) == inside
            assert bool(shapely.contains_xy(space.free, *world)) == inside
        found = shapely.transform(space.free, lambda at, frame=frame: to_frame(at, frame))
        assert shapely.symmetric_difference(found, free).area < 1e-9


def walled(shut, frame):
    """A problem on a map of 10 m x 6 m with a wall from its lower side, whose gap may be shut."""
    cells = np.zeros((60, 100), np.int8)
    cells[: 60 if shut else 44, 47:53] = OCCUPIED
    turn = np.array([0.0, 0.0, frame[2]])
    ends = [
        np.append(to_world(np.array(end[:2]), frame), end[2]) + turn
        for end in ((3.0, 1.0, 0.4), (7.0, 1.0, -1.2))
    ]
    return Problem(Space.from_grid(OccupancyGrid(cells, 0.1, frame)), *ends, CLEARANCE)


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize("shut", [False, True])
def test_plans_stay_on_a_rotated_map(name, shut):
    planner = quick(name, 2000)
    footprint = getattr(planner, "footprint", None)
    for k, frame in enumerate([(0.0, 0.0, 0.5), (3.0, -7.0, -2.0)]):
        problem = walled(shut, frame)
        plan = planner.plan(problem, np.random.default_rng(k))
        assert not plan_faults(plan, problem, footprint)
        assert not (shut and plan.status is Status.SOLVED)
        if name in ("visibility", "lattice"):
            flat = walled(shut, (0.0, 0.0, 0.0))
            expected = planner.plan(flat, np.random.default_rng(k))
            assert plan.status is expected.status
            if not shut:
                assert plan.length == pytest.approx(expected.length, abs=1e-9)
                placed = to_world(expected.path[:, :2], frame)
                np.testing.assert_allclose(plan.path[:, :2], placed, atol=1e-9)


def test_a_start_without_heading_has_heading_0_on_every_map():
    problem = walled(False, (0.0, 0.0, 0.5))
    problem = replace(problem, start=problem.start[:2])
    plan = quick("lattice", 2000).plan(problem, np.random.default_rng(0))
    assert plan.path[0, 2] == pytest.approx(0.0, abs=1e-9)


def test_shortest_paths_move_and_scale_with_their_map():
    for seed in range(40):
        rng = np.random.default_rng(seed)
        low = rng.uniform(0.5, 7.0, (6, 2))
        rectangles = np.hstack([low, low + rng.uniform(0.3, 2.5, (6, 2))])
        ends, radius = np.array([[0.4, 0.4], [9.6, 9.6]]), 0.3
        plans = []
        for scale, shift in ((1.0, np.zeros(2)), (rng.uniform(0.1, 30.0), rng.uniform(-99, 99, 2))):
            blocks = rng.permutation(rectangles) * scale + np.tile(shift, 2)
            box = np.array([0.0, 0.0, 10.0, 10.0]) * scale + np.tile(shift, 2)
            space = Space.from_rectangles(blocks, box)
            problem = Problem(space, *(ends * scale + shift), radius * scale)
            plans.append(make_planner("visibility").plan(problem, rng))
        assert plans[0].status is plans[1].status
        if plans[0].status is Status.SOLVED:
            assert plans[1].length == pytest.approx(scale * plans[0].length, rel=1e-9)


SAMPLING = [name for name in PLANNERS if "rrt" in name or name in ("prm", "swarm")]


@pytest.mark.long
@pytest.mark.parametrize("name", SAMPLING)
def test_on_average_sampling_planners_find_as_short_paths_on_rotated_maps(name):
    planner, lengths = quick(name, 1000), []
    for frame in ((0.0, 0.0, 0.0), (3.0, -7.0, -2.0)):
        problem = walled(False, frame)
        plans = [planner.plan(problem, np.random.default_rng(seed)) for seed in range(50)]
        lengths.append([plan.length for plan in plans if plan.status is Status.SOLVED])
    assert abs(len(lengths[0]) - len(lengths[1])) <= 1
    if lengths[0]:
        assert np.mean(lengths[1]) == pytest.approx(np.mean(lengths[0]), rel=0.01)


def test_geodesics_distances_and_poses_move_with_their_map():
    rng = np.random.default_rng(0)
    chair = Footprint()
    for seed in range(10):
        cells = OCCUPIED * (np.random.default_rng(seed).random((60, 80)) < 0.01).astype(np.int8)
        grid = OccupancyGrid(cells, 0.1)
        moved = replace(grid, origin=(*rng.uniform(-9.0, 9.0, 2), rng.uniform(-3.1, 3.1)))
        np.testing.assert_array_equal(moved.distance(), grid.distance())
        places = rng.uniform((0.5, 0.5), (7.5, 5.5), (30, 2))
        goal, *places = places
        there = to_world(np.array([goal, *places]), moved.origin)
        np.testing.assert_allclose(
            geodesic(moved, there[0], 0.31).at(there),
            geodesic(grid, goal, 0.31).at([goal, *places]),
            atol=1e-9,
        )
        for at, place in zip(there, [goal, *places], strict=True):
            yaw = float(rng.uniform(-math.pi, math.pi))
            free = is_free_pose(np.array([*place, yaw]), grid.walls(), no_discs(), chair, 0.0)
            pose = np.array([*at, yaw + moved.origin[2]])
            assert is_free_pose(pose, moved.walls(), no_discs(), chair, 0.0) == free


@pytest.mark.parametrize("name", PLANNERS)
@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ((2.0, 4.0, 0.3), (6.0, 4.0, 1.5)),
        ((2.0, 4.0, -2.9 + 4.0 * math.pi), (6.0, 4.0, 3.1)),
        ((2.0, 4.0, 7.0), (2.0, 4.0, -1.5)),
        ((2.0, 4.0), (6.0, 4.0, 9.4)),
        ((2.0, 4.0, 1.0), (6.0, 4.0)),
    ],
)
def test_every_plan_begins_and_ends_as_asked(name, start, goal):
    problem = on([(3.5, 2.0, 4.5, 4.5)], start, goal, CLEARANCE, size=8.0)
    planner = quick(name, 1000)
    plan = planner.plan(problem, np.random.default_rng(0))
    assert not plan_faults(plan, problem, getattr(planner, "footprint", None))


def test_the_judge_of_answers_finds_every_kind_of_fault():
    problem = on([], (2.0, 4.0, 0.0), (6.0, 4.0, 1.5), CLEARANCE, size=8.0)
    planner = make_planner("lattice")
    plan, footprint = planner.plan(problem, np.random.default_rng(0)), planner.footprint
    assert not plan_faults(plan, problem, footprint)

    def faults(**changes):
        return " ".join(plan_faults(dataclasses.replace(plan, **changes), problem, footprint))

    assert "status" in faults(status=Status.STUCK)
    assert "status" in faults(path=np.empty((0, 3)))
    assert "finite" in faults(path=plan.path * math.nan)
    assert "end is 0." in faults(path=plan.path + np.array([0.0, 0.1, 0.0]))
    turned = faults(path=np.vstack([plan.path, plan.path[-1] + np.array([0.0, 0.0, 0.2])]))
    assert "end is turned by 0.2" in turned
    assert "turns by 0.2" in turned
