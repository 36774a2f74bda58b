"""`wheelchair hardware`: tools for a real chair, and for its twin."""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from typing import Any

import numpy as np

from agents.cli.arguments import changed, report
from agents.deploy import end_as_by_ctrl_c, listen_for_rearm
from agents.deploy import to_stderr as _log
from agents.evaluation.provenance import write_json
from wheelchair_gym.base.files import atomic_write
from wheelchair_gym.base.settings import InputError, load, read_json
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.geometry.planar import relative_pose
from wheelchair_gym.hardware import joystick
from wheelchair_gym.hardware.boards.parameters import (
    board_parameters,
    save_parameters,
    set_parameters,
)
from wheelchair_gym.hardware.boards.ports import may_reset
from wheelchair_gym.hardware.boards.senses import POLL_PERIOD, BoardSensors
from wheelchair_gym.hardware.chair import HardwareChair
from wheelchair_gym.hardware.control_loop import WallClock
from wheelchair_gym.hardware.tools import distance_calibration, wheel_calibration
from wheelchair_gym.hardware.tools.diagnostics import Diagnostics, Orientation, status_rows
from wheelchair_gym.hardware.tools.speed_tuning import GAINS, step_response
from wheelchair_gym.sim.settings import MotorSettings

_TABLE_PERIOD = 0.5  # s between two tables


@contextmanager
def _boards(settings: Any) -> Iterator[tuple[Any, Any]]:
    """The connections to the boards, without a chair, and their clock."""
    clock = WallClock()
    hardware, sensors, drive = settings.hardware, settings.sensors, settings.chair.drive
    with closing(BoardSensors(hardware, sensors, drive, clock.now)) as senses:
        yield senses, clock


def _chair(settings: Any) -> Any:
    """The chair, which a person at the terminal can re-arm."""
    end_as_by_ctrl_c()
    chair = HardwareChair(settings.hardware, settings.sensors, settings.chair, 1.0 / settings.rate)
    listen_for_rearm(chair)
    return chair


def _numbers(prompt: str, example: str) -> list[float]:
    """Numbers that a person types, as many as in the example.

    Raises:
        InputError: standard input ends.
    """
    _log(prompt)
    wanted = len(example.split(","))
    for line in sys.stdin:
        try:
            values = [float(word) for word in line.split(",")]
        except ValueError:
            values = []
        if len(values) == wanted:
            return values
        if line.strip():
            _log(f"expected {'two numbers' if wanted == 2 else 'a number'}, such as {example}")
    raise InputError("standard input ended before the measurement was typed")


@contextmanager
def _chair_errors(more: str = "") -> Iterator[None]:
    """Turn a ValueError of the chair into a ConnectionError, for which the command exits with 1.

    `more` is said after it.
    """
    try:
        yield
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise ConnectionError(f"{error}{more}") from None


def check(given: argparse.Namespace) -> int:
    """Check all parts; 0 when all are good."""
    settings = env_settings(given.config)
    wanted = board_parameters(settings.chair, settings.sensors, settings.hardware)
    with _boards(settings) as (senses, clock):

        def ask(what: str) -> None:
            _log(f"please {what}")

        found = Diagnostics(senses, clock, wanted).run(None if given.no_person else ask)
        if given.hands:
            found += Orientation(senses, clock, settings.chair.footprint, ask).run()
    good = all(one.good for one in found)
    lines = [
        f"{'ok  ' if one.good else 'FAIL'}  {one.part:14}  {one.what:22}  {one.found}"
        + (f"\n{'':26}look at: {one.advice}" if not one.good and one.advice else "")
        for one in found
    ]
    report(given, {"good": good, "findings": [one._asdict() for one in found]}, "\n".join(lines))
    return 0 if good else 1


def setup(given: argparse.Namespace) -> int:
    """Write the config's parameters to the boards, and save them there."""
    settings = env_settings(given.config)
    parameters = board_parameters(settings.chair, settings.sensors, settings.hardware)
    with _boards(settings) as (senses, clock):
        for board, wanted in parameters.items():
            if board == "range" and senses.range is None:
                continue
            _save(senses, clock, board, wanted, f"{given.config}: ")
            print(f"{board} board: {len(wanted)} parameters as in {given.config}, saved")
    return 0


def _save(
    senses: Any, clock: Any, board: str, wanted: dict[str, float], prefix: str = "",
    suffix: str = "",
) -> None:  # fmt: skip
    """Write parameters to a board, which saves them.

    Raises:
        InputError: the board refuses one, or does not confirm that it saved them.
    """
    if refused := set_parameters(senses, clock, board, wanted):
        raise InputError(f"{prefix}{'; '.join(refused.values())}{suffix}")
    if not save_parameters(senses, clock, board):
        raise InputError(f"the {board} board does not confirm that it saved its parameters")


@_chair_errors()
def tune(given: argparse.Namespace) -> int:
    """Drive a step of the speed controller with the gains of --set, and plot it."""
    settings = env_settings(given.config)
    gains = {key: value for key, value in changed("motor", given.set).items() if key != "name"}
    if unknown := set(gains) - set(GAINS):
        raise InputError(f"--set {min(unknown)}: expected one of {', '.join(GAINS)}")
    motor = load(MotorSettings, gains, "--set", settings.chair.motor)
    settings = dataclasses.replace(settings, chair=dataclasses.replace(settings.chair, motor=motor))
    with closing(_chair(settings)) as chair:
        if gains:
            refused = set_parameters(chair.senses, chair.clock, "drive", chair.parameters["drive"])
            if refused:
                raise InputError("; ".join(refused.values()))
        step = step_response(chair, given.step, given.seconds, given.turn)
    if given.plot:
        _plot(given.plot, step, "turn [rad/s]" if given.turn else "speed [m/s]")
    text = "  ".join(f"{name} {value:.3f}" for name, value in step.figures.items())
    used = {name: getattr(motor, field) for name, field in GAINS.items()}
    report(given, {"gains": used, "step": given.step, "figures": step.figures}, text)
    return 0


def _plot(file: str, step: Any, name: str) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 6), layout="constrained")
    above, below = figure.subplots(2, sharex=True)
    above.plot(step.times, step.set_point, label="set point")
    above.plot(step.times, step.measured, label="wheels")
    above.set_ylabel(name)
    above.legend()
    below.plot(step.times, step.duties, label=["left", "right"])
    below.set(ylabel="duty", xlabel="time [s]")
    below.legend()
    with atomic_write(file) as part:
        figure.savefig(part)


@_chair_errors()
def calibrate(given: argparse.Namespace) -> int:
    """Measure counts per metre (written with --write), or the track (always written)."""
    settings = env_settings(given.config)
    return (_calibrate_track if given.quantity == "track" else _calibrate_distance)(given, settings)


def _calibrate_distance(given: argparse.Namespace, settings: Any) -> int:
    minimum = distance_calibration.NEAR
    if not given.push and given.distance < minimum:
        raise InputError(f"--distance {given.distance:g}: expected at least {minimum:g} m")
    configured = settings.chair.drive.counts_per_metre
    with _chair_errors("; nothing was written"):
        runs = (_pushed_runs if given.push else _driven_runs)(given, settings)
        result = distance_calibration.calibrate_distance(runs, configured)
    text = (
        f"{result.counts_per_metre:.1f} counts per metre, deviation {result.deviation:.1f} in "
        f"{len(runs)} runs; the config says {configured:g}\n"
    )
    text += "".join(f"{r.measured:.3f} m measured, {r.odometry:.3f} m counted\n" for r in runs)
    if given.write:
        counts = round(result.counts_per_metre, 1)
        with _boards(settings) as (senses, clock):
            wanted = {"counts_per_metre": counts}
            _save(senses, clock, "drive", wanted, suffix="; nothing was written")
        _write_drive(given.config, "counts_per_metre", counts)
        text += f"written to {given.config} and to the drive board, saved"
    else:
        text += "not written: --write does, to the config and to the drive board"
    report(given, result._asdict() | {"runs": [run._asdict() for run in runs]}, text)
    return 0


def _write_drive(config: str, key: str, value: float) -> None:
    """Write a setting of `chair.drive` to the config file."""
    content = read_json(config)
    content.setdefault("chair", {}).setdefault("drive", {})[key] = value
    write_json(config, content)


def _driven_runs(given: argparse.Namespace, settings: Any) -> list[Any]:
    """Runs that the chair drives: towards the wall and back, or ahead with a tape."""
    distance, tape = given.distance, given.tape
    free = distance * (2.0 if tape else 1.0) + distance_calibration.ROOM
    drive_run = distance_calibration.drive_run
    with closing(_chair(settings)) as chair:
        _log(
            f"the chair drives {distance:g} m straight ahead at about "
            f"{distance_calibration.SPEED:g} m/s{'' if tape else ', and back'}: keep {free:.1f} m "
            "free, and a hand at the emergency stop"
        )
        if tape:
            return [drive_run(chair, distance, False, _by_tape) for _ in range(given.runs)]
        return [drive_run(chair, distance, k % 2 == 1, None) for k in range(2 * given.runs)]


def _pushed_runs(given: argparse.Namespace, settings: Any) -> list[Any]:
    """Runs in which a person pushes the chair; no command is sent."""
    runs = []
    with _boards(settings) as (senses, clock):

        def standstill() -> Any:
            """Pose, wheel travel and wall of the standing chair, after all messages are read."""
            end = clock.now() + 1.0
            while clock.now() < end:
                senses.poll()
                clock.wait(clock.now() + POLL_PERIOD)
            if why := senses.stale(clock.now()):
                raise ValueError(why)
            see_wall = distance_calibration.measure_wall
            wall = None if given.tape else see_wall(senses, clock, senses.poll)
            return *senses.odometer.at(clock.now()), wall

        for _ in range(given.runs):
            pose, travel, wall = standstill()
            prompt = "hold the push switch, push it straight ahead, let it stand, then press Enter"
            _wait_for_enter(prompt, senses, clock)
            pose_after, travel_after, wall_after = standstill()
            distance_calibration.check_straight(travel_after - travel)
            motion = relative_pose(pose, pose_after)
            counted = math.hypot(motion[0], motion[1])
            measured = (
                _by_tape(counted) if wall is None
                else distance_calibration.distance_moved(wall, wall_after, motion)
            )  # fmt: skip
            runs.append(distance_calibration.Run(counted, measured))
    return runs


def _wait_for_enter(prompt: str, senses: Any, clock: Any) -> None:
    """Wait for a person's Enter, and read the boards meanwhile."""
    _log(prompt)
    lines: list[str] = []
    person = threading.Thread(target=lambda: lines.append(sys.stdin.readline()), daemon=True)
    person.start()
    while person.is_alive():
        senses.poll()
        clock.wait(clock.now() + POLL_PERIOD)
    if not lines or not lines[0]:
        raise InputError("standard input ended before Enter was pressed")


def _by_tape(counted: float) -> float:
    """The distance that a person measured."""
    prompt = f"it counted {counted:.3f} m: how many metres did the axle's centre move, by the tape?"
    return _numbers(prompt, "1.483")[0]


def _calibrate_track(given: argparse.Namespace, settings: Any) -> int:
    squares = []
    with closing(_chair(settings)) as chair:
        for run in range(2 * given.runs):
            _log(f"square {run + 1} of {2 * given.runs}")
            left = run % 2 == 0
            square = wheel_calibration.drive_square(chair, given.side, left, measured_end)
            squares.append(square)
    result = wheel_calibration.calibrate(squares, settings.chair.drive.track)
    _write_drive(given.config, "track", round(result.track, 5))
    unequal = 100.0 * (result.ratio - 1.0)
    text = (
        f"track {result.track:.4f} m, written to {given.config}: next, wheelchair hardware setup\n"
        f"right wheel {unequal:+.2f} % larger than the left (tyre pressure; not corrected)\n"
        f"ends of the squares: {1e3 * result.before:.0f} mm off now, "
        f"{1e3 * result.after:.0f} mm if track and wheel ratio were both corrected"
    )
    report(given, result._asdict(), text)
    return 0


def measured_end(what: str) -> Any:
    """The position (2,) [m] of the chair relative to its start, as a person measured it."""
    where = "how far is it from its start, AHEAD,LEFT in metres (of the axle's centre)?"
    return np.array(_numbers(f"{what}: {where}", "0.03,-0.12"))


def monitor(given: argparse.Namespace) -> int:
    """Show a live table of the boards' state."""
    settings = env_settings(given.config)
    lines = 0  # of the table before
    if not given.yes:
        _ask_before_reset([settings.hardware.drive_port, settings.hardware.range_port])
    with _boards(settings) as (senses, clock):
        started = printed = clock.now()
        while given.seconds is None or clock.now() - started < given.seconds:
            senses.poll()
            clock.wait(clock.now() + POLL_PERIOD)
            if clock.now() - printed >= _TABLE_PERIOD:
                printed = clock.now()
                rows = status_rows(senses, printed)
                if lines and sys.stdout.isatty():
                    print(f"\033[{lines}A\033[J", end="")
                print("\n".join(f"{name:13} {value}" for name, value in rows), flush=True)
                lines = len(rows)
    return 0


def _ask_before_reset(devices: Sequence[str]) -> None:
    """Ask a person whether ports may be opened that reset their boards.

    Raises:
        InputError: the person refuses, or there is no terminal.
    """
    named = [device for device in devices if may_reset(device)]
    if not named:
        return
    what = f"opening {' and '.join(named)} may reset the boards: a moving chair brakes hard"
    if sys.stdin is None or not sys.stdin.isatty():
        raise InputError(f"{what}; --yes opens them anyway")
    print(f"{what}. Open them? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise InputError("nothing was opened")


def drive(given: argparse.Namespace) -> int:
    """Drive by a joystick; 1 when the joystick is missing for too long, or the chair stops."""
    settings = env_settings(given.config)
    config = settings.hardware.joystick
    if not config.device:
        config = dataclasses.replace(config, device=joystick.ANY)
    joystick.load_evdev()
    chair: Any = None  # there is none yet while a person finds the joystick
    stick = joystick.Joystick(config, lambda: chair and chair.rearm())
    _await_joystick(stick, settings.chair.limits, given.timeout)
    chair, printed, missing = _chair(settings), 0.0, 0.0
    chair.joystick = stick
    _log("hold the button to drive; release it to stop")
    try:
        reading = chair.reset()
        while given.seconds is None or reading.stamp < given.seconds:
            reading = chair.drive(np.zeros(2))
            if reading.stamp - printed >= _TABLE_PERIOD:
                printed, (v, w) = reading.stamp, reading.twist
                why = stick.error or reading.halted
                print(f"{printed:7.1f} s  {v:6.3f} m/s  {w:6.3f} rad/s  {why}", flush=True)
            missing = missing + chair.period if stick.error else 0.0
            too_long = f"{stick.error}, for {given.timeout:g} s"
            ended = too_long if missing > given.timeout else chair.latched
            if ended:
                print(f"wheelchair: {ended}", file=sys.stderr)
                return 1
    finally:
        chair.close()
        stick.close()
    return 0


def _await_joystick(stick: Any, limits: Any, timeout: float) -> None:
    """Wait for a joystick.

    Raises:
        InputError: none is there after the timeout [s].
    """
    started, logged = time.monotonic(), False
    while stick(time.monotonic(), limits) is None and stick.error:
        if time.monotonic() - started >= timeout:
            raise InputError(f"{stick.error}; waited {timeout:g} s")
        if not logged:
            _log(f"waits {timeout:g} s for a joystick: {stick.error}")
            logged = True
        time.sleep(min(0.1, timeout))
