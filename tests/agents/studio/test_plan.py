"""Maps that people draw are what planners, problem files and map files get."""

import json
from types import SimpleNamespace
from urllib.parse import unquote

import numpy as np
import pytest
import shapely
from PIL import Image

from agents.studio import plan_session
from agents.studio.plan_session import PlanSession, answer, blank, drawn, loaded, problem_of
from planners.problem_files import read_problems
from tests.agents.studio.served import START, messages, send
from tests.agents.studio.test_server import get
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid, read_map, write_map

WALL, DOOR, FURNITURE, RUB_OUT = range(len(plan_session.SHAPES))
ENDS = [1.5, 4.0], [8.5, 4.0]


def length(grid, clearance=0.36):
    return answer("visibility", problem_of(grid, *ENDS, clearance), 0, 5.0)[1]["length"]


def test_a_wall_blocks_a_door_opens_and_furniture_stands_in_the_way():
    room = blank(10.0, 8.0)
    assert length(room) == pytest.approx(7.0)
    wall = [WALL, 5.0, 0.0, 5.0, 8.2]
    assert length(drawn(room, [wall])) is None
    through = length(drawn(room, [wall, [DOOR, 5.0, 1.5, 5.0, 2.6]]))
    assert 7.5 < through < 9.0
    assert length(drawn(room, [wall, [DOOR, 5.0, 1.5, 5.0, 1.9]])) is None  # too narrow
    assert 7.0 < length(drawn(room, [[FURNITURE, 4.0, 3.5, 5.0, 4.5]])) < through
    assert length(drawn(room, [wall, [RUB_OUT, 4.0, 3.0, 6.0, 5.0]])) == pytest.approx(7.0)
    assert length(drawn(room, [[WALL, -9.0, -9.0, -5.0, 30.0]])) == pytest.approx(7.0)  # outside


def test_shapes_may_be_points_and_lie_at_the_border():
    room = blank(4.0, 3.0)
    for shape in ([WALL, 2, 2, 2, 2], [FURNITURE, 1, 1, 1, 1], [DOOR, 0, 0, 0, 0]):
        assert drawn(room, [shape]).shape == room.shape
    assert drawn(room, []).cells.tobytes() == room.cells.tobytes()


@pytest.mark.parametrize("seed", range(5))
def test_rectangles_cover_what_is_solid_and_nothing_else(seed):
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((17, 23)) < 0.4, OCCUPIED, FREE).astype(np.int8)
    found = np.zeros(cells.shape, int)
    boxes = plan_session.rectangles(OccupancyGrid(cells, 0.1)) / 0.1
    for x0, y0, x1, y1 in np.rint(boxes).astype(int):
        found[y0:y1, x0:x1] += 1
    assert (found == (cells == OCCUPIED)).all()  # each cell once


def test_a_saved_problem_has_the_same_shortest_path(tmp_path):
    shapes = [[WALL, 5.0, 0.0, 5.0, 6.0], [FURNITURE, 6.0, 5.0, 7.5, 6.5]]
    moved = OccupancyGrid(blank(10.0, 8.0).cells, 0.05, (-2.0, 3.0, 0.0))
    for grid, at in ((drawn(blank(10.0, 8.0), shapes), (0.0, 0.0)), (moved, (-2.0, 3.0))):
        ends = [[x + at[0], y + at[1]] for x, y in ENDS]
        path = tmp_path / "drawn.json"
        plan_session.write_problem(path, grid, *ends)
        ((problem, optimum),) = read_problems(path)
        assert optimum is None
        expected = answer("visibility", problem_of(grid, *ends, 0.0), 0, 5.0)[1]["length"]
        assert answer("visibility", problem, 0, 5.0)[1]["length"] == pytest.approx(expected)
        area = shapely.area(problem.space.solid)
        beyond = 10.2 * (10.2 - 8.2)  # what the square adds
        assert area == pytest.approx((grid.cells == OCCUPIED).sum() * 0.05**2 + beyond, abs=1e-6)
    turned = OccupancyGrid(grid.cells, 0.05, (0.0, 0.0, 0.3))
    with pytest.raises(InputError, match=r"turned by 0\.3"):
        plan_session.write_problem(path, turned, *ENDS)


def test_a_saved_map_is_the_same_map(tmp_path):
    grid = drawn(blank(4.0, 3.0), [[FURNITURE, 1.0, 1.0, 2.0, 2.0]])
    write_map(grid, tmp_path / "mine.yaml", suffix=".png")
    for again in (read_map(tmp_path / "mine.yaml"), loaded(tmp_path / "mine.yaml", 0.05)):
        assert (again.cells == grid.cells).all()


@pytest.mark.parametrize(
    "image", ["../secret.png", "/etc/secret.png", "sub/a.png", 3, "", "none.png"]
)
def test_a_map_file_names_no_image_elsewhere(tmp_path, image):
    write_map(blank(4.0, 3.0), tmp_path / "secret.yaml", suffix=".png")
    folder = tmp_path / "uploads"
    (folder / "sub").mkdir(parents=True)
    text = (tmp_path / "secret.yaml").read_text().replace("secret.png", json.dumps(image))
    (folder / "mine.yaml").write_text(text)
    with pytest.raises(InputError, match=r"^mine\.yaml: ") as error:
        loaded(folder / "mine.yaml", 0.05)
    assert str(tmp_path) not in str(error.value)


@pytest.mark.parametrize("name", ["rrt", "rrt_star", "rrt_connect", "swarm", "rrt_woa", "prm"])
def test_what_grew_ends_with_the_plan(name):
    grid = drawn(blank(10.0, 8.0), [[WALL, 5.0, 0.0, 5.0, 6.0]])
    problem = problem_of(grid, *ENDS, 0.36)
    plan, row = answer(name, problem, 3, 5.0)
    assert row["grows"]
    assert row["clearance_min"] >= 0.35
    frames = list(plan_session.frames_of(name, problem, plan, 3))
    assert np.allclose(frames[-1]["path"], plan.path[:, :2], atol=0.006)
    assert len(frames) > 5
    made = [frame["iterations"] for frame in frames]
    assert made == sorted(set(made))
    found = [frame["length"] for frame in frames if frame["path"]]
    assert found[-1] == pytest.approx(plan.length)


def post(served, name, content, **headers):
    headers = {"Origin": f"http://{served.host}"} | headers
    path = f"/maps/{name}?token={served.studio.access.token}"
    try:
        return get(served, path, "POST", content, **headers)[0]
    except (BrokenPipeError, ConnectionResetError):  # it does not read the rest
        return 413


def test_uploads_are_maps_of_a_bare_name_and_a_limited_size(served, tmp_path):
    write_map(blank(5.0, 4.0), tmp_path / "hall.yaml", suffix=".png")
    files = {name: (tmp_path / name).read_bytes() for name in ("hall.yaml", "hall.png")}
    for name, content in files.items():
        assert post(served, name, content) == 204
    for name in ("Grundriss%20K%C3%BCche.PNG", "Plan%20(2).png", "%E8%A8%BA%E7%99%82%E6%89%80.png"):
        assert post(served, name, files["hall.png"]) == 204
        (served.studio.folder / "uploads" / unquote(name)).unlink()
    for name in ("..%2fx.yaml", "%2e%2e", "x.py", ".x.yaml", "a%00.png", "x" * 200 + ".png"):
        assert post(served, name, b"x") in (400, 404, 405)
    assert post(served, "big.png", b"x" * (33 << 20)) == 413
    assert post(served, "hall.png", b"x", Origin="http://evil.example") == 403
    assert sorted(p.name for p in (served.studio.folder / "uploads").iterdir()) == sorted(files)
    with served.socket("plan") as socket:
        messages(socket, "map")
        send(socket, "load", name="hall.yaml", resolution=0.05)
        shown = messages(socket, "map")
        assert shown["bounds"] == [0.0, 0.0, 5.2, 4.2]
        for name in ("../hall.yaml", "none.yaml", "..", ""):
            send(socket, "load", name=name, resolution=0.05)
            assert "load.name" in messages(socket, "error")["text"]
        post(served, "broken.png", b"no picture")
        send(socket, "load", name="broken.png", resolution=0.05)
        assert messages(socket, "error")["text"].startswith("broken.png")


def test_large_images_are_refused_before_they_are_decoded_and_loading_can_be_cancelled(
    tmp_path, monkeypatch
):
    (tmp_path / "uploads").mkdir()
    Image.new("L", (10_000, 10_000), 255).save(tmp_path / "uploads" / "large.png")  # 100 kB
    Image.new("L", (300, 200), 255).save(tmp_path / "uploads" / "Küche 1.png")
    sent = []
    session = PlanSession({}, tmp_path, SimpleNamespace(send=lambda *_, **x: sent.append(x)))
    with pytest.raises(InputError, match=r"^large.png: 100,000,000 .* at most 25,000,000: make"):
        session.on_load({"name": "large.png", "resolution": 0.01, "cancels": 0})
    load = {"name": "Küche 1.png", "resolution": 0.05, "cancels": 0}
    for act, bounds in (
        (lambda: session.on_load(load), (0, 0, 15, 10)),
        (lambda: session.on_scale({"factor": 2.0}), (0, 0, 30, 20)),
    ):
        act()
        assert sent[-1]["bounds"] == pytest.approx(bounds)
    cancelled = lambda *_: session.receive({"type": "cancel"})  # noqa: E731
    monkeypatch.setattr("agents.studio.plan_session.loaded", cancelled)
    with pytest.raises(InputError, match="cancelled; the map is as it was"):
        session.on_load(load)
    assert session._grid.bounds == pytest.approx(bounds)
    monkeypatch.setattr(session, "_waiting", SimpleNamespace(put_nowait=sent.append))
    ends = {"start": [1.5, 4.0], "goal": [8.5, 4.0], "clearance": 0.3}
    session.receive({"type": "plan", "planners": ["a_star"], "seed": 0, "deadline": 1.0, **ends})
    asked = sent.pop()
    cancelled()
    sent.clear()
    session.on_plan(asked)  # which waited for its turn
    assert sent == [{}]  # planned, and nothing before it
    monkeypatch.undo()
    session.close()


def test_far_ends_are_the_first_and_last_place_with_room():
    grid = drawn(blank(5.0, 4.0), [[FURNITURE, 0.0, 0.0, 2.0, 2.0]])
    places = grid.to_world(np.argwhere(grid.traversable(0.4)))
    assert plan_session.far_ends(grid, "x") == (places[0].tolist(), places[-1].tolist())


def test_a_place_is_planned_on_and_a_saved_map_is_driven_on(served, monkeypatch):
    place = served.studio.places["scene:map_file"]
    ours = place._replace(env={**place.env, "model": "rear"})  # as with --model
    monkeypatch.setitem(served.studio.places, "scene:map_file", ours)
    with served.socket("plan") as socket:
        messages(socket, "map")
        send(socket, "place", place="scene:crowd", seed=3)
        shown = messages(socket, "map")
        asked = {key: shown[key] for key in ("start", "goal")}
        send(socket, "plan", planners=["a_star", "rrt_star"], clearance=0.3, deadline=10.0, seed=0,
             **asked)  # fmt: skip
        rows = [messages(socket, "plan") for _ in range(2)]
        assert [row["planner"] for row in rows] == ["a_star", "rrt_star"]
        assert {row["status"] for row in rows} == {"solved"}
        messages(socket, "planned")
        send(socket, "save", what="map", name="../mine", **asked)
        assert "save.name" in messages(socket, "error")["text"]
        send(socket, "save", what="map", name="mine", **asked)
        assert messages(socket, "saved")["files"] == ["mine.yaml", "mine.png"]
        send(socket, "draw", shapes=[[7, 0, 0, 1, 1]])
        assert "kind 7" in messages(socket, "error")["text"]
        send(socket, "growth", planner="bug1")
        assert "bug1" in messages(socket, "error")["text"]
    with served.socket() as socket:
        assert ["map:mine", "map", "mine"] in messages(socket, "choices")["places"]
        send(socket, "start", **START | {"place": "map:mine"})
        assert messages(socket, "world")["order"]["place"] == "map:mine"
    assert served.studio.places["map:mine"].env == ours.env
