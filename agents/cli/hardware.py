"""`wheelchair hardware`: tools for a real chair, and for its twin."""

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from typing import Any

import numpy as np

from agents.cli.arguments import report
from agents.cli.fit import findings_table, judged
from agents.deploy import end_as_by_ctrl_c, listen_for_rearm
from agents.deploy import to_stderr as _log
from agents.evaluation.provenance import write_text
from wheelchair_gym.base.errors import load_extra
from wheelchair_gym.base.settings import InputError, dump, read_json
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.hardware import joystick
from wheelchair_gym.hardware.boards.parameters import (
    board_parameters,
    drive_parameters,
    save_parameters,
    set_parameters,
)
from wheelchair_gym.hardware.boards.ports import may_reset
from wheelchair_gym.hardware.boards.senses import POLL_PERIOD, BoardSensors
from wheelchair_gym.hardware.chair import HardwareChair
from wheelchair_gym.hardware.control_loop import WallClock
from wheelchair_gym.hardware.tools.diagnostics import Diagnostics, Orientation, status_rows
from wheelchair_gym.identification.excite import DURATION, excite, free_floor_env
from wheelchair_gym.identification.fit import fit, settings_of, tuned_chair
from wheelchair_gym.identification.logs import DriveLog
from wheelchair_gym.recording.record import RecordEpisodes

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


@contextmanager
def _chair_errors() -> Iterator[None]:
    """Turn a ValueError of the chair into a ConnectionError, for which the command exits with 1."""
    try:
        yield
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise ConnectionError(str(error)) from None


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
    """Write parameters to a board, which has to take each and to confirm that it saved them."""
    if refused := set_parameters(senses, clock, board, wanted):
        raise InputError(f"{prefix}{'; '.join(dict.fromkeys(refused.values()))}{suffix}")
    if not save_parameters(senses, clock, board):
        raise InputError(f"the {board} board does not confirm that it saved its parameters")


@_chair_errors()
def excite_chair(given: argparse.Namespace) -> int:
    """Drive for two minutes, and record it."""
    _excite(given, env_settings(given.config))
    return 0


def _excite(given: argparse.Namespace, settings: Any) -> DriveLog:
    """Drive the chair by a program, record it where that is wanted, and return the log."""
    with closing(_chair(settings)) as chair, ExitStack() as open_things:
        env: Any = free_floor_env(settings, chair)
        if given.record is not None:
            env = RecordEpisodes(env, given.record)
        open_things.enter_context(closing(env))
        _log(
            f"once it is re-armed (Enter) and nobody drives it, the chair drives squares, circles "
            f"and turns for {DURATION:.0f} s, at up to 0.7 m/s: keep 4 m x 4 m free, from 1 m "
            "behind to 2 m ahead, and a hand at the emergency stop"
        )
        log = excite(env)
        if given.record is not None:
            _log(f"recorded: wheelchair fit {env.file}")
        return log


@_chair_errors()
def calibrate(given: argparse.Namespace) -> int:
    """Drive for two minutes and fit the settings; 0 when the config agrees, or they are written."""
    settings = env_settings(given.config)
    log = _excite(given, settings)
    found = fit([(given.config, log)], settings.chair, settings.sensors, given.mass)
    lines = [findings_table(found.findings, check=True).text(), *found.notes]
    good = all(judged(one) != "OFF" for one in found.findings)
    if given.write:
        tuned = tuned_chair(found)
        wanted = drive_parameters(tuned)
        with _boards(settings) as (senses, clock):
            _save(senses, clock, "drive", wanted, suffix="; nothing was written")
        content = read_json(given.config)
        parts = {name: dump(getattr(tuned, name)) for name in ("drive", "motor", "body")}
        content.setdefault("chair", {}).update(parts)
        if content.pop("model", None) is not None:  # its sensors stand in the config from now on
            content["sensors"] = dump(settings.sensors)
        names = "laser", "more_lasers", "odometry"
        seen = dump(found.sensors)
        content.setdefault("sensors", {}).update({name: seen[name] for name in names})
        write_text(given.config, json.dumps(content, indent=2, allow_nan=False) + "\n")
        lines.append(f"written to {given.config} and to the drive board, saved")
    else:
        lines.append("not written: --write does, to the config and to the drive board")
    report(given, {"good": good, **settings_of(found)["fit.json"]}, "\n".join(lines))
    return 0 if good or given.write else 1


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
    """Ask a person whether ports may be opened that reset their boards; without a yes, refuse."""
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
    load_extra("evdev")
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
    """Wait for a joystick; an `InputError` if none is there after the timeout [s]."""
    started, logged = time.monotonic(), False
    while stick(time.monotonic(), limits) is None and stick.error:
        if time.monotonic() - started >= timeout:
            raise InputError(f"{stick.error}; waited {timeout:g} s")
        if not logged:
            _log(f"waits {timeout:g} s for a joystick: {stick.error}")
            logged = True
        time.sleep(min(0.1, timeout))
