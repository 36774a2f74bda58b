"""Laws of what is drawn for each episode: sensor errors and the delay of commands."""

import numpy as np
import pytest

from tests.sim.worlds import box
from wheelchair_gym.base.settings import InputError, load
from wheelchair_gym.safety import Shield
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.sim.randomization import RANDOMIZED, Randomization
from wheelchair_gym.sim.settings import ChairSettings

# Where the parameters of an episode hold each quantity.
FIELDS = {
    "laser.sigma": lambda p: p["laser_sigma"][0, :2],
    "laser.bias": lambda p: p["laser_bias"][0, :2],
    "laser.dropout": lambda p: p["laser_dropout"][0, :2],
    "laser.x_error": lambda p: p["laser_mount"][0, :2, 0] - (0.66, -0.2),
    "laser.y_error": lambda p: p["laser_mount"][0, :2, 1],
    "laser.yaw_error": lambda p: p["laser_mount"][0, :2, 2] - (0.0, 3.0),
    "ultrasonic.sigma": lambda p: p["ranger_sigma"][0],
    "odometry.diameter_error": lambda p: p["diameter_error"],
    "odometry.track_error": lambda p: p["track_error"],
    "odometry.variance": lambda p: p["wheel_variance"],
    "command_delay": lambda p: p["delay"] * p["dt"],
}
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
    values = drawn(Randomization(quantity=quantity, low=0.05, high=0.15))
    assert values.min() >= 0.05 - 1e-9
    assert values.max() <= 0.15 + 1e-9
    assert np.ptp(values) > 0.08
    if values.shape[1] > 1:  # each scanner and each ultrasonic has one of its own
        assert abs(np.corrcoef(values[:, 0], values[:, 1])[0, 1]) < 0.5


@pytest.mark.parametrize("quantity", RANDOMIZED)
def test_normal_draws_have_their_mean_and_stay_in_bounds(quantity):
    values = drawn(Randomization(quantity=quantity, distribution="normal", mean=0.05, std=0.03))
    assert abs(values.mean() - 0.05) < 0.02
    assert 0.015 < values.std() < 0.045
    if not quantity.endswith(("x_error", "y_error", "yaw_error")):
        assert values.min() >= 0.0


def test_without_rows_an_episode_is_as_the_settings_say():
    chair = SimulatedChair(sensors=TWO)
    chair.reset(box(), 7)
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
    late = SimulatedChair(ChairSettings(command_delay=0.01 * steps))
    prompt = SimulatedChair()
    for chair in (late, prompt):
        chair.reset(box(), 3)
    found = [[], []]
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
            given = shield.filter(np.array([0.8, 0.0]), reading)
            reading = chair.drive(given, shield.decision.protective)
        assert not chair.truth.touched
        assert chair.truth.pose[0] > 3.0


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([{"quantity": "laser.color"}], "it must be one of laser.sigma"),
        ([{"quantity": "laser.sigma", "distribution": "cauchy"}], "must be one of uniform, normal"),
        ([{"quantity": "laser.sigma", "low": 0.2, "high": 0.1}], "low is 0.2, above high, 0.1"),
        ([{"quantity": "laser.sigma", "mean": 0.1}], "mean and std are not of a uniform"),
        (
            [{"quantity": "laser.sigma", "distribution": "normal", "low": 0.1}],
            "low and high are not",
        ),
        ([{"quantity": "laser.dropout", "low": 0.5, "high": 1.5}], "expected values from 0 to 1"),
        ([{"quantity": "command_delay", "low": -0.1}], "expected values from 0 to 1"),
        ([{"quantity": "laser.sigma", "high": h} for h in (0.1, 0.2)], "names laser.sigma twice"),
    ],
)
def test_what_is_wrong_is_named_in_one_line(rows, message):
    with pytest.raises(InputError, match=message):
        load(ChairSettings, {"randomization": rows}, "chair.json")
