"""`wheelchair deploy` in real time across changing worlds of the twin, as a person runs it.

`python -m tests.benchmarks.deploy [--seeds 0-9] [--scenes SCENE...]`: JSON on stdout, recordings in
runs/deploy. Each drive is a twin of its own behind pseudo-terminals and a TCP port, and a deployed
policy in another process. Control steps that ended more than 10 ms late are counted; run it on a
machine that is otherwise idle. Exit code 1: a goal was not reached, or something was touched.
"""

import argparse
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

from wheelchair_gym.base.settings import read_json

GOAL = 0.3  # m, by truth
SCENES = "temporary", "crowd"
PATIENCE = 180.0  # s to compile and to get ready
DRIVE = 240.0  # s
POLICY = "lattice+window"
CONFIG = "configs/hardware.json"


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


def deploy(given, seed, shown, folder):
    """Run the command as a person does, who presses Enter while it waits; its report."""
    content = read_json(CONFIG)
    names = {"drive_port": "drive board", "range_port": "range board", "laser_port": "laser"}
    content["hardware"] |= {key: shown[name] for key, name in names.items()}
    config = folder / "config.json"
    config.write_text(json.dumps(content))
    record, result = f"{given.out}/{shown['name']}-{seed}.mcap", folder / "result.json"
    words = ["-m", "wheelchair_gym", "deploy", "--policy", POLICY, "--config", str(config)]
    words += ["--pose", "mcl"]
    words += ["--map", str(folder / "map.yaml"), "--start", shown["start"], "--goal", shown["goal"]]
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
        try:
            report, log = deploy(given, seed, shown, folder)
        finally:
            world.send_signal(signal.SIGINT)
            ended, said = world.communicate()
    behind = [line for line in said.splitlines() if "late" in line]
    truth = dict(line.rsplit(maxsplit=1) for line in ended.splitlines() if line)
    (x, y), (gx, gy) = (map(float, where.split(",")[:2]) for where in (truth["end"], shown["goal"]))
    planning = ["replans", "late_plans", "discarded_plans", "thinking_drove_s", "thinking_stood_s"]
    figures = "time", "length", "clearance_min", *planning, "late_steps", "late_ms_max"
    return {
        "scene": shown["name"],
        "seed": seed,
        "outcome": report["outcome"],
        "from_goal": math.hypot(x - gx, y - gy),
        "touched_ms": int(truth["touched"]),
        **{key: report.get(key) for key in (*figures, "plans_ms_p50", "plans_ms_max")},
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
    report = {
        "reached": reached,
        "of": len(rows),
        "late_steps": sum(row["late_steps"] or 0 for row in rows),
        "trials": rows,
    }
    print(json.dumps(report, indent=1))
    sys.exit(0 if reached == len(rows) else 1)


if __name__ == "__main__":
    main()
