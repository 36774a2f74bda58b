"""Verdicts on data whose truth is known, and the fit of readings to printed figures."""

from dataclasses import replace

import numpy as np
import pytest

from agents.studies import claims
from agents.studies.claims import Claim, ClaimVerdict
from agents.studies.model import Results, Row
from agents.studies.runner import STUDIES

CLAIMS = 100


def sample(mean, sd=1.0, n=200, seed=0, strata=3):
    """Three maps of different lengths, the same effect."""
    rng = np.random.default_rng(seed)
    return {f"map {k}": 10.0 * k + mean + sd * rng.normal(size=n) for k in range(strata)}


def steps(slope, sd=1.0, n=100, count=6):
    return [sample(100.0 + slope * k, sd, n, seed=k) for k in range(count)], list(range(count))


def of(found):
    return found.verdict(CLAIMS)


LESS, MORE, SAME = sample(95.0, seed=1), sample(105.0, seed=2), sample(100.02, seed=3)
BASE = sample(100.0, seed=4)
PAIRS = np.random.default_rng(0).normal(100.0, 5.0, 300)
NOISE = np.random.default_rng(1).normal(0.0, 1.0, 300)
PAIRED, SHORTER, LONGER = {"": PAIRS}, {"": PAIRS - 0.5 + NOISE}, {"": PAIRS + 0.5 + NOISE}
ONE, TWO = {"a": np.full(3, 1.0)}, {"a": np.full(3, 2.0)}  # without chance


def shared_steps(slope, missing=np.nan, count=5):
    """Rows of the same runs: their large chance is shared, and one run may have no value."""
    rng = np.random.default_rng(2)
    rows = [PAIRS + slope * k + 0.3 * rng.normal(size=len(PAIRS)) for k in range(count)]
    rows[1][7] = missing
    return [{"": row} for row in rows], list(range(count))


@pytest.mark.parametrize(
    ("found", "verdict"),
    [
        (claims.below(LESS, BASE, 0.01, ""), ClaimVerdict.HOLDS),
        (claims.below(MORE, BASE, 0.01, ""), ClaimVerdict.FAILS),
        (claims.below(SAME, BASE, 0.01, ""), ClaimVerdict.FAILS),  # surely no difference worth it
        (claims.above(MORE, BASE, 0.01, ""), ClaimVerdict.HOLDS),
        (claims.above(LESS, BASE, 0.01, ""), ClaimVerdict.FAILS),
        (claims.between(SAME, BASE, -0.01, 0.01, ""), ClaimVerdict.HOLDS),
        (claims.between(LESS, BASE, -0.01, 0.01, ""), ClaimVerdict.FAILS),
        (claims.between(LESS, BASE, -0.08, -0.02, ""), ClaimVerdict.HOLDS),
        (claims.between(LESS, BASE, -0.20, -0.10, ""), ClaimVerdict.FAILS),
        (claims.falls(*steps(-1.0), 0.01, ""), ClaimVerdict.HOLDS),
        (claims.falls(*steps(1.0), 0.01, ""), ClaimVerdict.FAILS),
        (claims.falls(*steps(0.0), 0.02, ""), ClaimVerdict.FAILS),
        (claims.rises(*steps(1.0), 0.01, ""), ClaimVerdict.HOLDS),
        (claims.rises(*steps(-1.0), 0.01, ""), ClaimVerdict.FAILS),
        (claims.level(*steps(0.0), 0.02, ""), ClaimVerdict.HOLDS),
        (claims.level(*steps(2.0), 0.02, ""), ClaimVerdict.FAILS),
        (claims.paired_below(PAIRS - 2.0 + NOISE, PAIRS, 0.005, ""), ClaimVerdict.HOLDS),
        (claims.paired_below(PAIRS + 2.0 + NOISE, PAIRS, 0.005, ""), ClaimVerdict.FAILS),
        (claims.paired_below(PAIRS + NOISE, PAIRS, 0.01, ""), ClaimVerdict.FAILS),
        # Runs that share most of their chance: compared run by run.
        (claims.below(SHORTER, PAIRED, 0.001, "", True), ClaimVerdict.HOLDS),
        (claims.below(LONGER, PAIRED, 0.001, "", True), ClaimVerdict.FAILS),
        (claims.above(LONGER, PAIRED, 0.001, "", True), ClaimVerdict.HOLDS),
        (claims.below(SHORTER, PAIRED, 0.001, ""), ClaimVerdict.OPEN),
        (claims.rises(*shared_steps(0.2), 0.001, "", True), ClaimVerdict.HOLDS),
        (claims.falls(*shared_steps(0.2), 0.001, "", True), ClaimVerdict.FAILS),
        (claims.rises(*shared_steps(0.2, 100.0), 0.001, ""), ClaimVerdict.OPEN),
        (claims.level(*shared_steps(0.0), 0.005, "", True), ClaimVerdict.HOLDS),
        (claims.spread_below({"": NOISE}, {"": 2 * NOISE[::-1]}, 0.05, ""), ClaimVerdict.HOLDS),
        (claims.spread_below({"": 2 * NOISE}, {"": NOISE[::-1]}, 0.05, ""), ClaimVerdict.FAILS),
        (claims.share_above(495, 500, 0.95, ""), ClaimVerdict.HOLDS),
        (claims.share_above(400, 500, 0.95, ""), ClaimVerdict.FAILS),
        (claims.below(ONE, TWO, 0.01, ""), ClaimVerdict.HOLDS),
        (claims.below(TWO, TWO, 0.01, ""), ClaimVerdict.FAILS),
    ],
)
def test_what_is_plain_is_told(found, verdict):
    assert of(found) == verdict
    assert found.low <= found.effect <= found.high


@pytest.mark.parametrize(
    "judge", [claims.below, claims.above, lambda a, b, m, s: claims.between(a, b, -m, m, s)]
)
def test_what_is_not_plain_cannot_be_told(judge):
    few, other = sample(99.0, 20.0, 5, 7), sample(100.0, 20.0, 5, 8)
    assert of(judge(few, other, 0.01, "")) == ClaimVerdict.OPEN
    lonely = {"map 0": np.array([1.0])}
    assert of(judge(lonely, lonely, 0.01, "")) == ClaimVerdict.OPEN
    assert of(judge({}, {}, 0.01, "")) == ClaimVerdict.OPEN


def test_trends_of_noise_cannot_be_told():
    for judge in (claims.falls, claims.rises, claims.level):
        assert of(judge(*steps(0.2, 40.0, 6), 0.01, "")) == ClaimVerdict.OPEN


def test_true_nothing_is_seldom_called_something():
    wrong = 0
    for seed in range(300):
        a, b = sample(100.0, 5.0, 30, 2 * seed), sample(100.0, 5.0, 30, 2 * seed + 1)
        wrong += claims.below(a, b, 0.0, "").verdict(1) == ClaimVerdict.HOLDS
    assert wrong / 300 < 0.06  # 2.5 % expected


def test_all_must_hold_and_one_failure_is_enough():
    good, bad = claims.below(LESS, BASE, 0.01, ""), claims.below(MORE, BASE, 0.01, "")
    open_ = claims.no_evidence("too few")
    assert of(claims.all_of([good, good], "")) == ClaimVerdict.HOLDS
    assert of(claims.all_of([good, bad], "")) == ClaimVerdict.FAILS
    assert of(claims.all_of([good, open_], "")) == ClaimVerdict.OPEN


def test_more_claims_ask_for_more():
    found = claims.below(sample(99.3, 3.0, 40, 5), sample(100.0, 3.0, 40, 6), 0.001, "")
    assert found.verdict(1) == ClaimVerdict.HOLDS
    assert found.verdict(10_000) == ClaimVerdict.OPEN


LENGTH = 35.6  # m


@pytest.fixture(scope="module")
def results():
    """Runs whose printed lengths follow the reading `right`; `wrong` is another draw."""
    rng = np.random.default_rng(0)
    gains = {"right": rng.uniform(0.97, 1.08, 60), "wrong": rng.uniform(0.97, 1.08, 60)}
    printed = LENGTH * gains["right"] + 0.1 * rng.normal(size=60)
    rows = tuple(
        Row(f"{reading} {k}", {"a": {}, "b": {}, "c": {}}, printed[k], reading, f"table {k // 20}")
        for reading in gains
        for k in range(60)
    )
    study = replace(STUDIES["t1-agreement"], rows=rows)
    records = [
        (row.label, stratum, seed, {"solved": True, "ratio": ratio + 0.001 * rng.normal()})
        for row, ratio in zip(rows, np.concatenate([*gains.values()]), strict=True)
        for stratum in "abc"
        for seed in range(3)
    ]
    return Results(study, records)


def test_the_fit_finds_the_length_that_made_the_figures(results):
    right, wrong = (claims.fit_reading(results, name) for name in ("right", "wrong"))
    assert right.correlation > 0.98 > 0.5 > abs(wrong.correlation)
    assert right.length.value == pytest.approx(LENGTH, abs=0.05)
    low, high = right.length.interval
    assert low < LENGTH < high
    assert right.rms == pytest.approx(0.1, rel=0.3)


def test_parts_are_fitted_alone(results):
    table = claims.agreement(results)
    assert [row["reading"] for row in table] == ["right", "wrong"]
    assert table[0]["correlation_low"] < table[0]["correlation"] < table[0]["correlation_high"]
    assert min(table[0][part] for part in ("odd", "even", "without")) > 0.98
    assert len(claims.ratios_of(results, "right", without="table 1")) == 40


@pytest.mark.parametrize(
    ("claim", "holds"),
    [
        ({"test": "follows", "rows": ["right"], "low": 0.8}, True),
        ({"test": "follows", "rows": ["wrong"], "low": 0.8}, False),
        ({"test": "fits_better", "pairs": [["right", "wrong"]]}, True),
        ({"test": "fits_better", "pairs": [["wrong", "right"]]}, False),
        ({"test": "implied", "rows": ["right"], "high": 0.03}, True),
        ({"test": "implied", "rows": ["right"], "high": 0.001}, False),
    ],
)
def test_claims_about_readings(results, claim, holds):
    found = Claim("", "", metric="ratio", **claim).judge(results)
    assert (found.p_for < 1e-4) == holds
    assert (found.p_against < 1e-2) != holds
    assert found.low <= found.effect <= found.high
