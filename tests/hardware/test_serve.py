"""The twin behind devices: hosts that know nothing of it open them, and are served."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from tests.conftest import PATIENCE, until
from tests.hardware.conftest import build, need_pty
from tests.physics.worlds import box
from wheelchair_gym.hardware.boards.link import Link
from wheelchair_gym.hardware.boards.protocol import Command, Mode, Odometry, Ranges, Rearm
from wheelchair_gym.hardware.laser.hokuyo import Hokuyo
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.hardware.twin.plant import Plant
from wheelchair_gym.hardware.twin.serve import ServedTwin
from wheelchair_gym.sensors.settings import SensorSettings

pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")


@pytest.fixture
def served():
    for target in ("libemulator.so", "drive.elf", "range.elf"):
        build(target)
    need_pty()
    twin = Twin(Plant(sensors=SensorSettings(noise=False)))
    twin.reset(box(3.0), 0)
    twin.run(0.001)
    twin.plant.scan(0)  # compiled before real time begins
    twin.plant.ping(0)
    served, done = ServedTwin(twin), threading.Event()
    thread = threading.Thread(target=served.run, args=(done.is_set,))
    thread.start()
    yield served
    done.set()
    thread.join()
    served.close()
    twin.close()


@pytest.mark.parametrize("resets", [False, True])
def test_opening_a_port_resets_its_board_where_it_is_told_to(served, resets):
    served.drive.wire.resets_on_open = resets
    before = served.twin.drive.resets
    for count in (1, 2):
        line = Link(served.drive.path)
        assert until(lambda poll=line.poll: any(isinstance(f.message, Odometry) for f in poll()))
        line.close()
        assert until(lambda: not served.drive._open)  # it is seen that nobody has it open
        assert served.twin.drive.resets - before == (count if resets else 0)


def test_a_host_drives_through_devices(served):
    drive, ranges = Link(served.drive.path), Link(served.range.path)
    laser = Hokuyo(f"tcp://127.0.0.1:{served.laser.port}")
    heard, scans = {}, []
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        for link in (drive, ranges):
            heard |= {type(frame.message): frame.message for frame in link.poll()}
        scans += laser.poll()
        told = heard.get(Odometry)
        stopped = told is None or told.mode == Mode.STOPPED  # again, where this machine was slow
        drive.send(Command(0.0 if stopped else 0.3, 0.0))
        if stopped:
            drive.send(Rearm(0xFFFF))
        if told and told.v > 0.1 and told.mode == Mode.HOST and Ranges in heard and len(scans) > 5:
            break
        time.sleep(0.01)
    else:
        pytest.fail(f"not served: {sorted(kind.__name__ for kind in heard)}, {len(scans)} scans")
    assert np.isfinite(scans[-1].scan.ranges).all()
    # Its laser is unplugged while the host is connected, and plugged in again.
    served.twin.laser.plugged = False
    broken = False
    while time.monotonic() < end and not broken:
        laser.poll()
        broken = bool(laser.error) and laser._line.connection is None
        time.sleep(0.01)
    assert broken
    served.twin.laser.plugged = True
    while time.monotonic() < end and not laser.poll():
        time.sleep(0.01)
    assert laser.error == ""
    # The host leaves; the chair stops by itself, and the devices stay for the next one.
    for line in (drive, ranges, laser):
        line.close()
    again, told = Link(served.drive.path), None
    while time.monotonic() < end and (told is None or told.mode != Mode.STOPPED):
        frames = [f.message for f in again.poll() if isinstance(f.message, Odometry)]
        told = frames[-1] if frames else told
        time.sleep(0.02)
    assert told.mode == Mode.STOPPED
    again.close()
