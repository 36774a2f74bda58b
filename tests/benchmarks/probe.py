"""`wheelchair deploy` with a clock at every stage of its loop, for `tests.benchmarks.deploy`.

`python -m tests.benchmarks.probe OUT ARGUMENTS...` runs `wheelchair ARGUMENTS...` and writes to OUT
(JSON) what took time, in seconds of the monotonic clock: control steps with their stages, plans,
collections of garbage, and functions that were compiled or loaded.
"""

from __future__ import annotations

import contextlib
import gc
import json
import sys
import threading
import time
from pathlib import Path

from numba.core.dispatcher import Dispatcher

from agents.cli import main
from agents.policies import GymPolicy, planning
from wheelchair_gym.hardware.chair import HardwareChair
from wheelchair_gym.hardware.control_loop import ControlLoop

now = time.monotonic
events: dict[str, list] = {name: [] for name in ("steps", "late", "plans", "garbage", "compiled")}


def running():
    """How long this thread has run, and how long it and all others have waited for a core [s]."""
    own, ran, waited, others = str(threading.get_native_id()), 0, 0, 0
    for task in Path("/proc/self/task").iterdir():
        with contextlib.suppress(OSError):  # it has just ended
            parts = (task / "schedstat").read_text().split()
            if task.name == own:
                ran, waited = int(parts[0]), int(parts[1])
            else:
                others += int(parts[1])
    return [1e-9 * ran, 1e-9 * waited, 1e-9 * others]


def timed(owner, name, begin, end):
    """Call `begin(arguments)` before and `end(arguments)` after a function of a class or module."""
    inner = getattr(owner, name)

    def outer(*arguments, **more):
        begin(arguments)
        try:
            return inner(*arguments, **more)
        finally:
            end(arguments)

    setattr(owner, name, outer)


def spans(name, label=lambda arguments: ""):
    """What `timed` calls to note beginnings and ends."""
    begun = {}

    def begin(arguments):
        begun[threading.get_ident()] = now()

    def end(arguments):
        at = begun.pop(threading.get_ident(), None)
        if at is not None:  # the outer one of two
            events[name].append([at, now(), label(arguments)])

    return begin, end


def mark(stage):
    """What `timed` calls at a stage of the present step: when, and how long the loop has run."""
    return lambda arguments: (
        events["steps"] and events["steps"][-1].append([stage, now(), *running()])
    )


def waited(arguments):
    mark("waited")(arguments)
    late = arguments[0].late
    if late and len(late) > len(events["late"]):
        events["late"].append([len(events["steps"]) - 1, late[-1][1]])


def begin_step(arguments):
    events["steps"].append([["begins", now(), *running()]])


def collected(phase, info):
    if phase == "start":
        events["garbage"].append([now()])
    elif events["garbage"]:
        events["garbage"][-1] += [now(), info["generation"]]


if __name__ == "__main__":
    timed(GymPolicy, "act", begin_step, mark("acted"))
    timed(HardwareChair, "drive", mark("filtered"), mark("sensed"))
    timed(ControlLoop, "wait_period", mark("commanded"), waited)
    timed(planning, "_make", *spans("plans"))
    timed(Dispatcher, "compile", *spans("compiled", lambda arguments: str(arguments[0].py_func)))
    gc.callbacks.append(collected)
    try:
        code = main(sys.argv[2:])
    finally:
        Path(sys.argv[1]).write_text(json.dumps(events))
    sys.exit(code)
