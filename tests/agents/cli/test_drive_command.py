"""`wheelchair drive` over emulated boards in real time, in a process of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from agents.person.recorded_stick import schedule
from tests.conftest import PATIENCE, ROOT, until
from tests.hardware.realtime import serving
from tests.hardware.served import hear_interrupts
from wheelchair_gym.hardware.twin.lockstep import JoystickState
from wheelchair_gym.recording.replay import read_recording

pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")

CENTRED = JoystickState(dead_man=True)
PUSHED = JoystickState(forward=1.0, turn=0.2, dead_man=True)


class Program:
    """`wheelchair drive` in a process of its own, with what it says."""

    def __init__(self, served, *arguments):
        command = [sys.executable, "-m", "wheelchair_gym", "drive", "--config", str(served.config)]
        environ = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
        hear_interrupts()
        self.process = subprocess.Popen(
            [*command, *arguments], env=environ, text=True, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )  # fmt: skip
        self.said = []
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self):
        for line in self.process.stderr:
            self.said.append(line)

    def says(self, text):
        return any(text in line for line in self.said)

    def end(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._thread.join()


def rearm_by_hand(faults, after=CENTRED):
    """Take the chair with the manual switch, which re-arms board and shield, and return it."""
    for stick in (JoystickState(manual=True), JoystickState(manual=True, dead_man=True), after):
        faults.joystick = stick
        time.sleep(0.5)


@pytest.mark.realtime
def test_a_person_drives_with_help_until_ctrl_c(tmp_path):
    file = tmp_path / "drive.json"
    with serving(tmp_path) as served:
        faults, place = served.twin.faults, served.twin.plant.pose.copy()
        faults.joystick = CENTRED
        program = Program(served, "--deadline", "5", "--json", str(file))
        try:
            assert until(lambda: program.says("must re-arm")), program.said
            end = time.monotonic() + PATIENCE
            while not np.hypot(*(served.twin.plant.pose - place)[:2]) > 0.3:
                assert time.monotonic() < end, program.said
                if abs(served.twin.motion.speed) < 0.01:
                    rearm_by_hand(faults)  # a busy machine is late, and its shield latches
                faults.joystick = PUSHED
                time.sleep(1.5)
            program.process.send_signal(signal.SIGINT)
            assert program.process.wait(PATIENCE) == 0
        finally:
            program.end()
    record = json.loads(file.read_text())
    assert record["length"] > 0.2
    assert (record["assistant"], record["input"]) == ("slide", "board")
    assert record["stick_effort"] > 0.0


@pytest.mark.realtime
@pytest.mark.long
def test_prompts_are_asked_for_and_recorded(tmp_path):
    file = tmp_path / "session.mcap"
    with serving(tmp_path) as served:
        served.twin.faults.joystick = CENTRED
        words = "--deadline", "5", "--prompts", "--seconds", "4", "--record", str(file)
        program = Program(served, *words)
        try:
            assert until(lambda: program.says("must re-arm")), program.said
            rearm_by_hand(served.twin.faults)
            assert program.process.wait(PATIENCE) == 0, program.said
        finally:
            program.end()
    assert program.says("push ")
    recorded = read_recording(file)[0]
    assert recorded.labels["prompts"] == schedule(0)
    assert not np.any([action for action in recorded.actions])
