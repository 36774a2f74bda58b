"""From logs to settings: what was measured, what is known in combination only, what was not seen.

First the noise and the kinematics with the mount, offset and delay of the scanner (`kinematics`),
then the drive train (`drive_train`). Nothing is guessed: a value that a log does not show keeps the
value of the config, and the findings say so.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.errors import InputError
from wheelchair_gym.base.settings import dump
from wheelchair_gym.engine import GRAVITY
from wheelchair_gym.geometry.kinematics import DriveGeometry
from wheelchair_gym.geometry.planar import compose, relative_pose
from wheelchair_gym.identification import drive_train, kinematics
from wheelchair_gym.identification.kinematics import Kinematics
from wheelchair_gym.identification.logs import DriveLog
from wheelchair_gym.perception.occupancy import wall_ahead
from wheelchair_gym.perception.slam import Slam, SlamSettings
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.randomization import JointRandomization
from wheelchair_gym.sim.settings import WHEEL_INERTIA, BodySettings, ChairSettings, MotorSettings

# Motion that a log has to show: its name, unit, and smallest amount.
NEEDED: Final = {
    "turn to the left": ("rad", 3.0), "turn to the right": ("rad", 3.0), "drive": ("m", 3.0),
}  # fmt: skip
_MIN_SCANS = 100
_LARGEST_OFFSET = 0.1  # m, of a scanner
_STANDS = 2e-3  # m that wheels move at most while a chair stands
_PARTICLES = 2  # of SLAM: poses need only be rough
_SURE = 1.96  # deviations of a 95 % interval
_SIGMA_DEVIATION = 0.05  # relative: of errors on simulated chairs (tests.benchmarks.identification)
# Deviations up to which a value counts as measured.
MEASURED: Final = {
    "scale": 2e-3, "wheel_ratio": 1e-3, "track": 3e-3, "x": 5e-3, "y": 5e-3, "yaw": 4e-3,
    "offset": 5e-3, "delay": 0.02,
}  # fmt: skip
# Differences from the config up to which it describes the chair well enough to drive.
AGREES: Final = {
    "scale": 5e-3, "wheel_ratio": 2e-3, "track": 5e-3, "x": 0.01, "y": 0.01, "yaw": 0.01,
    "offset": 0.01, "sigma": 0.01, "dropout": 0.01, "torque_constant": 0.3,
}  # fmt: skip
_RELATIVE = 0.05  # likewise, of push and damping: relative deviation
_MIN_SLOPE, _CERTAIN = math.radians(0.5), 4.0  # rad and deviations: of a pull that is reported
# Quantities of `chair.joint` that the unknowns become, in their order; `scale` divides counts. The
# uncertainty of the offset is the scanner's bias.
_JOINT: Final = (
    "odometry.scale_error", "odometry.diameter_error", "odometry.track_error", "laser.x_error",
    "laser.y_error", "laser.yaw_error",
)  # fmt: skip


class Finding(NamedTuple):
    """One quantity: its value and interval, and what the logs say about it."""

    name: str
    unit: str
    value: float | None  # None: not seen
    low: float | None  # of the 95 % interval
    high: float | None
    before: float | None  # in the config; None: it has no such setting
    status: str  # measured, combination only, not seen


class Fit(NamedTuple):
    """Settings that were found, and the findings behind them."""

    chair: ChairSettings
    sensors: SensorSettings
    joint: JointRandomization  # of what is still uncertain
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]  # structure that the model does not explain
    weakest: str  # the most uncertain combination of kinematic unknowns


def missing(log: DriveLog, drive: DriveGeometry) -> str:
    """Name all that a log lacks for identification; an empty text if it lacks nothing."""
    steps = np.diff(log.travel, axis=0)
    turns = (steps[:, 1] - steps[:, 0]) / drive.track
    seen = {
        "turn to the left": float(turns[turns > 0.0].sum()),
        "turn to the right": float(-turns[turns < 0.0].sum()),
        "drive": float(np.abs(steps.mean(axis=1)).sum()),
    }
    lacks = [
        f"a {name} of {least:g} {unit} (it has {seen[name]:.1f})"
        for name, (unit, least) in NEEDED.items()
        if seen[name] < least
    ]
    if (scans := len(log.scan_stamps)) < _MIN_SCANS:
        lacks.append(f"{_MIN_SCANS} scans (it has {scans})")
    return ", ".join(lacks)


def rough_poses(log: DriveLog, drive: DriveGeometry, laser: LaserSettings) -> Array:
    """Poses (m, 3) of the scanner at all scans, by SLAM with the config's geometry."""
    slam = Slam(dataclasses.replace(laser, offset=0.0), SlamSettings(particles=_PARTICLES))
    path = kinematics.wheel_path(log, np.array([1.0, drive.wheel_ratio, drive.track]))
    poses = kinematics.poses_at(log, path, log.scan_stamps)
    increments = relative_pose(np.concatenate([poses[:1], poses[:-1]]), poses)
    for increment, scan in zip(increments, log.ranges, strict=True):
        slam.update(increment, scan)
    return compose(slam.trajectory, np.array([laser.x, laser.y, laser.yaw]))


def find_kinematics(
    name: str, log: DriveLog, drive: DriveGeometry, laser: LaserSettings,
    rng: np.random.Generator, offset: float | None = None, known: Array | None = None,
) -> Kinematics:  # fmt: skip
    """Wheels and scanner of a log, which has this name; see `kinematics.identify`.

    Raises:
        InputError: the log lacks something, which is named.
    """
    if lacks := missing(log, drive):
        raise InputError(f"{name} lacks {lacks}")
    try:
        return kinematics.identify(
            log, drive, laser, rough_poses(log, drive, laser), rng, offset, known
        )
    except (ValueError, np.linalg.LinAlgError) as error:
        raise InputError(f"{name}: {error}") from None


def _tape_offset(name: str, log: DriveLog, laser: LaserSettings, distance: float) -> float:
    """The offset [m] of a scanner that stands at first, at a distance by tape from a wall ahead."""
    moved = np.abs(log.travel - log.travel[0]).max(axis=1) > _STANDS
    until = log.stamps[moved][0] if moved.any() else np.inf
    still = np.ma.masked_invalid(log.ranges[log.scan_stamps < until].astype(np.float64))
    centred = dataclasses.replace(laser, x=0.0, y=0.0)
    try:
        seen = wall_ahead(centred, still.mean(axis=0).filled(np.inf)).distance
        if abs(seen - distance) > _LARGEST_OFFSET:
            raise ValueError(f"the wall ahead is {seen:.3f} m away by laser")
    except ValueError as error:
        raise InputError(f"{name}: --wall {distance:g}: {error}") from None
    return seen - distance


def _combined(parts: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Values and covariance of several estimates, each weighted by its own covariance."""
    weights = [np.linalg.inv(covariance) for _, covariance in parts]
    covariance = np.linalg.inv(np.sum(weights, axis=0))
    terms = [weight @ values for weight, (values, _) in zip(weights, parts, strict=True)]
    return covariance @ np.sum(terms, axis=0), covariance


def _no_echo(log: DriveLog) -> tuple[int, int]:
    """Numbers of lost echoes, and of beams whose echoes in the scans before and after agree."""
    before, now, after = log.ranges[:-2], log.ranges[1:-1], log.ranges[2:]
    seen = np.isfinite(before) & np.isfinite(after)
    seen &= np.abs(np.where(seen, before, 0.0) - np.where(seen, after, 0.0)) < 0.1
    return int((seen & ~np.isfinite(now)).sum()), int(seen.sum())


def fit(
    logs: Sequence[tuple[str, DriveLog]], chair: ChairSettings, sensors: SensorSettings,
    mass: float | None = None, seed: int = 0, wall: float | None = None,
) -> Fit:  # fmt: skip
    """Find the settings of a chair.

    Args:
        logs: names and drives; values of several drives are combined by their covariances.
        chair: settings that the logs were recorded with.
        sensors: likewise.
        mass: weighed mass of chair and person [kg]; None: that of the config, of which only the
            ratio to the motors' gain is found.
        seed: of the bootstrap.
        wall: measured distance [m] from the scanner to the wall ahead at the start of the first
            log.

    Raises:
        InputError: a log lacks something, which is named.
    """
    laser, rng = sensors.laser, np.random.default_rng(seed)
    tape = None if wall is None else _tape_offset(*logs[0], laser, wall)
    found = [find_kinematics(name, log, chair.drive, laser, rng, tape) for name, log in logs]
    kinematic = _combined_kinematics(found)
    values, covariance = kinematic.values, kinematic.covariance
    findings = _kinematic_findings(kinematic, chair.drive, laser)
    named = _values(findings)
    drive = dataclasses.replace(
        chair.drive,
        counts_per_metre=chair.drive.counts_per_metre / named["scale"],
        wheel_radius=chair.drive.wheel_radius * named["scale"],
        wheel_ratio=named["wheel_ratio"],
        track=named["track"],
    )
    lost, beams = np.sum([_no_echo(log) for _, log in logs], axis=0).tolist()
    dropout, sigma = lost / max(1, beams), kinematic.sigma
    scanner = dataclasses.replace(
        _mounted(laser, findings, kinematic), sigma=sigma, dropout=dropout
    )
    chance = math.sqrt(dropout * (1.0 - dropout) / max(1, beams))
    findings += [
        _finding("sigma", "m", sigma, _SIGMA_DEVIATION * sigma, laser.sigma, math.inf),
        _finding("dropout", "", dropout, chance, laser.dropout, math.inf),
    ]
    more_lasers, more = _fit_further(logs, values, chair.drive, sensors, rng)
    body = chair.body if mass is None else dataclasses.replace(chair.body, mass=mass)
    chair = dataclasses.replace(chair, body=body)
    body, motor, of_motors, notes = _fit_motors(logs, values, chair, drive, mass, rng)
    odometry = dataclasses.replace(sensors.odometry, diameter_error=0.0, track_error=0.0)
    k = len(_JOINT)
    # Relative errors of the ratio and of the track, of which the joint row draws.
    scale = np.diag([1.0, 1.0, 1.0 / named["track"], *[1.0] * (k - 3)])
    joint = JointRandomization(
        quantities=_JOINT, mean=(0.0,) * k,
        covariance=tuple(map(tuple, (scale @ covariance[:k, :k] @ scale).tolist())),
    )  # fmt: skip
    return Fit(
        dataclasses.replace(chair, drive=drive, body=body, motor=motor),
        dataclasses.replace(sensors, laser=scanner, more_lasers=more_lasers, odometry=odometry),
        joint, tuple(findings + more + of_motors), notes, _weakest(covariance),
    )  # fmt: skip


def _combined_kinematics(found: Sequence[Kinematics]) -> Kinematics:
    values, covariance = _combined([(one.values, one.covariance) for one in found])
    conditional = np.min([one.conditional for one in found], axis=0)
    return Kinematics(
        values, conditional, covariance, float(np.median([one.sigma for one in found]))
    )


def _values(findings: Sequence[Finding]) -> dict[str, Any]:
    """Values by the names of UNKNOWNS; what was not seen keeps that of the config."""
    return {one.name.split()[0]: one.before if one.value is None else one.value for one in findings}


def _mounted(laser: LaserSettings, findings: Sequence[Finding], found: Kinematics) -> LaserSettings:
    """A scanner with the mount and offset that were found, whose uncertainty is its bias."""
    of = _values(findings)
    seen = next(one.value is not None for one in findings if one.name.startswith("offset"))
    bias = math.sqrt(found.covariance[kinematics.OFFSET, kinematics.OFFSET]) if seen else laser.bias
    return dataclasses.replace(
        laser, x=of["x"], y=of["y"], yaw=of["yaw"], offset=of["offset"], bias=bias
    )


def _fit_further(
    logs: Sequence[tuple[str, DriveLog]], values: Array, drive: DriveGeometry,
    sensors: SensorSettings, rng: np.random.Generator,
) -> tuple[tuple[LaserSettings, ...], list[Finding]]:  # fmt: skip
    """Further scanners and findings about them, with the wheels that the first one showed."""
    lasers, findings = list(sensors.more_lasers), []
    for k, laser in enumerate(lasers):
        found = []
        for name, log in logs:
            if k < len(log.more):
                own = log._replace(scan_stamps=log.more[k].stamps, ranges=log.more[k].ranges)
                who = f"{name}, laser {k + 1}"
                found.append(find_kinematics(who, own, drive, laser, rng, known=values))
        if found:
            kinematic = _combined_kinematics(found)
            of = _kinematic_findings(kinematic, drive, laser, f" of laser {k + 1}")
            lasers[k] = _mounted(laser, of, kinematic)
            findings += of[kinematics.MOUNT.start :]
    return tuple(lasers), findings


def _weakest(covariance: Array) -> str:
    """Name the most uncertain combination of UNKNOWNS, in units of MEASURED."""
    units = np.array(list(MEASURED.values()))
    variances, directions = np.linalg.eigh(covariance / np.outer(units, units))
    parts = zip(directions[:, -1], MEASURED, strict=True)
    named = [f"{part:+.2f} {name}" for part, name in sorted(parts, key=lambda p: -abs(p[0]))]
    share = math.sqrt(variances[-1])
    return f"most uncertain: {', '.join(named[:3])}: {share:.2f} of what counts as measured"


def tuned_chair(found: Fit) -> ChairSettings:
    """The chair of a fit, with the feed-forward that its motors ask for.

    The board's feed-forward of the speed is then the motors' constant, that of the acceleration the
    voltage that both motors need for it.
    """
    motor, drive = found.chair.motor, found.chair.drive
    total = found.chair.body.mass + 2.0 * WHEEL_INERTIA / drive.wheel_radius**2
    force = 2.0 * motor.gain * motor.torque_constant / (motor.resistance * drive.wheel_radius)
    motor = dataclasses.replace(motor, feed_constant=None, ka=total / force)
    return dataclasses.replace(found.chair, motor=motor)


def settings_of(found: Fit) -> dict[str, Any]:
    """Plain content of the files of a fit, by their names: settings, ranges and findings.

    `chair.json` and `sensors.json` are the sections of these names; `ranges.json` is the setting
    `chair.joint`: a simulation draws from it what is still uncertain.
    """
    return {
        "chair.json": dump(found.chair),
        "sensors.json": {k: v for k, v in dump(found.sensors).items() if k != "pose_source"},
        "ranges.json": dump(found.joint),
        "fit.json": {
            "findings": [one._asdict() for one in found.findings], "notes": list(found.notes),
            "weakest": found.weakest,
        },
    }  # fmt: skip


def _finding(
    name: str, unit: str, value: float, deviation: float, before: float | None, most: float
) -> Finding:
    """Return a finding with its interval, measured where its deviation is at most that."""
    low, high = float(value - _SURE * deviation), float(value + _SURE * deviation)
    status = "measured" if deviation <= most else "combination only"
    return Finding(name, unit, float(value), low, high, before, status)


def _unseen(name: str, unit: str, before: float | None) -> Finding:
    return Finding(name, unit, None, None, None, before, "not seen")


def _kinematic_findings(
    found: Kinematics, drive: DriveGeometry, laser: LaserSettings, suffix: str = ""
) -> list[Finding]:
    units = dict(zip(kinematics.UNKNOWNS, ("", "", "m", "m", "m", "rad", "m", "s"), strict=True))
    before = (1.0, drive.wheel_ratio, drive.track, laser.x, laser.y, laser.yaw, laser.offset, None)
    spread, findings = np.sqrt(np.diag(found.covariance)), []
    for k, (name, unit) in enumerate(units.items()):
        most, called = MEASURED[name], name + suffix
        if min(spread[k], found.conditional[k]) > most:
            findings.append(_unseen(called, unit, before[k]))
        else:
            value, deviation = found.values[k], spread[k]
            findings.append(_finding(called, unit, value, deviation, before[k], most))
    return findings


def _fit_motors(
    logs: Sequence[tuple[str, DriveLog]], values: Array, chair: ChairSettings,
    drive: DriveGeometry, mass: float | None, rng: np.random.Generator,
) -> tuple[BodySettings, MotorSettings, list[Finding], tuple[str, ...]]:  # fmt: skip
    """Return the body with its drag, the motors, findings, and notes."""
    body, motor, radius, notes, parts = chair.body, chair.motor, drive.wheel_radius, [], []
    limit = motor.resistance * motor.current_limit
    total = body.mass + 2.0 * WHEEL_INERTIA / radius**2
    for name, log in logs:
        try:
            path = kinematics.wheel_path(log, values)
            train = drive_train.fit_drive_train(log, values[0], path, 2.0 * limit, rng)
        except ValueError as error:
            notes.append(f"{name}: motors not seen: {error}")
            continue
        parts.append((train.values[:3], train.covariance[:3, :3]))
        slope, deviation, direction = drive_train.slope_of(train, total / body.mass)
        if slope > max(_MIN_SLOPE, _CERTAIN * deviation):
            notes.append(
                f"{name}: a constant pull as of a slope of {math.degrees(slope):.1f} deg, falling "
                f"{math.degrees(direction):.0f} deg from the first heading: is the floor level?"
            )
    friction = _unseen("friction", "", body.friction)
    if not parts:
        constant = _unseen("torque_constant", "V s/rad", motor.torque_constant)
        unseen = [_unseen("gain", "", motor.gain), constant, friction]
        return body, motor, unseen, tuple(notes)
    (push, damping, drag), covariance = _combined(parts)
    deviations = np.sqrt(np.diag(covariance))
    constant = 0.5 * damping / push * radius
    gain = push * total * motor.resistance * radius / constant
    ratio = deviations / np.array([push, damping, max(drag, 1e-3)])
    of_constant = constant * math.hypot(ratio[0], ratio[1])
    share = body.centre_of_mass / body.wheelbase
    known = (body.rolling_resistance * (1.0 - share) + body.caster_drag * share) * GRAVITY
    factor = float(np.clip(drag * total / body.mass / known, 0.0, 10.0)) if known else 1.0
    seen, of_seen = push * radius / constant, 2.0 * ratio[0] + ratio[1]
    weighed = -1.0 if mass is None else _RELATIVE * gain
    more = [
        _finding("gain/(R m)", "1/(ohm kg)", seen, seen * of_seen, None, seen * _RELATIVE),
        _finding("torque_constant", "V s/rad", constant, of_constant, motor.torque_constant,
                 _RELATIVE * constant),
        _finding("gain", "", gain, gain * ratio[0], motor.gain, weighed),
        _finding("drag", "m/s2", drag, deviations[2], known * body.mass / total, _RELATIVE * drag),
        friction,
    ]  # fmt: skip
    fitted = dataclasses.replace(
        motor, torque_constant=float(constant), gain=float(gain),
        feed_constant=motor.believed_constant,
    )  # fmt: skip
    rolling, casters = (min(0.5, factor * x) for x in (body.rolling_resistance, body.caster_drag))
    body = dataclasses.replace(body, rolling_resistance=rolling, caster_drag=casters)
    return body, fitted, more, tuple(notes)
