"""The chair's state as a table for the terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from wheelchair_gym.hardware.boards.protocol import Fault, Mode, Switch

if TYPE_CHECKING:
    from wheelchair_gym.hardware.boards.senses import BoardSensors


def flag_names(flags: Fault | Switch) -> str:
    """The names of the flags that are set."""
    return flags.name or "none"


def status_rows(senses: BoardSensors, now: float) -> list[tuple[str, str]]:
    """The chair's present state, as rows of name and value."""
    ages, rows = senses.ages(now), []
    for name, link in (("drive board", senses.drive), ("range board", senses.range)):
        if link is not None:
            s = link.statistics
            text = (
                link.error
                or link.mismatch
                or f"{s.received} frames, {s.bad} refused, {s.missed} missed"
            )
            rows.append((name, text))
    laser = senses.laser
    rows.append(("laser", laser.error or f"{laser.statistics.scans} scans"))
    rows.append(("ages", "  ".join(f"{name} {1e3 * age:.0f} ms" for name, age in ages.items())))
    if math.isfinite(ages["odometry"]):
        state = senses.odometry
        pose, _ = senses.odometer.at(now)
        rows += [
            ("mode", f"{Mode(state.mode).name}, faults {flag_names(Fault(state.faults))}"),
            ("switches", flag_names(Switch(state.switches))),
            ("set point", f"{state.v:.3f} m/s  {state.w:.3f} rad/s"),
            ("wheels", f"{state.speed_left:.3f}  {state.speed_right:.3f} m/s"),
            ("duties", f"{state.duty_left:.2f}  {state.duty_right:.2f}"),
            ("odometry", f"{pose[0]:.3f} m  {pose[1]:.3f} m  {math.degrees(pose[2]):.1f} deg"),
            ("battery", f"{state.battery:.1f} V"),
        ]
    ranges, sonar, old = senses.ranges(now)
    if np.isfinite(ranges).any():
        nearest = int(np.nanargmin(np.where(np.isfinite(ranges), ranges, np.inf)))
        bearing = math.degrees(senses.sensors.laser.fov * (nearest / (len(ranges) - 1) - 0.5))
        rows.append(("nearest echo", f"{ranges[nearest]:.2f} m at {bearing:.0f} deg"))
    sonar_texts = (f"{r:.2f} ({a:.1f} s)" for r, a in zip(sonar, old, strict=True))
    rows.append(("ultrasonics", "  ".join(sonar_texts)))
    return rows
