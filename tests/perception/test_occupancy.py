"""Occupancy mapping: exact rays, a map that is the room, a field that follows it, frontiers."""

import numpy as np
import pytest

from tests.perception.rooms import LASER, away, mapped, ranges, tour
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.maps import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, geodesic
from wheelchair_gym.perception import occupancy


def test_a_ray_passes_the_cells_that_brute_force_finds():
    rng = np.random.default_rng(0)
    rows, cols = 12, 17
    path = np.empty(rows + cols, np.uint32)
    row, col = np.indices((rows, cols))
    for _ in range(2000):
        a, b = rng.uniform(0, (cols, rows), (2, 2))
        low, high = np.zeros((rows, cols)), np.ones((rows, cols))
        for k, first in ((0, col), (1, row)):  # where along the segment it enters, and leaves
            t = np.sort([(first - a[k]) / (b[k] - a[k]), (first + 1 - a[k]) / (b[k] - a[k])], 0)
            low, high = np.maximum(low, t[0]), np.minimum(high, t[1])
        passed = path[: occupancy.cells_passed(*a, *b, cols, path)]
        assert len(set(passed)) == len(passed)
        assert set(passed) == set(np.flatnonzero(high > low))
        steps = np.abs(np.diff(passed // cols).astype(int)) + np.abs(np.diff(passed % cols * 1.0))
        assert (np.abs(np.diff(passed.astype(int))) > 0).all()
        assert (steps[np.abs(np.diff(passed.astype(int))) == 1] == 1).all()


@pytest.mark.parametrize(
    ("a", "b"), [((2.5, 3.5), (9.5, 3.5)), ((2.5, 8.5), (2.5, 1.5)), ((4.2, 4.2), (4.8, 4.1))]
)
def test_rays_along_an_axis_or_within_a_cell(a, b):
    path = np.empty(40, np.uint32)
    passed = path[: occupancy.cells_passed(*a, *b, 20, path)]
    across = [int(a[1]), int(b[1])], [int(a[0]), int(b[0])]
    assert len(passed) == 1 + abs(across[0][1] - across[0][0]) + abs(across[1][1] - across[1][0])
    assert set(passed // 20) == set(range(min(across[0]), max(across[0]) + 1))
    assert set(passed % 20) == set(range(min(across[1]), max(across[1]) + 1))


@pytest.fixture(scope="module")
def known():
    return mapped(1)


def test_scans_from_known_poses_give_the_room(known):
    grid = known.to_grid()
    solid = grid.to_world(np.argwhere(grid.cells == OCCUPIED))
    assert len(solid) > 300
    assert np.percentile(away(solid), 95) < 1.1 * grid.resolution  # a wall between two cells
    assert away(solid).max() < 2.5 * grid.resolution
    # What was seen is free, what is behind walls is not known.
    inside = grid.cells[tuple(grid.to_cell([(0.0, 0.0), (4.0, 1.5), (2.0, 0.5)]).T)]
    assert (inside == FREE).all()
    outside = grid.to_cell([(-2.3, 0.0), (1.0, 2.8), (3.15, 0.85)])
    assert (grid.cells[tuple(outside.T)] == UNKNOWN).all()
    # Every stretch of wall that scans could see is there.
    edge = np.stack([np.full(60, 5.0), np.linspace(-1.4, 2.4, 60)], axis=-1)
    gaps = np.hypot(*np.moveaxis(edge[:, None] - solid, -1, 0)).min(axis=1)
    assert gaps.max() < 2 * grid.resolution


def test_the_field_is_what_the_occupied_cells_say(known):
    solid = known.layers.odds[0] >= known.model.occupied
    reach = known.model.weights.shape[1] // 2
    wanted = np.zeros(known.layers.field[0].shape)
    for r, c in np.argwhere(solid):
        part = wanted[r - reach : r + reach + 1, c - reach : c + reach + 1]
        np.maximum(part, known.model.weights[known.layers.surface[0, r, c]["part"]], out=part)
    np.testing.assert_array_equal(known.layers.field[0], wanted)


def test_surfaces_stay_where_the_wall_is_however_often_it_is_seen():
    rng = np.random.default_rng(0)
    made = occupancy.OccupancyMap()
    for _ in range(200):
        pose = rng.uniform((0.2, -0.3, -3.0), (0.8, 0.3, 3.0))
        made.integrate(occupancy.read_scan(LASER, ranges(pose, rng)), pose)
    cells = np.argwhere(made.layers.odds[0] >= made.model.occupied)
    surface = made.layers.surface[0][tuple(cells.T)]
    hits = surface["hits"]
    places = (
        cells[:, ::-1] + np.stack([surface["x"], surface["y"]], axis=-1)
    ) * made.settings.resolution + made.corner
    east = (np.abs(places[:, 1]) < 1.0) & (places[:, 0] > 4.8)
    assert abs(np.average(places[east, 0], weights=hits[east]) - 5.0) < 0.005


def test_what_moved_away_is_free_again_and_log_odds_stay_within_their_clamp():
    known = occupancy.OccupancyMap()
    for reach, cell in ((1.0, OCCUPIED), (2.0, FREE)):
        for _ in range(20):
            scan = occupancy.read_scan(LASER, np.full(LASER.beams, reach))
            known.integrate(scan, np.zeros(3))
        ahead = known.to_grid()
        assert ahead.cells[tuple(ahead.to_cell((1.0 + LASER.x, 0.0)))] == cell
    minimum, maximum = (np.log(p / (1 - p)) for p in (occupancy.P_MIN, occupancy.P_MAX))
    assert known.layers.odds.min() == pytest.approx(minimum)
    assert known.layers.odds.max() == pytest.approx(maximum)


def test_invalid_beams_say_nothing_and_beams_without_echo_free_so_far():
    readings = np.full(LASER.beams, np.nan)
    readings[::2] = -np.inf
    known = occupancy.OccupancyMap()
    known.integrate(occupancy.read_scan(LASER, readings), np.zeros(3))
    assert (known.layers.odds == 0).all()
    known.integrate(occupancy.read_scan(LASER, np.full(LASER.beams, np.inf)), np.zeros(3))
    grid = known.to_grid()
    free = grid.to_world(np.argwhere(grid.cells == FREE)) - (LASER.x, 0)
    assert not (grid.cells == OCCUPIED).any()
    assert np.hypot(*free.T).max() == pytest.approx(3.0, abs=2 * grid.resolution)


def test_a_map_grows_and_keeps_what_it_knew():
    known = occupancy.OccupancyMap()
    pose = tour()[0]
    known.integrate(occupancy.read_scan(LASER, ranges(pose)), pose)
    before = known.to_grid()
    with pytest.raises(InputError):  # and a map that may not grow stays as it is
        known.grow_to((1e9, 1e9), 1.0)
    known.grow_to([(-30.0, 10.0), (3.0, -20.0)], 1.0)
    after = known.to_grid()
    for value in (FREE, OCCUPIED):
        one, two = (np.sort(g.to_world(np.argwhere(g.cells == value)), 0) for g in (before, after))
        np.testing.assert_allclose(one, two, atol=1e-9)
    assert after.inside([(-30.5, 10.5), (3.5, -20.5)]).all()


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: occupancy.OccupancyMap().to_grid(),
        lambda: occupancy.OccupancyMap().grow_to([(1e9, 0.0), (0.0, 1e9)], 1.0),
        lambda: occupancy.read_scan(LASER, np.ones(7)),
        lambda: occupancy.OccupancyMap().integrate(
            occupancy.read_scan(LASER, ranges(tour()[0])), (0, np.nan, 0)
        ),
    ],
)
def test_misuse_is_named(wrong):
    with pytest.raises(InputError):
        wrong()


@pytest.fixture
def cells():
    """A hall of 8 m x 4 m whose east end is unknown, and a closed room beside it."""
    cells = np.full((100, 100), UNKNOWN, np.int8)
    cells[20:60, 10:80] = FREE
    cells[19, 9:81] = cells[60, 9:81] = cells[19:61, 9] = OCCUPIED
    cells[64:80, 10:60] = FREE
    cells[63, 9:61] = cells[80, 9:61] = cells[63:81, 9] = cells[63:81, 60] = OCCUPIED
    return cells


def test_the_only_frontier_is_the_open_end(cells):
    grid = OccupancyGrid(cells, 0.1)
    pose = np.array([2.0, 4.0, 0.3])
    (found,) = occupancy.find_frontiers(grid, pose, 0.35)
    assert found.place[0] == pytest.approx(7.95)
    assert abs(found.place[1] - 4.0) < 0.06
    assert found.path_length == pytest.approx(geodesic(grid, pose[:2], 0.35).at(found.place))
    # Cells beside the walls are no place for the disc.
    assert found.length == pytest.approx(4.0 - 2 * 0.3)


def test_nothing_is_left_where_all_is_known_or_out_of_reach(cells):
    cells[19:61, 80] = OCCUPIED
    cells[64:80, 60] = FREE  # the room opens to the unknown, and no way leads there
    grid = OccupancyGrid(cells, 0.1)
    assert occupancy.find_frontiers(grid, (2.0, 4.0), 0.35) == []
    assert len(occupancy.find_frontiers(grid, (2.0, 7.2), 0.35)) == 1


def test_gaps_between_beams_are_no_frontiers(cells):
    cells[19:61, 80] = OCCUPIED
    cells[40, 40:43] = UNKNOWN
    grid = OccupancyGrid(cells, 0.1)
    assert occupancy.find_frontiers(grid, (2.0, 4.0), 0.35, min_length=1.0) == []
    (gap,) = occupancy.find_frontiers(grid, (2.0, 4.0), 0.35, min_length=0.2)
    assert gap.beyond == pytest.approx(0.03)


def test_what_lies_beyond_a_frontier_is_measured(cells):
    """A hall whose east end is unknown up to the map's edge, or up to a wall."""
    (found,) = occupancy.find_frontiers(OccupancyGrid(cells, 0.1), (2.0, 4.0), 0.35)
    assert found.beyond == np.inf
    cells[19:61, 95] = cells[19, 80:96] = cells[60, 80:96] = OCCUPIED
    (found,) = occupancy.find_frontiers(OccupancyGrid(cells, 0.1), (2.0, 4.0), 0.35)
    assert found.beyond == pytest.approx(40 * 15 * 0.01)
