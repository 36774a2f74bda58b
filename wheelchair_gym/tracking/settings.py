"""Settings of the tracker: what is tracked, and how exactly it is seen."""

from __future__ import annotations

from wheelchair_gym.config import setting, settings


@settings
class TrackerSettings:
    """How moving people and things are tracked."""

    max_range: float = setting(
        default=8.0, unit="m", low=0.5, high=100.0, source="someone at 1.5 m/s needs 5 s from there"
    )
    """Range up to which something is tracked."""
    sigma: float = setting(
        default=0.04, unit="m", low=0.001, high=1.0, source="measured: see the page on tracking"
    )
    """Standard deviation of a cluster's centre; more where beams are far apart, or it is hidden."""
