"""The chair stops after every fault: the host build of the drive board's firmware."""

import ctypes
import math
import subprocess

import numpy as np
import pytest

from tests.benchmarks.drive_faults import outward
from tests.hardware.bench import Bench, ibus
from tests.hardware.conftest import build
from tests.hardware.native import NativeDrive
from wheelchair_gym.geometry.kinematics import approach
from wheelchair_gym.hardware.boards import protocol
from wheelchair_gym.hardware.boards.parameters import DRIVE_PARAMETERS
from wheelchair_gym.hardware.boards.protocol import Fault, Mode, Status, Switch

STEP = 0.005  # s


def off(bench):
    return bench.duty == (0.0, 0.0) and not bench.enable and not bench.release


def test_set_points_are_those_of_the_simulated_chair(firmware):
    """One definition: the boards' `approach` is that of kinematics, to float32."""
    rng = np.random.default_rng(5)
    for _ in range(40):
        target, up, down = rng.uniform(-1, 1), *rng.uniform(0.2, 2.0, 2)
        jerk, start = rng.uniform(0.5, 8.0), rng.uniform(-1, 1)
        axis, out = (ctypes.c_float * 2)(start, 0.0), (ctypes.c_float * 600)()
        real = [ctypes.c_float(x) for x in (target, up, down, jerk, STEP)]
        firmware.library.approach_all(axis, *real, 600, out)
        speed, slope, speeds = start, 0.0, []
        for _ in range(600):
            speed, slope = approach(speed, slope, target, up, down, jerk, STEP)
            speeds.append(speed)
        assert np.abs(np.array(out) - speeds).max() < 2e-4


@pytest.mark.parametrize(
    ("v", "w"), [(0.5, 0.0), (-0.3, 0.4), (0.8, 1.0), (0.05, 0.0), (3.0, -3.0)]
)
def test_speed_follows_the_command_up_to_the_limits(bench, v, w):
    bench.start(v, w, seconds=4.0)
    told, v, w = bench.odometry(), min(v, 0.8), max(w, -1.0)
    assert (told.v, told.w) == (pytest.approx(v, abs=1e-4), pytest.approx(w, abs=1e-4))
    half = 0.5 * 0.54 * w
    assert bench.speeds == [pytest.approx(v - half, abs=0.01), pytest.approx(v + half, abs=0.01)]


def test_nothing_moves_before_a_person_has_re_armed(bench):
    bench.follow((0.5, 0.0), 1.0)
    assert off(bench)
    assert bench.odometry().faults == Fault.RESET
    assert bench.rearm() == Status.NOT_AT_ZERO
    bench.follow((0.0, 0.0), 0.1)
    assert bench.send(protocol.Rearm(Fault.STALL))[0].status == Status.OTHER_FAULTS
    assert bench.odometry().faults == Fault.RESET
    assert bench.rearm() == Status.DONE
    bench.run(0.5)
    assert bench.odometry().mode == Mode.HOST
    assert bench.duty == (0.0, 0.0)


def test_without_commands_the_set_point_falls_within_205_ms_and_the_brake_follows(bench):
    bench.start(0.8)
    bench.target = None
    bench.send(protocol.Command(0.8, 0.0))
    since, falls, rests = 0.0, None, None
    while rests is None:
        bench.run(STEP)
        since += STEP
        if falls is None and bench.odometry().v < 0.8 - 1e-3:
            falls = since
        if off(bench):
            rests = since
        assert since < 2.0
    assert falls <= 0.205 + 1e-9
    # The set point falls at 2.2 m/s2; the wheels rest at 1.5 or more of it all, and then brake.
    assert 0.8 / (rests - falls) >= 1.5
    assert bench.odometry().faults == 0
    bench.follow((0.0, 0.0), 0.1)
    assert bench.odometry().mode == Mode.HOST  # a short silence heals
    bench.follow(None, 1.3)
    assert bench.odometry().faults == Fault.LINK  # a long one needs a person
    bench.follow((0.5, 0.0), 1.0)
    assert off(bench)


# What happens at the bench, the fault, and within how many seconds it is told
CAUSES = {
    "emergency stop": (
        lambda b: setattr(b, "switches", Switch.STOP_PRESSED), Fault.EMERGENCY_STOP, 0.005
    ),
    "driver": (lambda b: setattr(b, "switches", Switch.DRIVER_LEFT), Fault.DRIVER, 0.005),
    "left encoder": (lambda b: setattr(b, "seen", [False, True]), Fault.STALL, 0.1),
    "right encoder": (lambda b: setattr(b, "seen", [True, False]), Fault.STALL, 0.1),
    "encoder noise": (lambda b: setattr(b, "illegal", b.illegal + 30), Fault.ENCODER, 0.105),
    "over-speed": (lambda b: setattr(b, "ways", [b.ways[0] + 0.1, b.ways[1]]), Fault.OVER_SPEED,
                   0.005),
    "battery": (lambda b: setattr(b, "battery", 28.0), Fault.UNDER_VOLTAGE, 0.9),
    # A single run of the control that is 10 ms late, or many that are late by less
    "late by 11 ms": (lambda b: setattr(b, "periods", lambda: 16), Fault.OVERRUN, 0.016),
    "late by 4 ms": (lambda b: setattr(b, "periods", lambda: 9), Fault.OVERRUN, 0.06),
    "late by 2 ms": (lambda b: setattr(b, "periods", lambda: 7), Fault.OVERRUN, 0.1),
    "late by 1 ms": (lambda b: setattr(b, "periods", lambda: 6), Fault.OVERRUN, 0.3),
}  # fmt: skip


@pytest.mark.parametrize("name", CAUSES)
def test_faults_stop_the_chair_and_stay_until_a_person_has_seen_to_them(bench, name):
    cause, fault, within = CAUSES[name]
    bench.start(0.5)
    cause(bench)
    bench.run(within)
    assert bench.odometry().faults == fault, Fault(bench.odometry().faults)
    bench.periods = lambda: 5
    # From 0.5 m/s at 1.5 m/s2, and the delay of the control where it still brakes.
    bench.run(0.5 / 1.5 + 0.15)
    assert off(bench)
    assert bench.speeds == [0.0, 0.0]
    bench.run(1.0)
    assert off(bench)  # though the host still asks for 0.5 m/s
    bench.target = (0.0, 0.0)
    bench.switches, bench.battery = 0, 38.0
    bench.seen = [True, True]
    bench.run(0.5)
    assert off(bench)
    bench.start(0.3, seconds=1.5)
    assert min(bench.speeds) == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize("switch", [Switch.STOP_PRESSED, Switch.FREEWHEEL, Switch.DRIVER_RIGHT])
def test_what_still_stands_refuses_the_re_arm(bench, switch):
    bench.target, bench.switches = (0.0, 0.0), switch
    bench.run(0.1)
    assert bench.rearm() == Status.CAUSE_STANDS


@pytest.mark.parametrize("mode", ["driving", "by_joystick", "host_gone"])
def test_the_lever_lifted_in_motion_leaves_the_motors_as_brakes(bench, mode):
    globals()[mode](bench)
    bench.switches, bench.grip = Switch.FREEWHEEL, 0.0
    bench.run(0.01)
    assert (bench.duty, bench.enable, bench.release) == ((0.0, 0.0), True, False)
    bench.run(0.8)
    assert off(bench)
    assert max(bench.speeds) < 0.03
    assert bench.odometry().faults & ~Fault.LINK == Fault.LEVER
    bench.switches = 0
    bench.follow((0.5, 0.0), 1.0)
    assert off(bench)


@pytest.mark.parametrize("stuck", [None, 0.8, -0.4])
def test_motors_that_do_not_brake_are_switched_off_though_the_lever_is_lifted(bench, stuck):
    """Pushed by hand, or a driver is stuck: duty 0 is of no use, and no runaway is told."""
    bench.start(0.0, seconds=0.2)
    bench.switches, bench.grip, bench.stuck = Switch.FREEWHEEL, 0.0, [stuck, stuck]
    bench.run(0.1)
    assert off(bench)
    bench.speeds = [0.2, 0.2]
    for _ in range(100):
        bench.run(STEP)
        if stuck is None:
            bench.speeds = [min(1.0, speed + 0.03) for speed in bench.speeds]
        assert bench.duty == (0.0, 0.0)
    assert off(bench)
    assert max(map(abs, bench.speeds)) < (1.1 if stuck is None else 0.6)
    assert bench.odometry().faults == Fault.LEVER


def test_a_touch_between_two_odometries_is_told(bench):
    bench.start(0.2, seconds=1.0)
    bench.odometry()
    bench.switches = Switch.LEFT
    bench.run(0.005)
    bench.switches = 0
    bench.run(0.015)
    assert bench.odometry().switches == Switch.LEFT
    assert bench.odometry().switches == 0


def test_the_host_is_told_whether_a_person_is_needed(bench):
    bench.follow((0.0, 0.0), 0.1)
    assert bench.odometry().mode == Mode.STOPPED
    bench.follow(None, 0.1)
    assert bench.rearm() == Status.DONE
    assert bench.odometry().mode == Mode.READY
    bench.follow((0.0, 0.0), 0.1)
    assert bench.odometry().mode == Mode.HOST
    bench.follow(None, 0.5)
    assert bench.odometry().mode == Mode.READY
    bench.run(1.0)
    assert bench.odometry().mode == Mode.STOPPED


def test_a_protective_stop_is_exempt_from_jerk_and_keeps_the_curve(bench):
    bench.start(0.4, 0.6)
    before = bench.odometry()
    bench.target = None
    bench.send(protocol.Command(0.0, 0.0, protocol.CommandFlag.PROTECTIVE))
    bench.run(0.1)
    now = bench.odometry()
    assert now.v == pytest.approx(0.4 - 2.2 * 0.1, abs=0.015)
    assert now.w / now.v == pytest.approx(before.w / before.v, rel=0.02)


@pytest.mark.parametrize("seed", range(20))
def test_runs_that_come_unevenly_measure_and_drive_the_same_speeds(bench, seed):
    rng, late = np.random.default_rng(seed), [0]

    def period():
        late.append(int(rng.integers(-1, 2)))
        return 5 + late[-1] - late[-2]

    bench.periods = period
    v, w = rng.uniform((-0.3, -0.5), (0.8, 0.5))
    bench.start(v, w)
    assert bench.odometry().v == pytest.approx(v, abs=1e-4)
    for _ in range(50):
        bench.run(0.02)
        told = bench.odometry()
        assert (told.speed_left, told.speed_right) == pytest.approx(bench.speeds, abs=0.03)
    assert sum(bench.speeds) / 2 == pytest.approx(v, abs=0.01)
    bench.target, way = (0.0, 0.0, protocol.CommandFlag.PROTECTIVE), sum(bench.ways) / 2
    bench.run(0.8)
    assert bench.odometry().faults == 0
    assert abs(sum(bench.ways) / 2 - way) < v * v / (2 * 1.5) + 0.04


def at_rest(bench):
    bench.start(0.0, seconds=0.5)


def driving(bench):
    bench.start(0.5)


def by_joystick(bench):
    bench.by_hand(0.2, manual=True)
    bench.by_hand(0.2, manual=True, held=True)
    bench.by_hand(2.0, manual=True, held=True, ahead=1.0)


def let_go(bench):
    by_joystick(bench)
    bench.by_hand(0.02, manual=True, ahead=1.0)


def host_gone(bench):
    driving(bench)
    bench.follow(None, 0.25)


@pytest.mark.parametrize("duty", [0.8, -0.8])
@pytest.mark.parametrize("mode", [at_rest, driving, by_joystick, let_go, host_gone])
def test_a_wheel_faster_than_its_aim_is_cut_in_every_mode(bench, mode, duty):
    mode(bench)
    bench.stuck = [duty, duty]
    aim = {driving: 0.5, by_joystick: 0.4}.get(mode, 0.0)
    passed = None
    for k in range(200):
        if mode in (by_joystick, let_go):
            held = mode is by_joystick
            bench.by_hand(0.01, manual=True, held=held, ahead=1.0)
        else:
            bench.run(0.01)
        fast = max(bench.speeds) > aim + 0.25 or min(bench.speeds) < -0.25
        if passed is None and fast:
            passed = k
        if not bench.enable:
            break
        assert passed is None or k - passed <= 20  # 0.2 s
    assert off(bench)
    assert bench.odometry().faults & ~Fault.LINK
    bench.run(1.0)
    assert bench.speeds == [0.0, 0.0]


@pytest.mark.parametrize("v", [0.0, 0.3])
@pytest.mark.parametrize("slow", [0.05, 0.1, -0.1])
def test_a_slow_driver_that_sticks_at_rest_or_as_the_chair_is_to_stop_is_cut_too(bench, v, slow):
    """It never comes to rest: it may go on for 50 mm from 0.5 s after its set point, no further."""
    bench.start(v, seconds=3.0 if v else 0.05)
    bench.stuck = [slow, slow]
    bench.target = (0.0, 0.0)
    while bench.odometry().v:
        bench.run(0.005)
    bench.run(0.5 if v else 0.0)
    begun = list(bench.ways)
    bench.run(1.5)
    assert off(bench)
    assert bench.odometry().faults & (Fault.RUNAWAY | Fault.IMPLAUSIBLE | Fault.STALL)
    assert max(abs(way - start) for way, start in zip(bench.ways, begun, strict=True)) < 0.07


def test_a_chair_that_rolls_while_it_is_stopped_is_told(bench):
    bench.run(0.1)
    bench.grip, bench.pull = 0.0, 1.2
    bench.run(0.5)
    assert bench.odometry().faults & Fault.RUNAWAY
    assert off(bench)


@pytest.mark.parametrize("pull", [0.0, 0.5, 1.36, -1.36])
@pytest.mark.parametrize("v", [0.8, -0.3, 0.1])
def test_slopes_and_hard_stops_are_no_runaways(bench, pull, v):
    """8 degrees pull by 1.36 m/s2; emergency, protective and gentle stops, a host that is lost."""
    bench.pull = pull
    for ends in ((0.0, 0.0), (0.0, 0.0, protocol.CommandFlag.PROTECTIVE), (-v, 0.5), None):
        bench.start(v, 0.2, seconds=2.5)
        bench.follow(ends, 2.5)
        assert bench.odometry().faults in (0, Fault.LINK), (ends, bench.odometry())
    bench.start(v, seconds=2.5)
    bench.switches = Switch.STOP_PRESSED
    bench.run(1.5)
    assert bench.odometry().faults == Fault.EMERGENCY_STOP


@pytest.mark.parametrize("inner", [-0.05, 0.01, 0.02, 0.03, 0.05, 0.08])
@pytest.mark.parametrize("downhill", [0.0, 1.57, 3.14, -1.57])
def test_a_turn_on_a_slope_about_a_slow_wheel_is_no_fault(bench, inner, downhill):
    """Its load changes all the way round: a slow wheel stands, or rolls back, for seconds."""
    pull = 1.36 * 180.0 / 135.0  # of 180 kg on 8 degrees, in terms of the bench's 135 kg
    bench.pull = pull * math.cos(downhill)
    bench.start()
    bench.target = (0.27 + inner, 1.0)
    for _ in range(1600):
        heading = (bench.ways[1] - bench.ways[0]) / 0.54
        bench.pull = pull * math.cos(heading - downhill)
        bench.run(STEP)
    assert bench.odometry().faults == 0, Fault(bench.odometry().faults)


@pytest.mark.parametrize("edge", [0, 1])
@pytest.mark.parametrize("turn", [0.0, 1.0])
@pytest.mark.parametrize(("aim", "within", "rim"), [(0.05, 0.42, 0.25), (0.01, 2.05, 0.15)])
def test_a_lost_encoder_of_a_slow_wheel_is_found_as_soon_where_the_chair_turns_about_it(
    bench, aim, within, rim, turn, edge
):
    """A wheel that a slope holds back turns back or on; one of a lost encoder gives no counts.

    Nor does a vibration about a single edge, of an encoder that lost one of its two channels.
    """
    bench.start(0.27 * turn + aim, turn)
    bench.seen[0], start, steps = False, bench.ways[0], 0
    while bench.enable and steps < 2000:
        bench.run(STEP)
        bench.counts[0] += edge * (1 if steps % 2 else -1)
        steps += 1
    assert bench.odometry().faults & Fault.STALL
    assert steps * STEP <= within
    assert bench.speeds[0] <= rim
    assert bench.ways[0] - start < 0.16


@pytest.mark.parametrize("target", [(0.0, 0.0, protocol.CommandFlag.PROTECTIVE), (0.0, 0.0), None])
def test_brakes_that_slip_again_and_again_are_a_fault_and_the_motors_hold(bench, target):
    bench.start(0.0, seconds=0.2)
    bench.follow(target, 0.5)
    bench.grip, bench.pull = 0.1, 1.36
    released, changes = bench.release, 0
    for _ in range(2000):
        bench.run(STEP)
        changes += bench.release != released
        released = bench.release
    assert bench.odometry().faults & Fault.BRAKE
    assert changes <= 8
    assert bench.ways[0] < 0.2
    home = bench.ways[0]
    bench.run(10.0)
    assert abs(bench.ways[0] - home) < 0.002
    assert bench.enable
    assert not bench.release
    bench.start(0.3, seconds=2.0)  # a person may drive it to level ground
    assert bench.speeds[0] == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize(("factor", "v"), [(2.0, 0.4), (2.0, 0.8), (0.5, 0.8)])
def test_counts_per_metre_that_cannot_be_are_told(bench, factor, v):
    """The board expects twice the counts, and drives twice as fast; or the other way round."""
    bench.start()
    assert bench.odometry().faults == 0
    bench.rearm()
    bench.follow(None, 1.5)  # stopped: parameters may be changed
    bench.send(protocol.Set(DRIVE_PARAMETERS.index("counts_per_metre"), 4346.0 * factor))
    bench.follow((0.0, 0.0), 0.1)
    assert bench.rearm() == Status.DONE
    bench.follow((v, 0.0), 6.0)
    assert bench.odometry().faults & Fault.IMPLAUSIBLE
    assert off(bench)


def test_a_hosts_rearm_does_not_hand_over_a_moving_chair(bench):
    by_joystick(bench)
    bench.run(0.2)  # the joystick is silent: on the way to rest
    bench.target = (0.8, 0.0)
    for _ in range(10):
        bench.run(STEP)
        if max(map(abs, bench.speeds)) > 0.05:
            assert bench.rearm() in (Status.MOVING, Status.DONE)
            assert bench.odometry().mode != Mode.HOST
    bench.run(0.1)
    assert max(bench.speeds) < 0.4
    bench.run(3.0)
    assert max(map(abs, bench.speeds)) < 0.01


@pytest.mark.parametrize("strips", range(2, 32, 2))
def test_a_pressed_side_moves_away_only_at_every_command(bench, strips):
    rng = np.random.default_rng(strips)
    bench.start(*rng.uniform((-0.3, -1.0), (0.8, 1.0)), seconds=2.0)
    bench.switches = strips
    bench.run(1.5)
    moved = 0.0
    for _ in range(12):
        bench.target = tuple(rng.uniform((-0.8, -1.0), (0.8, 1.0)))
        for _ in range(10):
            bench.run(0.05)
            left, right = bench.speeds
            v, w = (left + right) / 2, (right - left) / 0.54
            assert outward(strips, v, w) < 0.015
            moved = max(moved, abs(v))
    both = Switch.FRONT | Switch.REAR
    assert (moved < 0.01) == (strips & both == both)  # there is a way out of every other


def test_parameters_keep_their_bounds_and_change_at_rest_only(bench):
    for index, name in enumerate(DRIVE_PARAMETERS):
        (told,) = bench.send(protocol.Get(index))
        assert told.low <= told.value <= told.high, name
        for value in (math.nan, math.inf, -math.inf, told.low - 1.0, told.high * 1.01 + 1.0):
            (answer,) = bench.send(protocol.Set(index, value))
            assert (answer.status, answer.value) == (Status.OUT_OF_RANGE, told.value)
        (answer,) = bench.send(protocol.Set(index, told.high))
        assert (answer.status, answer.value) == (Status.DONE, told.high)
        bench.send(protocol.Set(index, told.value))
    assert bench.send(protocol.Get(len(DRIVE_PARAMETERS)))[0].status == Status.UNKNOWN
    bench.start(0.3)
    assert bench.send(protocol.Set(DRIVE_PARAMETERS.index("kp"), 10.0))[0].status == Status.MOVING
    assert bench.send(protocol.Save())[0].status == Status.MOVING


def test_what_cannot_be_understood_is_said_so(bench):
    assert bench.send(protocol.Unknown(0x55, b"abc")) == [protocol.Answer(0x55, 1, Status.UNKNOWN)]
    assert bench.send(protocol.Unknown(0x01, b"ab")) == [protocol.Answer(0x01, 2, Status.UNKNOWN)]
    assert bench.send(protocol.Identify()) == [protocol.Identity(1, len(DRIVE_PARAMETERS), 0, 0)]


def test_a_store_with_any_bit_wrong_is_refused(firmware):
    drive = NativeDrive(firmware)
    drive.send(protocol.Set(DRIVE_PARAMETERS.index("kp"), 55.0))
    size = drive.library.drive_store_size(drive.pointer)
    image = ctypes.create_string_buffer(size)
    drive.library.drive_store(drive.pointer, image)
    for bit in range(8 * size):
        broken = bytearray(image.raw)
        broken[bit // 8] ^= 1 << bit % 8
        assert not drive.library.drive_restore(drive.pointer, bytes(broken))
    for garbage in (bytes(size), b"\xff" * size, np.random.default_rng(1).bytes(size)):
        assert not drive.library.drive_restore(drive.pointer, garbage)
    assert drive.send(protocol.Get(DRIVE_PARAMETERS.index("kp")))[0].value == 40.0
    assert drive.library.drive_restore(drive.pointer, image.raw)
    assert drive.send(protocol.Get(DRIVE_PARAMETERS.index("kp")))[0].value == 55.0


def test_the_joystick_goes_before_the_host_that_must_ask_for_zero_before_it_drives_again(bench):
    bench.start(0.5)
    bench.by_hand(1.5, manual=True)
    assert bench.odometry().mode == Mode.MANUAL
    assert max(map(abs, bench.speeds)) < 0.01
    bench.by_hand(1.0, manual=False)
    # The host still asks for 0.5 m/s, but has not asked for zero since.
    assert bench.odometry().mode == Mode.HOST
    assert max(map(abs, bench.speeds)) < 0.01
    bench.target = (0.0, 0.0)
    bench.by_hand(0.1)
    bench.target = (0.5, 0.0)
    bench.by_hand(2.0)
    assert min(bench.speeds) == pytest.approx(0.5, abs=0.01)


def test_a_joystick_frame_with_any_byte_wrong_is_ignored(firmware):
    drive = Bench(firmware)
    good = ibus(manual=True, held=True)
    for at in range(len(good)):
        broken = bytearray(good)
        broken[at] ^= 0x10
        drive.stick(bytes(broken) + b"\0" * 32)
    drive.start(seconds=0.1)


@pytest.mark.parametrize("count", [5_000, pytest.param(1_000_000, marks=pytest.mark.long)])
def test_no_bytes_break_a_law_of_the_boards(count):
    """Sanitizers watch; fuzz.c states the laws."""
    fuzz = subprocess.run(
        [build("fuzz"), str(count), "1"], capture_output=True, text=True, check=False
    )
    assert fuzz.returncode == 0, fuzz.stderr[:2000]
