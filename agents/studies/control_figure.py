"""T1, figure 2.27: controls generated for a path, and where they take the chair."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from agents.studies.evidence import Evidence, share_above
from agents.studies.figures import rollout_figures
from agents.studies.model import Claim, Metric, Results, Row, Study
from planners.trees.variants import RrtStarWoaGlobal
from wheelchair_gym.config import dump

PLACES: Final = (*(f"thesis_{k}" for k in range(1, 6)), *(f"lab_{k}" for k in range(1, 4)))
CLEARANCE: Final = 0.40  # m: half the chair's width and a margin, as policies plan
_PLANNER: Final[dict[str, Any]] = {"name": "rrt_star_woa_global", **dump(RrtStarWoaGlobal.thesis())}


def _share(key: str, least: float, text: str) -> Callable[[Results], Evidence]:
    def judge(r: Results) -> Evidence:
        of = [record for records in r.runs.values() for record in records if record["solved"]]
        return share_above(sum(bool(record[key]) for record in of), len(of), least, text)

    return judge


STUDIES: Final = (
    Study(
        "control",
        "Generated controls, rolled out",
        "T1, figure 2.27 and general conclusion",
        f"Paths of the global variant with figure 3.1's settings at {CLEARANCE:g} m from all that "
        "is solid; controls by the generator's defaults; the roll-out obeys the chair's limits of "
        "speed and acceleration, and its outline is tested at every pose.",
        (
            Metric("feasible", "free and arrived", "share", 3),
            Metric("free", "free", "share", 3),
            Metric("arrived", "arrived", "share", 3),
            Metric("end_error_m", "end to goal", "m", 3),
            Metric("cross_track_m", "farthest off the path", "m", 3),
            Metric("drive_time", "drive", "s", 1),
            Metric("time_s", "CPU time", "s", 3),
        ),
        tuple(
            Row(place, {place: {"kind": "controls", "planner": _PLANNER, "scene": place,
                                "clearance": CLEARANCE, "kept": 1}})
            for place in PLACES
        ),
        (
            Claim("Generated controls keep free of collisions (in more than 99 % of runs)",
                  "T1, general conclusion", _share("free", 0.99, "runs free of collisions")),
            Claim("Generated controls arrive (in more than 95 % of runs)", "T1, figure 2.27",
                  _share("arrived", 0.95, "runs that arrived")),
            Claim("Trajectories are feasible: free and arriving (in more than 95 %)",
                  "T1, general conclusion", _share("feasible", 0.95, "feasible runs")),
        ),
        rollout_figures,
        runs=100,
        quick_runs=5,
        notes=(
            "The printed equations (2.15)-(2.16) measure the heading from +y, ours from +x; that "
            "is a turn by 90 degrees.",
            "Runs count where the planner found a path; a generator that finds no free way on ends "
            "its commands at rest, which is free and has not arrived.",
        ),
    ),
)  # fmt: skip
