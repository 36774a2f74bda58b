"""The laser's language: cut and joined anywhere, damaged, refused, wrapped; real scans read."""

import math
import socket
import threading
import time
from contextlib import suppress

import numpy as np
import pytest

from tests.conftest import PATIENCE, until
from wheelchair_gym.hardware.connection import RETRY
from wheelchair_gym.hardware.laser import scip
from wheelchair_gym.hardware.laser.hokuyo import ANSWER_WITHIN, Hokuyo
from wheelchair_gym.hardware.twin.laser import ScipSensor

UST_10LX = scip.Specs("UST-10LX", 20, 30000, 1440, 0, 1080, 540, 2400)
URG_04LX = scip.Specs("URG-04LX", 20, 5600, 1024, 44, 725, 384, 600)
MODELS = {"ust": UST_10LX, "urg": URG_04LX}
models = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)


def some_scan(model, seed=0):
    return np.random.default_rng(seed).integers(21, model.farthest, model.beams)


def stream_of(model, scans=2):
    """Return all bytes of a sensor from the first request on, and the scans in them."""
    sensor = ScipSensor(model)
    last = f"MD{model.first:04d}{model.last:04d}01000\n".encode()
    said = sensor.feed(b"SCIP2.0\nQT\nPP\nBM\n" + last)
    for k in range(scans):
        said += sensor.scan(some_scan(model, k), 25 * k)
    return said


def test_checksums_are_those_of_the_specification():
    assert (scip.checksum(b"00"), scip.checksum(b"99")) == (ord("P"), ord("b"))
    assert scip.encode_numbers([1234], 2) == b"CB"  # the specification's own examples
    assert scip.encode_numbers([5432], 3) == b"1Dh"
    assert scip.encode_numbers([16_000_000], 4) == b"m2@0"
    assert scip.decode_numbers(b"1DhCB0", 3).tolist() == [5432, 78976]
    assert scip.decode_numbers(b"1D", 3) is None
    assert scip.decode_numbers(b"1D\x07", 3) is None


@models
def test_replies_are_whole_at_every_cut_of_the_bytes(model):
    data = stream_of(model, 1)
    whole = scip.ScipParser().feed(data)
    assert [reply.status for reply in whole] == ["0E", "00", "00", "00", "00", "99"]
    for cut in range(len(data) + 1):
        parser = scip.ScipParser()
        assert parser.feed(data[:cut]) + parser.feed(data[cut:]) == whole
        assert parser.bad == 0
    parser = scip.ScipParser()
    assert [reply for k in range(len(data)) for reply in parser.feed(data[k : k + 1])] == whole


@models
def test_no_damaged_scan_is_believed(model):
    """A checksum of six bits catches every single change within a line; cut lines are too short."""
    data = stream_of(model, 1)
    start = data.rindex(f"MD{model.first:04d}{model.last:04d}".encode())
    good = scip.scan_of(scip.ScipParser().feed(data[start:])[0], 30.0)
    rng = np.random.default_rng(1)
    for at in range(start, len(data)):
        broken = bytearray(data[start:])
        broken[at - start] ^= 1 << int(rng.integers(6))
        short = data[start:at] + data[at + 1 :]
        for reply in scip.ScipParser().feed(bytes(broken)) + scip.ScipParser().feed(short):
            scan = scip.scan_of(reply, 30.0)
            assert scan is None or np.array_equal(scan.ranges, good.ranges)


def test_random_bytes_are_no_replies():
    parser = scip.ScipParser()
    rng = np.random.default_rng(2)
    for _ in range(200):
        for reply in parser.feed(rng.bytes(1000) + b"\n\n"):
            assert scip.scan_of(reply, 10.0) is None
    assert parser.bad > 100
    parser.feed(b"x" * 200_000)  # a line that never ends is let go
    assert parser.feed(b"\n\n" + stream_of(UST_10LX, 0))[-1].status == "00"


@pytest.mark.parametrize("name", MODELS)
def test_specifications_and_angles(name):
    model = MODELS[name]
    specs = scip.specs_of(scip.ScipParser().feed(stream_of(model, 0))[2])
    assert specs.beams == model.beams == {"ust": 1081, "urg": 682}[name]
    first, last = {"ust": (-135.0, 135.0), "urg": (-119.53, 119.88)}[name]
    assert np.degrees(specs.angles[[0, -1]]) == pytest.approx([first, last], abs=0.01)
    assert specs.angles[model.front - model.first] == 0.0


def test_what_is_no_range_is_marked_as_rep_117_has_it():
    said = np.array([0, 1, 16, 20, 21, 9999, 10000, 10001, 30000, 65533, 65535])
    nan, inf = math.nan, math.inf
    expected = [nan, nan, nan, nan, 0.021, 9.999, 10.0, inf, inf, inf, inf]
    assert scip.metres(said, 10.0) == pytest.approx(expected, nan_ok=True)


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


class SensorPort:
    """A sensor at a port; it cuts what it says into pieces of a size."""

    def __init__(self, sensor, piece=10**9):
        self.sensor, self.piece, self.said, self.open = sensor, piece, b"", True

    def read_all(self):
        if not self.open:
            raise OSError("gone")
        data, self.said = self.said[: self.piece], self.said[self.piece :]
        return data

    def write(self, data):
        self.said += self.sensor.feed(data)
        return len(data)

    def close(self):
        self.open = False


def begin(model=UST_10LX, piece=10**9):
    clock, sensor, ports = Clock(), ScipSensor(model), []

    def opener(_url):
        ports.append(SensorPort(sensor, piece))
        return ports[-1]

    laser = Hokuyo("x", 10.0, clock, opener)
    assert laser.poll() == []
    return laser, sensor, ports, clock


@pytest.mark.parametrize("piece", [1, 7, 64, 10**9])
@models
def test_the_laser_is_switched_on_and_read(model, piece):
    laser, sensor, ports, clock = begin(model, piece)
    assert sensor.on
    assert sensor.streaming
    assert laser.specs.model == model.model
    for k in range(3):
        clock.now += 0.025
        ports[0].said += sensor.scan(some_scan(model, k), 25 * k)
        (heard,) = laser.poll()
        assert heard.scan.ranges == pytest.approx(
            scip.metres(some_scan(model, k), min(10.0, model.farthest * 1e-3))
        )
        assert (heard.stamp, heard.received_at) == (pytest.approx(0.025 * k), clock.now)
    assert laser.error == ""
    laser.close()
    assert not sensor.on


def test_the_sensors_clock_wraps_and_time_does_not():
    laser, sensor, ports, _ = begin()
    stamps = []
    for k in range(6):
        ports[0].said += sensor.scan(some_scan(UST_10LX), 2 * scip.STAMP_WRAP - 60 + 25 * k)
        stamps += [heard.stamp for heard in laser.poll()]
    assert np.diff(stamps) == pytest.approx(np.full(5, 0.025))


def test_a_laser_that_is_off_is_switched_on_again():
    """Status 10: the request came while the laser was off."""
    laser, sensor, ports, clock = begin()
    sensor.on, sensor.streaming = False, ""
    clock.now += ANSWER_WITHIN + 0.1
    laser.poll()
    assert not ports[0].open  # silent too long: given up
    assert "no answer" in laser.error
    clock.now += RETRY
    laser.poll()
    assert sensor.on
    sensor.on, sensor.streaming = False, ""
    request = f"MD{UST_10LX.first:04d}{UST_10LX.last:04d}01000\n"
    ports[1].said += sensor.feed(request.encode())
    laser.poll()
    assert sensor.on
    assert sensor.streaming


def test_a_request_that_the_laser_refuses_is_named(monkeypatch):
    monkeypatch.setattr(ScipSensor, "_obey", lambda self, said: "20" if said == "BM" else scip.OK)
    laser, _, ports, _ = begin()
    assert laser.error == "x: BM was refused with status 20"
    assert not ports[0].open


def test_real_scans_are_read_back(shared):
    """The ranges of a real URG-04LX, said again and read, cut at random."""
    rows = (shared / "logs" / "mines_exp1.dat").read_text().splitlines()[::40]
    laser, sensor, ports, clock = begin(URG_04LX)
    rng = np.random.default_rng(7)
    checked = 0
    for k, row in enumerate(rows):
        said = np.array(row.split()[24:706], np.int64)
        if len(said) != URG_04LX.beams:
            continue
        clock.now += 0.1
        data, heard = sensor.scan(said, 100 * k), []
        for part in np.split(np.frombuffer(data, np.uint8), np.sort(rng.integers(0, len(data), 3))):
            ports[0].said += part.tobytes()
            heard += laser.poll()
        (one,) = heard
        np.testing.assert_array_equal(one.scan.ranges, scip.metres(said, 5.6))
        checked += 1
    assert checked >= 5
    assert laser.bad == 0


def serve(listener, sensor, scans):
    """A sensor at a TCP port, in a thread: sends scans while it is asked to, in odd pieces."""
    peer, _ = listener.accept()
    peer.settimeout(0.005)
    end, k = time.monotonic() + PATIENCE, 0
    with peer:
        while time.monotonic() < end and k < scans:
            with suppress(TimeoutError):
                data = peer.recv(4096)
                if not data:
                    return
                peer.sendall(sensor.feed(data))
            data = sensor.scan(some_scan(sensor.specs, k), 25 * k)
            if data:
                peer.sendall(data[:100])
                peer.sendall(data[100:])
                k += 1


def test_a_laser_at_a_tcp_port():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        sensor = ScipSensor(UST_10LX)
        thread = threading.Thread(target=serve, args=(listener, sensor, 5), daemon=True)
        thread.start()
        laser, heard = Hokuyo(f"tcp://127.0.0.1:{port}"), []
        assert until(lambda: heard.extend(laser.poll()) or len(heard) >= 5)
        assert [one.scan.stamp for one in heard] == [0, 25, 50, 75, 100]
        assert heard[4].scan.ranges == pytest.approx(scip.metres(some_scan(UST_10LX, 4), 10.0))
        thread.join(PATIENCE)
        assert until(lambda: laser.poll() or laser.error)
        assert "closed" in laser.error  # the sensor hung up
        laser.close()
    gone = Hokuyo(f"tcp://127.0.0.1:{port}")
    assert until(lambda: gone.poll() or gone.error != "not opened yet")
    assert gone.error
    assert gone.poll() == []
