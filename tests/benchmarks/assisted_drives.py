"""Thousands of whole drives of simulated people behind an assistant and the shield, in batches.

`python -m tests.benchmarks.assisted_drives [--drivers A,B] [--scenes A,B] [--assist A,B] [--drives
N]`: each driver drives N times in each scene with each assistant, with all noise of sensors, and
chairs drawn anew. Every drive is a line of `--out`, and one that stands there is not driven again,
so that a run that was ended goes on. Then tables: success, contacts that the chair caused at more
than 0.05 m/s, and times by driver; and a line for each such contact.

`direct` is driven without the shield. The time limit is 60 s and ten times the time of the shortest
way; success within four times the time of `expert` through the same interface in the same world is
shown beside it. For this, each driver's interface is driven by `expert`, too.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
from collections import defaultdict
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.metrics import wilson
from tests.attacks import REAR
from wheelchair_gym.assistance import COMPILED
from wheelchair_gym.config import dump
from wheelchair_gym.drivers import DRIVERS, make_driver
from wheelchair_gym.envs import NavigationVectorEnv

SCENES = {
    "floor_plan": "floor_plan",
    "home": {
        "name": "floor_plan", "kind": "home", "door_width": [0.9, 1.1],
        "corridor_width": [1.1, 1.6],
    },
    "clutter": "clutter",
    "crowd": "crowd",
}  # fmt: skip
ROWS = 25  # of a batch
KEY = ("driver", "scene", "assist", "seed", "number")
TIMES = 4.0  # times the time of `expert` in which a drive has to arrive
ACTIVE = 0.05  # full speeds: a smaller twist has no direction


def driver_of(name: str) -> Any:
    """A driver; `expert@NAME` is `expert` with the interface of another."""
    base, at, other = name.partition("@")
    return {"name": base, "interface": dump(make_driver(other).interface)} if at else base


def with_expert(name: str) -> str:
    """The driver that has the interface of another and is `expert` otherwise."""
    same = make_driver(name.partition("@")[2] or name).interface == make_driver("expert").interface
    return "expert" if same else f"expert@{name}"


def drive(driver: str, scene: str, assistant: str, given: Any) -> list[Any]:
    """All drives of a driver in a scene: of each row the first episodes, each as a record."""
    n, episodes = ROWS, given.drives // ROWS
    env = NavigationVectorEnv(
        n, scene=SCENES[scene], driver=driver_of(driver), assistant=assistant,
        shield=assistant != "direct", num_threads=1, randomize=True, pose_source="modelled",
        bank={"size": given.worlds, "turnover": 0.0, "cache": given.cache},
        config={
            "task": {"time_base": 60.0 * given.limit, "time_factor": 10.0 * given.limit},
            "sensors": {"more_lasers": [REAR] if given.rear else []},
        },
    )  # fmt: skip
    limits = env.settings.chair.limits
    full = np.array([limits.forward, limits.turn])
    seen, _ = env.reset(seed=0)
    number, over, nothing = np.zeros(n, int), np.zeros(n, bool), np.zeros((n, 2))
    angles, counts, least = np.zeros(n), np.zeros(n), np.full(n, math.inf)
    contacts: list[list[Any]] = [[] for _ in range(n)]
    found = []
    while (number < episodes).any():
        sticks = seen["stick"][:, :2].astype(float)
        ahead = np.where(sticks[:, 0] > 0.0, limits.forward, limits.backward)
        asked = sticks * np.stack([ahead, np.full(n, limits.turn)], -1) / full
        seen, _, terminated, truncated, info = env.step(nothing)
        drives = ~over & (number < episodes)  # the others begin an episode, or are done
        over = terminated | truncated
        twists = info["shield"]["given"] if "shield" in info else asked * full
        least = np.where(drives, np.minimum(least, info["clearance"]), least)
        both = drives & (np.hypot(*asked.T) > ACTIVE) & (np.hypot(*(twists / full).T) > ACTIVE)
        turn = np.arctan2(*(twists / full).T[::-1]) - np.arctan2(*asked.T[::-1])
        angles += both * np.abs(np.remainder(turn + math.pi, 2 * math.pi) - math.pi)
        counts += both
        for i in np.flatnonzero(drives & info["at_fault"]).tolist():
            pose = [round(float(x), 3) for x in info["pose"][i]]
            contacts[i].append({
                "time": float(info["time"][i]), "speed": float(info["approach_speed"][i]),
                "other_speed": float(info["other_approach_speed"][i]),
                "with": int(info["contact_with"][i]), "pose": pose,
                "twist": info["twist"][i].tolist(), "asked": (asked[i] * full).tolist(),
                "given": twists[i].tolist(),
            })  # fmt: skip
        for i in np.flatnonzero(drives & over).tolist():
            found.append({
                "driver": driver, "scene": scene, "assist": assistant, "seed": i,
                "number": int(number[i]), "success": bool(info["is_success"][i]),
                "time": float(info["time"][i]), "bumped": bool(info["bumped"][i]),
                "angle": float(angles[i] / counts[i]) if counts[i] else 0.0,
                "clearance": float(least[i]), "contacts": contacts[i],
            })  # fmt: skip
            angles[i], counts[i], least[i], contacts[i] = 0.0, 0.0, math.inf, []
            number[i] += 1
    env.close()
    return found


def run(given: argparse.Namespace) -> dict[Any, Any]:
    """Drive what the file lacks; all drives of the file that are asked for, by their keys."""
    path = Path(given.out)
    path.parent.mkdir(parents=True, exist_ok=True)
    stored: dict[Any, Any] = {}
    if path.exists():
        for line in path.read_text().splitlines():
            one = json.loads(line)
            stored[tuple(one[name] for name in KEY)] = one
    names = list(given.drivers)
    if not given.no_expert:
        names = list(dict.fromkeys([*(with_expert(name) for name in names), *names]))
    asked = {}
    for scene, assistant, driver in product(given.scenes, given.assist, names):
        rows = product(range(ROWS), range(given.drives // ROWS))
        keys = [(driver, scene, assistant, *row) for row in rows]
        if not all(key in stored for key in keys):
            made = drive(driver, scene, assistant, given)
            with path.open("a") as file:
                file.writelines(f"{json.dumps(one)}\n" for one in made)
            stored |= {tuple(one[name] for name in KEY): one for one in made}
        driven = {key: stored[key] for key in keys}
        asked |= driven
        arrived = sum(one["success"] for one in driven.values())
        hits = sum(bool(one["contacts"]) for one in driven.values())
        line = f"{scene:<11}{assistant:<11}{driver:<24}{arrived:>5} of {len(driven)}"
        print(f"{line}, caused contacts in {hits}", file=sys.stderr, flush=True)
    return asked


def tables(drives: dict[Any, Any], given: argparse.Namespace) -> str:
    """Tables by driver, and a line for each contact that the chair caused."""
    lines = []
    for assistant in given.assist:
        lines += [
            "", f"{assistant}: {given.drives} drives of each driver in each of",
            ", ".join(given.scenes),
            "", "| driver | drives | caused a contact | success [%] (95 %) | in time [%] | "
            "time beside `expert` | off the stick, median [deg] |",
            "| --- | ---: | ---: | ---: | ---: | ---: | ---: |",
        ]  # fmt: skip
        for driver in given.drivers:
            every = [
                (drives[key], drives.get((with_expert(driver), *key[1:])))
                for key in drives
                if key[0] == driver and key[2] == assistant
            ]
            well = [one["success"] for one, _ in every]
            hits = sum(bool(one["contacts"]) for one, _ in every)
            low, high = wilson(sum(well), len(well))
            experts = [(one, of) for one, of in every if of is not None and of["success"]]
            timely = [one["success"] and one["time"] <= TIMES * of["time"] for one, of in experts]
            ratios = [math.log(one["time"] / of["time"]) for one, of in experts if one["success"]]
            angle = math.degrees(float(np.median([one["angle"] for one, _ in every])))
            beside = f"{math.exp(float(np.mean(ratios))):.2f}" if ratios else "-"
            share = f"{100 * np.mean(timely):.0f} of {len(timely)}" if timely else "-"
            lines.append(
                f"| `{driver}` | {len(well)} | {hits} | {100 * np.mean(well):.0f} ({100 * low:.0f}"
                f" to {100 * high:.0f}) | {share} | {beside} | {angle:.1f} |"
            )
        hits_by = defaultdict(int)
        count = 0
        for key, one in drives.items():
            if key[2] == assistant:
                count += 1
                hits_by[key[1]] += bool(one["contacts"])
        lines += ["", f"{count} drives; drives with a caused contact: {dict(hits_by)}"]
    lines += ["", "Contacts that the chair caused:"]
    for key, one in drives.items():
        if key[2] != "direct":
            lines += [f"{key}: {json.dumps(contact)}" for contact in one["contacts"][:1]]
    return "\n".join(lines)


def names(text: str) -> list[str]:
    """Names between commas."""
    return text.split(",")


def main() -> int:
    """Drive, and print tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drivers", type=names, default=list(DRIVERS))
    parser.add_argument("--scenes", type=names, default=list(SCENES))
    parser.add_argument("--assist", type=names, default=["shared_dwa"], help=", ".join(COMPILED))
    parser.add_argument(
        "--drives", type=int, default=75, help=f"of a driver in a scene; a multiple of {ROWS}"
    )
    parser.add_argument("--worlds", type=int, default=120, help="of a scene, which drives share")
    parser.add_argument("--cache", default="runs/assisted_drives/worlds", help="folder of worlds")
    text = "of the time limit, for slow interfaces; use another --out"
    parser.add_argument("--limit", type=float, default=1.0, help=f"times {text}")
    text = "a second scanner looks back; use another --out"
    parser.add_argument("--rear", action="store_true", help=text)
    parser.add_argument("--out", default="runs/assisted_drives/drives.jsonl")
    parser.add_argument("--no-expert", action="store_true", help="no drives of expert beside")
    given = parser.parse_args()
    if given.drives < ROWS or given.drives % ROWS:
        parser.error(f"--drives is {given.drives}; expected a multiple of {ROWS}")
    os.makedirs(given.cache, exist_ok=True)
    print(tables(run(given), given))
    return 0


if __name__ == "__main__":
    sys.exit(main())
