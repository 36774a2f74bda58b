"""Simulated people beside what was published about real ones.

`python -m tests.benchmarks.driver_figures [--drives N]`: drivers drive N courses or floor plans
each, without help and without the shield, with all noise of the sensors and chairs drawn anew, and
a table states what was published beside what they did. Drives of two drivers are paired: they are
in the same worlds. Times are compared where both arrive, by the geometric mean of their ratios.
"""

import argparse
import math
import sys
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.assisted import StickTrace
from agents.evaluation.statistics import mean_interval, ratio_interval, wilson
from agents.evaluation.tables import markdown_table
from wheelchair_gym.base.arrays import Array
from wheelchair_gym.envs import NavigationVectorEnv
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.types import Stick

PERIOD = 0.1  # s: a step
TIME = 120.0  # s: the time limit, with ten times the time of the shortest way
MINIMUM = 0.1  # deflection of a stick that has a direction
BESIDE = 0.15  # m from the outline: farther returns are not what it touched


class Drive(NamedTuple):
    """Measures of a drive.

    Attributes:
        success: whether it arrived without a contact at fault.
        time: of the drive [s].
        movements: how often the stick was moved, by the definition of the results' column.
        spread: circular standard deviation of the stick's direction [rad].
        touched: where the chair first touched something at fault: "ahead", "aside" or "behind".
        right: how far right of the middle between what is beside it the chair drove, as a mean [m].
    """

    success: bool
    time: float
    movements: float
    spread: float
    touched: str
    right: float


def where_touched(ranges: Array, laser: Any, outline: Footprint) -> str:
    """The part of the outline that is nearest to what the first scanner sees.

    What is too near for a range stands before the scanner, which is at the chair's front.
    """
    if (ranges <= 0.0).any():
        return "ahead"
    points = laser.directions * ranges[:, None] + (laser.x, laser.y)
    beyond = np.maximum(points[:, 0] - outline.front, -outline.rear - points[:, 0])
    beside = np.abs(points[:, 1]) - outline.half_width
    gaps = np.hypot(np.maximum(beyond, 0.0), np.maximum(beside, 0.0))
    k = int(np.argmin(gaps))
    if gaps[k] > BESIDE:
        return "behind"
    return "ahead" if points[k, 0] > outline.front - 0.02 else "aside"


def judged(sticks: Array, end: Any, touched: str, right: list[float], limits: Any) -> Drive:
    """A drive by its sticks (n, 2), a step each."""
    trace = StickTrace(limits, PERIOD)
    for forward, left in sticks.tolist():
        trace.add(Stick(forward, left, False), np.zeros(2))
    a_minute = trace.figures(np.zeros((len(sticks) + 1, 2)), 1.0)["stick_movements"]
    used = sticks[np.hypot(*sticks.T) > MINIMUM]
    mean = abs(np.exp(1j * np.arctan2(used[:, 1], used[:, 0])).mean()) if len(used) else 1.0
    return Drive(
        end["success"], end["time"], a_minute * end["time"] / 60.0,
        math.sqrt(-2.0 * math.log(min(1.0, max(1e-9, mean)))), touched, float(np.mean(right)),
    )  # fmt: skip


@cache
def drives(driver: str, place: str, n: int) -> list[Drive]:
    """The drives of a driver in floor plans, or on a course of skills, by row."""
    scene: Any = place if place == "floor_plan" else {"name": "skill", "course": place}
    env = NavigationVectorEnv(
        n, scene, split="test", driver=driver, assistant="direct", num_threads=1, randomize=True,
        pose_source="modelled", bank={"size": n, "turnover": 0.0},
        config={"task": {"time_base": TIME, "time_factor": 10.0}},
    )  # fmt: skip
    laser, chair = env.settings.sensors.laser, env.settings.chair
    beams = [int(np.argmin(np.abs(laser.angles - a))) for a in (math.pi / 2, -math.pi / 2)]
    sticks: list[list[Array]] = [[] for _ in range(n)]
    rights: list[list[float]] = [[] for _ in range(n)]
    touched, found = [""] * n, dict[int, Drive]()
    seen, _ = env.reset(seed=0)
    while len(found) < n:
        asked, ranges = seen["stick"][:, :2].astype(float), seen["laser"].astype(float)
        seen, _, terminated, truncated, info = env.step(np.zeros((n, 2)))
        for i in (i for i in range(n) if i not in found):
            sticks[i].append(asked[i])
            rights[i].append(0.5 * float(ranges[i, beams[0]] - ranges[i, beams[1]]))
            if info["at_fault"][i] and not touched[i]:
                touched[i] = where_touched(seen["laser"][i].astype(float), laser, chair.footprint)
            if terminated[i] or truncated[i]:
                end = {"success": bool(info["is_success"][i]), "time": float(info["time"][i])}
                row = np.array(sticks[i])
                found[i] = judged(row, end, touched[i], rights[i], chair.limits)
    env.close()
    arrived = sum(one.success for one in found.values())
    print(f"{driver:<20}{place:<12}{arrived} of {n} arrived", file=sys.stderr, flush=True)
    return [found[i] for i in range(n)]


def centimetres(metres: list[float]) -> str:
    """A mean [cm] with its 95 % interval."""
    mean, low, high = (100.0 * value for value in mean_interval(metres))
    return f"{mean:.1f} ({low:.1f} to {high:.1f})"


def ratio(one: str, other: str, place: str, n: int, field: str = "time") -> str:
    """Return the ratio of a figure of two drivers, over pairs of drives that arrive."""
    pairs = [
        (getattr(a, field), getattr(b, field))
        for a, b in zip(drives(one, place, n), drives(other, place, n), strict=True)
        if a.success and b.success and getattr(a, field) > 0.0 and getattr(b, field) > 0.0
    ]
    if len(pairs) < 3:
        return f"only {len(pairs)} pairs arrive"
    mean, low, high = ratio_interval(*zip(*pairs, strict=True))
    return f"{mean:.2f} ({low:.2f} to {high:.2f}; {len(pairs)} pairs)"


def share(of: str, place: str, n: int, *parts: str) -> str:
    """The share of drives that end in a contact at fault, of these parts or of any."""
    hits = [one.touched for one in drives(of, place, n)]
    k = sum(hit in parts if parts else bool(hit) for hit in hits)
    low, high = wilson(k, n)
    return f"{100 * k / n:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def rows(n: int) -> list[tuple[str, str, str]]:
    """Return rows of a published figure, its source, and the simulated drivers' figure."""
    left, expert_left = (
        centimetres([-one.right for one in drives(driver, "forward", n)])
        for driver in ("hemineglect", "expert")
    )
    plan = "floor_plan"
    return [
        (
            "experts and novices are alike in simple tasks", "Sorrento 2011, 10 and 13 people",
            f"time forward, `expert` to `novice`: {ratio('expert', 'novice', 'forward', n)}",
        ),
        (
            "experts manoeuvre sideways in about half the time", "Sorrento 2011",
            f"time, `expert` to `novice`: {ratio('expert', 'novice', 'sideways', n)}",
        ),
        (
            "experts make fewer movements of the stick, sideways and in turns of 180 degrees",
            "Sorrento 2011",
            "`expert` to `novice`: sideways "
            f"{ratio('expert', 'novice', 'sideways', n, 'movements')}, turn "
            f"{ratio('expert', 'novice', 'turn', n, 'movements')}",
        ),
        (
            "the variability of the stick's direction is alike", "Sorrento 2011",
            f"`expert` to `novice`: sideways {ratio('expert', 'novice', 'sideways', n, 'spread')}",
        ),
        (
            "with neglect of the left, more direct hits", "Webster 1989, 12 and 12 people",
            f"hits ahead: `hemineglect` {share('hemineglect', plan, n, 'ahead')}, `expert` "
            f"{share('expert', plan, n, 'ahead')}",
        ),
        (
            "with neglect of the left, not more side-swipes", "Webster 1989",
            "hits aside or behind: `hemineglect` "
            f"{share('hemineglect', plan, n, 'aside', 'behind')}, `expert` "
            f"{share('expert', plan, n, 'aside', 'behind')}",
        ),
        (
            "with neglect of the left, left of the corridor's middle", "Turton 2009",
            f"cm to the left: `hemineglect` {left}, `expert` {expert_left}",
        ),
        (
            "a second task makes most unassisted drivers crash", "Carlson and Demiris",
            f"drives with a contact at fault: `inattentive` {share('inattentive', plan, n)}, "
            f"`expert` {share('expert', plan, n)}",
        ),
        (
            "less fine-motor ability: more collisions and time", "Human Factors 2012, 23 people",
            f"contacts: `ataxia` {share('ataxia', plan, n)}; time to `expert`'s: "
            f"{ratio('ataxia', 'expert', plan, n)}",
        ),
        (
            "an isometric stick is faster forward, a conventional one backward",
            "Mahajan 2011, 20 people",
            "time, `isometric` to `essential_tremor`: forward "
            f"{ratio('isometric', 'essential_tremor', 'forward', n)}, backward "
            f"{ratio('isometric', 'essential_tremor', 'backward', n)}",
        ),
        (
            "switches are far worse than a stick", "HFES 2009, 23 people",
            f"time to `expert`'s: `head_array` {ratio('head_array', 'expert', plan, n)}, "
            f"`scanning` {ratio('scanning', 'expert', plan, n)}",
        ),
    ]  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drives", type=int, default=100, help="of each driver in each place")
    given = parser.parse_args()
    if given.drives < 3:
        parser.error(f"--drives is {given.drives}; expected 3 or more")
    print(markdown_table(("published", "by", "simulated"), rows(given.drives)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
