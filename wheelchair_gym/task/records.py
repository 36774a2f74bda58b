"""Records of the task: what kernels know of its rules and of an episode's progress."""

from __future__ import annotations

import numpy as np

from wheelchair_gym.compiled.address import Target, pointer_record
from wheelchair_gym.task.observations import POOL, SIZES, STICKS, TRAIL_POINTS
from wheelchair_gym.task.prepared_episode import PREPARED
from wheelchair_gym.task.rewards import TERM_VALUES
from wheelchair_gym.tracking.tracker import TRACKERS

RULES, RULES_TARGETS = pointer_record(
    ("period", "f8"),  # s
    ("max_steps", "i8"),  # of an episode
    ("forward", "f8"),  # m/s
    ("backward", "f8"),
    ("turn", "f8"),  # rad/s
    ("size", SIZES),  # numbers of each key of the observation
    ("place", SIZES),  # where each begins
    ("scanners", "i8"),
    ("pools", Target(POOL, None)),  # of each scanner
    ("reaches", Target("f8", None)),  # m: of the ultrasonics
    ("twist_most", "f8", (2,)),  # m/s, rad/s
    ("points", "i8"),  # of the guidance that are observed; 0: none
    ("ahead", Target("f8", None)),  # their distances (points,) [m], or plan times [s]
    ("has_poses", "b1"),  # they are poses at plan times
    ("uses_fan", "b1"),  # side clearances are those at a fan of poses
    ("fan_poses", Target("f4", None)),  # `side_clearance.fan_poses()`
    ("outline", "f8", (3,)),  # `Footprint.array`
    ("mount", "f8", (2,)),  # m: of the first scanner
    ("directions", Target("f8", None, 2)),  # of its beams (laser_beams, 2)
    ("laser_beams", "i8"),
    ("back", Target("f8", None)),  # m: how far back places of the trail are
    ("has_driver", "b1"),  # a person drives, whose stick is observed
    ("bump_ends", "b1"),  # a pressed strip ends the episode
    ("arrival_margin", "f8"),  # m
    ("heading", "b1"),
    ("heading_tolerance", "f8"),  # rad
    ("aim", "i8"),  # index into AIMS
    ("weights", TERM_VALUES),
    ("time_base", "f8"),  # s
    ("time_factor", "f8"),
)

PROGRESS = np.dtype(
    [
        ("steps_left", "i8"),  # control periods
        ("steps", "i8"),  # so far
        ("to_go", "f8"),  # m, or s, at the last reading where a way was known
        ("geodesic", "f8"),  # m, from the start
        ("time_limit", "f8"),  # s
        ("action", "f8", (2,)),  # the last one, clipped
        ("previous", "f8", (2,)),  # the one before
        ("is_shielded", "b1"),  # a shield filters
        ("shield_share", "f8", (2,)),  # taken off the last twist, in shares of full speeds
        # the person who drives: deflections forward and to the left, the latest first; the second
        # is that which the last action answered
        ("sticks", "f8", (STICKS, 2)),
        ("latched", "b1"),
        ("person_arrived", "b1"),  # the person who drives is at its goal, by truth
        ("n_trail", "i8"),  # points of its trail so far; the last ones are kept
        ("trail_points", "f8", (TRAIL_POINTS, 2)),  # m
    ],
    align=True,
)

# Rows of a task by address: a call takes a microsecond for each array, and for this record once.
TASK, TASK_TARGETS = pointer_record(
    ("n", "i8"),
    ("rules", Target(RULES, 1)),
    ("prepared", Target(PREPARED, None)),
    ("progress", Target(PROGRESS, None)),
    ("trackers", Target(TRACKERS, 1)),  # of no rows where tracks are not observed
)
