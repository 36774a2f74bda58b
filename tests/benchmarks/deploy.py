"""`wheelchair deploy` in real time across changing worlds of the twin, as a person runs it.

`python -m tests.benchmarks.deploy [--seeds 0-9] [--scenes SCENE...]`: JSON on stdout, recordings in
runs/deploy. Each drive is a twin of its own behind pseudo-terminals and a TCP port, a deployed
policy in another process, and beside both a process on every core that does nothing but sleep for a
millisecond, and writes down when it slept too long. Every control step that ended more than 10 ms
late is listed with its cause: the machine, if for at least half of the delay the loop, or a thread
that it waited for, was ready to run and got no core, or a sleeper overslept; else our own doing.
Run it in a quiet hour all the same. Exit code 1: a goal was not reached, something was touched, or
a step was late by our own doing.
"""

from __future__ import annotations

import argparse
import ast
import itertools
import json
import math
import os
import pty
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from wheelchair_gym.config import read_json

GOAL = 0.3  # m, by truth
SCENES = "temporary", "crowd"
EVENTS = "steps", "late", "plans", "garbage", "compiled"
PATIENCE = 180.0  # s to compile and to get ready
DRIVE = 240.0  # s
POLICY = "lattice+window"
CONFIG = "configs/hardware.json"
SLEEPER = """
import os, select, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
last, stalls = time.monotonic(), []
while True:
    time.sleep(0.001)
    now = time.monotonic()
    if now - last > 0.004:
        stalls.append((last + 0.001, now))
        if select.select([sys.stdin], [], [], 0)[0]:
            break
    last = now
    if int(now * 1000) % 50 == 0 and select.select([sys.stdin], [], [], 0)[0]:
        break
print(stalls)
"""


def program(*words, **options):
    """A program of this project, in a process of its own."""
    return subprocess.Popen([sys.executable, *words], text=True, **options)


def twin(scene, seed, folder):
    """The twin of a seed, and what it said of itself."""
    words = ["-m", "wheelchair_gym", "twin", "--config", CONFIG, "--scene", scene]
    words += ["--seed", str(seed), "--write-map", str(folder / "map.yaml")]
    running = program(*words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    shown = dict(running.stdout.readline().rsplit(maxsplit=1) for _ in range(5))
    return running, shown


def overlap(spans, begin, end):
    """How long spans (first, last, ...) lasted within a time [s]."""
    return sum(max(0.0, min(end, span[1]) - max(begin, span[0])) for span in spans)


def periods(events):
    """Control periods of a drive: numbers, and marks from the end of one wait to that of the next.

    A mark is a stage, when it was reached, how long the loop had run, and how long it and all other
    threads of its process had waited for a core [s].
    """
    steps = events["steps"]
    for number in range(1, len(steps)):
        before = [mark for mark in steps[number - 1] if mark[0] in ("waited", "sensed")]
        marks = before + steps[number]
        names = [mark[0] for mark in marks]
        if len(before) == 2 and "waited" in names[1:]:
            yield number, marks[: names.index("waited", 1) + 1]


def stages(marks):
    """How long each stage of a period took [ms]."""
    return {f"{a[0]} to {b[0]}": 1e3 * (b[1] - a[1]) for a, b in itertools.pairwise(marks)}


def longest(events):
    """The longest of each stage in which the loop does not wait, and of other events [ms]."""
    found = {name: 0.0 for name in ("plans", "garbage", "compiled")}
    for _, marks in periods(events):
        begin, end = marks[0][1], marks[-1][1]
        for name, value in list(stages(marks).items())[:-1]:
            found[name] = max(found.get(name, 0.0), value)
        for name in ("plans", "garbage", "compiled"):
            found[name] = max(found[name], 1e3 * overlap(events[name], begin, end))
    return found


def compiled(events):
    """What was compiled or loaded once the chair drove, and how long that took [ms]."""
    begun = min((marks[0][1] for _, marks in periods(events)), default=math.inf)
    return [(what, 1e3 * (last - at)) for at, last, what in events["compiled"] if at > begun]


def late_steps(events, stalls):
    """Late control steps of a drive, with what was done in their periods, and their causes."""
    rows, delays = [], dict(events["late"])
    for number, marks in periods(events):
        if number not in delays:
            continue
        delay, begin, end = delays[number], marks[0][1], marks[-1][1]
        took = stages(marks)
        within = {name: overlap(events[name], begin, end) for name in ("plans", "garbage")}
        ran, queued, others = (marks[-1][k] - marks[0][k] for k in (2, 3, 4))
        # Where it neither ran, nor was ready to, before its wait, another thread held a lock.
        blocked = max(0.0, marks[-2][1] - begin - (marks[-2][2] - marks[0][2]) - queued)
        no_core = queued + min(blocked, others)
        stalled = max(overlap(those, begin, end) for those in stalls)
        within["compiled"] = overlap(events["compiled"], begin, end)
        slowest = max(list(took)[:-1], key=lambda name: took[name])
        if no_core + stalled >= 0.5 * delay:
            cause = "the machine"
        elif within["compiled"] >= 0.5 * delay:
            cause = "functions were compiled"
        elif within["garbage"] >= 0.5 * delay:
            cause = "garbage was collected"
        else:
            cause = f"slow: {slowest}" if took[slowest] >= 1e3 * delay else "overslept"
        rows.append(
            {
                "cause": cause,
                "step": number,
                "late_ms": 1e3 * delay,
                "ran_ms": 1e3 * ran,
                "no_core_ms": 1e3 * no_core,
                "stalled_ms": 1e3 * stalled,
                "stages_ms": took,
                **{f"{name}_ms": 1e3 * value for name, value in within.items()},
            }
        )
    return rows


def deploy(given, seed, shown, folder):
    """Run the command as a person does, who presses Enter while it waits; its report."""
    content = read_json(CONFIG)
    names = {"drive_port": "drive board", "range_port": "range board", "laser_port": "laser"}
    content["hardware"] |= {key: shown[name] for key, name in names.items()}
    config = folder / "config.json"
    config.write_text(json.dumps(content))
    record, result = f"{given.out}/{shown['name']}-{seed}.mcap", folder / "result.json"
    words = ["-m", "tests.benchmarks.probe", str(folder / "events.json"), "deploy"]
    words += ["--policy", POLICY, "--config", str(config), "--pose", "mcl"]
    words += [
        "--map",
        str(folder / "map.yaml"),
        "--start",
        shown["start"],
        "--goal",
        shown["goal"],
    ]
    words += ["--record", record, "--json", str(result)]
    near, far = pty.openpty()
    running = program(*words, stdin=far, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    log = []

    def listen():
        for line in running.stderr:
            log.append(line.rstrip())
            if "must re-arm" in line:
                time.sleep(1.0)
                os.write(near, b"\n")

    threading.Thread(target=listen, daemon=True).start()
    end = time.monotonic() + PATIENCE + DRIVE
    while running.poll() is None and time.monotonic() < end:
        time.sleep(0.2)
    if running.poll() is None:
        running.terminate()
        running.wait()
    report = json.loads(result.read_text()) if result.exists() else {"outcome": "no result"}
    return report, log


def trial(given, scene, seed):
    """One drive; a row of figures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        world, shown = twin(scene, seed, folder)
        shown["name"] = scene
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        cores = sorted(os.sched_getaffinity(0))
        sleepers = [program("-c", SLEEPER, str(core), **pipes) for core in cores]
        try:
            report, log = deploy(given, seed, shown, folder)
        finally:
            stalls = [ast.literal_eval(one.communicate("\n")[0]) for one in sleepers]
            world.send_signal(signal.SIGINT)
            ended, said = world.communicate()
        file = folder / "events.json"
        events = json.loads(file.read_text()) if file.exists() else {name: [] for name in EVENTS}
    behind = [line for line in said.splitlines() if "late" in line]
    truth = dict(line.rsplit(maxsplit=1) for line in ended.splitlines() if line)
    (x, y), (gx, gy) = (map(float, where.split(",")[:2]) for where in (truth["end"], shown["goal"]))
    planning = ["replans", "late_plans", "discarded_plans", "thinking_drove_s", "thinking_stood_s"]
    figures = "time", "length", "clearance_min", *planning, "plans_ms_p50", "plans_ms_p95"
    driven = sum(any(mark[0] == "waited" for mark in step) for step in events["steps"])
    return {
        "scene": shown["name"],
        "seed": seed,
        "outcome": report["outcome"],
        "from_goal": math.hypot(x - gx, y - gy),
        "touched_ms": int(truth["touched"]),
        **{key: report.get(key) for key in (*figures, "plans_ms_max")},
        "steps": driven,
        "longest_ms": longest(events),
        "compiled": compiled(events),
        "late": late_steps(events, stalls),
        "stalls": [len(those) for those in stalls],
        "world": behind[-1] if behind else "in time",
        "log": log,
    }


def seeds(text):
    """Numbers of A-B, or A."""
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=seeds, default=seeds("0-9"))
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--out", default="runs/deploy")
    given = parser.parse_args()
    Path(given.out).mkdir(parents=True, exist_ok=True)
    rows = []
    for scene, seed in itertools.product(given.scenes, given.seeds):
        rows.append(row := trial(given, scene, seed))
        shown = {k: v for k, v in row.items() if k != "log" or row["outcome"] == "no result"}
        print(shown, file=sys.stderr, flush=True)
    reached = sum(
        r["outcome"] == "success" and r["from_goal"] <= GOAL and r["touched_ms"] == 0 for r in rows
    )
    late = [step for row in rows for step in row["late"]]
    own = [step for step in late if step["cause"] != "the machine"]
    report = {
        "reached": reached,
        "of": len(rows),
        "steps": sum(row["steps"] for row in rows),
        "late": len(late),
        "late_by_our_doing": len(own),
        "trials": rows,
    }
    print(json.dumps(report, indent=1))
    sys.exit(0 if reached == len(rows) and not own else 1)


if __name__ == "__main__":
    main()
