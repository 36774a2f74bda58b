"""The twin from the command line: says where it is, does what is typed, and ends cleanly."""

import math
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from tests.conftest import ROOT, need_pty, output_of, put, refusal
from tests.hardware.conftest import build_twin
from tests.hardware.served import hear_interrupts
from wheelchair_gym.envs import EnvSettings, NavigationEnv
from wheelchair_gym.hardware.boards.protocol import Switch
from wheelchair_gym.hardware.twin.lockstep import Faults, JoystickState, Twin
from wheelchair_gym.hardware.twin.plant import PlantSettings, Slope
from wheelchair_gym.hardware.twin.serve import COMMANDS, ServedTwin, run_command
from wheelchair_gym.maps import read_map

SAID = {
    "press stop": lambda served: served.twin.faults.switches == Switch.STOP_PRESSED,
    "encoder left lost": lambda served: served.twin.faults.disconnected_encoders == [True, False],
    "encoder right swapped": lambda served: served.twin.faults.swapped_encoders == [False, True],
    "block right": lambda served: served.twin.faults.blocked_wheels == (False, True),
    "driver right -0.6": lambda served: served.twin.faults.stuck_drivers == [None, -0.6],
    "motor left inverted": lambda served: served.twin.faults.inverted_motors == [True, False],
    "motor both swapped": lambda served: served.twin.faults.swapped_motors,
    "brakes 0.2": lambda served: served.twin.faults.brake_fraction == 0.2,
    "slope 8": lambda served: served.twin.faults.slope == Slope(math.radians(8.0)),
    "slope 8 90": lambda served: served.twin.faults.slope == Slope(math.radians(8.0), math.pi / 2),
    "push -250": lambda served: served.twin.faults.push_force == -250.0,
    "push-switch held": lambda served: served.twin.faults.push_switch,
    "reset-on-open drive": lambda served: served.drive.wire.resets_on_open,
    "battery 28": lambda served: served.twin.faults.battery == 28.0,
    "sonar 3 silent": lambda served: served.twin.faults.silent_ultrasonics == {3},
    "sonar 4 0.5": lambda served: served.twin.faults.stuck_ultrasonics == {4: 0.5},
    "stick 0.5 -0.2": lambda served: (
        served.twin.faults.joystick == JoystickState(0.5, -0.2, True, True)
    ),
    "stick free": lambda served: served.twin.faults.joystick == JoystickState(manual=True),
    "unplug laser": lambda served: not served.twin.laser.plugged,
    "unplug drive": lambda served: not served.drive.wire.plugged,
    "silence laser": lambda served: served.twin.laser.silent,
    "noise 0.1": lambda served: served.range.wire.noise.corrupt == 0.1,
}


def test_words_break_it_and_mend_it():
    build_twin()
    need_pty()
    twin = Twin()
    served = ServedTwin(twin)
    for line, broken in SAID.items():
        assert run_command(served, line).endswith("done")
        assert broken(served), line
        assert run_command(served, "heal").endswith("done")
        assert not broken(served), line
    assert twin.faults == Faults()
    for line in ("hang drive", "power range"):
        assert run_command(served, line).endswith("done")
    wrong = "press, press x, driver left 2, motor left swapped, brakes 2, slope 90, battery x, "
    wrong += "battery 99, sonar 8 silent, sonar 2.5 silent, noise -1, unplug x, stick 2 0, stick x"
    for line in wrong.split(", "):
        assert f"expected {line.split()[0]}" in run_command(served, line)
    assert set(run_command(served, "help").split()) >= set(COMMANDS)
    assert run_command(served, "") == ""
    served.close()
    twin.close()


def test_policies_are_compared_on_a_twin_whose_plant_differs(tmp_path, capsys):
    build_twin()
    plant = put(tmp_path / "plant.json", {"sensors": {"laser": {"offset": 0.05}}})
    ranges = []
    for file in (None, str(plant)):
        chair = {"name": "twin", "plant": file}
        env = NavigationEnv("empty", {"sensors": {"noise": False}}, chair=chair, pose_source="mcl")
        env.reset(seed=0)
        ranges.append(env.task.reading.laser)
        for _ in range(5):
            env.step(np.array([1.0, 0.0], np.float32))
        env.reset(seed=0)  # it comes to rest before it is carried back
        assert env.chair.truth.pose == pytest.approx(env.episode.start, abs=1e-3)
        env.close()
    assert np.nanmedian(ranges[1] - ranges[0]) == pytest.approx(0.05, abs=2e-3)
    words = ["compare", "--policies", "straight", "--scenes", "empty", "--episodes", "1"]
    words += ["--no-video", "--quiet", "--jobs", "1", "--pose", "mcl", "--out", str(tmp_path)]
    assert "straight" in output_of([*words, "--chair", "twin", "--plant", plant], capsys)
    assert "--plant needs --chair twin" in refusal([*words, "--plant", str(plant)], capsys)
    plant.write_text('{"sensors": {"laser": {"of": 0.05}}}')
    message = f"{plant}.sensors.laser.of is not a setting"
    assert message in refusal([*words, "--chair", "twin", "--plant", str(plant)], capsys)
    assert PlantSettings.read({}, EnvSettings()).sensors.odometry.track_error == 0.0
    message = "chair twin: it has no pose source 'truth'"
    assert message in refusal([*words[:-4], "--pose", "truth", "--chair", "twin"], capsys)


def test_it_serves_until_it_is_told_to_end(tmp_path, request):
    build_twin()
    need_pty()
    picture = tmp_path / "end.png"
    command = [sys.executable, "-m", "wheelchair_gym", "twin", "--start", "2,2,0.5"]
    command += ["--map", "wheelchair_gym/maps/data/clinic.yaml", "--picture", str(picture)]
    command += ["--config", str(ROOT / "configs/hardware.json")]
    told = tmp_path / "told.yaml"
    command += ["--write-map", str(told)]
    hear_interrupts()
    program = subprocess.Popen(
        command, cwd=ROOT, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    request.addfinalizer(program.kill)
    lines = [program.stdout.readline() for _ in range(5)]
    places = dict(line.rsplit(maxsplit=1) for line in lines)
    assert list(places) == ["drive board", "range board", "laser", "start", "goal"]
    assert places["start"] == "2.000,2.000,0.500"
    assert min(read_map(told).shape) > 50
    assert os.path.exists(places["drive board"])
    program.stdin.write("press stop\n")
    program.stdin.flush()
    assert program.stdout.readline() == "press stop: done\n"
    program.send_signal(signal.SIGINT)
    _, said = program.communicate(timeout=600)
    assert program.returncode == 130
    assert said.strip().splitlines()[-1] == "wheelchair: stopped"
    assert picture.stat().st_size > 1000
