"""Settings of the task: what is observed, when it ends, what is rewarded."""

from __future__ import annotations

import math
from typing import Literal

from wheelchair_gym.config import setting, settings


@settings
class RewardWeights:
    """Weights of the named reward terms; the reward is their weighted sum."""

    progress: float = setting(
        default=0.125, unit="1/m", source="way to go that was covered; 1/s where the aim is time"
    )
    time: float = setting(default=-0.05, unit="1/s", source="each second costs")
    arrived: float = setting(default=1.0, source="by the chair's own estimate")
    bumped: float = setting(default=-2.0, source="a bumper strip was pressed")
    timeout: float = setting(default=-0.5, source="the time limit was reached")
    change: float = setting(default=-0.003, source="squared change of the action")
    withheld: float = setting(
        default=0.0, source="what a shield took from the twist that was asked for, in full speeds"
    )
    haste: float = setting(
        default=0.0, unit="s/m2",
        source="squared speed of the outline's fastest corner, each second within 0.2 m of what "
        "the scan shows, and more the nearer",
    )  # fmt: skip


@settings
class TaskSettings:
    """Navigation to a goal."""

    beams: int = setting(
        default=1081, source="observed; fewer than the laser has: pooled by their minimum", low=1
    )
    tolerance: float = setting(default=0.30, unit="m", source="goal counts as reached", low=0.01)
    doubt: float = setting(
        default=0.10,
        unit="m",
        source="most that an estimated pose errs: so much nearer it must be to say 'arrived'",
        low=0.0,
    )
    heading: bool = setting(default=False, source="true: the goal's heading counts, too")
    heading_tolerance: float = setting(
        default=math.radians(15.0), unit="rad", source="of the goal's heading", low=0.01
    )
    time_base: float = setting(default=30.0, unit="s", source="time limit of no way", low=0.1)
    time_factor: float = setting(
        default=3.0, source="time limit per time at full speed along the geodesic", low=0.0
    )
    look_ahead: tuple[float, ...] = setting(
        default=(0.5, 1.0, 1.5, 2.0, 3.0), unit="m", source="along the guidance path", low=0.0
    )
    look_ahead_time: tuple[float, ...] = setting(
        default=(0.5, 1.0, 2.0, 3.5, 5.0),
        unit="s",
        source="of plan time, where poses guide",
        low=0.0,
    )
    last_action: bool = setting(default=False, source="true: the last action is observed, too")
    shield_state: bool = setting(
        default=False,
        source="true: whether a shield filters (1 or 0), and what it withheld of the last twist, "
        "in full speeds ahead and of turning, are observed, too",
    )
    gaps: bool = setting(
        default=False,
        source="true: how far the outline could move to the left and to the right before it "
        "touches what the scan shows, is observed, too: where it stands and at each pose ahead; "
        "where none is looked at, at a fan of poses that it may take next",
    )
    trail: tuple[float, ...] = setting(
        default=(), unit="m", low=0.0, high=15.0,
        source="of way ago: where it was then is observed, too; at first, where it began",
    )  # fmt: skip
    unguided: bool = setting(
        default=False,
        source="true: poses ahead, and the gaps there, are for a critic and a teacher alone, under "
        "keys of their own where 'privileged' is, too",
    )
    privileged: bool = setting(
        default=False, source="true: a critic's key 'privileged' is observed; in training only"
    )
    aim: Literal["goal", "path", "field", "time"] = setting(
        default="field",
        source="progress is measured towards the goal, along path or geodesic; time: in seconds "
        "by the ways of the outline, which need the guidance 'poses'",
    )
    margin: float = setting(
        default=0.05, unit="m", source="kept by the geodesic beyond half the width", low=0.0
    )
    reward: RewardWeights = RewardWeights()
