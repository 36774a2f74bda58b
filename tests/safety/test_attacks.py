"""Attackers who know the truth do no harm while the shield is on, and do while it is off."""

import numpy as np
import pytest

from tests.attacks import BACKWARDS, GREEDY, PIVOT, RANDOM, SCENES, SLOW, SWITCHES, Attack, entering
from wheelchair_gym.safety import ShieldSettings
from wheelchair_gym.sim.state import DECEITS


def attack(scene, rows, each, *, shield, faults=0.2, seed=0, bank=8, rate=10.0):
    report = Attack(scene, rows, shield, faults, bank=bank, rate=rate).run(seed, each)
    return report, [event for event in report.events if event.seen]


@pytest.mark.parametrize(
    ("scene", "rate"), [("floor_plan", 10.0), ("crossing", 10.0), ("edges", 20.0), ("people", 10.0)]
)
def test_with_the_shield_no_attack_does_harm(scene, rate):
    report, harmful = attack(scene, 48, 2, shield=True, rate=rate)
    assert harmful == []
    assert all(event.closing <= SLOW for event in report.events)


@pytest.mark.parametrize(
    ("scene", "rate", "seed", "faults"),
    [
        ("floor_plan", 20.0, 8000625, 0.2),
        ("hall", 20.0, 8000074, 0.2),
        ("hall", 10.0, 500062, 1.0),
        ("hall", 50.0, 500231, 1.0),
        ("clutter", 10.0, 500041, 1.0),
        ("edges", 5.0, 2122, 0.2),
        # A laser moved back by 0.3 m among cylinders is accepted after 1 s.
        pytest.param("clutter", 50.0, 8000439, 0.2, marks=pytest.mark.xfail(strict=True)),
    ],
)
def test_what_once_did_harm_does_no_harm(scene, rate, seed, faults):
    """A laser that begins to deceive close to something clears no obstacle, and the chair creeps.

    Round a corner at 5 Hz, a stop in comfort that leaves too little becomes a protective one.
    """
    given = {"faults": faults, "seed": seed, "rate": rate}
    report, harmful = attack(scene, 1, 4, shield=True, bank=200, **given)
    assert report.attacks == 4
    assert harmful == []


@pytest.mark.parametrize(("seed", "each"), [(251, 3), (372, 4)])
def test_what_nobody_could_see_is_met_slowly(seed, each):
    """While the chair's turn lags behind what it is set to, and its speed still rises."""
    report, _ = attack("floor_plan", 1, each, shield=True, seed=seed, bank=200, rate=20.0)
    assert report.contacts > 0
    assert all(event.closing < SLOW for event in report.events)


@pytest.mark.parametrize("rate", [5.0, 10.0, 20.0])
def test_nothing_of_the_outline_enters_unseen_cells_faster_than_it_may(rate, monkeypatch):
    """By the true twist, except in single periods at the edges of cells."""
    attacker = Attack("floor_plan", 64, True, 0.0, bank=64, rate=rate)
    attacker._kinds = np.array([BACKWARDS, SWITCHES, GREEDY, PIVOT, RANDOM])
    env, speeds = attacker.env, []
    outline, step = env.settings.chair.footprint.array, env.step

    def told(actions):
        result = step(actions)
        shields, free = env._shields, ~result[-1]["contact"]
        speed = entering(shields, result[-1]["twist"], outline, ShieldSettings().memory_time)
        speeds.append(speed[free & ~shields["decision"]["protective"]])
        return result

    monkeypatch.setattr(env, "step", told)
    attacker.run(0, 2)
    speeds = np.concatenate(speeds)
    assert np.quantile(speeds[speeds > 0.02], 0.95) > 0.08  # they tried
    assert (speeds > SLOW).sum() <= 5e-4 * len(speeds)
    assert speeds.max() < 1.2 * SLOW


def test_without_it_the_same_attacks_do():
    report, harmful = attack("floor_plan", 48, 2, shield=False)
    assert len(harmful) > 0.3 * report.attacks
    assert max(event.closing for event in harmful) > 0.5


def test_without_it_every_attack_on_an_edge_reaches_it():
    report, harmful = attack("edges", 32, 2, shield=False, faults=0.0)
    assert report.contacts == report.attacks
    assert len(harmful) > 0.9 * report.attacks


@pytest.mark.long
@pytest.mark.parametrize("rate", [5.0, 10.0, 50.0])
@pytest.mark.parametrize("scene", SCENES)
def test_thousands_of_attacks_do_no_harm(scene, rate):
    """A laser that begins to deceive close to something may do harm; nothing else may."""
    report, harmful = attack(scene, 250, 2, shield=True, seed=5_000, bank=100, rate=rate)
    assert all(event.fault in DECEITS for event in harmful)
    assert len(harmful) <= 2
    assert all(event.closing <= SLOW for event in report.events if not event.seen)
