"""A drive that shows wheels, motors and scanner: both ways, at all speeds, in 4 m x 4 m."""

import dataclasses
from typing import Any, Final

import gymnasium as gym
import numpy as np

from wheelchair_gym.envs import EnvSettings, NavigationEnv
from wheelchair_gym.identification.logs import DriveLog, log_of_reports
from wheelchair_gym.maps import FREE, OccupancyGrid
from wheelchair_gym.perception.localized_chair import unwrapped
from wheelchair_gym.perception.occupancy import read_scan
from wheelchair_gym.safety import ShieldSettings
from wheelchair_gym.safety.stops import BY_HAND
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.types import Chair, Command, Episode, Reading

_QUARTER, _FULL = 2.62, 7.9  # s of a quarter turn at 0.6 rad/s, of a full one at 0.8 rad/s


def _square(side: float) -> list[tuple[float, float, float]]:
    leg = [(0.4, 0.0, 3.0), (0.0, 0.0, 1.0), (0.0, side * 0.6, _QUARTER), (0.0, 0.0, 1.0)]
    return 4 * leg


# Twists [m/s, rad/s] and their durations [s]: standing, squares, circles and full turns both ways,
# fast and slow ahead and back.
PROGRAM: Final = (
    (0.0, 0.0, 3.0),
    *_square(1.0), *_square(-1.0),
    (0.3, 0.5, 12.6), (0.0, 0.0, 1.0), (0.3, -0.5, 12.6), (0.0, 0.0, 1.0),
    (0.0, 0.8, _FULL), (0.0, 0.0, 1.0), (0.0, -0.8, _FULL), (0.0, 0.0, 1.0),
    *2 * ((0.7, 0.0, 1.8), (0.0, 0.0, 1.5), (-0.3, 0.0, 4.2), (0.0, 0.0, 1.0)),
    (0.05, 0.0, 4.0), (0.0, 0.0, 1.0), (-0.05, 0.0, 4.0), (0.0, 0.0, 3.0),
)  # fmt: skip
DURATION: Final = sum(seconds for _, _, seconds in PROGRAM)  # s
# Floor that the program needs about the axle's centre at its start: from, to [m].
ROOM: Final = {"ahead": (-1.0, 2.0), "left": (-1.9, 1.9)}


def free_floor_env(settings: EnvSettings, chair: Chair) -> NavigationEnv:
    """The environment of a drive on floor that a person has cleared, without map and goal.

    Its shield allows full speed where nothing was seen yet, as behind the chair; it stops before
    obstacles.
    """
    limits = settings.chair.limits
    shield = dataclasses.replace(
        settings.shield or ShieldSettings(), unseen_speed=max(limits.forward, limits.turn)
    )
    config = EnvSettings(
        rate=settings.rate,
        chair=settings.chair,
        sensors=dataclasses.replace(settings.sensors, pose_source="odometry"),
        hardware=settings.hardware,
        shield=shield,
    )
    return NavigationEnv("empty", config, chair=chair)


def check_room(reading: Reading, sensors: SensorSettings) -> None:
    """Refuse a place in which the program does not fit, as far as the scanners see it.

    Raises:
        ValueError: something stands within ROOM; the text says where.
    """
    scans = zip(sensors.lasers, sensors.slices, strict=True)
    echoes = np.concatenate([read_scan(one, reading.laser[beams]).echoes for one, beams in scans])
    (back, front), (right, left) = ROOM["ahead"], ROOM["left"]
    x, y = echoes.T
    inside = (x > back) & (x < front) & (y > right) & (y < left)
    if inside.any():
        place = echoes[inside][np.argmin(np.hypot(x[inside], y[inside]))]
        raise ValueError(
            f"something stands {place[0]:.2f} m ahead and {place[1]:.2f} m to the left of the "
            f"axle; expected free floor from {back:g} to {front:g} m ahead and {right:g} to "
            f"{left:g} m to the left"
        )


def excite(env: gym.Env[Any, Any]) -> DriveLog:
    """Drive the program in a `free_floor_env`, wrapped or not, once nobody drives by hand; the log.

    The shield may slow the program.

    Raises:
        ValueError: there is too little room, or the chair or the shield stopped the program.
    """
    inner: Any = env.unwrapped
    chair, shield, settings = unwrapped(inner.chair), inner.shield, inner.settings
    floor = OccupancyGrid(np.full((200, 200), FREE, np.int8), 0.1, (-10.0, -10.0, 0.0))
    far = np.array([9.0, 9.0, 0.0])
    env.reset(options={"episode": Episode(floor, np.zeros(3), far, time_limit=1e6)})
    while inner.task.reading.halted == BY_HAND:  # until the person hands the chair back
        if env.step(Command(np.zeros(2)).as_action(inner.task.limits))[2]:
            raise ValueError("a bumper was pressed before the drive began")
    reading: Reading = inner.task.reading
    check_room(reading, settings.sensors)
    wheels, stamps, scans = [chair.wheels], [chair.scan_stamps], [reading.laser]
    due = reading.stamp
    for v, w, seconds in PROGRAM:
        due += seconds
        action = Command(np.array([v, w])).as_action(inner.task.limits)
        while reading.stamp < due - 0.5 / inner.settings.rate:
            _, _, terminated, _, _ = env.step(action)
            reading, decision = inner.task.reading, shield.decision
            why = reading.halted or (decision.protective and decision.reason)
            if why or terminated:
                after = f"after {reading.stamp:.0f} s"
                raise ValueError(f"{after} the drive was stopped: {why or 'a bumper was pressed'}")
            wheels.append(chair.wheels)
            stamps.append(chair.scan_stamps)
            scans.append(reading.laser)
    return log_of_reports(
        np.concatenate(wheels), stamps, scans, settings.sensors, settings.chair.drive
    )
