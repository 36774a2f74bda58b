"""A planner of your own: judged by independent geometry, benchmarked, and driven along.

Anything with `plan(problem, rng, deadline=None) -> Plan` is a planner. From the command line:
`wheelchair plan --planner own_planner:Detour ...`, `wheelchair bench planners --planners
own_planner:Detour,rrt_star` and `wheelchair compare --policies own_planner:Detour+window`.
"""

import numpy as np

from planners import Plan, Status, make_planner
from planners.judge import Judge
from planners.problem import Problem
from wheelchair_gym.scenes import make_scene


class Detour:
    """Tries points at random until the way over one of them is free."""

    def __init__(self, tries: int = 2000):
        self.tries = tries

    def plan(self, problem: Problem, rng: np.random.Generator, deadline: float | None = None):
        """A path over one point, or none."""
        low, high = np.reshape(problem.space.bounds, (2, 2))
        judge = Judge.of(problem)
        for _ in range(self.tries):
            path = np.array([problem.start[:2], rng.uniform(low, high), problem.goal[:2]])
            if not judge.faults(path, problem.start, problem.goal):
                return Plan(Status.SOLVED, path)
        return Plan(Status.EXHAUSTED)


if __name__ == "__main__":
    from planners.collision.space import Space

    episode = make_scene("clutter").sample(np.random.default_rng(3))
    space = Space.from_map(episode.map, episode.walls, episode.discs)
    problem = Problem(space, episode.start, episode.goal, clearance=0.36)
    for name in ("own_planner:Detour", "rrt_star", "visibility"):
        plan = make_planner(name).plan(problem, np.random.default_rng(0))
        print(f"{name:20} {plan.status}, {plan.length:.2f} m")
