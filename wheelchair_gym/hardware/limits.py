"""What a program that drives a real chair puts up with: how old, how late, how long."""

from __future__ import annotations

from wheelchair_gym.config import setting, settings
from wheelchair_gym.safety.settings import StaleSettings

_STALE = StaleSettings()  # of the shield: the host's limits are the same unless they are set


@settings
class HostLimits:
    """Beyond these the chair is told to stand."""

    scan: float = setting(
        default=_STALE.laser, unit="s", source="oldest of the laser: shield.stale", low=0.01
    )
    odometry: float = setting(
        default=_STALE.odometry, unit="s", source="oldest of the encoders: shield.stale", low=0.01
    )
    pose: float = setting(default=0.5, unit="s", source="oldest of the localiser", low=0.01)
    ultrasonic: float = setting(
        default=_STALE.ultrasonic, unit="s", source="oldest of each: shield.stale", low=0.01
    )
    hold: float = setting(
        default=0.5, unit="s", source="twist_mux: a command counts so long beyond its period",
        low=0.0,
    )  # fmt: skip
    drift: float = setting(
        default=1e-3, source="s per s that two clocks may part", low=0.0, high=0.1
    )
    patience: float = setting(default=5.0, unit="s", source="for fresh data at reset", low=0.1)
    still: float = setting(
        default=0.05, unit="m/s, rad/s", source="a chair at reset stands", low=0.001
    )
