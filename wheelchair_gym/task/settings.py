"""Settings of the task: what is observed, when it ends, what is rewarded."""

from __future__ import annotations

import math
from typing import Literal

from wheelchair_gym.config import setting, settings

_TUNED = "tuned on training seeds"
_CHOICE = "design choice"


@settings
class RewardWeights:
    """Weights of the named reward terms; the reward is their weighted sum."""

    progress: float = setting(
        default=0.125,
        unit="1/m",
        doc="Way to go that was covered [m]; seconds to go where the aim is time.",
        source=_TUNED,
    )
    time: float = setting(default=-0.05, unit="1/s", doc="Time that passed [s].", source=_TUNED)
    arrived: float = setting(
        default=1.0, doc="1 at the goal, by the chair's own estimate.", source=_CHOICE
    )
    bumped: float = setting(default=-2.0, doc="1 if a bumper strip is pressed.", source=_TUNED)
    timeout: float = setting(default=-0.5, doc="1 at the time limit.", source=_TUNED)
    action_rate: float = setting(default=-0.003, doc="Squared change of the action.", source=_TUNED)
    shield_intervention: float = setting(
        default=0.0,
        doc="What the shield took off the twist that was asked for, in full speeds.",
        source=_CHOICE,
    )
    proximity_speed: float = setting(
        default=0.0,
        unit="s/m2",
        doc="Squared speed of the outline's fastest corner within 0.2 m of what the scan shows, "
        "more the nearer [m2/s2], times the period [s].",
        source=_CHOICE,
    )


@settings
class TaskSettings:
    """Navigation to a goal."""

    beams: int = setting(
        default=1081,
        low=1,
        doc="Observed laser beams; fewer than the laser has are pooled by their minimum.",
        source="data sheet: Hokuyo UST-10LX",
    )
    tolerance: float = setting(
        default=0.30, unit="m", low=0.01, doc="Distance at which the goal counts as reached.",
        source=_CHOICE,
    )  # fmt: skip
    arrival_margin: float = setting(
        default=0.10,
        unit="m",
        low=0.0,
        doc="How much nearer than the tolerance an estimated pose must be to count as arrived.",
        source="largest error of an estimated pose (`modelled.position_max`)",
    )
    heading: bool = setting(default=False, doc="True: the goal's heading counts, too.")
    heading_tolerance: float = setting(
        default=math.radians(15.0),
        unit="rad",
        low=0.01,
        doc="Error of heading at which the goal counts as reached, where the heading counts.",
        source=_CHOICE,
    )
    time_base: float = setting(
        default=30.0, unit="s", low=0.1, doc="Time limit of an episode without a way to go.",
        source=_CHOICE,
    )  # fmt: skip
    time_factor: float = setting(
        default=3.0,
        low=0.0,
        doc="Time limit added for each second at full speed along the geodesic.",
        source=_CHOICE,
    )
    look_ahead: tuple[float, ...] = setting(
        default=(0.5, 1.0, 1.5, 2.0, 3.0),
        unit="m",
        low=0.0,
        doc="Distances along the guidance path at which its points are observed.",
        source=_CHOICE,
    )
    look_ahead_time: tuple[float, ...] = setting(
        default=(0.5, 1.0, 2.0, 3.5, 5.0),
        unit="s",
        low=0.0,
        doc="Plan times at which poses of the guidance are observed, where it gives poses.",
        source=_CHOICE,
    )
    last_action: bool = setting(default=False, doc="True: the last action is observed.")
    shield_state: bool = setting(
        default=False,
        doc="True: whether a shield filters (1 or 0) and what it took off the last twist, in full "
        "speeds ahead and of turning, are observed.",
    )
    side_clearance: bool = setting(
        default=False,
        doc="True: how far the outline could move to the left and to the right before it touches "
        "what the scan shows is observed, where it stands and at each pose ahead; without poses "
        "ahead, at a fan of poses that it may take next.",
    )
    trail: tuple[float, ...] = setting(
        default=(),
        unit="m",
        low=0.0,
        high=15.0,
        doc="Distances back along its own way at which the chair's places are observed; before it "
        "has come so far, its start.",
    )
    hide_guidance: bool = setting(
        default=False,
        doc="True: poses ahead and the side clearances there are shown to critics and teachers "
        "alone, under `privileged_path` and `privileged_side_clearance`.",
    )
    privileged: bool = setting(
        default=False, doc="True: a critic's keys are observed; in training only."
    )
    aim: Literal["goal", "path", "field", "time"] = setting(
        default="field",
        doc="What progress is measured along: the straight line to the goal, the path, the "
        "geodesic, or seconds to go by the guidance 'poses'.",
    )
    margin: float = setting(
        default=0.05,
        unit="m",
        low=0.0,
        doc="Clearance that the geodesic keeps beyond half the chair's width.",
        source=_CHOICE,
    )
    reward: RewardWeights = RewardWeights()
