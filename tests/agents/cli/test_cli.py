"""The command: wrong input is one line and code 2; JSON on stdout stands alone."""

import json
import math
import os
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from PIL import Image

from agents.cli import COMMANDS, main, parser, train
from agents.cli.arguments import changed, report, spec
from agents.cli.compare import comparison_name, scenes_of
from agents.control import FOLLOWERS
from agents.evaluation.compare import SUITES
from agents.evaluation.provenance import command_line
from planners import PLANNERS, Plan, Status, make_planner
from tests.conftest import ROOT, json_of, output_of, put, python, refusal, run
from tests.hardware.realtime import EPISODE, X, Y
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid, write_map
from wheelchair_gym.scenes import SCENES

YARD = "type octile\nheight 3\nwidth 5\nmap\n.....\n..T..\n.....\n"


@pytest.fixture(scope="module")
def hall(tmp_path_factory):
    """A map of a hall of 5 m x 4 m with a block in the middle, and files that are broken."""
    folder = tmp_path_factory.mktemp("maps")
    cells = np.full((40, 50), FREE, np.int8)
    cells[15:25, 20:30] = OCCUPIED
    write_map(OccupancyGrid(cells, 0.1), folder / "hall.yaml")
    (folder / "broken.yaml").write_text("image: [")
    text = (folder / "hall.yaml").read_text()
    (folder / "corrupt.pgm").write_bytes(b"P5\n50 40")
    (folder / "corrupt.yaml").write_text(text.replace("hall.pgm", "corrupt.pgm"))
    rects = [[2.0, 1.5, 3.0, 2.5]]
    problem = {"name": "hall", "size": 5, "rects": rects, "start": [1, 2], "goal": [4, 2]}
    (folder / "problems.json").write_text(json.dumps([problem | {"optimum": 3.2361}]))
    (folder / "broken.json").write_text("[{")
    (folder / "object.json").write_text("{}")
    (folder / "scenes.json").write_text('{"clutter": {"walls": 3}}')
    (folder / "yard.map").write_text(YARD)
    (folder / "house.json").write_text('{"verts": [[0, 0], [5, 0], [5, 4], [0, 4]]}')
    (folder / "mapless.json").write_text('{"MapProcessor_Map_Name": "9"}')
    figure = '{"MapProcessor_Map_Name": "5", "MapProcessor_Obstacles_Dilation": 4,}'
    (folder / "figure.json").write_text(figure)
    (folder / "undilated.json").write_text(figure.replace("4", "0"))
    return folder


def plan(hall, name, start="1,2", goal="4,2", planner="rrt_connect"):
    return ["plan", "--map", hall / name, "--planner", planner, "--start", start, "--goal", goal]


PLAN = "plan --map {hall}/hall.yaml --planner rrt_connect --start 1,2 --goal 4,2"
BENCH = "bench planners --no-peers"
WRONG = yaml.safe_load(Path(__file__).with_name("wrong_words.yaml").read_text())
CONFIG = "--config configs/hardware.json"
DEPLOY = f"deploy {CONFIG} --map map.yaml --start {X},{Y},0 --goal {X},{Y}"
NOOK = "0.1,2"  # free, and nearer to a wall than any side of the chair
WORDS = [[text.format(CONFIG=CONFIG, DEPLOY=DEPLOY, NOOK=NOOK) for text in row]
         for row in WRONG["words"]]  # fmt: skip


@pytest.mark.parametrize("case", sorted(WRONG["cases"]))
def test_wrong_input_is_one_line_and_code_2(hall, capfd, case):
    """Also of what compiled code says: the file descriptors are read."""
    words = WRONG["cases"][case].format(plan=PLAN.format(hall=hall), bench=BENCH, hall=hall)
    refusal(words.split(), capfd)


@pytest.mark.parametrize(("words", "says"), WORDS)
def test_wrong_words_are_named_in_one_line(words, says, tmp_path, monkeypatch, capsys):
    pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    (tmp_path / "file").touch()
    write_map(EPISODE.map, tmp_path / "map.yaml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ROS_DOMAIN_ID", "")
    monkeypatch.setattr("wheelchair_gym.hardware.boards.parameters.PATIENCE", 0.05)
    line = refusal(words.split(), capsys)
    assert says in line
    assert len(line) < 500 or "did you mean" not in line


def test_a_scene_of_a_suite_goes_by_its_label():
    (scene,) = scenes_of(["dock"], SUITES["skills"].scenes)
    assert scene["course"] == "dock"


def test_a_figure_that_does_not_exist_is_null_in_json(capsys):
    report(SimpleNamespace(json="-"), {"figures": [math.inf, {"angle": math.nan}]}, "")
    assert json.loads(capsys.readouterr().out) == {"figures": [None, {"angle": None}]}


def test_a_planner_that_finds_nothing_says_why(hall, capsys):
    assert run(*plan(hall, "hall.yaml", planner="potential_field")) == 1
    said = capsys.readouterr().err
    assert "stuck: no path was found with 0.36 m clearance: a local minimum at [" in said


@pytest.mark.parametrize("name", ["hall.yaml", "yard.map", "house.json"])
def test_maps_of_every_kind_are_planned_in(hall, capsys, name, tmp_path):
    words, picture = plan(hall, name, "1,1", "4,1", "visibility"), tmp_path / "plan.png"
    answer = json_of([*words, "--picture", picture], capsys)
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert (answer["status"], answer["path"][0], answer["path"][-1]) == ("solved", [1, 1], [4, 1])
    assert 3.0 - 1e-9 <= answer["touching"] <= answer["lower_bound"] <= answer["length"] < 4.0


@pytest.mark.parametrize("planner", [[], ["--planner", "visibility"]])
def test_a_plan_needs_no_planner_and_is_filmed_by_any(hall, tmp_path, planner):
    film, ends = tmp_path / "plan.gif", ["--start", "1,2", "--goal", "4,2"]
    assert run("plan", "--map", hall / "hall.yaml", *ends, *planner, "--video", film) == 0
    with Image.open(film) as pictures:
        assert pictures.n_frames >= (1 if planner else 10)


@pytest.mark.parametrize(("name", "y", "arrives"), [("figure", 18.5, 1), ("undilated", 19.95, 0)])
def test_the_thesis_settings_are_a_planner_and_a_map(hall, capsys, tmp_path, name, y, arrives):
    """The first search of commands misses a segment; a goal nearer to a wall than the rear does."""
    words = ["plan", "--config", hall / f"{name}.json", "--goal", f"28.5,{y}"]
    assert run(*words, "--json", tmp_path / "plan.json") == 0
    says, answer = capsys.readouterr().out, json.loads((tmp_path / "plan.json").read_text())
    assert answer["name"] == "thesis_5"
    assert (answer["path"][0], answer["path"][-1]) == ([1.5, 1.5], [28.5, y])
    assert answer["arrived"] == arrives == (answer["error"] < 0.1)
    assert ("arrive in" if arrives else "the end of segment") in says
    assert run(*plan(hall, "hall.yaml", planner=f"{words[2]}:rrt_star")) == 0


@pytest.mark.parametrize("poses", [False, True])
def test_a_path_through_a_wall_is_not_called_solved(hall, capsys, monkeypatch, tmp_path, poses):
    class Straight:
        def plan(self, problem, rng, deadline=None):
            path = np.array([problem.start[:2], problem.goal[:2]])
            return Plan(Status.SOLVED, np.hstack([path, np.zeros((2, 1))]) if poses else path)

    planner = Straight()
    if poses:
        planner.footprint = Footprint()
    monkeypatch.setattr("agents.cli.plan.make_planner", lambda spec: planner)
    picture = tmp_path / "plan.png"
    assert run(*plan(hall, "hall.yaml"), "--picture", picture) == 1
    assert picture.exists()
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("wheelchair: plan: invalid: Straight says solved, but")
    assert "inside an obstacle" in said.err
    (answer,) = json_of(["plan", "--problems", hall / "problems.json", "--planner", "rrt"], capsys)
    assert answer["status"] == "invalid"
    assert "inside an obstacle" in answer["note"]


def test_problems_are_answered_one_by_one(hall, capsys):
    arguments = ["plan", "--problems", hall / "problems.json", "--planner", "rrt_star"]
    (answer,) = json_of(arguments, capsys)
    assert set(answer) == {"name", "status", "length", "optimum", "time_s", "nodes", "note", "path"}
    assert answer["length"] >= answer["optimum"] - 1e-3


@pytest.mark.parametrize(
    "arguments", [["scenes"], ["scenes", "clutter", "--samples", "2"], ["settings", "limits"]]
)
def test_json_stands_alone_on_stdout(capsys, arguments):
    json_of(arguments, capsys)
    assert output_of(arguments, capsys).strip()


@pytest.mark.parametrize(
    ("words", "folder"),
    [("", "demo"), ("--suite homes", "homes"), ("--map a/hall.yaml,plan.png", "hall_plan"),
     ("--scenes clutter,my.json:wide", "clutter_my.json_wide"),
     ("--scenes a,b,c,d,e --suite homes", "a_b_c_and_2_more")],
)  # fmt: skip
def test_a_comparisons_folder_is_called_as_what_is_compared(words, folder):
    assert comparison_name(parser().parse_all(["compare", *words.split()])) == folder


def test_training_says_what_tensorboard_needs(monkeypatch, capsys):
    monkeypatch.setattr("agents.cli.train.find_spec", lambda name: None)
    assert run("train", "ppo", "--set", "frames=none") == 2
    assert "log needs pip install 'wheelchair_gym[learn]'" in capsys.readouterr().err


def test_training_makes_each_run_once(monkeypatch, tmp_path):
    made = []
    monkeypatch.setattr(train, "_train", lambda given, case: made.append(case.folder) or {})
    words = ["train", "bc", "--seeds", "0,1,0", "--vary", "rounds=1,2,1", "--out", str(tmp_path)]
    monkeypatch.setattr("agents.learning.folder.write_sweep", lambda *_: "")
    assert main(words) == 0
    assert made == [tmp_path / f"rounds_{k}" / f"seed_{seed}" for k in (1, 2) for seed in (0, 1)]


def test_the_version_and_completion_scripts_are_printed(capsys):
    version = output_of(["--version"], capsys)
    assert re.fullmatch(r"wheelchair \d+\.\d+\.\d+\S*\n", version)
    for shell in ("bash", "zsh"):
        assert "--planner" in output_of(["--completion", shell], capsys)


def test_an_episode_is_driven_and_drawn(capsys, tmp_path):
    config = put(tmp_path / "short.json", {"task": {"time_base": 1.0, "time_factor": 0.0}})
    picture = tmp_path / "end.png"
    arguments = ["simulate", "--policy", "straight", "--config", config, "--picture", picture]
    assert json_of(arguments, capsys)["outcome"] == "timeout"  # it was driven
    assert picture.exists()
    last = output_of(arguments, capsys).splitlines()[-1]
    assert "did not arrive (timeout) after" in last


def test_a_comparison_leaves_everything_in_its_folder(capsys, tmp_path):
    config = put(tmp_path / "short.json", {"task": {"time_base": 1.0, "time_factor": 0.0}})
    out = tmp_path / "out"
    arguments = [
        "compare", "--policies", "random,straight", "--scenes", "floor_plan", "--episodes", "1",
        "--jobs", "1", "--out", out, "--config", config, "--quiet", "--no-video",
    ]  # fmt: skip
    out.mkdir()
    (out / "episode.gif").write_bytes(b"a film of somebody")
    assert "straight" in output_of(arguments, capsys)
    assert (out / "episode.gif").exists()
    results = json.loads((out / "results.json").read_text())
    assert results["title"] == "Policies on floor_plan"
    assert set(results) == {
        "title", "command", "provenance", "policies", "scenes", "records", "summary", "video",
        "kinds",
    }  # fmt: skip
    assert (out / "table.md").exists()
    assert (out / "report.html").exists()
    first = (out / "episodes.jsonl").read_bytes()
    assert json_of(arguments, capsys)["records"] == results["records"]
    assert not (out / "episode.gif").exists()  # taken for one of the comparison that was there
    assert (out / "episodes.jsonl").read_bytes() == first


def test_a_page_names_every_command_scene_planner_and_follower():
    pages = ROOT / "README.md", ROOT / "docs" / "how_to" / "command_line.md"
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    named = set(re.findall(r"`([\w-]+)`", text))
    commands = {command.name.split()[0] for command in COMMANDS}
    scenes = {name for name in SCENES if not name.startswith("thesis")}
    assert named >= commands | scenes | set(PLANNERS) | set(FOLLOWERS)


def test_the_help_names_every_suite(capsys):
    with pytest.raises(SystemExit):
        main(["compare", "--help"])
    assert set(re.findall(r"\w+", capsys.readouterr().out)) >= set(SUITES)


def test_results_name_the_command_as_a_person_types_it(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["somewhere/__main__.py", "plan", "--map", "my hall.yaml"])
    assert command_line() == "wheelchair plan --map 'my hall.yaml'"


def test_settings_come_from_a_file_and_from_changes(tmp_path):
    """A tree that ends with the first path in its planner still does when its step is changed."""
    file = put(tmp_path / "mine.json", {"rrt_star_woa_local": {"tree": {"step": 2.0}}})
    given = spec(f"{file}:rrt_star_woa_local")
    planner = make_planner(changed(given, ["tree.iterations=30000", "whales.population=7"]))
    default = make_planner("rrt_star_woa_local")
    assert planner.tree == replace(default.tree, step=2.0, iterations=30000)
    assert planner.whales == replace(default.whales, population=7)
    assert planner.tree.return_on_first_path


def test_a_file_names_its_settings_as_it_likes(tmp_path):
    own = {"quick": {"name": "rrt_star", "step": 2.0}, "rrt": {"step": 1.0}}
    file = put(tmp_path / "mine.json", own)
    assert make_planner(spec(f"{file}:quick")) == make_planner({"name": "rrt_star", "step": 2.0})
    assert make_planner(spec(f"{file}:rrt")) == make_planner({"name": "rrt", "step": 1.0})


def test_every_world_of_a_file_with_every_pose_source(tmp_path, monkeypatch):
    worlds = [
        {"world": k, "start": [0, 0, 0], "goal": [3, 0], "circles": [[1.5, y, 0.1]],
         "reference_path_length": 4.0}
        for k, y in ((3, 0.0), (8, 2.0))
    ]  # fmt: skip
    (tmp_path / "two.json").write_text(json.dumps(worlds))
    code = run(
        "compare", "--scenes", tmp_path / "two.json", "--policies", "straight", "--training-seeds",
        "--pose", "truth,odometry", "--episodes", "1", "--out", tmp_path / "out", "--jobs", "1",
        "--quiet", "--no-video", "--shield", "off",
    )  # fmt: skip
    found = json.loads((tmp_path / "out" / "results.json").read_text())
    names = [f"two {world}, {pose}" for pose in ("truth", "odometry") for world in (3, 8)]
    assert code == 0
    assert found["scenes"] == names
    assert [record["outcome"] for record in found["records"]] == ["collision", "success"] * 2
    good = found["records"][1]
    assert good["barn"] == pytest.approx(2.0 / max(good["time"], 4.0))
    assert good["barn_own"] == pytest.approx(5.0 / max(good["time"], 10.0))
    assert (good["seed"], found["provenance"]["config"]["env"]["split"]) == (0, "train")


def test_training_starts_anew_in_its_environment_once(monkeypatch, capsys):
    """Libraries read it when they are loaded; what a person has set stays."""
    started = []
    monkeypatch.setattr(os, "execve", lambda *told: started.append(told))
    monkeypatch.setattr(sys, "argv", ["wheelchair", "train", "ppo", "--config", "none.json"])
    monkeypatch.setattr(sys, "orig_argv", ["python", "wheelchair", "train", "ppo"])
    monkeypatch.setenv("OMP_WAIT_POLICY", "ACTIVE")
    monkeypatch.delenv("GLIBC_TUNABLES", raising=False)
    assert main() == 2
    ((program, arguments, environ),) = started
    assert (program, arguments) == (sys.executable, [sys.executable, "wheelchair", "train", "ppo"])
    assert environ["OMP_WAIT_POLICY"] == "ACTIVE"
    assert environ["GLIBC_TUNABLES"] == "glibc.malloc.hugetlb=1"
    for name, value in environ.items():
        monkeypatch.setenv(name, value)
    assert main() == 2
    assert len(started) == 1
    assert capsys.readouterr().err.count("none.json") == 2


def test_warm_up_names_everything_that_it_has_compiled(capsys):
    lines = output_of(["warm-up", "--jobs", "1"], capsys).splitlines()
    said = {line.split(": ", 1)[1] for line in lines}
    assert said >= {f"planner {name}" for name in PLANNERS.built_in}
    assert said >= {f"follower {name}" for name in FOLLOWERS.built_in}
    assert len(said) == len(lines) == int(lines[0].split()[2].rstrip(","))


LOST = """
import ctypes, os, signal, sys, time
from agents import cli
signal.signal(signal.SIGINT, signal.default_int_handler)
@ctypes.CFUNCTYPE(None)
def called_by_c():
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.0)  # here the interrupt is raised, which C does not pass on
def run(given):
    called_by_c()
    while True:
        time.sleep(0.01)
cli.run, sys.argv = run, ["wheelchair", "warm-up"]
sys.exit(cli.main())
"""


def test_ctrl_c_stops_a_command_also_where_python_drops_the_interrupt():
    ran = python(LOST)
    assert (ran.returncode, ran.stderr) == (130, "wheelchair: stopped\n")
