"""Attackers who know the truth do no harm while the shield is on, and do while it is off."""

from __future__ import annotations

import pytest

from tests.attacks import SCENES, SLOW, Attack


def attack(scene, rows, each, *, shield, faults=0.2, seed=0, bank=8, rate=10.0):
    report = Attack(scene, rows, shield, faults, bank=bank, rate=rate).run(seed, each)
    return report, [event for event in report.events if event.seen]


@pytest.mark.parametrize(
    ("scene", "rate"), [("floor_plan", 10.0), ("crossing", 10.0), ("edges", 20.0)]
)
def test_with_the_shield_no_attack_does_harm(scene, rate):
    report, harmful = attack(scene, 48, 2, shield=True, rate=rate)
    assert harmful == []
    assert all(event.closing <= SLOW for event in report.events)


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
    report, harmful = attack(scene, 250, 2, shield=True, seed=5_000, bank=100, rate=rate)
    assert harmful == []
    assert all(event.closing <= SLOW for event in report.events)
