"""The line between host and board: noise, silence, unplugging; no damaged word is ever believed."""

import errno
import os
import subprocess
import sys
import termios
import threading

import numpy as np
import pytest

from tests.conftest import PATIENCE, ROOT, long_but, need_pty
from tests.hardware.conftest import build_twin
from tests.hardware.test_hokuyo import Clock
from tests.sim.worlds import box
from wheelchair_gym.hardware.boards import ports, protocol
from wheelchair_gym.hardware.boards.link import Link
from wheelchair_gym.hardware.boards.ports import explain
from wheelchair_gym.hardware.connection import RETRY
from wheelchair_gym.hardware.twin.board import LineNoise, SerialCable
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.hardware.twin.plant import Plant
from wheelchair_gym.sensors.settings import SensorSettings

serial = pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")


class FakePort:
    """A port whose bytes a test gives and takes; raises while unplugged."""

    def __init__(self):
        self.given, self.taken, self.plugged, self.full = b"", b"", True, False

    def read_all(self):
        self._check()
        data, self.given = self.given, b""
        return data

    def write(self, data):
        self._check()
        if self.full:
            return 0
        self.taken += data
        return len(data)

    def close(self):
        self._check()

    def _check(self):
        if not self.plugged:
            raise OSError(5, "Input/output error")


def test_a_loop_gives_back_what_was_sent():
    link = Link("loop://", opener=lambda url: serial.serial_for_url(url, timeout=0))
    numbers = [link.send(protocol.Command(0.1 * k, 0.0)) for k in range(5)]
    frames = link.poll()
    assert [frame.sequence for frame in frames] == numbers
    assert [frame.message.v for frame in frames] == pytest.approx([0.1 * k for k in range(5)])
    assert link.statistics.received == link.statistics.sent == 5
    assert link.statistics.bad == link.statistics.missed == 0
    link.close()
    assert link.send(protocol.Identify()) is None
    assert link.poll() == []


@pytest.mark.parametrize("url", ["/dev/no-such-device", "nonsense://x", "twin://nobody"])
def test_a_line_that_is_not_there_is_said_so_and_tried_again(url):
    clock = Clock()
    link = Link(url, clock)
    assert link.poll() == []
    assert link.connection is None
    assert link.error
    assert link.send(protocol.Identify()) is None
    assert link.statistics.unsent == 1


def test_an_unplugged_line_opens_again():
    clock, ports, told = Clock(), [], protocol.Identity(1, 2, 3, 4)

    def opener(_url):
        ports.append(FakePort())
        if plugged:
            return ports[-1]
        raise OSError(2, "No such file or directory")

    plugged = True
    link = Link("x", clock, opener)
    assert link.send(protocol.Identify()) == 1
    assert ports[0].taken[:1] == b"\0"  # ends a frame that the board has received in part
    ports[0].given = protocol.encode(told, 10) + protocol.encode(told, 14)
    assert len(link.poll()) == 2
    assert link.statistics.missed == 3
    ports[0].given = protocol.encode(told, 15)[:5]
    link.poll()
    plugged = ports[0].plugged = False
    assert link.poll() == []
    assert link.connection is None
    assert "Input/output" in link.error
    for _ in range(5):
        assert link.send(protocol.Identify()) is None
    clock.now += RETRY
    link.poll()
    plugged = True
    assert link.connection is None
    clock.now += RETRY
    assert link.send(protocol.Identify()) is not None
    # The half frame from before is no part of what comes now.
    ports[-1].given = protocol.encode(told, 99)
    assert len(link.poll()) == 1
    assert link.statistics.bad == 0
    assert link.statistics.opened == 2
    assert link.statistics.missed == 3


@pytest.fixture
def terminal():
    """A device that nothing else opens, and that no board stands behind."""
    need_pty()
    near, far = os.openpty()
    yield os.ttyname(far)
    os.close(near)
    os.close(far)


HOLD = """
import sys
from wheelchair_gym.hardware.boards.ports import open_port
held = open_port(sys.argv[1])
print("holds", flush=True)
sys.stdin.read()
"""


def test_a_port_is_one_program_s_alone(terminal):
    """Another one is told who has it, in one line that blames no cable."""
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, terminal], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        cwd=ROOT, text=True,
    )  # fmt: skip
    assert holder.stdout.readline() == "holds\n"
    clock = Clock()
    link = Link(terminal, clock)
    assert link.send(protocol.Identify()) is None
    assert link.error.startswith(f"{terminal} is in use by ")
    assert f"process {holder.pid}" in link.error
    assert "cable" not in link.error
    assert "\n" not in link.error
    holder.communicate("")
    clock.now += RETRY
    assert link.send(protocol.Identify()) is not None
    second = Link(terminal, clock)  # a config whose boards share a device
    second.poll()
    assert "this very program" in second.error
    link.close()


def test_closing_a_port_leaves_dtr_alone(terminal):
    """The next opening then resets no board."""
    link = Link(terminal)
    link.poll()
    reader = os.open(terminal, os.O_RDWR | os.O_NOCTTY)
    assert not termios.tcgetattr(reader)[2] & termios.HUPCL
    os.close(reader)
    link.close()


def test_what_forbids_a_port_is_told_with_what_to_do(tmp_path, monkeypatch):
    device = str(tmp_path / "ttyACM0")
    said = str(explain(device, PermissionError(errno.EACCES, "Permission denied")))
    assert device in said
    assert "sudo usermod -aG dialout $USER" in said
    by_id = tmp_path / "by-id"
    monkeypatch.setattr(ports, "_BY_ID", str(by_id))
    for there in ("no USB serial port is there", "usb-Arduino_Mega-if00"):
        link = Link(device)
        link.poll()
        assert "no such device" in link.error
        assert there in link.error
        by_id.mkdir(exist_ok=True)
        (by_id / "usb-Arduino_Mega-if00").touch()
    monkeypatch.setattr(ports, "is_running", lambda program: program == "ModemManager")
    said = str(explain(device, OSError(errno.EBUSY, "busy")))
    assert "in use by another program" in said
    assert "ModemManager" in said
    assert "ModemManager" in ports.silent_advice()


def test_another_version_of_the_protocol_is_called_that(monkeypatch):
    port = FakePort()
    link = Link("x", Clock(), lambda _: port)
    mine = protocol.VERSION
    monkeypatch.setattr(protocol, "VERSION", mine + 1)
    frame = protocol.encode(protocol.Identity(1, 2, 3, 4), 7)
    monkeypatch.undo()
    port.given = frame
    assert link.poll() == []
    assert f"speaks version {mine + 1} of the protocol" in link.mismatch
    assert f"this program version {mine}" in link.mismatch
    port.given = protocol.encode(protocol.Identity(1, 2, 3, 4), 8)
    assert len(link.poll()) == 1
    assert link.mismatch == ""
    port.given = np.random.default_rng(1).bytes(100_000)
    link.poll()
    assert link.mismatch == ""  # noise, on a line that was understood
    strange = Link("x", Clock(), lambda _: port)
    port.given = np.random.default_rng(1).bytes(100_000)
    assert strange.poll() == []
    assert strange.statistics.bad > 100
    assert "not understood" in strange.mismatch


def test_a_full_line_loses_one_frame_only():
    port = FakePort()
    link = Link("x", Clock(), lambda _: port)
    assert link.send(protocol.Identify()) is not None
    port.full = True
    assert link.send(protocol.Identify()) is None
    assert link.error == "x: it takes no data"
    port.full = False
    assert link.send(protocol.Identify()) is not None
    assert link.error == ""
    assert (link.statistics.unsent, link.statistics.sent) == (1, 2)


def test_a_frame_counts_as_sent_however_late_the_computer_looks(terminal, monkeypatch):
    monkeypatch.setattr(serial.serialutil.Timeout, "expired", lambda self: True)
    assert Link(terminal).send(protocol.Identify()) is not None


def test_a_port_that_takes_no_data_keeps_nobody_waiting(terminal):
    """Nobody reads at its far end: a hung converter, or a twin that Ctrl-Z has stopped."""
    link = Link(terminal)

    def fill():
        while not link.statistics.unsent or link.statistics.sent + link.statistics.unsent < 2000:
            link.send(protocol.Command(0.3, 0.0))

    sender = threading.Thread(target=fill, daemon=True)
    sender.start()
    sender.join(PATIENCE)
    assert not sender.is_alive()
    assert link.error == f"{terminal}: it takes no data"
    link.close()


class NoisyChair:
    """A twin, and a host that commands it at 50 Hz over a wire that harms."""

    def __init__(self, seed):
        build_twin()
        self.twin = Twin(Plant(sensors=SensorSettings(noise=False)))
        self.twin.reset(box(50), 0)
        self.wire = SerialCable(self.twin.drive, np.random.default_rng(seed), log=[])
        self.link = Link("noisy", lambda: self.twin.steps * 1e-3, lambda url: self.wire.open())
        self.frames = []
        self.sent = {}  # sequence -> the last command of that number

    def run(self, seconds, v=0.0):
        for _ in range(round(seconds / 0.02)):
            number = self.link.send(protocol.Command(v, 0.0))
            if number is not None:
                self.sent[number] = v
            self.twin.run(0.02)
            self.frames += self.link.poll()
        return self

    def rearm(self):
        self.run(0.1)
        self.link.send(protocol.Rearm(0xFFFF))
        self.run(0.1)
        assert any(
            isinstance(f.message, protocol.Answer) and not f.message.status for f in self.frames
        )

    @property
    def now(self):
        return next(
            f.message for f in self.frames[::-1] if isinstance(f.message, protocol.Odometry)
        )


@pytest.mark.parametrize(("seed", "seconds"), long_but([(1, 2.0), (2, 600.0)], [(1, 2.0)]))
@pytest.mark.parametrize(
    "noise", [{"corrupt": 0.02}, {"corrupt": 0.1}, {"flip": 0.02}, {"drop": 0.02}, {"burst": 0.005}]
)
def test_harmed_bytes_are_never_believed(noise, seed, seconds):
    """Neither end believes any of the bytes that are harmed each way while the chair drives."""
    chair = NoisyChair(seed)
    chair.rearm()
    chair.run(2.0, 0.5)
    chair.wire.noise = LineNoise(**noise)
    heard = len(chair.frames)
    worst = 0.0
    for _ in range(round(seconds / 0.1)):
        chair.run(0.1, 0.5)
        worst = max(worst, abs(chair.twin.motion.speed), abs(chair.twin.motion.turn))
        if chair.now.mode == protocol.Mode.STOPPED and chair.now.faults:  # a long gap latched
            chair.wire.noise = LineNoise()
            chair.rearm()
            chair.wire.noise = LineNoise(**noise)
    frames = chair.frames[heard:]
    # Every frame believed is one that the board said.
    said = set(protocol.Receiver().feed(b"".join(chair.wire.log)))
    assert all(frame in said for frame in frames)
    # And every command that the board believed is one that the host said.
    odometry = [f.message for f in frames if isinstance(f.message, protocol.Odometry)]
    assert worst < 0.55
    assert all(abs(told.w) < 1e-9 and -1e-4 <= told.v <= 0.5001 for told in odometry)
    assert all(told.echo in chair.sent for told in odometry)
    assert chair.link.statistics.bad > 0
    # As soon as the noise ends, both ends hear each other again: within 100 ms.
    chair.wire.noise = LineNoise()
    before = len(chair.frames)
    chair.run(0.1, 0.4)
    assert len(chair.frames) > before
    assert chair.now.age < 0.05
    assert chair.now.bad > 0
    chair.twin.close()
