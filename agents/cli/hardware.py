"""`wheelchair hardware`: a technician's tools for the real chair, and for its twin."""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from typing import Any

from agents.cli.arguments import add_json, changed, count, distance, finite, report

_SHOWN = 0.5  # s between two tables
_EXAMPLE = "configs/hardware.json"


def add(parts: Any) -> None:
    """Add the subcommand's parsers."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "hardware",
        help="check, set up, tune, calibrate, watch and hand-drive a real chair",
        description="Tools for a chair behind its boards; they work on `wheelchair twin`, too.",
        epilog=f"example: wheelchair hardware check --config {_EXAMPLE}",
    )
    whats = parser.add_subparsers(dest="what", required=True, metavar="WHAT")
    one = _part(whats, "check", _check, "is all there, and does all answer; it drives nowhere")
    one.add_argument("--no-person", action="store_true", help="leave the emergency stop out")
    add_json(one)
    one = _part(whats, "setup", _setup, "give the boards the config's parameters, and save them")
    one = _part(whats, "tune", _tune, "drive a step of the speed control and plot it")
    one.add_argument("--step", type=distance, default=0.3, help="m/s or rad/s (default 0.3)")
    one.add_argument("--seconds", type=distance, default=2.0, help="it is held (default 2)")
    one.add_argument("--turn", action="store_true", help="turn in place: the chair stays there")
    one.add_argument(
        "--set", metavar="GAIN=VALUE", action="append", default=[],
        help="try it: kp, ki, kd, ka, smoothing (the board forgets it, see setup)",
    )  # fmt: skip
    one.add_argument("--plot", metavar="FILE.png", help="draw it")
    add_json(one)
    one = _part(
        whats, "calibrate", _calibrate,
        "counts of a metre, by a straight way to a wall; then the track, by squares (UMBmark)",
    )  # fmt: skip
    one.add_argument(
        "what", nargs="?", choices=("distance", "track"), default="distance",
        help="counts per metre (default), or the track, which needs them right",
    )  # fmt: skip
    one.add_argument("--runs", type=count, default=2, help="there and back (default 2)")
    one.add_argument("--way", type=distance, default=1.5, help="distance: straight (default 1.5 m)")
    one.add_argument(
        "--tape", action="store_true", help="distance: a person measures, where no wall is ahead"
    )
    one.add_argument(
        "--push", action="store_true",
        help="distance: a person pushes it, brakes lifted; nothing is driven",
    )  # fmt: skip
    one.add_argument("--side", type=distance, default=4.0, help="track: square (default 4 m)")
    one.add_argument(
        "--write", action="store_true", help="distance: write it to the config and to the board"
    )
    add_json(one)
    one = _part(
        whats, "monitor", _monitor, "what all say, live; through the program that drives, if any"
    )
    one.add_argument("--yes", action="store_true", help="open the ports even if that resets boards")
    one.add_argument("--seconds", type=finite, help="end by itself (default: Ctrl-C)")
    one = _part(whats, "drive", _drive, "by the joystick at the host (hardware.joystick)")
    one.add_argument("--seconds", type=finite, help="end by itself (default: Ctrl-C)")
    one.add_argument(
        "--wait", type=distance, default=30.0, help="s for a joystick that is missing (default 30)"
    )


def _part(whats: Any, name: str, run: Any, what: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = whats.add_parser(name, help=what, description=what + ".")
    parser.add_argument("--config", metavar="FILE.json", required=True, help=f"as {_EXAMPLE}")
    parser.set_defaults(run=run)
    return parser


def _settings(given: argparse.Namespace) -> Any:
    from wheelchair_gym.envs.settings import env_settings

    return env_settings(given.config)


def _senses(settings: Any) -> tuple[Any, Any]:
    """The lines alone, and the clock."""
    from wheelchair_gym.hardware.boards.senses import BoardSenses
    from wheelchair_gym.hardware.pacing import WallClock

    clock = WallClock()
    own = settings.hardware
    return BoardSenses(own, settings.sensors, settings.chair.drive, clock.now), clock


def _wanted(settings: Any) -> dict[str, dict[str, float]]:
    from wheelchair_gym.hardware.boards.parameters import wanted_parameters

    return wanted_parameters(settings.chair, settings.sensors, settings.hardware)


def _chair(settings: Any) -> Any:
    """The chair, which a person at the terminal may re-arm."""
    from agents.deploy import ended_as_by_hand, hear_person
    from wheelchair_gym.hardware.chair import HardwareChair

    ended_as_by_hand()
    chair = HardwareChair(settings.hardware, settings.sensors, settings.chair, 1.0 / settings.rate)
    hear_person(chair)
    return chair


def _check(given: argparse.Namespace) -> int:
    from wheelchair_gym.hardware.tools.diagnostics import Checker

    settings = _settings(given)
    senses, clock = _senses(settings)

    def ask(what: str) -> None:
        print(f"please {what}", file=sys.stderr, flush=True)

    try:
        found = Checker(senses, clock, _wanted(settings)).run(None if given.no_person else ask)
    finally:
        senses.close()
    good = all(one.good for one in found)
    lines = [
        f"{'ok  ' if one.good else 'FAIL'}  {one.part:14}  {one.what:22}  {one.found}"
        + (f"\n{'':26}look at: {one.advice}" if not one.good and one.advice else "")
        for one in found
    ]
    report(given, {"good": good, "findings": [one._asdict() for one in found]}, "\n".join(lines))
    return 0 if good else 1


def _setup(given: argparse.Namespace) -> int:
    from wheelchair_gym.config import InputError
    from wheelchair_gym.hardware.tools.provision import save_parameters, set_parameters

    settings = _settings(given)
    senses, clock = _senses(settings)
    try:
        for board, wanted in _wanted(settings).items():
            if board == "range" and senses.range is None:
                continue
            left = set_parameters(senses, clock, board, wanted)
            if left:
                raise InputError(f"{given.config}: {'; '.join(left.values())}")
            if not save_parameters(senses, clock, board):
                raise InputError(f"the {board} board does not say that it saved its parameters")
            print(f"{board} board: {len(wanted)} parameters as in {given.config}, saved")
    finally:
        senses.close()
    return 0


def _tune(given: argparse.Namespace) -> int:
    from wheelchair_gym.config import InputError, load
    from wheelchair_gym.hardware.tools.provision import set_parameters
    from wheelchair_gym.hardware.tools.speed_tuning import GAINS, step_response
    from wheelchair_gym.physics.settings import MotorSettings

    settings = _settings(given)
    tried = {k: v for k, v in changed("motor", given.set).items() if k != "name"}
    if wrong := set(tried) - set(GAINS):
        raise InputError(f"--set {min(wrong)}: expected one of {', '.join(GAINS)}")
    motor = load(MotorSettings, tried, "--set", settings.chair.motor)
    settings = dataclasses.replace(settings, chair=dataclasses.replace(settings.chair, motor=motor))
    chair = _chair(settings)
    try:
        if tried:
            left = set_parameters(chair.senses, chair.clock, "drive", chair.wanted["drive"])
            if left:
                raise InputError("; ".join(left.values()))
        step = step_response(chair, None, given.step, given.seconds, given.turn)  # type: ignore[arg-type]
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        print(f"wheelchair: {error}", file=sys.stderr)
        return 1
    finally:
        chair.close()
    if given.plot:
        _plot(given.plot, step, "turn [rad/s]" if given.turn else "speed [m/s]")
    figures = step.figures
    gains = {name: getattr(motor, name) for name in GAINS}
    text = "  ".join(f"{name} {value:.3f}" for name, value in figures.items())
    report(given, {"gains": gains, "step": given.step, "figures": figures}, text)
    return 0


def _plot(file: str, step: Any, name: str) -> None:
    from matplotlib.figure import Figure

    from wheelchair_gym.files import whole

    figure = Figure(figsize=(8, 6), layout="constrained")
    above, below = figure.subplots(2, sharex=True)
    above.plot(step.times, step.asked, label="set point")
    above.plot(step.times, step.done, label="wheels")
    above.set_ylabel(name)
    above.legend()
    below.plot(step.times, step.duties, label=["left", "right"])
    below.set_ylabel("duty")
    below.set_xlabel("time [s]")
    below.legend()
    with whole(file) as part:
        figure.savefig(part)


def _calibrate(given: argparse.Namespace) -> int:
    return _calibrate_track(given) if given.what == "track" else _calibrate_distance(given)


def _calibrate_distance(given: argparse.Namespace) -> int:
    from wheelchair_gym.config import InputError
    from wheelchair_gym.hardware.tools.distance_calibration import LEAST, calibrate_distance

    if not given.push and given.way < LEAST:
        raise InputError(f"--way {given.way:g}: expected at least {LEAST:g} m")
    settings = _settings(given)
    believed = settings.chair.drive.counts_per_metre
    try:
        runs = (_pushed if given.push else _driven)(given, settings)
        told = calibrate_distance(runs, believed)
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        print(f"wheelchair: {error}; nothing was written", file=sys.stderr)
        return 1
    text = (
        f"{told.counts_per_metre:.1f} counts per metre, deviation {told.deviation:.1f} in "
        f"{len(runs)} runs; the config says {believed:g}\n"
    )
    text += "".join(f"{r.measured:.3f} m measured, {r.counted:.3f} m counted\n" for r in runs)
    if given.write:
        _keep_counts(given, settings, round(told.counts_per_metre, 1))
        text += f"written to {given.config} and to the drive board, saved"
    else:
        text += "not written: --write does, to the config and to the drive board"
    report(given, told._asdict() | {"runs": [run._asdict() for run in runs]}, text)
    return 0


def _driven(given: argparse.Namespace, settings: Any) -> list[Any]:
    """Runs that it drives: towards the wall and back, or ahead with a tape."""
    from wheelchair_gym.hardware.tools.distance_calibration import ROOM, SPEED, drive_run

    free = given.way * (2.0 if given.tape else 1.0) + ROOM
    chair = _chair(settings)
    print(
        f"it drives {given.way:g} m straight ahead at about {SPEED:g} m/s"
        + ("" if given.tape else ", and back over that way")
        + f": keep {free:.1f} m free, and a hand at the emergency stop",
        file=sys.stderr, flush=True,
    )  # fmt: skip
    try:
        if given.tape:
            return [drive_run(chair, given.way, False, _by_tape) for _ in range(given.runs)]
        return [drive_run(chair, given.way, k % 2 == 1, None) for k in range(2 * given.runs)]
    finally:
        chair.close()


def _pushed(given: argparse.Namespace, settings: Any) -> list[Any]:
    """Runs that a person pushes it; no command is sent."""
    import math

    from wheelchair_gym.geometry import between
    from wheelchair_gym.hardware.pacing import Clock
    from wheelchair_gym.hardware.tools.diagnostics import LOOK
    from wheelchair_gym.hardware.tools.distance_calibration import Run, moved, see_wall, straight

    senses, clock = _senses(settings)

    def stands() -> Any:
        """Pose, ways and wall where it stands now; all that waits on the lines is taken in."""
        held: Clock = clock
        end = held.now() + 1.0
        while held.now() < end:
            senses.poll()
            held.wait(held.now() + LOOK)
        if why := senses.silent(held.now()):
            raise ValueError(why)
        wall = None if given.tape else see_wall(senses, held, senses.poll)
        return *senses.odometer.at(held.now()), wall

    runs = []
    try:
        for _ in range(given.runs):
            pose, ways, wall = stands()
            _wait_for_enter("push it straight ahead, let it stand, then press Enter", senses, clock)
            after, counted_ways, later = stands()
            straight(counted_ways - ways)
            way = between(pose, after)
            counted = math.hypot(way[0], way[1])
            if wall is None:
                runs.append(Run(counted, _by_tape(counted)))
            else:
                runs.append(Run(counted, moved(wall, later, way)))
    finally:
        senses.close()
    return runs


def _wait_for_enter(what: str, senses: Any, clock: Any) -> None:
    """Wait for a person's Enter; what the boards say meanwhile is taken in."""
    import threading

    from wheelchair_gym.config import InputError
    from wheelchair_gym.hardware.tools.diagnostics import LOOK

    print(what, file=sys.stderr, flush=True)
    lines: list[str] = []
    person = threading.Thread(target=lambda: lines.append(sys.stdin.readline()), daemon=True)
    person.start()
    while person.is_alive():
        senses.poll()
        clock.wait(clock.now() + LOOK)
    if not lines or not lines[0]:
        raise InputError("standard input ended before Enter was pressed")


def _by_tape(counted: float) -> float:
    """Ask a person how far it came."""
    from wheelchair_gym.config import InputError

    print(
        f"it counted {counted:.3f} m: how many metres did the axle's centre come, by the tape?",
        file=sys.stderr, flush=True,
    )  # fmt: skip
    for line in sys.stdin:
        try:
            return float(line)
        except ValueError:
            if line.strip():
                print("expected a number, such as 1.483", file=sys.stderr, flush=True)
    raise InputError("standard input ended before the way was told")


def _keep_counts(given: argparse.Namespace, settings: Any, counts: float) -> None:
    """Give counts of a metre to the drive board, which may refuse them, then to the config.

    Raises:
        InputError: the board refuses them, or the file cannot be written.
    """
    from agents.evaluation.provenance import write_json
    from wheelchair_gym.config import InputError, read_json
    from wheelchair_gym.hardware.tools.provision import save_parameters, set_parameters

    senses, clock = _senses(settings)
    try:
        if refused := set_parameters(senses, clock, "drive", {"counts_per_metre": counts}):
            raise InputError(f"{'; '.join(refused.values())}; nothing was written")
        if not save_parameters(senses, clock, "drive"):
            raise InputError("the drive board does not say that it saved its parameters")
    finally:
        senses.close()
    content = read_json(given.config)
    content.setdefault("chair", {}).setdefault("drive", {})["counts_per_metre"] = counts
    write_json(given.config, content)


def _calibrate_track(given: argparse.Namespace) -> int:
    from agents.evaluation.provenance import write_json
    from wheelchair_gym.config import read_json
    from wheelchair_gym.hardware.tools.wheel_calibration import calibrate, drive_square

    settings = _settings(given)
    chair, squares = _chair(settings), []
    try:
        for run in range(2 * given.runs):
            left = run % 2 == 0
            print(f"square {run + 1} of {2 * given.runs}", file=sys.stderr)
            squares.append(drive_square(chair, None, given.side, left, _measured))  # type: ignore[arg-type]
    except ValueError as error:
        print(f"wheelchair: {error}", file=sys.stderr)
        return 1
    finally:
        chair.close()
    told = calibrate(squares, settings.chair.drive.track)
    content = read_json(given.config)
    content.setdefault("chair", {}).setdefault("drive", {})["track"] = round(told.track, 5)
    write_json(given.config, content)
    unequal = 100.0 * (told.ratio - 1.0)
    report(
        given,
        told._asdict(),
        f"track {told.track:.4f} m, written to {given.config}: next, wheelchair hardware setup\n"
        f"right wheel {unequal:+.2f} % larger than the left (tyre pressure; not corrected)\n"
        f"ends of the squares: {1e3 * told.before:.0f} mm off, {1e3 * told.after:.0f} mm with both",
    )
    return 0


def _measured(what: str) -> Any:
    """Ask a person where the chair stands."""
    import numpy as np

    from wheelchair_gym.config import InputError

    print(
        f"{what}: how far is it from its start, AHEAD,LEFT in metres (of the axle's centre)?",
        file=sys.stderr, flush=True,
    )  # fmt: skip
    for line in sys.stdin:
        try:
            x, y = (float(word) for word in line.split(","))
            return np.array([x, y])
        except ValueError:
            if line.strip():
                print("expected two numbers, such as 0.03,-0.12", file=sys.stderr, flush=True)
    raise InputError("standard input ended before the place was told")


def _monitor(given: argparse.Namespace) -> int:
    from wheelchair_gym.hardware.boards.feed import watch
    from wheelchair_gym.hardware.tools.diagnostics import LOOK
    from wheelchair_gym.hardware.tools.monitor import live_rows

    settings = _settings(given)
    device = settings.hardware.drive
    show = _Table()
    if (told := watch(device)) is not None:
        print(f"{device} is held by another program: this is what it hears", file=sys.stderr)
        begun = time.monotonic()
        for rows in told:
            show(rows)
            if given.seconds is not None and time.monotonic() - begun >= given.seconds:
                return 0
        print(f"the program that held {device} has ended", file=sys.stderr)
        return 0
    if not given.yes:
        _ask_before_reset([device, settings.hardware.range])
    senses, clock = _senses(settings)
    begun = shown = clock.now()
    try:
        while given.seconds is None or clock.now() - begun < given.seconds:
            senses.poll()
            clock.wait(clock.now() + LOOK)
            if clock.now() - shown >= _SHOWN:
                shown = clock.now()
                show(live_rows(senses, shown))
    finally:
        senses.close()
    return 0


class _Table:
    """Rows on the terminal, each table in the place of the one before."""

    def __init__(self) -> None:
        self._drawn = 0

    def __call__(self, rows: Any) -> None:
        if self._drawn and sys.stdout.isatty():
            print(f"\033[{self._drawn}A\033[J", end="")
        print("\n".join(f"{name:13} {value}" for name, value in rows), flush=True)
        self._drawn = len(rows)


def _ask_before_reset(devices: Any) -> None:
    """Let a person agree to what opening ports does to their boards."""
    from wheelchair_gym.config import InputError
    from wheelchair_gym.hardware.boards.ports import resets

    named = [device for device in devices if resets(device)]
    if not named:
        return
    what = f"opening {' and '.join(named)} may reset the boards: a chair that is driven brakes hard"
    if sys.stdin is None or not sys.stdin.isatty():
        raise InputError(f"{what}; --yes opens them all the same")
    print(f"{what}. Open them? [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise InputError("nothing was opened")


def _drive(given: argparse.Namespace) -> int:
    import numpy as np

    from wheelchair_gym.hardware.joystick import ANY, Joystick, load_evdev

    settings = _settings(given)
    own = settings.hardware.joystick
    if not own.device:
        own = dataclasses.replace(own, device=ANY)
    load_evdev()
    stick = Joystick(own, lambda: chair.rearm())
    limits = settings.chair.limits
    _await_joystick(stick, limits, given.wait)
    chair, shown, gone = _chair(settings), 0.0, 0.0
    chair.hand = stick
    print("hold the button to drive; let go to stand", file=sys.stderr)
    try:
        reading = chair.reset(None, 0)
        while given.seconds is None or reading.stamp < given.seconds:
            reading = chair.drive(np.zeros(2))
            if reading.stamp - shown >= _SHOWN:
                shown, (v, w) = reading.stamp, reading.twist
                why = stick.why or reading.halted
                print(f"{shown:7.1f} s  {v:6.3f} m/s  {w:6.3f} rad/s  {why}", flush=True)
            gone = gone + chair.period if stick.why else 0.0
            ended = f"{stick.why}, for {given.wait:g} s" if gone > given.wait else chair.latched
            if ended:
                print(f"wheelchair: {ended}", file=sys.stderr)
                return 1
    finally:
        chair.close()
        stick.close()
    return 0


def _await_joystick(stick: Any, limits: Any, patience: float) -> None:
    """Wait for a joystick, and say so.

    Raises:
        InputError: none is there when patience [s] ends.
    """
    from wheelchair_gym.config import InputError

    begun, told = time.monotonic(), False
    while stick(time.monotonic(), limits) is None and stick.why:
        if time.monotonic() - begun >= patience:
            raise InputError(f"{stick.why}; waited {patience:g} s")
        if not told:
            print(f"waits {patience:g} s for a joystick: {stick.why}", file=sys.stderr, flush=True)
            told = True
        time.sleep(min(0.1, patience))
