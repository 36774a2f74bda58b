"""Settings of the tracker: what is tracked, how it moves, when it is confirmed or dropped."""

from __future__ import annotations

from wheelchair_gym.config import setting, settings


@settings
class TrackerSettings:
    """How moving people and things are tracked."""

    max_range: float = setting(
        default=8.0, unit="m", low=0.5, high=100.0, source="someone at 1.5 m/s needs 5 s from there"
    )
    """Range up to which something is tracked."""
    cluster_gap: float = setting(
        default=0.15, unit="m", low=0.01, high=1.0, source="Leigh et al. 2015: 0.13"
    )
    """Neighbouring hits farther apart are of two clusters; more where beams are farther apart."""
    max_width: float = setting(
        default=1.2, unit="m", low=0.1, high=5.0, source="a door leaf is 0.6 to 1.1 m wide"
    )
    """Widest cluster that is tracked."""
    person_width: float = setting(
        default=0.9, unit="m", low=0.1, high=5.0, source="shoulders and swinging arms"
    )
    """Widest track that can be a person."""
    leg_distance: float = setting(
        default=0.8, unit="m", low=0.0, high=2.0, source="Leigh et al. 2015; a step of 0.7 m"
    )
    """Greatest distance between the centres of two legs of one person."""
    sigma: float = setting(
        default=0.04, unit="m", low=0.001, high=1.0, source="measured: see the page on tracking"
    )
    """Standard deviation of a cluster's centre; more where beams are far apart, or it is hidden."""
    sigma_of_legs: float = setting(
        default=0.08, unit="m", low=0.001, high=1.0, source="Leigh et al. 2015: 0.1"
    )
    """The same of a pair of legs."""
    time_sigma: float = setting(
        default=0.005, unit="s", low=0.0, high=1.0, source="half of a 10 ms step of the drive board"
    )
    """Error of a scan's stamp: where the chair turns, it moves everything that the laser sees."""
    acceleration_density: float = setting(
        default=1.0,
        unit="m2/s3",
        low=0.0,
        high=100.0,
        source="2 m/s2, kept for 0.25 s: people start with 1.4 +- 0.9 m/s2 (Fugger et al. 2000)",
    )
    """Spectral density of the random acceleration of what is tracked: the process noise."""
    first_speed_sigma: float = setting(
        default=1.0, unit="m/s", low=0.01, high=10.0, source="people walk with up to 2 m/s"
    )
    """Standard deviation of the speed of a new track, along each axis."""
    gate: float = setting(
        default=3.0, low=0.1, high=100.0, source="Mahalanobis: 99 % of a Gaussian in the plane"
    )
    """Greatest distance between a track and a cluster that continues it, in standard deviations."""
    confirm_time: float = setting(
        default=0.2, unit="s", low=0.0, high=10.0, source="measured: see the page on tracking"
    )
    """How long it must be seen moving before a track is confirmed."""
    confirm_distance: float = setting(
        default=0.25, unit="m", low=0.0, high=10.0, source="Leigh et al. 2015: 0.5; half a body"
    )
    """How far it must have come from where it stood before a track is confirmed."""
    moving_speed: float = setting(
        default=0.2, unit="m/s", low=0.0, high=10.0, source="a slow walk is 0.4"
    )
    """Speed from which something moves."""
    static_time: float = setting(
        default=1.0, unit="s", low=0.1, high=60.0, source="0.25 m/s covers the noise of a place"
    )
    """What has been seen at one place for so long belongs to the static surroundings."""
    memory_time: float = setting(
        default=8.0,
        unit="s",
        low=0.1,
        high=600.0,
        source="measured: with 3 s, tracks jump to walls",
    )
    """For how long the tracker remembers what was free and what was occupied."""
    map_distance: float = setting(
        default=0.15, unit="m", low=0.0, high=5.0, source="a cell and a modelled pose error"
    )
    """What is so near a mapped wall belongs to it."""
    map_spread: float = setting(
        default=0.03, low=0.0, high=1.0, source="error of the heading [rad]"
    )
    """So much farther from a mapped wall, per range, what is seen may be and still belong to it."""
    gone_time: float = setting(
        default=0.3, unit="s", low=0.0, high=10.0, source="three scans at 10 Hz"
    )
    """A track is dropped when the laser has seen through its place for so long."""
    max_sigma: float = setting(
        default=1.2, unit="m", low=0.1, high=10.0, source="about 1.5 s hidden"
    )
    """A track is dropped when the standard deviation of its place is greater."""
