"""`wheelchair deploy` in real time across floor plans of the twin, as a person runs it.

`python -m tests.benchmarks.deploy [--seeds 0-19] [--scene floor_plan] [--policy lattice+window]`:
JSON on stdout, recordings in runs/deploy. Each seed is a twin of its own behind pseudo-terminals
and a TCP port, a deployed policy in another process, and beside both a bare loop of the same
period, in which nothing is done: control steps that begin more than 10 ms late are counted in both.
What else this machine does counts as well: run it in a quiet hour. `--simulated` drives the same in
simulated time, on any machine: then nothing is late. Exit code 1: a goal was not reached, a wall
was touched, or the chair's steps were late more often than the bare loop's.
"""

from __future__ import annotations

import argparse
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

import numpy as np

from wheelchair_gym.config import read_json
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.scenes import make_scene

LATE = 0.010  # s
GOAL = 0.3  # m, by truth
PATIENCE = 180.0  # s to compile and to get ready
CONFIG = "configs/hardware.json"
BARE = """
import sys, time
period, late, steps, begun = float(sys.argv[1]), 0, 0, time.monotonic()
print("ready", flush=True)
import select
while not select.select([sys.stdin], [], [], 0)[0]:
    steps += 1
    due = begun + steps * period
    time.sleep(max(0.0, due - time.monotonic()))
    late += time.monotonic() - due > 0.010
print(steps, late)
"""


def program(*words, **options):
    """A program of this project, in a process of its own."""
    return subprocess.Popen([sys.executable, *words], text=True, **options)


def twin(given, seed, folder):
    """The twin of a seed, and what it said of itself."""
    words = ["-m", "agents.cli", "twin", "--config", given.config, "--scene", given.scene]
    words += ["--seed", str(seed), "--write-map", str(folder / "map.yaml")]
    words += ["--picture", f"{given.out}/{seed}.png"]
    running = program(*words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    told = dict(running.stdout.readline().rsplit(maxsplit=1) for _ in range(5))
    return running, told


def stamps_of(file):
    """When each control step of a recording began [s since reset]."""
    from wheelchair_gym.recording.replay import read_recording

    chapters = read_recording(file)
    return [moment.reading.stamp for moment in chapters[0].states] if chapters else []


def lateness(stamps, period):
    """Control steps, and how many began more than LATE after their deadline."""
    late = sum(stamp - period * math.floor(stamp / period + 1e-6) > LATE for stamp in stamps[1:])
    return max(0, len(stamps) - 1), late


def deploy(given, seed, told, folder):
    """Run the command as a person does, who presses Enter while it waits; its report."""
    content = read_json(given.config)
    names = {"drive": "drive board", "range": "range board", "laser": "laser"}
    content["hardware"] |= {key: told[name] for key, name in names.items()}
    config = folder / "config.json"
    config.write_text(json.dumps(content))
    record, result = f"{given.out}/{seed}.mcap", folder / "result.json"
    words = ["-m", "agents.cli", "deploy", "--policy", given.policy, "--config", str(config)]
    words += ["--map", str(folder / "map.yaml"), "--start", told["start"], "--goal", told["goal"]]
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
    end = time.monotonic() + PATIENCE + given.seconds
    while running.poll() is None and time.monotonic() < end:
        time.sleep(0.2)
    if running.poll() is None:
        running.terminate()
        running.wait()
    report = json.loads(result.read_text()) if result.exists() else {"outcome": "no result"}
    return report, log, record


def trial(given, seed):
    """One seed; a row of figures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        world, told = twin(given, seed, folder)
        bare = program("-c", BARE, "0.1", stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        bare.stdout.readline()
        try:
            report, log, record = deploy(given, seed, told, folder)
        finally:
            beside, _ = bare.communicate("\n")
            world.send_signal(signal.SIGINT)
            ended, said = world.communicate()
    steps, late = lateness(stamps_of(record), 0.1) if report["outcome"] != "no result" else (0, 0)
    idle, idle_late = map(int, beside.split())
    behind = [line for line in said.splitlines() if "late" in line]
    truth = dict(line.rsplit(maxsplit=1) for line in ended.splitlines() if line)
    (x, y), (gx, gy) = (map(float, where.split(",")[:2]) for where in (truth["end"], told["goal"]))
    return {
        "seed": seed,
        "outcome": report["outcome"],
        "from_goal": math.hypot(x - gx, y - gy),
        "touched_ms": int(truth["touched"]),
        "time": report.get("time"),
        "length": report.get("length"),
        "clearance_min": report.get("clearance_min"),
        "steps": steps,
        "late": late,
        "bare_steps": idle,
        "bare_late": idle_late,
        "world": behind[-1] if behind else "in time",
        "log": log,
    }


def simulated(given, seed):
    """One seed in simulated time; a row of figures."""
    import gymnasium as gym

    from agents.deploy import Deployment
    from agents.deploy import deploy as drive
    from agents.policies import make_policy
    from tests.hardware.hosted import Hosted

    settings = env_settings(given.config, scene=given.scene)
    episode = make_scene(given.scene).sample(np.random.default_rng((seed, 0)))
    hosted, log = Hosted(episode, chair=settings.chair, sensors=settings.sensors), []
    env = gym.make(
        "wheelchair_gym/Hardware-v0",
        config=settings,
        chair=hosted.chair,
        disable_env_checker=True,
    ).unwrapped
    report = drive(env, make_policy(given.policy), episode, Deployment(), log.append)
    env.close()
    hosted.clock.wait(hosted.clock.now() + 1.0)
    x, y, _ = hosted.twin.plant.pose
    row = {
        "seed": seed,
        "outcome": report["outcome"],
        "from_goal": math.hypot(x - episode.goal[0], y - episode.goal[1]),
        "touched_ms": hosted.twin.bumper_steps,
        "log": log,
    }
    row |= {key: report[key] for key in ("time", "length", "clearance_min")}
    hosted.close()
    return row | dict.fromkeys(("steps", "late", "bare_steps", "bare_late"), 0)


def seeds(text):
    """Numbers of A-B, or A."""
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=seeds, default=seeds("0-19"))
    parser.add_argument("--scene", default="floor_plan")
    parser.add_argument("--policy", default="lattice+window")
    parser.add_argument("--config", default=CONFIG)
    parser.add_argument("--seconds", type=float, default=240.0, help="for the drive")
    parser.add_argument("--simulated", action="store_true", help="in simulated time")
    parser.add_argument("--out", default="runs/deploy")
    given = parser.parse_args()
    env_settings(given.config)
    Path(given.out).mkdir(parents=True, exist_ok=True)
    rows = []
    for seed in given.seeds:
        rows.append((simulated if given.simulated else trial)(given, seed))
        print({k: v for k, v in rows[-1].items() if k != "log"}, file=sys.stderr, flush=True)
    steps, late = sum(r["steps"] for r in rows), sum(r["late"] for r in rows)
    bare, bare_late = sum(r["bare_steps"] for r in rows), sum(r["bare_late"] for r in rows)
    reached = sum(
        r["outcome"] == "success" and r["from_goal"] <= GOAL and r["touched_ms"] == 0 for r in rows
    )
    report = {
        "reached": reached,
        "of": len(rows),
        "late_share": late / max(1, steps),
        "bare_late_share": bare_late / max(1, bare),
        "trials": rows,
    }
    print(json.dumps(report, indent=1))
    sys.exit(0 if reached == len(rows) and late * bare <= bare_late * steps else 1)


if __name__ == "__main__":
    main()
