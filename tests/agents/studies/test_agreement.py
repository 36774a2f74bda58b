"""Readings: the fit finds the length that made the figures, and a wrong reading fits worse."""

from dataclasses import replace

import numpy as np
import pytest

from agents.studies import claims
from agents.studies.claims import Claim
from agents.studies.model import Results, Row
from agents.studies.runner import STUDIES

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
