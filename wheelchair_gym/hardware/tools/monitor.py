"""What a chair says now, as a table for people."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from wheelchair_gym.hardware.boards.messages import Fault, Mode, Switch

if TYPE_CHECKING:
    from wheelchair_gym.hardware.boards.senses import BoardSenses


def flag_names(flags: Fault | Switch) -> str:
    """What is set, by name."""
    return flags.name or "none"


def live_rows(senses: BoardSenses, now: float) -> list[tuple[str, str]]:
    """What a chair says now, as rows of name and value."""
    ages, rows = senses.ages(now), []
    for name, link in (("drive board", senses.drive), ("range board", senses.range)):
        if link is not None:
            s = link.statistics
            state = (
                link.why
                or link.mismatch
                or f"{s.received} frames, {s.bad} refused, {s.missed} missed"
            )
            rows.append((name, state))
    laser = senses.laser
    rows.append(("laser", laser.why or f"{laser.statistics.scans} scans"))
    rows.append(("ages", "  ".join(f"{name} {1e3 * age:.0f} ms" for name, age in ages.items())))
    if math.isfinite(ages["odometry"]):
        told = senses.odometry
        pose, _ = senses.odometer.at(now)
        rows += [
            ("mode", f"{Mode(told.mode).name}, faults {flag_names(Fault(told.faults))}"),
            ("switches", flag_names(Switch(told.switches))),
            ("set point", f"{told.v:.3f} m/s  {told.w:.3f} rad/s"),
            ("wheels", f"{told.speed_left:.3f}  {told.speed_right:.3f} m/s"),
            ("duties", f"{told.duty_left:.2f}  {told.duty_right:.2f}"),
            ("odometry", f"{pose[0]:.3f} m  {pose[1]:.3f} m  {math.degrees(pose[2]):.1f} deg"),
            ("battery", f"{told.battery:.1f} V"),
        ]
    ranges, sonar, old = senses.ranges(now)
    if np.isfinite(ranges).any():
        nearest = int(np.nanargmin(np.where(np.isfinite(ranges), ranges, np.inf)))
        bearing = math.degrees(senses.sensors.laser.fov * (nearest / (len(ranges) - 1) - 0.5))
        rows.append(("nearest echo", f"{ranges[nearest]:.2f} m at {bearing:.0f} deg"))
    told_sonar = (f"{r:.2f} ({a:.1f} s)" for r, a in zip(sonar, old, strict=True))
    rows.append(("ultrasonics", "  ".join(told_sonar)))
    return rows
