"""Model predictive path integral control: the mean of many noisy roll-outs, weighed by cost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.control.fan import whole_fan
from agents.control.follower import Follower, Objective, allowed, near_of, widest
from agents.control.local_map import Surroundings
from agents.control.reference import Reference
from agents.control.rollout import Motion, cheapest, costs_of
from wheelchair_gym.config import setting, settings

Array = NDArray[np.float64]


@settings
class PathIntegral:
    """MPPI (Williams et al. 2017) on the shared roll-out; warm-started every period."""

    samples: int = setting(default=72, low=4, high=10_000, source="10 ms on one core")
    pieces: int = setting(default=4, low=1, high=50, source="twists within the horizon")
    spread_v: float = setting(default=0.20, unit="m/s", low=0.0, source="of the noise; tuned")
    spread_w: float = setting(default=0.30, unit="rad/s", low=0.0, source="of the noise; tuned")
    temperature: float = setting(default=0.03, unit="m", low=1e-6, source="of the weights; tuned")
    hold: float = setting(default=0.4, unit="s", low=0.1, source="four periods at 10 Hz")
    margin: float = setting(default=0.05, unit="m", low=0.0, source="laser sigma 15 mm, 3 sigma")
    backward: float = setting(default=0.2, unit="m/s", low=0.0, source="nothing looks back")
    seed: int = setting(default=0, low=0, source="of the noise, anew for every path")
    objective: Objective = Objective()

    def make(self) -> Follower:
        """A follower at rest."""
        return PathIntegralFollower(self)


class PathIntegralFollower:
    """Carries the mean commands from one period to the next."""

    def __init__(self, own: PathIntegral) -> None:
        self.own = own
        self._rng = np.random.default_rng(own.seed)
        self._mean: Array = np.zeros((own.pieces, 2))

    def twist(self, around: Surroundings, reference: Reference, chair: Motion) -> Array | None:
        """See `Follower.twist`."""
        own, limits = self.own, chair.limits
        near, weights = near_of(around, reference), own.objective.weights
        long = own.objective.horizon / own.pieces
        self._mean += (
            chair.period / long * (np.vstack([self._mean[1:], self._mean[-1:]]) - self._mean)
        )
        # Noise that lasts over the horizon and noise of each piece, in equal parts; and a coarse
        # fan, so that a mean that something new has barred finds another way at once.
        spread = np.array([own.spread_v, own.spread_w])
        noise = self._rng.standard_normal((own.samples, own.pieces + 1, 2)) * spread
        drawn = self._mean + (noise[:, :1] + noise[:, 1:]) / np.sqrt(2.0)
        drawn[0] = self._mean
        fan = whole_fan(limits, own.backward)[::3]
        drawn = np.concatenate([drawn, np.repeat(fan[:, None], own.pieces, axis=1)])
        low = -min(own.backward, limits.backward), -limits.turn
        drawn = np.clip(drawn, low, (limits.forward, limits.turn))
        lasting = np.full((*drawn.shape[:2], 1), long)
        candidates = np.concatenate([drawn, lasting], axis=2)  # (c, pieces, 3)

        def pick(margin: float, slow: bool) -> Array | None:
            some = allowed(candidates, around, slow)
            costs = costs_of(some, chair.body, near, margin, weights)
            share = np.exp((costs.min() - costs) / own.temperature)
            mean = (share / share.sum()) @ some.reshape(len(some), -1)
            mean = mean.reshape(1, own.pieces, 3)
            # The mean first if it is about as good as the best: it wobbles less.
            mean_cost = costs_of(mean, chair.body, near, margin, weights)
            costs = np.append(mean_cost - own.temperature, costs)
            some = np.concatenate([mean, some])
            first = np.ascontiguousarray(some[:, 0])
            best = cheapest(first, costs, chair.body, near, own.hold, margin)
            if best < 0:
                return None
            self._mean = some[best, :, :2].copy()
            return first[best, :2]

        twist = widest(around, chair, own.margin, pick)
        if twist is None:
            self._mean[:] = 0.0
        return twist
