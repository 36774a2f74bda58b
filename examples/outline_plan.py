"""Plan for the chair's outline through a door off a corridor, with and without whales.

`python examples/outline_plan.py`: RRT* over poses finds a path, and rounds of shortcuts, rewiring
and whales make it quicker to drive. The judge shares no code with the planner.
"""

import numpy as np

from planners import Problem, Space, make_planner
from planners.judge import sweep_faults
from wheelchair_gym.geometry.outline import Footprint

CORRIDOR, DOOR = 1.3, 1.0  # m

wall = [(0.0, CORRIDOR, 3.0, CORRIDOR + 0.12), (3.0 + DOOR, CORRIDOR, 6.0, CORRIDOR + 0.12)]
space = Space.from_rectangles(wall, (0.0, 0.0, 6.0, 5.0))
start, goal = np.array([0.6, 0.65, 0.0]), np.array([3.5, 4.0])
footprint = Footprint()
problem = Problem(space, start, goal, clearance=footprint.half_width + 0.03)
for label, shares in (("with whales", {}), ("without whales", {"local_share": 0.0})):
    planner = make_planner({"name": "se2_rrt_star_woa", **shares})
    plan = planner.plan(problem, np.random.default_rng(0))
    faults = sweep_faults(plan.path, footprint.corners, space.solid, space.bounds)
    evaluations = plan.counters["local_evaluations"]
    print(
        f"{label:15s} {plan.status}, {plan.length:.2f} m, {len(plan.path)} poses,"
        f" {evaluations} evaluations by whales, {len(faults)} faults"
    )
