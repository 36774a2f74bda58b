"""Statistics: shares, means, medians and paired tests, against published and independent values."""

import numpy as np
import pytest
from scipy import stats

from agents.evaluation import statistics


@pytest.mark.parametrize(
    ("hits", "trials", "low", "high"),
    [
        (0, 10, 0.0, 0.27753),  # Wilson 1927, and Agresti and Coull 1998
        (10, 10, 0.72247, 1.0),
        (5, 10, 0.23659, 0.76341),
        (81, 263, 0.25527, 0.36621),  # Newcombe 1998, method 3
        (15, 148, 0.06243, 0.16054),
        (0, 0, 0.0, 1.0),
    ],
)
def test_wilson_intervals_are_the_published_ones(hits, trials, low, high):
    assert statistics.wilson(hits, trials) == pytest.approx((low, high), abs=6e-5)


@pytest.mark.parametrize(("hits", "trials"), [(-1, 3), (4, 3)])
def test_impossible_counts_are_refused(hits, trials):
    with pytest.raises(ValueError, match="trials"):
        statistics.wilson(hits, trials)


def test_one_stratum_is_welch_as_scipy_has_it():
    rng = np.random.default_rng(1)
    a, b = rng.normal(3.0, 2.0, 17), rng.normal(3.5, 1.0, 40)
    theirs = stats.ttest_ind(a, b, equal_var=False)
    found = statistics.estimate([{"map": a}, {"map": b}], [1.0, -1.0])
    assert found.freedom == pytest.approx(theirs.df)
    assert 2 * min(found.p_above(), found.p_below()) == pytest.approx(theirs.pvalue)
    assert found.interval == pytest.approx(theirs.confidence_interval(0.95))


def test_intervals_cover_the_truth_as_often_as_they_say():
    hits = 0
    for seed in range(400):
        rng = np.random.default_rng(seed)
        maps = {f"map {k}": rng.normal(5.0 + 10.0 * k, 2.0, 8) for k in range(3)}
        low, high = statistics.estimate([maps], [1.0]).interval
        hits += low <= 15.0 <= high  # mean of 5, 15 and 25
    assert 0.92 <= hits / 400 <= 0.98


@pytest.mark.parametrize("n", [1, 5, 6, 7, 8, 9, 12, 17, 30])
def test_intervals_of_medians_cover_the_median_as_often_as_they_say(n):
    """Of a skewed and of a discrete distribution; none is given where none can be."""
    rng = np.random.default_rng(n)
    for median, drawn in ((np.log(2.0), rng.exponential(size=(2000, n))),
                          (2.0, rng.binomial(4, 0.5, (2000, n)))):  # fmt: skip
        found, low, high = np.array([statistics.median_interval(values) for values in drawn]).T
        assert (found == np.median(drawn, axis=1)).all()
        assert np.isnan(low).all() == np.isnan(high).all() == (n < 6)
        assert n < 6 or np.mean((low <= median) & (median <= high)) > 0.942  # 0.95, and 1.6 sigma


def test_one_sample_has_the_interval_of_the_t_test():
    values = np.random.default_rng(2).normal(1.0, 1.0, 12)
    theirs = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert statistics.mean_interval(values) == pytest.approx((values.mean(), *theirs))


def test_ratios_have_the_interval_of_their_logarithms():
    ours, theirs = np.random.default_rng(3).lognormal(0.0, 0.3, (2, 15))
    found = stats.ttest_1samp(np.log(ours / theirs), 0.0).confidence_interval(0.95)
    assert statistics.ratio_interval(ours, theirs)[1:] == pytest.approx(np.exp(found))
    assert statistics.ratio_interval([2.0, 8.0], [1.0, 2.0])[0] == pytest.approx(8.0**0.5)


def test_paired_successes_are_compared_where_only_one_succeeds():
    ours, theirs = [True] * 7 + [False] * 3, [True] * 2 + [False] * 5 + [True] + [False] * 2
    assert statistics.mcnemar(ours, theirs) == (5, 1, pytest.approx(stats.binomtest(5, 6).pvalue))
    assert statistics.mcnemar(ours, ours) == (0, 0, 1.0)


def test_adjusted_p_values_are_those_of_holm():
    assert statistics.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert statistics.holm([]) == []
