"""The real firmware on emulated boards: the chair does as told, and stops after every fault."""

import math

import numpy as np
import pytest

from tests.benchmarks import bounds, drive_faults
from tests.hardware.conftest import build, build_twin
from tests.hardware.pilot import PERIOD, Pilot
from tests.sim.worlds import box, drives, exact_chair, placed
from wheelchair_gym.actors.records import NOBODY, person
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.hardware.boards import protocol
from wheelchair_gym.hardware.boards.protocol import Fault, Identify, Identity, RangeStatus, Switch
from wheelchair_gym.hardware.laser.hokuyo import Hokuyo
from wheelchair_gym.hardware.twin import lockstep
from wheelchair_gym.hardware.twin.board import FREQUENCY
from wheelchair_gym.hardware.twin.laser import sensor_specs
from wheelchair_gym.hardware.twin.plant import Slope
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.settings import BodySettings, ChairSettings, MotorSettings, PhysicsSettings

WATCHDOG = 0x08  # MCUSR
COUNTS = 4346.0  # 1/m


@pytest.fixture
def pilot():
    build_twin()
    pilot = Pilot()
    yield pilot
    pilot.twin.close()


@pytest.mark.parametrize(("v", "w"), [(0.5, 0.0), (-0.3, 0.4), (0.8, 0.9)])
def test_the_chair_drives_as_it_is_told(pilot, v, w):
    pilot.start(v, w, 3.0)
    assert pilot.twin.motion.speed == pytest.approx(v, abs=0.01)
    assert pilot.twin.motion.turn == pytest.approx(w, abs=0.02)
    # No count is lost or made up, except those of the last step, under way.
    pilot.follow((0.0, 0.0), 2.0)
    true = pilot.twin.motion.left, pilot.twin.motion.right
    assert (pilot.now.left, pilot.now.right) == tuple(math.floor(count) for count in true)
    assert (pilot.bad, pilot.now.bad, pilot.now.lost) == (0, 0, 0)
    assert pilot.twin.drive.call("overruns") == 0
    assert pilot.twin.drive.resets == 0


def test_the_boards_drive_like_the_simulated_chair(pilot):
    """Law 3 at the motors, where both control at 200 Hz: twist within 2 % or a count a period.

    The boards' control runs up to 5 ms after a command came, which a few instants show.
    """
    commands = np.random.default_rng(4).uniform((-0.3, -0.8), (0.8, 0.8), (5, 2))
    sim = placed(exact_chair(step=0.005, motor=MotorSettings(control_rate=200.0)), box(50))
    pilot.start(seconds=0.2)  # its motors have taken it over from the brakes
    start = pilot.pose
    quantum = np.array([1.0, 2.0 / 0.54]) / COUNTS / 0.1
    within = []
    for command in [*commands, np.zeros(2)]:
        pilot.target = tuple(command)
        for _ in range(20):
            pilot.run(0.1)
            sim.drive(command)
            twist = pilot.twin.motion.speed, pilot.twin.motion.turn
            allowed = np.maximum(0.02 * np.abs(sim.truth.twist), quantum)
            within.append(np.all(np.abs(twist - sim.truth.twist) <= allowed))
            off = np.hypot(*(pilot.pose - start - sim.truth.pose)[:2])
            assert off < 0.005 + 0.01 * sim.truth.distance
    assert np.mean(within) > 0.95
    end, true = pilot.pose - start, sim.truth.pose
    assert sim.truth.distance > 3.0
    assert np.hypot(*(end - true)[:2]) < 0.002 * sim.truth.distance
    assert abs(end[2] - true[2]) < math.radians(0.2)


def test_the_emergency_stop_cuts_the_power_without_any_board(pilot):
    pilot.start(0.8, 0.0, 3.0)
    pilot.twin.drive.hang()  # the board is dead, and its pins stay as they are
    pilot.twin.faults.switches = Switch.STOP_PRESSED
    assert not pilot.twin.enabled
    assert pilot.twin.braked
    assert 0.8 / pilot.until_rest() >= 1.5


def test_a_swapped_encoder_stops_the_chair(pilot):
    """A wheel that is controlled the wrong way round would run away."""
    pilot.start(0.0, 0.0, 0.2)
    pilot.twin.faults.swapped_encoders[1] = True
    pilot.follow((0.5, 0.0), 1.0)
    assert pilot.now.faults & Fault.DIRECTION
    pilot.run(0.5)
    assert abs(pilot.twin.motion.speed) < 1e-3
    assert pilot.twin.braked
    assert np.abs(pilot.pose).max() < 0.3  # m, m, rad


def test_a_hung_drive_board_is_reset_and_stays_stopped(pilot):
    pilot.start(0.8, 0.0, 3.0)
    pilot.twin.drive.hang()
    steps = pilot.twin.steps
    while not pilot.twin.braked:
        pilot.twin.run(0.001)
        assert pilot.twin.steps - steps < 100
    assert 0.8 / pilot.until_rest() >= 1.5
    pilot.run(0.5)
    assert pilot.twin.drive.resets == 1
    assert pilot.now.faults & Fault.RESET
    assert pilot.ask(Identify(), Identity).cause & WATCHDOG
    assert abs(pilot.twin.motion.speed) < 1e-6  # though the host goes on asking for 0.8 m/s
    pilot.start(0.3, 0.0, 2.0)
    assert pilot.twin.motion.speed == pytest.approx(0.3, abs=0.01)


def test_baud_rates_are_those_of_the_wire(pilot):
    """The emulator does not model a mismatch: the registers themselves are looked at."""
    pilot.run(0.02)
    for board in (pilot.twin.drive, pilot.twin.range):
        ubrr, double = board.read_word(0xC4), board.read_memory(0xC0) & 0x02
        assert double
        assert FREQUENCY / (8 * (ubrr + 1)) == protocol.BAUD
    ubrr = pilot.twin.drive.read_word(0xCC)
    assert pilot.twin.drive.read_memory(0xC8) & 0x02
    assert FREQUENCY / (8 * (ubrr + 1)) == pytest.approx(lockstep.IBUS_BAUD, rel=0.022)


def test_ultrasonics_see_the_world(pilot):
    """Both models, to their resolution; ages follow the order of firing."""
    pilot.twin.reset(box(2.0, (0.3, -0.2, 0.4)), 0)
    pilot.run(0.6)
    for which, told in enumerate(pilot.ranges.ranges[:8]):
        true = pilot.twin.plant.ping(which)
        if math.isfinite(true):
            assert (told.range, told.status) == (pytest.approx(true, abs=2e-3), RangeStatus.ECHO)
    ages = [told.age for told in pilot.ranges.ranges[:8]]
    order = sorted(range(8), key=lambda which: -ages[which])
    start = order.index(0)
    assert tuple(order[start:] + order[:start]) == (0, 4, 1, 5, 2, 6, 3, 7)
    assert max(ages) < 0.5


def test_a_pulse_without_echo_is_none(pilot):
    """38 ms wrap a 16-bit clock of half microseconds: it would read as 0.897 m."""
    pilot.run(0.6)
    assert {(told.status, told.range) for told in pilot.ranges.ranges[:8]} == {
        (RangeStatus.NO_ECHO, 65.535)
    }


def test_a_sensor_that_does_not_answer_is_said_so(pilot):
    pilot.twin.reset(box(2.0), 0)
    pilot.twin.faults.silent_ultrasonics = {1, 6}
    pilot.run(0.6)
    silent = {i for i, told in enumerate(pilot.ranges.ranges) if told.status == RangeStatus.SILENT}
    assert silent == {1, 6}
    pilot.twin.faults.silent_ultrasonics = set()
    pilot.run(0.6)
    assert RangeStatus.SILENT not in {told.status for told in pilot.ranges.ranges}
    pilot.twin.faults.stuck_ultrasonics = {0: 0.5, 5: 0.7}
    pilot.run(0.6)
    told = pilot.ranges.ranges
    assert (told[0].range, told[5].range) == (
        pytest.approx(0.5, abs=2e-3),  # a count of 4 us is 0.7 mm
        pytest.approx(0.7, abs=2e-3),
    )


@pytest.mark.parametrize("clocks", [1, 9, 14])
def test_a_ranger_that_holds_the_bus_is_clocked_free(pilot, clocks):
    pilot.run(0.6)
    pilot.twin.range.call("hold_bus", clocks)
    pilot.run(0.2)
    assert RangeStatus.SILENT in {told.status for told in pilot.ranges.ranges}
    pilot.run(1.0)
    assert RangeStatus.SILENT not in {told.status for told in pilot.ranges.ranges}
    assert pilot.twin.range.resets == 0


def test_a_hung_range_board_is_reset(pilot):
    pilot.run(0.3)
    pilot.twin.range.hang()
    pilot.run(0.4)
    assert pilot.twin.range.resets == 1
    assert pilot.ask(Identify(), Identity, "range") == Identity(2, 7, WATCHDOG, 1)


@pytest.mark.parametrize("angle", [2.0, 8.0])
def test_gravity_and_brakes_are_those_of_the_slope(pilot, angle):
    """Free on a slope it speeds up by g sin(angle) less what rolling takes; braked it stands."""
    pilot.twin.faults.slope = Slope(math.radians(angle), 0.0)
    start = pilot.pose
    pilot.run(2.0)
    assert np.abs(pilot.pose - start).max() < 1e-3
    assert pilot.now.left == pilot.now.right == 0
    pilot.twin.faults.switches, pilot.twin.faults.push_switch = Switch.FREEWHEEL, True
    pilot.run(0.5)
    before = pilot.twin.motion.speed
    pilot.run(0.5)
    rise = (pilot.twin.motion.speed - before) / 0.5
    pull = 9.81 * math.sin(math.radians(angle))
    wheels = 135.0 / (135.0 + 2 * 0.15 / 0.165**2)
    assert rise == pytest.approx((pull - 0.25) * wheels, abs=0.12)


@pytest.mark.parametrize(("angle", "way", "end"), [(3, 0.5, 0.07), (6, 0.9, 0.16), (8, 1.2, 0.22)])
@pytest.mark.parametrize("state", ["board", "emergency stop", "hung"])
def test_the_lever_lifted_in_motion_leaves_a_chair_that_is_braked(angle, way, end, state):
    """180 kg at 0.5 m/s downhill: within 5 s, with the board at work, without power, or hung."""
    build("drive.elf")
    pilot = Pilot(chair=ChairSettings(body=BodySettings(mass=180.0))).start(0.5, 0.0, 2.0)
    faults, start = pilot.twin.faults, pilot.pose
    faults.slope, faults.switches = Slope(math.radians(angle)), Switch.FREEWHEEL
    if state == "emergency stop":
        faults.switches |= Switch.STOP_PRESSED
    elif state == "hung":
        pilot.twin.drive.hang()
    fastest = 0.0
    for _ in range(250):
        fastest = max(fastest, pilot.run(PERIOD).twin.motion.speed)
    assert fastest < 0.6
    assert np.hypot(*(pilot.pose - start)[:2]) < way
    assert pilot.twin.motion.speed < end
    assert pilot.now.faults & (Fault.RESET if state == "hung" else Fault.LEVER)
    assert not pilot.now.faults & Fault.RUNAWAY
    # A broken wire looks like the lever, and then the brakes can hold.
    assert not pilot.twin.drive.read_memory(lockstep._PORTL) & lockstep._RELEASE
    pilot.twin.close()


def test_an_attendant_pushes_it_with_the_push_switch_held_and_hardly_without(pilot):
    pilot.start(0.0, 0.0, 0.1)
    pilot.twin.faults.switches = Switch.STOP_PRESSED
    pilot.follow(None, 0.1)
    pilot.twin.faults.switches, pilot.twin.faults.push_force = Switch.FREEWHEEL, 250.0
    pilot.run(3.0)
    assert 0.15 < pilot.twin.motion.speed < 0.25  # shorted: 1,006 N s/m, and 34 N of rolling
    pilot.twin.faults.push_switch, pilot.twin.faults.push_force = True, 60.0
    pilot.run(3.0)
    assert pilot.twin.motion.speed > 0.6
    assert pilot.now.faults == Fault.EMERGENCY_STOP
    pilot.twin.faults.push_switch, pilot.twin.faults.push_force = False, 0.0
    pilot.run(0.5)
    assert pilot.twin.motion.speed < 0.05


def test_odometry_has_a_constant_age_at_every_load_of_the_board(pilot):
    """Within the millisecond that a host leaves between it and the begin of a period."""
    pilot.start(0.0, 0.0, 1.5)  # and its brakes close
    late = set()
    for twist in ((0.0, 0.0), (0.8, -0.3), (0.5, 1.0), (0.05, 0.9), (-0.3, -0.8), (0.0, 0.0)):
        for k in range(1000):
            if k % 97 == 0:
                pilot.send(protocol.Command(*twist))
            count = len(pilot.odometry)
            pilot.twin.run(0.001)
            pilot.listen()
            if len(pilot.odometry) > count:
                late.add(pilot.twin.steps - round(1e3 * pilot.now.stamp))
    assert max(late) - min(late) <= 1


@pytest.mark.parametrize(
    ("case", "number"),
    [
        ("runaway, host, 0.5 m/s, 8 deg down", 3),
        ("motors swapped", 5),
        ("zero asked on 2 to 8 deg", 1),
        ("joystick takes over, 0.8 m/s", 2),
        ("EEPROM damaged", 0),
        ("no fault: slopes to 8 deg", 9),  # starts into a turn while its load is not yet borne
        ("no fault: battery at 15 %", 18),  # a slow wheel rolls back while a turn ends
        ("strips", 3),
        ("strips", 7),
        ("strips", 16),  # pressed while it turns fast
        ("no fault: pushed by 250 N", 15),  # against its way and then along it, as it comes to rest
        ("no fault: 90 counts a turn", 51),  # to and fro by a count, after a protective stop
    ],
)
def test_the_hardest_trials_of_the_benchmark_keep_their_bounds(case, number):
    build_twin()
    for figure, (worst, bound) in drive_faults.trial(case, number).items():
        assert bound is None or worst <= bound, figure


def test_figures_whose_name_begins_with_min_have_lower_bounds():
    rows = bounds.summary([{"min_x": (2, 1), "x": (2, 1)}, {"min_x": (3, 1), "x": (1, 1)}])
    assert [(row["worst"], row["kept"]) for row in rows.values()] == [(2, True), (2, False)]


def test_both_boards_keep_their_time_under_all_input(pilot):
    """100 random floods at 10 to 100 % of the line's rate: 200 runs a second, and true speeds."""
    rng, boards = np.random.default_rng(6), (pilot.twin.drive, pilot.twin.range)
    words = [protocol.Get(7), protocol.Get(200), protocol.Set(3, 1e6), Identify(), protocol.Save()]
    words += [protocol.Unknown(0x55, rng.bytes(48)), None]
    pilot.start(0.5, 0.0, 1.0)
    boards[0].call("note", b"L", 4)
    for _ in range(100):
        if pilot.now.faults:  # commands may be lost
            assert Fault(pilot.now.faults) in (Fault.LINK, Fault.OVERRUN)
            pilot.run(1.0)
            assert abs(pilot.twin.motion.speed) < 1e-3
            pilot.start(0.5, 0.0, 0.1)
        word, share = words[rng.integers(len(words))], rng.uniform(0.1, 1.0)
        pilot.target, stamp = (rng.uniform(-0.3, 0.8), rng.uniform(-0.5, 0.5)), pilot.ranges.stamp
        boards[0].pin_changes()
        for _ in range(10):
            data = protocol.encode(word, 0) * 100 if word else rng.bytes(900)  # or noise
            for board in boards:
                board.write(data[: round(share * 890)])
            pilot.run(PERIOD)
        periods = np.diff(boards[0].pin_changes().astype(float)) / (1e-3 * FREQUENCY)
        assert periods.max() < 8.0
        assert periods.mean() == pytest.approx(5.0, abs=0.1)
        motion, half = pilot.twin.motion, 0.27 * pilot.twin.motion.turn
        true = motion.speed - half, motion.speed + half
        assert (pilot.now.speed_left, pilot.now.speed_right) == pytest.approx(true, abs=0.1)
        assert pilot.ranges.stamp - stamp > 0.1
    assert [board.resets for board in boards] == [0, 0]


def test_encoders_that_leave_no_time_for_the_control_stop_the_chair(pilot):
    """Both channels chatter at 140,000 edges a second: the board names what fails."""
    pilot.start(0.0, 0.0, 0.3)
    drive = pilot.twin.drive
    pilot.target = (0.3, 0.0)
    for _ in range(10):
        begun = drive.cycle
        for k in range(1390):
            drive.rotate_encoder("B", 0, 0.0, 1.0, begun + 230 * k + 115)
            drive.rotate_encoder("B", 0, 1.9, 0.9, begun + 230 * k + 230)
        pilot.run(PERIOD)
    assert (Fault(pilot.now.faults), drive.resets) == (Fault.OVERRUN, 0)
    assert pilot.twin.braked
    assert abs(pilot.twin.motion.speed) < 1e-3


def test_the_laser_says_what_it_sees(pilot):
    """Scans at 40 Hz in simulated time, through SCIP, to the millimetre."""
    pilot.twin.reset(box(3.0, (0.5, -0.4, 0.3)), 0)
    laser = Hokuyo("twin", 10.0, lambda: pilot.twin.steps * 1e-3, lambda _: pilot.twin.laser)
    scans = []
    for _ in range(25):
        pilot.twin.run(0.02)
        scans += laser.poll()
    assert len(scans) in (19, 20)
    assert np.diff([one.stamp for one in scans]) == pytest.approx(0.025)
    assert laser.specs.angles == pytest.approx(np.radians(np.linspace(-135, 135, 1081)))
    true = pilot.twin.plant.scan(0)
    assert scans[-1].scan.ranges == pytest.approx(true, abs=6e-4)
    pilot.twin.laser.silent = True
    pilot.twin.run(0.02)
    laser.poll()
    pilot.twin.run(1.1)
    assert laser.poll() == []
    assert "no answer" in laser.error
    pilot.twin.laser.silent = False
    for _ in range(100):
        pilot.twin.run(0.02)
        scans += laser.poll()
    assert laser.error == ""


def test_beams_that_no_hokuyo_has_are_said_so():
    assert sensor_specs(LaserSettings()).steps_per_turn == 1440
    assert sensor_specs(LaserSettings(beams=181, fov=math.pi)).steps_per_turn == 360
    with pytest.raises(InputError, match="64 beams over 270 deg"):
        sensor_specs(LaserSettings(beams=64))


def test_people_walk_in_the_twin_as_they_do_in_simulation(pilot):
    walker = person([(2.5, -2.0), (2.5, 2.0)], avoids=NOBODY)
    world = box(5.0, actors=[walker])
    chair = SimulatedChair(sensors=SensorSettings(noise=False), physics=PhysicsSettings(step=1e-3))
    chair.reset(world, 0)
    pilot.twin.reset(world, 0)
    apart, seen = [], []
    for reading in drives(chair, np.zeros(2), 40):
        pilot.run(0.1)
        twins = pilot.twin.plant.chair.chairs.worlds[0].actor_poses()
        apart.append(np.hypot(*(twins - chair.truth.actor_poses)[0, :2]))
        seen.append(np.nanmin(pilot.twin.plant.scan(0)))
        assert seen[-1] == pytest.approx(np.nanmin(reading.laser), abs=0.05)
    assert max(apart) < 0.02
    assert max(seen) - min(seen) > 0.3  # somebody passes


def test_a_person_who_walks_into_the_standing_twin_presses_its_strip(pilot):
    walker = person([(2.5, 0.0), (0.0, 0.0)], avoids=NOBODY)
    pilot.twin.reset(box(5.0, actors=[walker]), 0)
    pilot.run(0.5)
    assert pilot.twin.bumper_steps == 0
    pilot.run(4.0)
    assert pilot.twin.bumper_steps > 0
