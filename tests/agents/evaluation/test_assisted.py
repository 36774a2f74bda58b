"""Measures of drives with a person, against values worked out by hand; and their comparison."""

import math
from dataclasses import replace

import numpy as np
import pytest

from agents.cli import main
from agents.cli.compare import assistants, with_drivers
from agents.evaluation.assisted import MEASURES, StickTrace
from agents.evaluation.compare import terminal_table
from agents.evaluation.evaluate import episode_env
from agents.evaluation.plots import unbeaten
from tests.benchmarks.assisted_drives import driver_of, with_expert
from tests.conftest import output_of
from wheelchair_gym.base.settings import read_json
from wheelchair_gym.geometry.kinematics import Limits
from wheelchair_gym.people.drivers import make_driver
from wheelchair_gym.types import Stick

LIMITS = Limits()
PERIOD = 0.1


def figures(sticks, given, twists=None, length=1.0):
    trace = StickTrace(LIMITS, PERIOD)
    for stick, twist in zip(sticks, given, strict=True):
        trace.add(Stick(*stick), np.array(twist))
    moved = np.zeros((len(sticks) + 1, 2)) if twists is None else np.array(twists)
    return trace.figures(moved, length)


def test_to_be_given_what_was_asked_is_full_agreement():
    sticks = [(1.0, 0.5, False)] * 10
    found = figures(sticks, [(0.8, 0.5)] * 10, length=2.0)
    assert found["agreement_angle"] == pytest.approx(0.0)
    assert found["intervention_share"] == found["intervention_size"] == found["authority"] == 0.0
    assert found["stick_movements"] == pytest.approx(60.0)  # one in a second
    assert found["stick_effort"] == pytest.approx(math.hypot(1.0, 0.5) * 1.0 / 2.0)
    assert found["stick_travel"] == pytest.approx(math.hypot(1.0, 0.5) / 2.0)
    assert set(found) == set(MEASURES)


def test_a_quarter_turn_and_half_the_time():
    """Ahead is asked for; in half of the steps a turn in place is given."""
    sticks = [(1.0, 0.0, False)] * 10
    found = figures(sticks, [(0.8, 0.0), (0.0, 1.0)] * 5)
    assert found["agreement_angle"] == pytest.approx(math.pi / 4)
    assert found["intervention_share"] == pytest.approx(0.5)
    assert found["intervention_size"] == pytest.approx(math.sqrt(2) / 2)
    assert found["authority"] == pytest.approx(5 * math.sqrt(2) / (10 + 5 * math.sqrt(2)))


def test_a_stick_that_rests_has_no_direction():
    found = figures([(0.0, 0.0, False)] * 5, [(0.0, 0.0)] * 5)
    assert found["agreement_angle"] == found["intervention_size"] == math.inf
    assert found["authority"] == math.inf
    assert found["stick_movements"] == 0.0


def test_movements_are_excursions_and_turns_that_are_held():
    out, centre, left = (1.0, 0.0, False), (0.05, 0.0, False), (0.0, 1.0, False)
    found = figures([out, out, centre, out, left, left, left, centre, out, centre], [(0, 0)] * 10)
    assert found["stick_movements"] == pytest.approx(4 * 60.0)  # out, out, left, out in a second


def test_motion_long_after_the_stick_was_let_go_is_unwanted():
    n = 40
    sticks = [(1.0, 0.0, False)] + [(0.0, 0.0, False)] * (n - 1)
    twists = [(0.4, 0.0)] * (n + 1)
    found = figures(sticks, [(0.0, 0.0)] * n, twists)
    assert found["unwanted_motion"] == pytest.approx((n - 1) * PERIOD - 1.5, abs=PERIOD + 1e-9)
    latched = [(1.0, 0.0, True)] + [(0.0, 0.0, True)] * (n - 1)
    assert figures(latched, [(0.0, 0.0)] * n, twists)["unwanted_motion"] == 0.0
    assert figures([(0.0, 0.0, False)] * n, [(0, 0)] * n, twists)["unwanted_motion"] == 0.0


def test_only_the_bare_stick_is_compared_without_the_shield():
    policies = assistants(["direct", "shield"])
    (scene,) = with_drivers(["clutter"], ["novice"])
    env = {"shield": True}
    assert [episode_env(scene, env, each)["shield"] for each in policies] == [False, True]
    assert episode_env(scene, env)["driver"] == "novice"
    assert scene["label"] == "clutter, novice"


def test_people_and_assistants_are_compared(tmp_path, capsys):
    command = [
        "compare", "--driver", "expert,sip_and_puff", "--assist", "direct,slide", "--scenes",
        "clutter", "--episodes", "1", "--jobs", "1", "--no-video", "--quiet", "--out",
        str(tmp_path),
    ]  # fmt: skip
    shown = output_of(command, capsys)
    assert "off the stick [deg]" in shown
    evaluation = read_json(tmp_path / "results.json")
    assert evaluation["policies"] == ["direct", "slide"]
    assert evaluation["scenes"] == ["clutter, expert", "clutter, sip_and_puff"]
    for record in evaluation["records"]:
        assert set(MEASURES) <= set(record)
        if record["policy"] == "direct":
            assert record["intervention_share"] == 0.0
    assert "with a person at the stick" in (tmp_path / "report.html").read_text()
    report = (tmp_path / "report.html").read_text()
    assert 0 < report.find("Success against authority") < report.find("Success by scene")
    assert "stick travel" in terminal_table(evaluation, ["all"])
    stored = (tmp_path / "episodes.jsonl").read_text()
    assert main(command) == 0  # nothing is driven again
    assert (tmp_path / "episodes.jsonl").read_text() == stored


def test_what_is_unbeaten_has_less_authority_or_more_success():
    points = [(20.0, 80.0), (0.0, 50.0), (10.0, 80.0), (10.0, 70.0), (30.0, 90.0), (5.0, 40.0)]
    assert unbeaten(points) == [1, 2, 4]


def test_benchmarks_change_one_setting_of_a_driver_and_keep_the_rest():
    usual = make_driver("sip_and_puff")
    changed = make_driver(driver_of("sip_and_puff+interface.error=0.1"))
    assert changed.interface == replace(usual.interface, error=0.1)
    assert changed.intention == usual.intention
    assert make_driver(driver_of("ataxia+hand.tremor=0.3")).hand.tremor == 0.3
    expert = make_driver(driver_of(with_expert("sip_and_puff+interface.error=0.1")))
    assert expert == replace(make_driver("expert"), interface=changed.interface)
