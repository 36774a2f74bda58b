"""Records of the task: what kernels know of its rules, of an episode's progress, of a step."""

from __future__ import annotations

import numpy as np

from wheelchair_gym.task.rewards import TERMS

CRUMBS = 64  # of a trail that are kept

RULES = np.dtype(
    [
        ("period", "f8"),  # s
        ("forward", "f8"),  # m/s
        ("backward", "f8"),
        ("turn", "f8"),  # rad/s
        ("beams", "i8"),  # observed
        ("laser_reach", "f8"),  # m
        ("rangers", "i8"),
        ("reaches", "u8"),  # address of the ultrasonics' reaches (rangers,) [m]
        ("twist_most", "f8", (2,)),  # m/s, rad/s
        ("goal_room", "i8"),  # numbers that tell the goal: 3, or 5 with its heading
        ("points", "i8"),  # of the guidance looked at; 0: none
        ("ahead", "u8"),  # address of their distances (points,) [m], or plan times [s]
        ("posed", "b1"),  # they are poses at plan times
        ("unguided", "b1"),  # they are for critics alone
        ("last_action", "b1"),  # is observed
        ("shield_state", "b1"),  # is observed
        ("gaps", "i8"),  # numbers that tell the gaps; 0: none
        ("fanned", "b1"),  # at a fan of poses, not at those of the guidance
        ("fan", "u8"),  # address of `gaps.fan()`
        ("outline", "f8", (3,)),  # `Footprint.array`
        ("mount", "f8", (2,)),  # m: of the laser
        ("directions", "u8"),  # address of the beams' directions (laser_beams, 2)
        ("laser_beams", "i8"),
        ("trail", "i8"),  # places of its own way that are looked back at
        ("back", "u8"),  # address of how far back they are (trail,) [m]
        ("privileged", "b1"),  # observed, too, is what only a critic may see
        ("doubt", "f8"),  # m
        ("heading", "b1"),
        ("heading_tolerance", "f8"),  # rad
        ("aim", "i8"),  # index into AIMS
        ("weights", "f8", (len(TERMS),)),
        ("time_base", "f8"),  # s
        ("time_factor", "f8"),
    ],
    align=True,
)

PROGRESS = np.dtype(
    [
        ("steps_left", "i8"),  # control periods
        ("to_go", "f8"),  # m, or s, at the last reading where a way was known
        ("geodesic", "f8"),  # m, from the start
        ("time_limit", "f8"),  # s
        ("action", "f8", (2,)),  # the last one, clipped
        ("previous", "f8", (2,)),  # the one before
        ("guarded", "b1"),  # a shield filters
        ("withheld", "f8", (2,)),  # by it of the last twist, in full speeds ahead and of turning
        ("n_crumbs", "i8"),  # of its trail so far; the last ones are kept
        ("crumbs", "f8", (CRUMBS, 2)),  # m
    ],
    align=True,
)

VERDICT = np.dtype(
    [
        ("terms", "f8", (len(TERMS),)),
        ("reward", "f8"),
        ("arrived", "b1"),  # by the chair's own estimate
        ("terminated", "b1"),
        ("truncated", "b1"),
        ("valid_beams", "i8"),
        ("geodesic", "f8"),  # m, from the start
    ],
    align=True,
)

# Where the only row of each argument of `assess` lies: a call takes a microsecond per array.
ALONE = np.dtype([("rules", "u8"), ("course", "u8"), ("progress", "u8"), ("verdict", "u8")])
