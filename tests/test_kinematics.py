"""Laws of approaching a speed."""

import numpy as np

from wheelchair_gym.geometry.kinematics import approach


def test_an_approach_ends_on_its_target_and_stays():
    """From any start to any target, exactly, since all callers take zero for rest."""
    rng = np.random.default_rng(0)
    for _ in range(500):
        speed, slope, target = rng.uniform(-1, 1), 0.0, rng.choice([0.0, rng.uniform(-1, 1)])
        for _ in range(3000):
            speed, slope = approach(speed, slope, target, 0.5, 0.8, 1.0, 0.01)
        assert (speed, slope) == (target, 0.0)
