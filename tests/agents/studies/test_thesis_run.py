"""The thesis's program: from a drawn map and its settings file to polygons, commands and a film."""

import json
import re

import cv2
import numpy as np
import pytest
import shapely
from PIL import Image, ImageDraw

from agents.cli import main
from agents.studies.plan_pictures import PlanPictures, controls_of, problem_of
from planners import Status, make_planner
from planners.judge import Judge
from planners.rrt_star_woa import thesis
from tests.conftest import refusal
from tests.planners.test_thesis import FIGURE as FIGURE_TEXT
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid, occupied_polygons, read_grid

CELL = 0.1  # m: edge of a pixel
ENDS = {"resolution": CELL, "start": [1.0, 1.0], "goal": [11.0, 7.0]}
OPTIONS = ["--resolution", "0.1", "--start", "1,1", "--goal", "11,7"]
FIGURE = json.loads(thesis.without_trailing_commas(FIGURE_TEXT)) | {
    "TestMode": False, "MapProcessor_Obstacles_Dilation": 4, "MapProcessor_Epsilon": 0.5,
    "MapProcessor_Map_Name": "hall.png",
}  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with images of halls of 12 m x 8 m; commands run in another one."""
    image = Image.new("L", (120, 80), "white")
    draw = ImageDraw.Draw(image)
    draw.rectangle((40, 30, 44, 79), fill="black")
    draw.rectangle((75, 0, 79, 45), fill="black")
    draw.ellipse((95, 30, 105, 40), fill="black")
    draw.line((10, 20, 30, 10), fill="black")  # thin
    maps = tmp_path / "maps"
    maps.mkdir()
    image.save(maps / "hall.png")
    image.transpose(Image.Transpose.FLIP_LEFT_RIGHT).save(maps / "5.png")
    Image.new("L", (120, 80), "black").save(maps / "black.png")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return maps


@pytest.fixture
def short_films(monkeypatch):
    """Few pictures of the tree, of the whales and of the roll-out."""
    for name, pictures in (("GROWTH", 5), ("SWARM", 3), ("DRIVE", 4)):
        monkeypatch.setattr(f"agents.studies.plan_pictures.{name}", pictures)


def settings(folder, **changes):
    path = folder / "figure.json"
    path.write_text(json.dumps({**FIGURE, **changes})[:-1] + ",}")
    return path


def solid_pixels(path):
    """Return solid pixels of an image or its border as squares [m], without the program's code."""
    dark = np.array(Image.open(path).convert("L"))[::-1] < 128
    dark[[0, -1]] = dark[:, [0, -1]] = True
    rows, columns = np.nonzero(dark)
    x, y = columns * CELL, rows * CELL
    return shapely.union_all(shapely.box(x, y, x + CELL, y + CELL))


@pytest.mark.parametrize("epsilon", [0.3, 1.0, 3.0])
@pytest.mark.parametrize("seed", range(3))
def test_polygons_stay_within_epsilon_of_the_outline(seed, epsilon):
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.random((90, 120)).astype(np.float32), (0, 0), 4.0)
    grid = OccupancyGrid(np.where(noise < np.quantile(noise, 0.3), OCCUPIED, FREE), 1.0)
    exact, rough = (
        [shapely.LinearRing(region.outer) for region in occupied_polygons(grid, epsilon=e)]
        for e in (0.0, epsilon)
    )
    gaps = [shapely.hausdorff_distance(a, b, 0.05) for a, b in zip(exact, rough, strict=True)]
    assert max(gaps) <= epsilon + 1e-6
    if epsilon >= 1.0:
        corners = [sum(shapely.get_num_coordinates(rings)) for rings in (exact, rough)]
        assert corners[1] < 0.5 * corners[0]


def test_a_thin_wall_stays_at_every_epsilon(folder):
    grid = read_grid(folder / "hall.png", resolution=CELL)
    for epsilon in (0.0, 5.0):
        found = occupied_polygons(grid, epsilon=epsilon)
        wall = shapely.LineString([(1.2, 5.9), (2.8, 6.8)])
        assert any(shapely.intersects(shapely.Polygon(region.outer), wall) for region in found)


@pytest.mark.parametrize("planner", thesis.PLANNERS_OF_FILE)
@pytest.mark.parametrize(("dilation", "epsilon"), [(0, 0.02), (3, 0.5), (5, 1.0)])
def test_paths_are_free_on_polygons_and_on_the_dilated_image(folder, planner, dilation, epsilon):
    file = thesis.read_thesis(
        settings(folder, MapProcessor_Obstacles_Dilation=dilation, MapProcessor_Epsilon=epsilon)
    )
    drawn = problem_of(file, **ENDS)
    solid = solid_pixels(folder / "hall.png")
    for seed in range(5):
        found = make_planner(file.planner(planner)).plan(drawn.problem, np.random.default_rng(seed))
        assert found.status is Status.SOLVED
        assert not [*Judge.of(drawn.problem).faults(found.path, *np.array([[1, 1], [11, 7.0]]))]
        gap = shapely.distance(shapely.LineString(found.path), solid)
        # Outlines cut corners by at most half a pixel, and leave out at most epsilon.
        assert gap >= (dilation - 0.5 - epsilon) * CELL
        if dilation == 0:  # the path's own depth, where it crosses a cut corner
            inside = shapely.intersection(shapely.LineString(found.path), solid.buffer(-0.6 * CELL))
            assert inside.length == 0.0


def test_commands_keep_the_chair_off_the_image(folder):
    file = thesis.read_thesis(settings(folder, MapProcessor_Epsilon=0.02))
    drawn = problem_of(file, **ENDS)
    found = make_planner(file.planner()).plan(drawn.problem, np.random.default_rng(0))
    made = controls_of(drawn, found, 0)
    assert made.arrived
    assert made.collision_free
    assert np.hypot(*(made.rollout[-1, :2] - [11.0, 7.0])) < 0.2
    assert shapely.distance(shapely.LineString(made.rollout[:, :2]), solid_pixels(
        folder / "hall.png")) > 0.25  # fmt: skip


CHANGED = {
    "ReturnOnFirstPath": False, "MapProcessor_Obstacles_Dilation": 6, "MapProcessor_Epsilon": 3.0,
    "MapProcessor_Map_Name": "5", "PathPlanner_Iterations": 50, "PathPlanner_Step_Size": 0.5,
    "PathPlanner_Search_Radius": 3.0, "PathPlanner_Goal_Threshold": 3.0,
    "PathOptimizer_Population": 20, "PathOptimizer_Iterations": 40,
    "PathOptimizer_a_Parameter": 1.0, "PathOptimizer_b_Parameter": 0.2,
    "PathOptimizer_Shortness_Weight": 0.0, "PathOptimizer_Collision_Free_Weight": 1000.0,
    "PathOptimizer_Width_Bound": 0.5, "PathOptimizer_Height_Bound": 0.5,
}  # fmt: skip


def outcome(path):
    file = thesis.read_thesis(path)
    drawn = problem_of(file, **ENDS)
    plans = [
        make_planner(file.planner()).plan(drawn.problem, np.random.default_rng(seed))
        for seed in range(3)
    ]
    return drawn.problem.space.free.area, [(p.path.tolist(), len(p.tree)) for p in plans]


@pytest.mark.parametrize("key", sorted(CHANGED))
def test_each_key_of_map_and_planner_changes_the_plan(folder, key):
    area, plans = outcome(settings(folder))
    other_area, other_plans = outcome(settings(folder, **{key: CHANGED[key]}))
    assert plans != other_plans
    assert (abs(area - other_area) > 0.01) == key.startswith("MapProcessor")


def test_the_other_keys_draw_film_or_say_that_they_do_nothing(folder, capsys):
    assert set(thesis.KEYS) - set(CHANGED) == {"RenderGraphics", "CreateVideo", "TestMode"}
    path = settings(folder, RenderGraphics=True, TestMode=True)
    assert main(["plan", "--config", str(path), *OPTIONS]) == 0
    said = capsys.readouterr()
    assert re.match(r"solved: .* commands arrive in .* s, free of contact\n", said.out)
    assert said.err.splitlines()[-1].endswith("TestMode: the thesis does not say what it does")
    picture = np.array(Image.open("figure.png"))
    for colour in ((213, 94, 0), (0, 114, 178), (86, 180, 233), (58, 64, 72), (158, 165, 173)):
        assert (picture == colour).all(axis=-1).sum() > 50  # path, roll-out, tree, solid, dilated
    before = (folder.parent / "here" / "figure.png").read_bytes()
    said = refusal(["plan", "--config", path, *OPTIONS], capsys)
    assert "RenderGraphics would overwrite figure.png; name it with --picture" in said
    assert (folder.parent / "here" / "figure.png").read_bytes() == before
    again = [*OPTIONS, "--picture", "figure.png"]
    assert main(["plan", "--config", str(path), *again]) == 0


def test_a_film_grows_the_tree_shows_whales_and_drives_the_commands(folder, short_films):
    file = thesis.read_thesis(settings(folder))
    drawn, planner = problem_of(file, **ENDS), make_planner(file.planner())
    found = planner.plan(drawn.problem, np.random.default_rng(1))
    frames = [*PlanPictures(drawn, planner, found, 1, controls_of(drawn, found, 1)).film()]
    assert len({frame.shape for frame in frames}) == 1
    assert len(frames) == 5 + 3 + 4 + 15  # the last picture stays for a second
    tree, path, rollout, best = (
        [int((frame == colour).all(axis=-1).sum()) for frame in frames]
        for colour in ((86, 180, 233), (213, 94, 0), (0, 114, 178), (0, 158, 115))
    )
    assert tree[0] < tree[2] < tree[4]
    assert path[3] == 0 < path[4]  # it is there with the last sample
    assert best[4] < best[7]  # whales: the best free path, beside the goal
    assert rollout[8] < rollout[9] < rollout[10] < rollout[11] == rollout[-1]


def test_create_video_writes_a_film_once(folder, capsys, short_films, monkeypatch):
    monkeypatch.setattr("agents.cli.plan.video_suffix", lambda: ".gif")
    path = settings(folder, CreateVideo=True)
    assert main(["plan", "--config", str(path), *OPTIONS]) == 0
    with Image.open("figure.gif") as film:
        assert film.n_frames == 5 + 3 + 4  # equal pictures are one
    capsys.readouterr()
    said = refusal(["plan", "--config", path, *OPTIONS], capsys)
    assert "CreateVideo would overwrite figure.gif" in said


def test_a_planner_of_the_thesis_takes_its_settings_from_the_file(folder, capsys):
    path = str(settings(folder, PathPlanner_Iterations=3))
    for name in ("rrt_star", "rrt_star_woa_local", thesis.GLOBAL):
        assert main(["plan", "--config", path, *OPTIONS, "--planner", name]) == 1
    assert "without effect: PathOptimizer_Population, " in capsys.readouterr().err
    assert main(["plan", "--config", path, *OPTIONS, "--planner", "a_star"]) == 0


WRONG = {
    "missing image": ({"MapProcessor_Map_Name": "no.png"}, OPTIONS, "no.png"),
    "unknown map": ({"MapProcessor_Map_Name": "9"}, OPTIONS, "MapProcessor_Map_Name is '9'"),
    "black image": ({"MapProcessor_Map_Name": "black.png"}, OPTIONS, "black.png: all of it is"),
    "all dilated": ({"MapProcessor_Obstacles_Dilation": 38}, OPTIONS, "Obstacles_Dilation 38 and"),
    "huge dilation": ({"MapProcessor_Obstacles_Dilation": 10**6}, OPTIONS, "Dilation is 1000000;"),
    "start in an obstacle": ({}, [*OPTIONS[:3], "4.2,2", *OPTIONS[4:]], "the start (4.2, 2) lies"),
    "start in the dilation": ({}, [*OPTIONS[:3], "3.8,2", *OPTIONS[4:]], "the start (3.8, 2) lies"),
    "no scale": ({}, OPTIONS[2:], "hall.png: an image has no scale"),
    "a second scale": ({"MapProcessor_Map_Name": "3"}, OPTIONS, "thesis_3: the resolution is"),
    "no start": ({}, OPTIONS[:2], "hall.png needs --start and --goal"),
    "unknown film": ({}, [*OPTIONS, "--video", "film.avi"], "film.avi: expected a name"),
}


@pytest.mark.parametrize("case", sorted(WRONG))
def test_what_is_wrong_is_named_in_one_line(folder, capfd, case):
    changes, options, says = WRONG[case]
    path = settings(folder, **changes)
    assert says in refusal(["plan", "--config", path, *options], capfd)
