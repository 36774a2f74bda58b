"""Logs: what is bad is skipped and counted, or refused; what is good becomes a map."""

import numpy as np
import pytest

from tests.conftest import json_of, output_of, put, refusal
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.maps import OCCUPIED, read_map
from wheelchair_gym.perception.logs import LASER, PER_TICK, TRACK, read_log

RANGES = 24  # column of the first


def line(k, *, time=None, left=None, right=None, far=2000.0):
    """A scan in a round room: straight on, 10 ticks a line."""
    values = np.zeros(RANGES + LASER.beams)
    values[0] = 1e5 * k if time is None else time
    values[2] = 10 * k if left is None else left
    values[3] = 10 * k if right is None else right
    values[RANGES:] = far
    return " ".join(f"{v:.0f}" for v in values)


def written(tmp_path, lines):
    return put(tmp_path / "robot.dat", "\n".join(lines) + "\n")


def test_a_good_log_is_read_as_it_is(tmp_path):
    log = read_log(written(tmp_path, [line(k) for k in range(5)]))
    assert log.skipped == {}
    np.testing.assert_allclose(log.stamps, 0.1 * np.arange(5))
    np.testing.assert_allclose(log.increments[1:, 0], 10 * PER_TICK)
    np.testing.assert_allclose(log.odometry[-1], (40 * PER_TICK, 0, 0), atol=1e-12)
    assert (log.ranges == 2.0).all()


def test_a_turn_to_the_left_is_positive(tmp_path):
    log = read_log(written(tmp_path, [line(0), line(1, left=-10, right=10)]))
    assert log.increments[1] == pytest.approx((0, 0, 20 * PER_TICK / TRACK))


BAD = {
    "truncated": line(2)[:900],
    "not a number": line(2).replace(" 2000", " two", 1),
    "not finite": line(2).replace(" 2000", " nan", 1),
    "time goes back": line(2, time=5e4),
    "ticks leap": line(2, left=10**9),
}


@pytest.mark.parametrize("reason", BAD)
def test_a_bad_line_is_skipped_with_a_reason(tmp_path, reason):
    log = read_log(written(tmp_path, [line(0), line(1), BAD[reason], "", line(3)]))
    assert log.skipped == {reason: 1}
    assert len(log.stamps) == 3
    # What the wheels did meanwhile is not lost.
    np.testing.assert_allclose(log.odometry[-1], (30 * PER_TICK, 0, 0), atol=1e-12)


@pytest.mark.parametrize("bits", [16, 32])
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("sign", [1, -1])
def test_counters_that_wrap_are_followed(bits, signed, sign, tmp_path):
    def counted(ticks):
        ticks %= 1 << bits
        return ticks - (1 << bits) if signed and ticks >= 1 << (bits - 1) else ticks

    edge = (1 << (bits - 1)) if signed else 0
    ticks = [edge + sign * (300 * k - 1500) for k in range(11)]
    lines = [line(k, left=counted(t), right=counted(t)) for k, t in enumerate(ticks)]
    log = read_log(written(tmp_path, lines))
    assert log.skipped == {}
    np.testing.assert_allclose(log.odometry[-1], (sign * 3000 * PER_TICK, 0, 0), atol=1e-9)


@pytest.mark.parametrize("seconds", [0.1, 1.0, 4.0, 10.0])
def test_counters_that_are_reset_end_the_log(seconds, tmp_path):
    leap = 5.0 * seconds / PER_TICK  # as far as is rejected within one line
    ticks = [round(1.2 * leap) + 10 * k for k in range(5)] + [10 * k for k in range(20)]
    lines = [line(k, time=1e6 * seconds * k, left=t, right=t) for k, t in enumerate(ticks)]
    with pytest.raises(InputError, match=r"line 6: the wheels' ticks leap by .* and stay there"):
        read_log(written(tmp_path, lines))


def test_errors_of_the_laser_are_invalid_not_walls(tmp_path):
    log = read_log(written(tmp_path, [line(0, far=0.0), line(1, far=7.0)]))
    assert np.isnan(log.ranges).all()


@pytest.mark.parametrize("content", [b"", b"\n\n", b"hello\n", b"\xff\xfe\x00", b"nan " * 800])
def test_a_file_without_a_scan_is_refused_in_one_line(tmp_path, capsys, content):
    path = tmp_path / "bad.dat"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"bad\.dat"):
        read_log(path)
    assert "bad.dat" in refusal(["map", "--log", path, "--out", tmp_path / "out"], capsys)
    assert not (tmp_path / "out").exists()


def test_the_command_leaves_map_picture_and_figures(tmp_path, capsys):
    path = written(tmp_path, [line(k) for k in range(25)] + [BAD["truncated"]])
    given = ["--out", tmp_path / "out", "--picture", tmp_path / "map.png"]
    found = json_of(["map", "--log", path, "--particles", "2", *given], capsys)
    assert found["skipped"] == {"truncated": 1}
    assert [of["name"] for of in found["maps"]] == ["odometry only", "SLAM, 2 particles"]
    assert (read_map(tmp_path / "out" / "map.yaml").cells == OCCUPIED).any()
    assert (read_map(tmp_path / "out" / "odometry.yaml").cells == OCCUPIED).any()
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    blind = written(tmp_path, [line(k, far=0.0) for k in range(3)])
    words = ["map", "--log", blind, "--odometry-only", "--out", tmp_path]
    assert "no residual" in output_of(words, capsys)


def test_slam_maps_a_real_log_better_than_its_wheels(shared, tmp_path, capsys):
    log = shared / "logs" / "mines_exp1.dat"
    if not log.is_file():
        pytest.skip(f"{log} is absent")
    given = ["--particles", "1", "--out", tmp_path]
    wheels, slam = json_of(["map", "--log", log, *given], capsys)["maps"]
    assert slam["residual_median"] < 0.9 * wheels["residual_median"]
    assert slam["residual_mean"] < 0.7 * wheels["residual_mean"]
    assert slam["occupied_cells"] < 0.8 * wheels["occupied_cells"]  # walls are drawn once
