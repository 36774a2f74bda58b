"""Laws of what is drawn for each episode: sensor errors and the delay of commands."""

import dataclasses
import hashlib

import numpy as np
import pytest

from tests.sim.worlds import box, busy, cluttered, drive_for, exact_chair, placed, step
from wheelchair_gym.base.settings import load
from wheelchair_gym.geometry.kinematics import DriveGeometry
from wheelchair_gym.safety import Shield
from wheelchair_gym.sensors.settings import LaserSettings, OdometrySettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.randomization import RANDOMIZED, JointRandomization, Randomization
from wheelchair_gym.sim.settings import ChairSettings, MotorSettings, PhysicsSettings

# Where the parameters of an episode hold each quantity.
FIELDS = {
    "laser.sigma": lambda p: p["laser_sigma"][0, :2],
    "laser.bias": lambda p: p["laser_bias"][0, :2],
    "laser.dropout": lambda p: p["laser_dropout"][0, :2],
    "laser.x_error": lambda p: p["laser_mount"][0, :2, 0] - (0.66, -0.2),
    "laser.y_error": lambda p: p["laser_mount"][0, :2, 1],
    "laser.yaw_error": lambda p: p["laser_mount"][0, :2, 2] - (0.0, 3.0),
    "ultrasonic.sigma": lambda p: p["ranger_sigma"][0],
    "odometry.diameter_error": lambda p: 2.0 * (p["radius_right"] - p["radius_left"]) / radii(p),
    "odometry.track_error": lambda p: p["track"] / p["nominal_track"] - 1.0,
    "odometry.variance": lambda p: p["wheel_variance"],
    "command_delay": lambda p: p["delay"] * p["dt"],
    "laser.offset_error": lambda p: p["laser_offset"][0, :2],
    "odometry.scale_error": lambda p: 0.5 * radii(p) / p["nominal_radius"] - 1.0,
    "body.mass": lambda p: p["mass"],
    "body.rolling_resistance": lambda p: p["body"]["rolling_resistance"],
    "body.caster_drag": lambda p: p["body"]["caster_drag"],
    "motor.gain": lambda p: p["gain"],
    "motor.resistance": lambda p: p["motor"]["resistance"],
    "physics.slope": lambda p: np.arcsin(np.hypot(*p["pull"].T) / 9.81),
}
SCALE = {"body.mass": 1000.0, "motor.gain": 10.0}  # of the numbers of the tests


def radii(p):
    return p["radius_right"] + p["radius_left"]


TWO = SensorSettings(more_lasers=(LaserSettings(x=-0.2, yaw=3.0, beams=31),))
AHEAD = np.array([0.5, 0.0])


def drawn(row, keys=60, sensors=TWO):
    """The values (keys, items) of one quantity in several episodes."""
    chair, found = SimulatedChair(ChairSettings(randomization=(row,)), sensors), []
    for key in range(keys):
        chair.reset(box(), key)
        found.append(np.array(FIELDS[row.quantity](chair.parameters), np.float64))
    return np.array(found)


def test_every_quantity_is_tested():
    assert set(FIELDS) == set(RANDOMIZED)


@pytest.mark.parametrize("quantity", RANDOMIZED)
def test_uniform_draws_fill_their_range_anew_in_each_episode(quantity):
    scale = SCALE.get(quantity, 1.0)
    row = Randomization(quantity=quantity, low=0.05 * scale, high=0.15 * scale)
    values = drawn(row) / scale
    assert values.min() >= 0.05 - 1e-9
    assert values.max() <= 0.15 + 1e-9
    assert np.ptp(values) > 0.08
    if values.shape[1] > 1:  # each scanner and each ultrasonic has one of its own
        assert abs(np.corrcoef(values[:, 0], values[:, 1])[0, 1]) < 0.5


@pytest.mark.parametrize("quantity", RANDOMIZED)
def test_normal_draws_have_their_mean_and_stay_in_bounds(quantity):
    scale = SCALE.get(quantity, 1.0)
    row = {
        "quantity": quantity, "distribution": "normal", "mean": 0.05 * scale, "std": 0.03 * scale,
    }  # fmt: skip
    values = drawn(load(Randomization, row, "row")) / scale
    assert abs(values.mean() - 0.05) < 0.02
    assert 0.015 < values.std() < 0.045
    if not quantity.endswith("_error") and quantity != "physics.slope":
        assert values.min() >= 0.0


@pytest.mark.parametrize("quantity", RANDOMIZED)
def test_equal_bounds_mean_that_value(quantity):
    value = 0.1 * SCALE.get(quantity, 1.0)
    values = drawn(Randomization(quantity=quantity, low=value, high=value), 3)
    assert values == pytest.approx(value, rel=1e-9)


def test_a_joint_row_draws_its_covariance():
    """A weak motor with a light chair: the ratio is known, either alone is not."""
    names = ("motor.gain", "body.mass", "laser.offset_error")
    spread = np.array([(0.2, 0.0), (28.0, 0.0), (0.0, 0.01)])
    joint = JointRandomization(
        quantities=names, mean=(1.0, 140.0, 0.02), covariance=(spread @ spread.T).tolist()
    )
    chair, found = SimulatedChair(ChairSettings(joint=joint), sensors=TWO), []
    for key in range(400):
        chair.reset(box(), key)
        p = chair.parameters
        found.append([p["gain"][0], p["mass"][0], *p["laser_offset"][0, :2]])
    gain, mass, offset, second = np.array(found).T
    assert gain.std() == pytest.approx(0.2, rel=0.1)
    assert gain.mean() == pytest.approx(1.0, abs=0.03)
    assert np.allclose(mass / gain, 140.0)
    assert offset.std() == pytest.approx(0.01, rel=0.1)
    assert abs(np.corrcoef(gain, offset)[0, 1]) < 0.15
    assert not second.any()  # of the second scanner
    settings = ChairSettings(joint=joint)
    assert settings.max_mass == pytest.approx(140.0 + 28.0 * 3.46)
    assert settings.min_gain == pytest.approx(1.0 - 0.2 * 3.46)


def test_without_rows_an_episode_is_as_the_settings_say():
    chair = placed(SimulatedChair(sensors=TWO), box(), 7)
    base, now = chair.chairs.base, chair.parameters
    for name in ("laser_sigma", "laser_bias", "laser_dropout", "laser_mount", "ranger_sigma"):
        assert np.array_equal(base[name], now[name])
    assert now["delay"][0] == 0


def test_without_noise_sensors_are_exact_and_commands_are_late():
    rows = (
        Randomization(quantity="laser.sigma", low=0.1, high=0.2),
        Randomization(quantity="laser.yaw_error", low=0.1, high=0.2),
        Randomization(quantity="command_delay", low=0.05, high=0.05),
    )
    chair = SimulatedChair(ChairSettings(randomization=rows), SensorSettings(noise=False))
    other = SimulatedChair(sensors=SensorSettings(noise=False))
    assert np.array_equal(chair.reset(box(), 3).laser, other.reset(box(), 3).laser)
    assert chair.parameters["delay"][0] == 5


def test_a_scanner_that_is_mounted_wrong_sees_the_world_turned():
    turned = Randomization(quantity="laser.yaw_error", low=np.radians(10.0), high=np.radians(10.0))
    exact = LaserSettings(sigma=0.0, bias=0.0, dropout=0.0)
    sensors = SensorSettings(laser=exact)
    seen = SimulatedChair(ChairSettings(randomization=(turned,)), sensors).reset(box(), 3).laser
    other = SimulatedChair(sensors=sensors).reset(box(), 3).laser
    steps = 40  # beams, 0.25 degrees apart
    assert np.allclose(seen[:-steps], other[steps:], atol=1e-4)


@pytest.mark.parametrize("steps", [1, 10, 25])
def test_a_command_takes_effect_so_much_later(steps):
    late = placed(SimulatedChair(ChairSettings(command_delay=0.01 * steps)), box(), 3)
    prompt, found = placed(SimulatedChair(), box(), 3), [[], []]
    for k in range(12):
        twist = AHEAD if k < 6 else -0.4 * AHEAD
        for chair, trace in zip((late, prompt), found, strict=True):
            chair.drive(twist)
            trace.append(chair.state["v"][0])
    if steps == 10:  # one control period
        assert np.array_equal(found[0][1:], found[1][:-1])
    assert found[0] != found[1]
    assert abs(np.array(found[0])).sum() > 0.1


@pytest.mark.parametrize("delay", [0.1, 0.3])
def test_the_shield_stops_a_chair_whose_commands_are_late(delay):
    row = Randomization(quantity="command_delay", low=0.0, high=delay)
    settings = ChairSettings(randomization=(row,))
    assert settings.longest_delay == delay
    for key in range(4):
        chair, shield = SimulatedChair(settings), Shield(chair=settings)
        reading = chair.reset(box(5.0, (2.0, 0.0, 0.0)), key)
        for _ in range(100):
            reading = step(chair, shield, (0.8, 0.0), reading)
        assert not chair.truth.touched
        assert chair.truth.pose[0] > 3.0


DIGEST = "d6a7ff9aafae8fb7484ac05403d31351e4c4f585cdd4c3559b13d9015eab0eca"


def test_default_settings_drive_as_before_there_were_others():
    """To the micrometre, of what two chairs sense in two worlds: one drawn, one as specified."""
    digest = hashlib.sha256()
    for world in (cluttered, busy):
        for randomize in (False, True):
            sensors = SensorSettings(pose_source="odometry")
            chair = SimulatedChair(ChairSettings(randomize=randomize), sensors)
            chair.reset(world(3), 11)
            for k in range(60):
                twist = np.array([0.5 * np.sin(0.2 * k) + 0.2, np.cos(0.13 * k)])
                reading, state = chair.drive(twist, k == 40), chair.state
                for values in (
                    reading.laser, reading.ultrasonic, reading.pose, reading.twist,
                    chair.truth.pose, state["duty"], state["voltage"], state["charge"],
                ):  # fmt: skip
                    values = np.nan_to_num(np.asarray(values, np.float64), posinf=99, neginf=-9)
                    digest.update((np.round(values, 6) + 0.0).tobytes())
    assert digest.hexdigest() == DIGEST


def test_a_ratio_of_the_wheels_that_is_known_is_no_error():
    """It drives straight, and its odometry knows where it is; one that is unknown turns it."""
    drives = {
        "known": ChairSettings(drive=DriveGeometry(wheel_ratio=1.02)),
        "unknown": ChairSettings(
            randomization=(Randomization("odometry.diameter_error", low=0.02, high=0.02),)
        ),
    }
    yaws = {}
    for name, settings in drives.items():
        sensors = SensorSettings(pose_source="odometry", odometry=OdometrySettings(0.0, 0.0, 0.0))
        chair = placed(SimulatedChair(settings, sensors), box(50.0))
        reading = drive_for(chair, np.array([0.5, 0.0]), 80)
        p = chair.parameters[0]
        assert p["radius_right"] / p["radius_left"] == pytest.approx(1.02, abs=3e-4)
        yaws[name] = chair.truth.pose[2]
        off = np.abs(reading.pose - chair.truth.pose).max()
        assert off < 0.01 if name == "known" else off > 0.1
    assert abs(yaws["known"]) < 1e-3
    assert yaws["unknown"] > 0.1


def test_a_chair_rolls_down_a_slope_that_its_motors_do_not_hold():
    """With motors that resist little, at g sin(angle) less rolling resistance."""
    free = ChairSettings(motor=MotorSettings(resistance=100.0, kp=0.0, ki=0.0, ka=0.0))
    for downhill, sign in ((0.0, 1.0), (np.pi, -1.0), (np.pi / 2.0, 0.0)):
        physics = PhysicsSettings(slope=0.05, downhill=downhill)
        chair = placed(SimulatedChair(free, SensorSettings(noise=False), physics), box(50.0))
        drive_for(chair, np.zeros(2), 10)
        speed = 9.81 * np.sin(0.05) * 1.0
        assert sign * chair.truth.twist[0] == pytest.approx(abs(sign) * speed, rel=0.5, abs=2e-3)
        if sign:
            assert 0.3 * speed < sign * chair.truth.twist[0] < speed


def test_an_offset_that_the_chair_knows_does_not_reach_a_reading():
    exact = LaserSettings(sigma=0.0, bias=0.0, dropout=0.0, offset=0.05)
    known = SimulatedChair(sensors=SensorSettings(laser=exact)).reset(box(), 3).laser
    plain = SensorSettings(laser=dataclasses.replace(exact, offset=0.0))
    assert np.array_equal(known, SimulatedChair(sensors=plain).reset(box(), 3).laser)
    row = Randomization(quantity="laser.offset_error", low=-0.05, high=-0.05)
    unknown = SimulatedChair(ChairSettings(randomization=(row,)), sensors=plain)
    assert np.allclose(unknown.reset(box(), 3).laser, known - 0.05, atol=1e-6)


def test_a_board_may_believe_in_another_motor():
    """The gain turns it faster than the feed-forward expects; the speed control makes it good."""
    speeds = []
    for gain, feed in ((1.0, None), (1.0, 1.85), (0.5, None)):
        motor = MotorSettings(gain=gain, feed_constant=feed, ki=0.0)
        chair = placed(exact_chair(motor=motor), box(50.0))
        drive_for(chair, np.array([0.5, 0.0]), 30)
        speeds.append(chair.truth.twist[0])
    assert speeds[1] < speeds[0] - 0.05
    assert speeds[2] < speeds[0] - 0.005
