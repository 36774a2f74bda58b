"""Grey wolves: the pack closes in on its three best (Mirjalili, Mirjalili and Lewis 2014)."""

from __future__ import annotations

from planners.random_stream import Stream, uniform
from planners.swarm.state import Swarm
from wheelchair_gym.compiled.kernel import borrowing_kernel


@borrowing_kernel
def hunt(swarm: Swarm, a: float, state: Stream) -> None:
    """Move every wolf once, in place: R1 (4.3)-(4.11), with the D of the original in (4.6)-(4.8).

    The leaders alpha, beta and delta are the three best remembered positions.
    """
    X, costs = swarm.positions, swarm.own_costs
    k, d = X.shape
    alpha, beta, delta = -1, -1, -1
    for i in range(k):
        if alpha < 0 or costs[i] < costs[alpha]:
            alpha, beta, delta = i, alpha, beta
        elif beta < 0 or costs[i] < costs[beta]:
            beta, delta = i, beta
        elif delta < 0 or costs[i] < costs[delta]:
            delta = i
    for i in range(k):
        for c in range(d):
            total = 0.0
            for leader in (alpha, beta, delta):
                A = 2.0 * a * uniform(state) - a  # (4.10)
                C = 2.0 * uniform(state)  # (4.11)
                prey = swarm.own[leader, c]
                total += prey - A * abs(C * prey - X[i, c])  # (4.3)-(4.8)
            X[i, c] = total / 3.0  # (4.9)
