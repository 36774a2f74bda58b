"""Laws of simulated people: what they give follows from settings, seed and chair."""

import numpy as np
import pytest

from tests.conftest import at_start, steps_of
from wheelchair_gym.base.settings import dump
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.geometry.outline import signed_clearance, signed_gap
from wheelchair_gym.geometry.planar import to_frame
from wheelchair_gym.people.drivers import DRIVERS, driver_spec, intention, make_driver
from wheelchair_gym.people.drivers.settings import (
    Driver,
    Hand,
    Intention,
    Perception,
    ProportionalStick,
)
from wheelchair_gym.people.drivers.state import WAYS, constants_of, signals_of, tremor_filter
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings

QUICK = {"scene": "clutter", "beams": 64}


def sticks(driver, steps=60, seed=3, drive=True, **settings):
    """The signals (steps, 2) of a person whose chair drives as it asks, or stands; and the env."""
    env = at_start(NavigationEnv(**(QUICK | settings), driver=driver, split="test"), seed)
    found = []
    for _ in range(steps):
        stick = env.task.stick
        found.append(stick[:2])
        action = np.array(stick[:2]) if drive else np.zeros(2)
        if any(env.step(action)[2:4]):
            break
    return np.array(found), env


@pytest.mark.parametrize("name", DRIVERS)
def test_each_is_made_and_stored(name):
    made = make_driver(name)
    assert isinstance(made, Driver)
    assert make_driver(driver_spec(made)) == made
    assert make_driver({"name": name, **dump(made)}) == made
    signals = signals_of(made)
    assert (signals[0] == 0.0).all()
    assert np.abs(signals).max() <= 1.0
    person = constants_of(made, ChairSettings(), SensorSettings(), 0.1)[0]
    assert person["n_signals"] == len(signals)


def test_another_interface_has_the_rest_of_the_person():
    made = make_driver({"name": "novice", "interface": {"kind": "scanning"}})
    assert made.interface.kind == "scanning"
    assert made.intention == make_driver("novice").intention


def test_a_tremor_has_its_frequency_and_amplitude():
    hand = Hand(tremor=0.15, tremor_frequency=6.0)
    a, b, gain = tremor_filter(hand, 0.01)
    rng, values = np.random.default_rng(0), np.zeros(200_000)
    for k in range(2, len(values)):
        values[k] = a * values[k - 1] - b * values[k - 2] + gain * rng.standard_normal()
    power = np.abs(np.fft.rfft(values)) ** 2
    frequencies = np.fft.rfftfreq(len(values), 0.01)
    assert power.cumsum().searchsorted(0.5 * power.sum()) / 2000.0 == pytest.approx(6.0, abs=0.2)
    assert frequencies[-1] == pytest.approx(50.0)
    assert np.sqrt(2.0) * values.std() == pytest.approx(0.15, rel=0.05)


def test_the_hand_trembles_as_its_settings_say():
    """At 100 Hz of control each tick is seen; the person rests, since the goal is far behind it."""
    still = Driver(
        Intention(period=5.0),
        Perception(reaction=2.0),
        Hand(tremor=0.3, tremor_frequency=4.0),
        ProportionalStick(dead_zone=0.0, smoothing=0.0, levels=1e6),
    )
    found, _ = sticks(still, steps=180, drive=False, rate=100.0)  # until the first decision acts
    power = np.abs(np.fft.rfft(found[:, 0])) ** 2
    assert np.fft.rfftfreq(len(found), 0.01)[power.argmax()] == pytest.approx(4.0, abs=1.2)
    assert 0.05 < np.sqrt(2.0) * found.std() < 0.6


def test_a_dead_zone_hides_what_is_small_and_steps_are_of_a_byte():
    trembling = Hand(tremor=0.05)
    free = Driver(
        Intention(period=5.0), Perception(reaction=2.0), trembling, ProportionalStick(dead_zone=0.0)
    )
    found, _ = sticks(free, steps=15, drive=False)
    assert found.any()
    assert np.allclose(found * 127.0, np.round(found * 127.0))
    zone = Driver(free.intention, free.perception, trembling, ProportionalStick(dead_zone=0.5))
    assert not sticks(zone, steps=15, drive=False)[0].any()


def test_nothing_is_given_before_the_reaction_time():
    late = make_driver({"name": "expert", "perception": {"reaction": 1.0}})
    found, _ = sticks(late, steps=30)
    assert not found[:10].any()
    assert found[10:20].any()


def test_weakness_shrinks_one_side_alone():
    strong, _ = sticks("expert", drive=False, steps=40)
    weak, _ = sticks({"name": "expert", "hand": {"forward": 0.3}}, drive=False, steps=40)
    assert 0.0 < weak[:, 0].max() < 0.5 * strong[:, 0].max()


def test_a_driver_without_sight_drives_on_and_one_with_sight_brakes():
    _, blind = sticks("blind", steps=40)
    _, sees = sticks("expert", steps=40)
    assert blind.drivers.states["n_points"][0] == 0
    assert sees.drivers.states["n_points"][0] > 20


def test_neglect_hides_most_of_the_left():
    _, env = sticks("hemineglect", steps=30)
    d = env.drivers.states[0]
    points = d["points"][: d["n_points"]]
    sides = np.arctan2(points[:, 1], points[:, 0])
    assert (sides > np.radians(10)).sum() < 0.6 * (sides < -np.radians(10)).sum()
    _, env = sticks("hemianopia", steps=30)
    d = env.drivers.states[0]
    assert (d["points"][: d["n_points"], 1] < 1e-9).all()


@pytest.mark.parametrize("driver", ["head_array", "weak_left"])
def test_the_signal_that_is_chosen_costs_least(driver):
    """All signals are weighed as one by one, though most are left out early."""
    for seed in range(3):
        _, env = sticks(driver, steps=15, seed=seed)
        d = env.drivers.states[0]
        p = constants_of(env.drivers.driver, ChairSettings(), SensorSettings(), 0.1)[0]
        p["beams"], p["per_beam"], p["coarse"] = 64, np.radians(270) / 63, 1
        prepared, truth = env._prepared.record[0], env.chair.truth
        chosen = intention._choose(p, d, prepared, truth.pose, truth.twist)
        costs = []
        for k in range(p["n_signals"]):
            begin, to_go = intention._begin(p, truth.twist, k), np.empty(intention.POSES)
            before = signed_gap(d["points"], d["n_points"], p["outline"], *begin)
            bound = intention._min_cost(p, d, prepared, k, begin, truth.pose, to_go)
            costs.append(intention._cost(p, d, k, begin, to_go, before, np.inf))
            assert costs[-1] >= bound
        assert chosen == int(np.argmin(costs))


@pytest.mark.parametrize(("driver", "seed"), [("sip_and_puff", 0), ("scanning", 5)])
def test_few_signals_do_not_turn_a_chair_to_and_fro_for_ever(driver, seed):
    """A slow way ahead is worth more than a short turn from one good heading to another."""
    env = at_start(NavigationEnv(
        scene="floor_plan", driver=driver, assistant="shield", shield=True,
        config={"task": {"time_base": 60.0, "time_factor": 10.0}}, split="test"
    ), seed)  # fmt: skip
    *_, (*_, info) = steps_of(env, np.zeros(2))
    assert info["is_success"]


def test_a_driver_who_aims_at_obstacles_does_not_slow_before_a_desk():
    _, env = sticks("expert", scene={"name": "skill", "course": "dock"})
    d, prepared = env.drivers.states[0], env._prepared.record[0]
    p = constants_of(env.drivers.driver, ChairSettings(), SensorSettings(), 0.1)[0]
    for way, slows in (("outline", True), ("obstacle", False)):
        p["way"] = WAYS.index(way)
        intention._take_aim(p, d, prepared, env.chair.truth.pose)
        assert np.isfinite(d["fastest"]) == slows


def test_the_gap_to_points_is_the_least_of_their_distances():
    rng, outline = np.random.default_rng(0), ChairSettings().footprint.array
    for _ in range(50):
        points, pose = rng.uniform(-2.0, 2.0, (20, 2)), rng.uniform(-1.0, 1.0, 3)
        within = to_frame(points, pose)
        count = int(rng.integers(0, 20))
        each = [signed_clearance(*point, outline) for point in within[:count]]
        assert signed_gap(points, count, outline, *pose) == pytest.approx(
            min(each, default=np.inf), abs=1e-12
        )


def test_latched_signals_last_and_end_by_a_signal():
    found, env = sticks("sip_and_puff", steps=150)
    assert env.drivers.states["presses"][0] > 0
    driven = found[:, 0] != 0.0
    assert driven.any()
    values = {tuple(np.round(row, 6)) for row in found}
    assert values <= {tuple(np.round(row, 6)) for row in signals_of(make_driver("sip_and_puff"))}


def test_a_scan_takes_its_time():
    """From rest, forward is lit first: it cannot be picked before its time has passed."""
    found, _ = sticks("scanning", steps=40)
    assert not found[: int(0.28 * 10 + 12)].any()
    assert found.any()


def test_a_person_reacts_to_the_motion_that_was_given():
    """A driver that pushes in vain backs off; one that moves does not."""
    pushed, env = sticks("expert", steps=80, drive=False)
    assert (pushed[:, 0] < -0.05).any()
    assert env.drivers.states["decisions"][0] >= 15


def test_a_lapse_keeps_the_last_signal():
    absent = {"name": "expert", "perception": {"lapses": 60.0}, "intention": {"period": 1.0}}
    assert not sticks(absent, steps=30)[0].any()
    assert sticks({**absent, "perception": {}}, steps=30)[0].any()


def test_minds_change_only_where_settings_say():
    wavering = {"name": "expert", "intention": {"mind_changes": 30.0}}
    found, _ = sticks(wavering, steps=60, scene="floor_plan")
    firm, _ = sticks("expert", steps=60, scene="floor_plan")
    n = min(len(found), len(firm))
    assert not np.array_equal(found[:n], firm[:n])
