"""A feature whose extra is not installed names that extra in one line."""

import re
import sys
import tomllib

import numpy as np
import pytest

from planners.swarm.peers import Mealpy
from tests.conftest import ROOT, refusal
from wheelchair_gym import InputError
from wheelchair_gym.recording.sink import Sink
from wheelchair_gym.rendering.video import Window, write_video

CONFIG = ["--config", str(ROOT / "configs" / "hardware.json")]
REAL = ["simulate", "--pose", "odometry", "--goal", "1,1"]
PICTURE = np.zeros((8, 8, 3), np.uint8)
DEPLOY = ["deploy", "--map", "some.yaml", "--start", "1,2,0", "--goal", "3,2"]
# Package: the module that is imported, and what needs it: words of a command, or a call.
NEEDED = {
    "pyserial": ("serial", [
        *(["hardware", what, *CONFIG] for what in ("check", "setup", "calibrate")),
        ["hardware", "monitor", "--yes", *CONFIG], [*REAL, "--chair", "hardware", *CONFIG],
        [*DEPLOY, "--chair", "hardware", *CONFIG],
    ]),
    "evdev": ("evdev", [["hardware", "drive", *CONFIG]]),
    "starlette": ("starlette", [["studio"]]),
    "uvicorn": ("uvicorn", [["studio"]]),
    "websockets": ("websockets", [
        [*REAL, "--chair", "ros://127.0.0.1:1"],
        [*DEPLOY, "--chair", "ros://127.0.0.1:1", *CONFIG],
        ["robot", "--scene", "empty"],
    ]),
    "cyclonedds": ("cyclonedds", [["robot", "--scene", "empty", "--dds"]]),
    "rosbags": ("rosbags", [
        ["simulate", "--scene", "empty", "--record", "run", "--format", "ros2"],
    ]),
    "mcap": ("mcap", [["replay", "there.mcap"]]),
    "foxglove-sdk": ("foxglove", [lambda: Sink("some.mcap")]),
    "pygame-ce": ("pygame", [Window]),
    "moviepy": ("imageio_ffmpeg", [lambda: write_video("some.mp4", [PICTURE], 10.0)]),
    "minari": ("minari", [["dataset", "some-v0", "--episodes", "1"]]),
    "optuna": ("optuna", [["tune", "window", "--vary", "horizon=1:3"]]),
    "onnx": ("onnx", [["export", "ppo_goal", "--onnx", "some.onnx"]]),
    "onnxruntime": ("onnxruntime", [["simulate", "--policy", "some.onnx"]]),
    "mealpy": ("mealpy", [lambda: Mealpy().search(None, None, 1, 1, None)]),
}  # fmt: skip
# The documentation, a log beside ours, algorithms for loops of one's own, and what benchmarks
# compare with: left out where they are not installed.
LEFT_OUT = {
    "furo", "myst-parser", "schemdraw", "sphinx", "tensorboard", "sb3-contrib", "ir-sim", "ompl",
}  # fmt: skip


def extras():
    """Package -> extra, of all but those of developers."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        table = tomllib.load(file)["project"]["optional-dependencies"]
    return {
        re.match(r"[\w-]+", one)[0]: name
        for name, ones in table.items() if name != "dev" for one in ones
    }  # fmt: skip


def test_every_package_of_an_extra_is_known_here():
    assert set(extras()) == set(NEEDED) | LEFT_OUT


@pytest.fixture
def without(monkeypatch):
    def take(name):
        for one in [m for m in sys.modules if m.partition(".")[0] == name]:
            monkeypatch.delitem(sys.modules, one)
        monkeypatch.setitem(sys.modules, name, None)

    return take


@pytest.mark.parametrize("package", NEEDED)
def test_what_needs_it_names_the_extra_in_one_line(package, without, tmp_path, monkeypatch, capsys):
    module, uses = NEEDED[package]
    without(module)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.mcap").touch()
    for use in uses:
        if isinstance(use, list):
            said = refusal(use, capsys)
        else:
            with pytest.raises(InputError) as error:
                use()
            (said,) = str(error.value).splitlines()
        assert re.search(rf"pip install ['\"]wheelchair_gym\[{extras()[package]}\]", said), said
        assert [file.name for file in tmp_path.iterdir()] == ["there.mcap"]  # nothing was begun
