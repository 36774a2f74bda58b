"""Settings of the shield: clearances, memory, expected motion of people, stale data."""

from wheelchair_gym.base.settings import setting, settings


@settings
class StaleSettings:
    """Maximum age of sensor data; silent, invalid and frozen data count alike."""

    laser: float = setting(default=0.2, unit="s", low=0.01, source="eight scans at 40 Hz")
    """Longest time without a valid, new scan."""
    ultrasonic: float = setting(
        default=1.0, unit="s", low=0.01, source="two rounds of eight rangers"
    )
    """Longest time without a valid echo of a ranger that has been heard before."""
    odometry: float = setting(default=0.1, unit="s", low=0.01, source="five messages at 50 Hz")
    """Longest time without valid, new odometry."""


@settings
class ShieldSettings:
    """Limits of the requested twist by the shield."""

    stop_margin: float = setting(
        default=0.021, unit="m", low=0.0, source="measured: edges and a stop err by 10 mm each"
    )
    """Clearance that the outline always keeps, beyond the error of the lasers by their settings
    (9 mm by default: twice `bias`, and a third of `sigma`)."""
    time_headway: float = setting(default=0.08, unit="s", low=0.0)
    """Slow zone: clearance beside the outline per speed of the outline."""
    reaction_time: float = setting(
        default=0.05, unit="s", low=0.0, high=2.0, source="links and motors"
    )
    """Delay from a reading to the motion that answers it."""
    creep_speed: float = setting(default=0.05, unit="m/s", low=0.0)
    """Speed up to which the chair may move inside the stop zone."""
    memory_time: float = setting(default=3.0, unit="s", low=0.1, high=60.0)
    """Time for which free space and objects that may move are remembered."""
    static_memory_time: float = setting(default=60.0, unit="s", low=0.1, high=3600.0)
    """Time for which an unobserved static obstacle is remembered."""
    vacated_time: float = setting(
        default=1.5, unit="s", low=0.1, high=60.0, source="a door may fall shut behind it"
    )
    """Time for which space that the chair has left counts as free."""
    unseen_speed: float = setting(default=0.1, unit="m/s", low=0.08)
    """Maximum speed of the outline into space that no sensor has seen. Below the lower bound a
    chair hardly starts: all around it is unseen, and its rear corners count whichever way they
    move."""
    person_speed: float = setting(default=1.5, unit="m/s", low=0.0)
    """Maximum speed that a person is expected to reach in any direction."""
    person_acceleration: float = setting(
        default=2.7, unit="m/s2", low=0.0, source="0 to 1.34 m/s in 0.5 s"
    )
    """Acceleration expected of a person who stands."""
    moving_memory_time: float = setting(default=3.0, unit="s", low=0.0, high=60.0)
    """Time for which an object that moved is expected to move again."""
    wary_time: float = setting(default=10.0, unit="s", low=0.0, high=3600.0)
    """How long after something moved nearby the chair backs into unseen space no faster than
    `creep_speed`."""
    tracks: bool = setting(default=True)
    """Whether a person who is tracked is expected near where their velocity takes them, rather than
    anywhere that `person_speed` reaches."""
    track_sigmas: float = setting(
        default=1.0, low=0.0, high=10.0, source="93 % of velocities or more: see tracking"
    )
    """Standard deviations of a track's velocity and place that are allowed for."""
    stale: StaleSettings = StaleSettings()
