"""Settings of the shield: clearances, memory, expected motion of people, stale data."""

from __future__ import annotations

from wheelchair_gym.config import setting, settings


@settings
class StaleSettings:
    """Greatest age of sensor data; silent, invalid and frozen data count alike."""

    laser: float = setting(
        default=0.2, unit="s", low=0.01, doc="Longest time without a valid, new scan.",
        source="eight scans at 40 Hz",
    )  # fmt: skip
    ultrasonic: float = setting(
        default=1.0, unit="s", low=0.01,
        doc="Longest time without a valid echo of a ranger that has been heard before.",
        source="two rounds of eight rangers",
    )  # fmt: skip
    odometry: float = setting(
        default=0.1, unit="s", low=0.01, doc="Longest time without valid, new odometry.",
        source="five messages at 50 Hz",
    )  # fmt: skip


@settings
class ShieldSettings:
    """How the shield limits the requested twist."""

    stop_margin: float = setting(
        default=0.03, unit="m", low=0.0,
        doc="Width of the stop zone: clearance that the outline always keeps.",
        source="measured: means of the laser err by 5 mm, edges and a stop by 10 mm each",
    )  # fmt: skip
    time_headway: float = setting(
        default=0.08, unit="s", low=0.0,
        doc="Slow zone: clearance beside the outline per speed of the outline.",
        source="design choice",
    )  # fmt: skip
    reaction_time: float = setting(
        default=0.05, unit="s", low=0.0, high=2.0,
        doc="Delay from a reading to the motion that answers it.", source="links and motors",
    )  # fmt: skip
    creep_speed: float = setting(
        default=0.05, unit="m/s", low=0.0,
        doc="Speed up to which the chair may move inside the stop zone.", source="design choice",
    )  # fmt: skip
    memory_time: float = setting(
        default=3.0, unit="s", low=0.1, high=60.0,
        doc="How long free space and objects that may move are remembered.",
        source="design choice",
    )  # fmt: skip
    static_memory_time: float = setting(
        default=60.0, unit="s", low=0.1, high=3600.0,
        doc="How long an unobserved static obstacle is remembered.", source="design choice",
    )  # fmt: skip
    vacated_time: float = setting(
        default=1.5, unit="s", low=0.1, high=60.0,
        doc="How long space that the chair has left counts as free.",
        source="a door may fall shut behind it",
    )  # fmt: skip
    unseen_speed: float = setting(
        default=0.1, unit="m/s", low=0.0,
        doc="Greatest speed of the outline into space that no sensor has seen.",
        source="design choice",
    )  # fmt: skip
    person_speed: float = setting(
        default=1.5, unit="m/s", low=0.0,
        doc="Greatest speed that a person is expected to reach in any direction.",
        source="design choice",
    )  # fmt: skip
    person_acceleration: float = setting(
        default=2.7, unit="m/s2", low=0.0, doc="Acceleration expected of a person who stands.",
        source="0 to 1.34 m/s in 0.5 s",
    )  # fmt: skip
    moving_memory_time: float = setting(
        default=3.0, unit="s", low=0.0, high=60.0,
        doc="How long an object that moved is expected to move again.", source="design choice",
    )  # fmt: skip
    stale: StaleSettings = StaleSettings()
