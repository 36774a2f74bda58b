"""`wheelchair drive` over emulated boards in real time, in a process of its own."""

import json
import signal
import time
from contextlib import closing

import numpy as np
import pytest

from agents.people.recorded_stick import schedule
from tests.conftest import PATIENCE, until
from tests.hardware.served import Program
from wheelchair_gym.hardware.twin.lockstep import JoystickState
from wheelchair_gym.recording.replay import read_recording

pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")

CENTRED = JoystickState(dead_man=True)
PUSHED = JoystickState(forward=1.0, turn=0.2, dead_man=True)


def drive(served):
    return "drive", "--config", str(served.config), "--deadline", "5"


def says(program, text):
    return any(text in line for line in program.errors)


def rearm_by_hand(faults, after=CENTRED):
    """Take the chair with the manual switch, which re-arms board and shield, and return it."""
    for stick in (JoystickState(manual=True), JoystickState(manual=True, dead_man=True), after):
        faults.joystick = stick
        time.sleep(0.5)


@pytest.mark.realtime
def test_a_person_drives_with_help_until_ctrl_c(served, tmp_path):
    file = tmp_path / "drive.json"
    faults, place = served.twin.faults, served.twin.plant.pose.copy()
    faults.joystick = CENTRED
    with closing(Program(*drive(served), "--json", str(file))) as program:
        assert until(lambda: says(program, "must re-arm")), program.errors
        end = time.monotonic() + PATIENCE
        while not np.hypot(*(served.twin.plant.pose - place)[:2]) > 0.3:
            assert time.monotonic() < end, program.errors
            if abs(served.twin.motion.speed) < 0.01:
                rearm_by_hand(faults)  # a busy machine is late, and its shield latches
            faults.joystick = PUSHED
            time.sleep(1.5)
        program.process.send_signal(signal.SIGINT)
        assert program.process.wait(PATIENCE) == 0
    record = json.loads(file.read_text())
    assert record["length"] > 0.2
    assert (record["assistant"], record["input"]) == ("slide", "board")
    assert record["stick_effort"] > 0.0


@pytest.mark.realtime
@pytest.mark.long
def test_prompts_are_asked_for_and_recorded(served, tmp_path):
    file = tmp_path / "session.mcap"
    served.twin.faults.joystick = CENTRED
    figures = tmp_path / "figures.json"
    words = "--prompts", "--seconds", "4", "--record", str(file), "--json", str(figures)
    with closing(Program(*drive(served), *words)) as program:
        assert until(lambda: says(program, "must re-arm")), program.errors
        rearm_by_hand(served.twin.faults)
        assert program.process.wait(PATIENCE) == 0, program.errors
    assert says(program, "push ")
    recorded = read_recording(file)[0]
    assert recorded.labels["prompts"] == schedule(0)
    assert not np.any([action for action in recorded.actions])
    record = json.loads(figures.read_text())
    assert (record["assistant"], record["agreement_angle"]) == (None, None)  # it stood
    assert "assistant" not in recorded.labels
    with closing(Program(*drive(served), "--seconds", "0")) as program:
        assert until(lambda: says(program, "must re-arm")), program.errors
        rearm_by_hand(served.twin.faults)
        assert program.process.wait(PATIENCE) == 0, program.errors
    assert "changed the stick's twist for 0 % of the time" in program.said[-1]
