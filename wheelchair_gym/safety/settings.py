"""Settings of the shield: what it keeps clear of, how it remembers, whom it does not trust."""

from __future__ import annotations

from wheelchair_gym.config import setting, settings


@settings
class StaleSettings:
    """How old what the chair is driven by may be; silent, invalid and frozen count alike."""

    laser: float = setting(default=0.2, unit="s", source="eight scans at 40 Hz", low=0.01)
    ultrasonic: float = setting(
        default=1.0, unit="s", source="two rounds of eight rangers; never heard: not mounted",
        low=0.01,
    )  # fmt: skip
    odometry: float = setting(default=0.1, unit="s", source="five messages at 50 Hz", low=0.01)


@settings
class ShieldSettings:
    """What may really be driven: slower or not at all, along what was asked for."""

    stop_margin: float = setting(
        default=0.03, unit="m",
        source="stop zone: a laser's means err by 5 mm, edges and a stop by 10 mm each", low=0.0,
    )  # fmt: skip
    time_headway: float = setting(
        default=0.08, unit="s",
        source="slow zone: so much of its own speed the outline keeps clear beside it", low=0.0,
    )  # fmt: skip
    reaction_time: float = setting(
        default=0.05, unit="s", source="from a reading to what wheels do of it: links and motors",
        low=0.0, high=2.0,
    )  # fmt: skip
    creep_speed: float = setting(
        default=0.05, unit="m/s", source="inside the stop zone: slower is no collision", low=0.0
    )
    memory_time: float = setting(
        default=3.0, unit="s", source="for which free space and what may move are remembered",
        low=0.1, high=60.0,
    )  # fmt: skip
    static_memory_time: float = setting(
        default=60.0, unit="s", source="for which what stood, and nobody has looked at since, is",
        low=0.1, high=3600.0,
    )  # fmt: skip
    vacated_time: float = setting(
        default=1.5, unit="s",
        source="for which space that the chair left is free: a door falls to behind it",
        low=0.1, high=60.0,
    )  # fmt: skip
    unseen_speed: float = setting(
        default=0.1, unit="m/s", source="walking-stick speed into what nobody has seen", low=0.0
    )
    person_speed: float = setting(
        default=1.5, unit="m/s", source="that whoever moves may take up in any direction", low=0.0
    )
    person_acceleration: float = setting(
        default=2.7, unit="m/s2", source="whoever moves: 0 to 1.34 m/s in 0.5 s", low=0.0
    )
    moving_memory_time: float = setting(
        default=3.0, unit="s", source="whoever moved may move again", low=0.0, high=60.0
    )
    stale: StaleSettings = StaleSettings()
