"""The twin behind devices: hosts that know nothing of it open them, and are served."""

import numpy as np
import pytest

from tests.conftest import until
from wheelchair_gym.hardware.boards.link import Link
from wheelchair_gym.hardware.boards.protocol import Command, Mode, Odometry, Ranges, Rearm
from wheelchair_gym.hardware.laser.hokuyo import Hokuyo

pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")


def newest(links):
    """The newest message of each kind that links have heard since they were last asked."""
    return {type(frame.message): frame.message for link in links for frame in link.poll()}


@pytest.mark.parametrize("resets", [False, True])
def test_opening_a_port_resets_its_board_where_it_is_told_to(served, resets):
    served.drive.wire.resets_on_open = resets
    before = served.twin.drive.resets
    for count in (1, 2):
        line = Link(served.drive.path)
        assert until(lambda line=line: Odometry in newest([line]))
        line.close()
        assert until(lambda: not served.drive._open)  # it is seen that nobody has it open
        assert served.twin.drive.resets - before == (count if resets else 0)


def test_a_host_drives_through_devices(served):
    drive, ranges = Link(served.drive.path), Link(served.range.path)
    laser = Hokuyo(f"tcp://127.0.0.1:{served.lasers[0].port}")
    heard, scans = {}, []

    def driven():
        heard.update(newest((drive, ranges)))
        scans.extend(laser.poll())
        told = heard.get(Odometry)
        stopped = told is None or told.mode == Mode.STOPPED  # again, where this machine was slow
        drive.send(Command(0.0 if stopped else 0.3, 0.0))
        if stopped:
            drive.send(Rearm(0xFFFF))
        return not stopped and told.v > 0.1 and Ranges in heard and len(scans) > 5

    assert until(driven), (heard, len(scans))
    assert np.isfinite(scans[-1].scan.ranges).all()
    # Its laser is unplugged while the host is connected, and plugged in again.
    served.twin.laser.plugged = False

    def lost():
        laser.poll()
        return laser.error and laser.connection is None

    assert until(lost)
    served.twin.laser.plugged = True
    assert until(laser.poll)
    assert laser.error == ""
    # The host leaves; the chair stops by itself, and the devices stay for the next one.
    for line in (drive, ranges, laser):
        line.close()
    again = Link(served.drive.path)
    assert until(lambda: (told := newest([again]).get(Odometry)) and told.mode == Mode.STOPPED)
    again.close()
