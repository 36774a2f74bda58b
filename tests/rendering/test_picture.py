"""Pictures show what they are told, where it is."""

import dataclasses
import math

import numpy as np
import pytest

from tests.agents.fakes import reading
from wheelchair_gym.actors.records import combine, door, furniture, obstacle, person
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.geometry.planar import polygon_edges, to_frame, to_world
from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.rendering import PlanPicture, TopView, floor, palette
from wheelchair_gym.rendering.picture import CHAIR_ALPHA
from wheelchair_gym.types import Episode, no_discs

OUTER = [(-0.2, -0.2), (8.2, -0.2), (8.2, 6.2), (-0.2, 6.2)]
INNER = [(0.0, 0.0), (8.0, 0.0), (8.0, 6.0), (0.0, 6.0)]
BLOCK = [(6.0, 1.0), (7.0, 1.0), (7.0, 2.0), (6.0, 2.0)]
BARE = (0.0, 0.0, 6.0, 4.0), (0.5, 0.5), (5.5, 3.5)  # bounds, start and goal of a plan


def room(origin=(0.0, 0.0, 0.0)):
    """A room with a block and a disc; the map's left quarter is unknown."""
    cells = np.zeros((60, 80), dtype=np.int8)
    cells[:, :20] = -1
    cells[:, -1] = 0
    return Episode(
        map=OccupancyGrid(cells, 0.1, origin),
        start=np.array([3.0, 5.0, 0.0]),
        goal=np.array([7.0, 5.0, 0.0]),
        walls=np.vstack([polygon_edges(p) for p in (OUTER, INNER, BLOCK)]),
        discs=np.array([[3.0, 1.2, 0.4]]),
    )


def colour_at(image, frame, point):
    column, row = np.floor(frame.pixels(point)).astype(int)
    return tuple(int(v) for v in image[row, column])


def over(colour, ground, alpha):
    return alpha * np.array(colour) + (1 - alpha) * np.array(ground)


@pytest.fixture(scope="module")
def view():
    return TopView(room())


POSES = [(4.5, 3.0, yaw) for yaw in (0.0, 0.7, math.pi / 2, -2.5)] + [(5.0, 3.5, 1.0)]


@pytest.mark.parametrize("pose", POSES)
def test_chair_covers_its_footprint_and_nothing_else(view, pose):
    image = view.draw(pose)
    f = Footprint()
    body = over(palette.CHAIR, palette.FREE, CHAIR_ALPHA)
    # Just inside each corner and beside the heading mark; nothing else is drawn there.
    inside = np.add(0.85 * f.corners, (0.03, 0.0))
    for point in to_world(inside, pose):
        assert np.abs(colour_at(image, view.frame, point) - body).max() <= 2
    for point in to_world(1.15 * f.corners, pose):
        assert colour_at(image, view.frame, point) == palette.FREE
    changed = np.argwhere((image != view.background.image).any(axis=-1))[:, ::-1] + 0.5
    frame = view.frame
    metres = (changed - (frame.left, frame.bottom)) / (frame.scale, -frame.scale)
    own = to_frame(metres, pose)
    edge = 3.0 / view.frame.scale  # half a stroke and its soft rim
    assert (own[:, 0] > -f.rear - edge).all()
    assert (own[:, 0] < f.front + edge).all()
    assert (np.abs(own[:, 1]) < f.half_width + edge).all()


def test_floor_solids_and_unknown_have_their_colours(view):
    image = view.draw((4.5, 3.0, 0.0))
    expected = {
        (6.5, 1.5): palette.SOLID,
        (3.0, 1.2): palette.SOLID,
        (8.1, 3.0): palette.SOLID,
        (-0.1, 3.0): palette.SOLID,
        (1.0, 3.0): palette.UNKNOWN,
        (3.0, 3.0): palette.FREE,
        (7.5, 0.5): palette.FREE,
        (7.0, 5.0): palette.GOAL,
    }
    for point, colour in expected.items():
        assert colour_at(image, view.frame, point) == colour, point


def test_map_is_laid_where_its_origin_turns_it():
    cells = np.zeros((20, 40), dtype=np.int8)
    cells[0, :] = 100  # the row at lowest y of its own frame
    grid = OccupancyGrid(cells, 0.1, (5.0, 1.0, math.pi / 2))
    view = TopView(Episode(map=grid, start=np.array([4.0, 2.0, 0.0]), goal=np.array([4.0, 4.0, 0])))
    image = view.draw((4.0, 3.0, 0.0))
    for y in (1.2, 2.0, 3.0, 4.8):
        assert colour_at(image, view.frame, (4.95, y)) == palette.MAPPED
        assert colour_at(image, view.frame, (4.85, y)) == palette.FREE
        assert colour_at(image, view.frame, (5.05, y)) == palette.UNKNOWN


def test_laser_ends_and_cones_reach_as_far_as_they_read(view):
    pose = np.array([4.0, 3.0, 0.0])
    scan = np.full(271, 2.0)
    image = view.draw(pose, reading(scan, pose=pose))
    assert colour_at(image, view.frame, (4.66 + 2.0, 3.0)) == palette.LASER
    through_gap = view.draw(pose, reading(np.where(np.arange(271) == 135, 3.0, scan), pose=pose))
    assert colour_at(through_gap, view.frame, (4.66 + 3.0, 3.0)) == palette.LASER
    fan = over(palette.LASER, palette.FREE, 0.10)
    assert np.abs(colour_at(image, view.frame, (4.66 + 1.9, 3.0)) - fan).max() <= 2
    assert colour_at(image, view.frame, (4.66 + 2.1, 3.0)) == palette.FREE
    fresh, old = (
        view.draw(pose, reading((), pose=pose, ultrasonic=1.0, age=a)) for a in (0.0, 0.9)
    )
    at = to_world((0.40, 0.31 + 0.8), pose)  # inside the left wide cone
    ground = np.array(palette.FREE)
    strength = [np.abs(colour_at(i, view.frame, at) - ground).sum() for i in (fresh, old)]
    assert strength[0] > strength[1] > 0
    for image in (fresh, old):
        assert colour_at(image, view.frame, to_world((0.40, 0.31 + 1.1), pose)) == palette.FREE


def test_no_echo_draws_no_point_and_bad_values_do_no_harm(view):
    pose = (4.0, 3.0, 0.0)
    for bad in (np.nan, np.inf, -np.inf):
        image = view.draw(pose, reading(np.full(271, bad), pose=pose, ultrasonic=bad))
        assert not (image == palette.LASER).all(axis=-1).any()


def test_estimate_is_drawn_only_where_it_differs(view):
    pose = np.array([4.0, 3.0, 0.5])
    assert (view.draw(pose, reading((), pose=pose)) == view.draw(pose)).all()
    ghost = view.draw(pose, reading((), pose=np.add(pose, (0.3, 0.0, 0.0))))
    assert (ghost == palette.ESTIMATE).all(axis=-1).any()


def test_same_arguments_give_the_same_picture_and_leave_the_background(view):
    before = view.background.image.copy()
    pose = (4.0, 3.0, 0.5)
    arguments = {
        "trail": [(3, 3), (4, 3)],
        "path": [(3, 3), (5, 4), (7, 5)],
        "look_ahead": [(5, 4)],
        "caption": "1.0 s",
    }
    first, second = (
        view.draw(pose, reading(np.full(90, 1.5), pose=pose), **arguments) for _ in "ab"
    )
    assert (first == second).all()
    assert (view.background.image == before).all()
    assert (TopView(room()).draw(pose) == view.draw(pose)).all()


@pytest.mark.parametrize("size", [320, 641, 1000, (480, 640), (640, 360)])
def test_pictures_have_the_size_asked_for_and_even_sides(size):
    image = TopView(room(), size=size).draw((4.0, 3.0, 0.0))
    height, width = image.shape[:2]
    assert image.dtype == np.uint8
    assert (height % 2, width % 2) == (0, 0)
    assert (height, width) == size if isinstance(size, tuple) else abs(max(image.shape) - size) <= 1


def test_walls_in_any_order_and_direction_fill_the_same():
    rng = np.random.default_rng(1)
    diamond = polygon_edges([(1, 1), (2, 2), (1, 3), (0, 2)])
    touching = polygon_edges([(2, 2), (3, 1), (4, 2), (3, 3)])  # shares a corner
    walls = np.vstack([diamond, touching])
    images = []
    for _ in range(4):
        mixed = walls[rng.permutation(len(walls))]
        swap = rng.random(len(mixed)) < 0.5
        mixed[swap] = mixed[swap][:, [2, 3, 0, 1]]
        assert sum(map(len, floor.closed_loops(mixed))) == len(walls)
        fine = floor.new_canvas((-1, 0, 5, 4), 640).resized(floor.FINE)
        floor.draw_obstacles(fine, mixed, no_discs())
        images.append(fine.resized(1 / floor.FINE).image)
    for image in images[1:]:
        # Only the rounding of strokes may depend on the direction in which they are drawn.
        assert np.abs(image.astype(int) - images[0]).max() <= 40
        assert ((image == palette.SOLID) == (images[0] == palette.SOLID)).mean() > 0.999


def test_plan_shows_solids_holes_path_and_tree():
    hole = [(1.5, 1.5), (2.5, 1.5), (2.5, 2.5), (1.5, 2.5)]
    square = [(1, 1), (3, 1), (3, 3), (1, 3)]
    path, tree = [(0.5, 0.5), (5.0, 0.5), (5.5, 3.5)], [(4.0, 2.0, 4.0, 3.0)]
    picture = PlanPicture(*BARE, path, tree, polygons=[square, hole])
    image, frame = picture.draw(), floor.new_canvas((-0.06, -0.06, 6.06, 4.06), 640).frame
    assert colour_at(image, frame, (1.2, 2.0)) == palette.SOLID
    assert colour_at(image, frame, (2.0, 2.0)) == palette.FREE
    assert colour_at(image, frame, (3.0, 0.5)) == palette.TRAIL
    assert np.abs(np.subtract(colour_at(image, frame, (4.0, 2.5)), palette.FREE)).sum() > 60


def test_a_legend_names_what_is_drawn_and_nothing_else():
    drawn = {
        "path": [(0.5, 0.5), (5.5, 0.5), (5.5, 3.5)],
        "tree": [(4.0, 2.0, 4.0, 3.0)],
        "optimum": [(0.5, 0.5), (5.5, 3.5)],
        "swarm": [("whale", palette.ORANGE, [(0.5, 0.5), (0.5, 3.5), (5.5, 3.5)])],
        "outlines": [[(0.2, 0.2), (0.8, 0.2), (0.8, 0.8), (0.2, 0.8)]],
    }
    colours = {
        "path": palette.TRAIL, "tree": palette.TREE, "optimum": palette.OPTIMUM,
        "swarm": palette.ORANGE, "outlines": palette.OUTLINE,
    }  # fmt: skip
    plain = PlanPicture(*BARE, **drawn).draw()
    full = PlanPicture(*BARE, **drawn).draw(legend=True)
    rows = len(full) - len(plain)
    np.testing.assert_array_equal(full[rows:], plain)
    for left_out in drawn:
        some = {name: what for name, what in drawn.items() if name != left_out}
        legend = PlanPicture(*BARE, **some).draw(legend=True)[:rows]
        for name, colour in colours.items():
            assert (legend == colour).all(axis=-1).any() == (name != left_out), (name, left_out)


@pytest.mark.parametrize("words", [1, 12, 60])
def test_a_caption_above_a_picture_has_all_its_words(words):
    """Each word changes the picture, which grows by rows; the drawing below stays."""
    said = ["solved"] * words
    picture = PlanPicture(*BARE)
    whole, bare = (picture.draw(caption=c, legend=True) for c in (" ".join(said), ""))
    assert len(whole) > len(bare)
    np.testing.assert_array_equal(whole[len(whole) - len(bare) + 30 :], bare[30:])
    for k in {0, words // 2, words - 1}:
        other = " ".join([*said[:k], "failed", *said[k + 1 :]])
        assert (picture.draw(caption=other, legend=True) != whole).any(), k


@pytest.mark.parametrize("beam", [0, 135, 270])
def test_a_lone_beam_without_echo_is_no_spike(view, beam):
    pose = (4.0, 3.0, 0.0)
    scan = np.full(271, 1.0)
    scan[beam] = np.inf
    angle = math.radians(beam - 135)
    beyond = (4.66 + 1.3 * math.cos(angle), 3.0 + 1.3 * math.sin(angle))
    assert colour_at(view.draw(pose, reading(scan, pose=pose)), view.frame, beyond) == palette.FREE


@pytest.mark.parametrize("size", [(640, 320), (480, 640), 320, 1000])
@pytest.mark.parametrize("words", [1, 8, 40])
def test_a_caption_stays_clear_of_the_scale_bar(size, words):
    view = TopView(room(), size=size)
    said = "12.3 m" + " and 4.5 m" * words
    bare, captioned = (view.draw((4.0, 3.0, 0.0), caption=c) for c in ("", said))
    strip = floor.strip_height(max(bare.shape[:2]))
    bar = np.argwhere((bare[-strip + 3 :].astype(int).sum(axis=-1) < 500).any(axis=0)).min()
    written = np.argwhere((bare != captioned).any(axis=(0, 2)))
    assert 0 < written.min() < strip
    assert written.max() < bar
    gap = 0.1 * strip  # what ends there was not cut off
    assert written.max() < bar - gap


def test_movers_are_drawn_at_their_true_shapes():
    """A person, a box, a leaf and an obstacle that is not there."""
    things = [
        person([(3.0, 3.0)], radius=0.3),
        furniture((5.0, 3.0, 0.0), (0.8, 0.4), 5.0),
        door((4.0, 2.0), 0.0, 1.0, 1.0),
        obstacle((2.5, 2.0), 0.3),
    ]
    episode = dataclasses.replace(room(), actors=combine(things))
    view = TopView(episode)
    poses = episode.actors.rows["pose"].copy()
    poses[3] = np.nan
    image = view.draw((7.0, 3.0, 0.0), actors=poses)
    plain = view.draw((7.0, 3.0, 0.0))
    for point, colour in (
        ((3.2, 3.1), palette.PERSON), ((5.3, 3.1), palette.LIGHT), ((4.5, 2.0), palette.LEAF),
    ):  # fmt: skip
        assert colour_at(image, view.frame, point) == colour
    for point in ((3.0, 3.4), (5.0, 3.3), (4.5, 2.2), (2.5, 2.0)):
        assert colour_at(image, view.frame, point) == colour_at(plain, view.frame, point)
