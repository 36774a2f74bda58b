"""Laws of what is observed."""

import itertools

import numpy as np
import pytest

from wheelchair_gym.task.observations import observed_range, pool_beams


@pytest.mark.parametrize(
    ("beams", "groups"), [(1081, 1081), (1081, 181), (1081, 64), (64, 64), (64, 63), (7, 2), (3, 1)]
)
def test_pooling_is_the_nearest_of_equal_groups(beams, groups):
    """Group j holds beams floor(j n / m) to floor((j + 1) n / m); each is seen as `see` sees it."""
    rng = np.random.default_rng(beams + groups)
    for _ in range(20):
        scan = rng.uniform(0, 12, beams).astype(np.float32)
        for odd in (np.inf, -np.inf, np.nan, 0.0):
            scan[rng.random(beams) < 0.05] = odd
        out = np.empty(groups, np.float32)
        assert pool_beams(scan, 10.0, out) == np.isfinite(scan).sum()
        edges = np.arange(groups + 1) * beams // groups
        expected = [
            min(observed_range(float(r), 10.0) for r in scan[a:b])
            for a, b in itertools.pairwise(edges)
        ]
        assert out.tolist() == np.float32(expected).tolist()
