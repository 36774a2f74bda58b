"""Thousands of whole drives of simulated people behind an assistant and the shield, in batches.

`python -m tests.benchmarks.assisted_drives [--drivers A,B] [--scenes A,B] [--assist A,B] [--drives
N]`: each driver drives N times in each scene with each assistant, with all noise of sensors, and
chairs drawn anew. A scene is one of `SCENES` or a course of driving skills. Every drive is a line
of `--out`, and one that stands there is not driven again, so that a run that was ended goes on.
Then tables: success, contacts that the chair caused at more than 0.05 m/s, and times by driver; a
line for each such contact; and assistants side by side.

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
from numpy.typing import NDArray
from scipy.stats import binomtest

from agents.assistance import ASSISTANTS, make_assistant
from agents.assistance.assistant import AssistMission
from agents.evaluation.assisted import StickTrace
from agents.evaluation.metrics import wilson
from tests.attacks import REAR
from wheelchair_gym.assistance import COMPILED
from wheelchair_gym.config import dump
from wheelchair_gym.drivers import DRIVERS, make_driver
from wheelchair_gym.envs import NavigationVectorEnv
from wheelchair_gym.scenes.skill import COURSES
from wheelchair_gym.types import Reading, Stick

SCENES = {
    "floor_plan": "floor_plan",
    "home": {
        "name": "floor_plan", "kind": "home", "door_width": [0.9, 1.1],
        "corridor_width": [1.1, 1.6],
    },
    "clutter": "clutter",
    "crowd": "crowd",
}  # fmt: skip
Floats = NDArray[np.float64]

NEW = np.zeros(8, np.float32)  # s: age of ultrasonic ranges, which no assistant looks at
KEY = ("driver", "scene", "assist", "seed", "number")
TIMES = 4.0  # times the time of `expert` in which a drive has to arrive


def driver_of(name: str) -> Any:
    """A driver; `expert@NAME` is `expert` with the interface of another.

    `NAME+part.setting=VALUE` is a driver with a number changed, as in `ataxia+hand.tremor=0.3`.
    """
    base, at, other = name.partition("@")
    if at:
        return {"name": base, "interface": dump(make_driver(driver_of(other)).interface)}
    base, plus, change = name.partition("+")
    if not plus:
        return base
    key, _, value = change.partition("=")
    part, _, field = key.partition(".")
    given = dump(make_driver(base))[part] if part == "interface" else {}
    return {"name": base, part: given | {field: float(value)}}


def with_expert(name: str) -> str:
    """The driver that has the interface of another and is `expert` otherwise."""
    driver = make_driver(driver_of(name.partition("@")[2] or name))
    same = driver.interface == make_driver("expert").interface
    return "expert" if same else f"expert@{name}"


def ranges(seen: Floats, reach: Any) -> NDArray[np.float32]:
    """Ranges of a reading from observed ones."""
    found = np.where(seen >= reach, np.inf, seen)
    return np.where(found <= 0.0, -np.inf, found).astype(np.float32)  # too near


class Helpers:
    """Assistants of n rows that are not compiled: they see what a row observes."""

    def __init__(self, name: str, env: NavigationVectorEnv) -> None:
        self._env, self._limits = env, env.settings.chair.limits
        self._helpers = [make_assistant(name) for _ in range(env.num_envs)]
        self._given = np.zeros((env.num_envs, 2))
        self._reaches = np.array([m.reach for m in env.settings.sensors.ultrasonic.models])

    def actions(self, seen: Any, info: Any, begin: NDArray[np.bool_]) -> Floats:
        """Actions (n, 2) for what rows see, with their info; some begin an episode."""
        s, actions = self._env.settings, np.zeros((len(self._helpers), 2))
        scans = ranges(seen["laser"], s.sensors.laser.reach)
        echoes = ranges(seen["ultrasonic"], self._reaches)
        self._given[begin] = 0.0
        less = np.array([self._limits.twist(each) for each in self._given])
        less = less - info["shield"]["given"] if "shield" in info else 0.0 * less
        less[begin] = 0.0
        for i, helper in enumerate(self._helpers):
            if begin[i]:
                helper.reset(AssistMission(s.chair, s.sensors, 1.0 / s.rate))
            forward, left, latched = seen["stick"][i, :3].astype(float).tolist()
            reading = Reading(
                info["pose_estimate"][i].copy(), seen["twist"][i].astype(float), scans[i],
                echoes[i], NEW, False, 24.0, 0.0 if begin[i] else float(info["time"][i]), "",
                tuple(self._given[i].tolist()), tuple(less[i].tolist()),
            )  # fmt: skip
            twist = helper.assist(Stick(forward, left, latched > 0.5), reading, None)
            actions[i] = self._limits.action(twist)
        self._given[:] = actions
        return actions


def measures(trace: StickTrace, steps: int, distance: float) -> dict[str, float]:
    """Measures of a drive of so many steps and so long a way [m]; no direction is an angle of 0."""
    found = trace.figures(np.zeros((steps + 1, 2)), distance)
    angle = found["agreement_angle"]
    return {
        "angle": angle if math.isfinite(angle) else 0.0,
        "intervention": found["intervention_share"],
        "authority": found["authority"],
        "effort": found["stick_effort"],
    }


def interval(values: Any) -> tuple[float, float, float]:
    """A mean and its 95 % interval."""
    values = np.asarray(values, float)
    mean, half = values.mean(), 1.96 * values.std(ddof=1) / math.sqrt(len(values))
    return float(mean), float(mean - half), float(mean + half)


def scene_of(name: str) -> Any:
    """The scene of a name: one of SCENES, or a course."""
    return {"name": "skill", "course": name} if name in COURSES else SCENES[name]


def drive(driver: str, scene: str, assistant: str, given: Any) -> list[Any]:
    """All drives of a driver in a scene: of each row the first episodes, each as a record."""
    n, episodes = given.rows, given.drives // given.rows
    env = NavigationVectorEnv(
        n, scene_of(scene), split="test", driver=driver_of(driver),
        assistant=assistant if assistant in COMPILED else None,
        shield=assistant != "direct", num_threads=1, randomize=True, pose_source="modelled",
        bank={"size": given.worlds, "turnover": 0.0, "cache": given.cache},
        config={
            "task": {"time_base": 60.0 * given.limit, "time_factor": 10.0 * given.limit},
            "sensors": {"more_lasers": [REAR] if given.rear else []},
        },
    )  # fmt: skip
    limits = env.settings.chair.limits
    full = np.array([limits.forward, limits.turn])
    helpers = None if assistant in COMPILED else Helpers(assistant, env)
    seen, info = env.reset(seed=0)
    begin = np.ones(n, bool)
    number, over, nothing = np.zeros(n, int), np.zeros(n, bool), np.zeros((n, 2))
    period, least = 1.0 / env.settings.rate, np.full(n, math.inf)
    traces = [StickTrace(limits, period) for _ in range(n)]
    steps = np.zeros(n, int)
    contacts: list[list[Any]] = [[] for _ in range(n)]
    found = []
    while (number < episodes).any():
        sticks = seen["stick"][:, :2].astype(float)
        ahead = np.where(sticks[:, 0] > 0.0, limits.forward, limits.backward)
        asked = sticks * np.stack([ahead, np.full(n, limits.turn)], -1) / full
        actions = nothing if helpers is None else helpers.actions(seen, info, begin)
        seen, _, terminated, truncated, info = env.step(actions)
        begin = over
        drives = ~over & (number < episodes)  # the others begin an episode, or are done
        over = terminated | truncated
        twists = info["shield"]["given"] if "shield" in info else asked * full
        least = np.where(drives, np.minimum(least, info["clearance"]), least)
        steps += drives
        for i in np.flatnonzero(drives).tolist():
            traces[i].add(Stick(sticks[i, 0], sticks[i, 1], False), twists[i])
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
                **measures(traces[i], int(steps[i]), float(info["distance"][i])),
                "clearance": float(least[i]), "contacts": contacts[i],
            })  # fmt: skip
            traces[i], steps[i], least[i] = StickTrace(limits, period), 0, math.inf
            contacts[i] = []
            number[i] += 1
    env.close()
    return found


def run(given: argparse.Namespace) -> dict[Any, Any]:
    """Drive what the file lacks; all drives of the file that are asked for, by their keys."""
    os.makedirs(given.cache, exist_ok=True)
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
    asked: dict[Any, Any] = {}
    for scene, assistant, driver in product(given.scenes, given.assist, names):
        rows = product(range(given.rows), range(given.drives // given.rows))
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
        line = f"{scene:<17}{assistant:<11}{driver:<24}{arrived:>5} of {len(driven)}"
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
        hits_by: defaultdict[str, int] = defaultdict(int)
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


def side_by_side(drives: dict[Any, Any], given: argparse.Namespace) -> str:
    """Assistants beside each other: by driver, by scene, and in pairs with the first.

    Empty for one assistant alone.
    """
    first = given.assist[0]
    if len(given.assist) < 2:
        return ""
    mine = [k for k in drives if k[2] == first and k[0] in given.drivers]
    keys = [(k[0], k[1], *k[3:]) for k in mine]
    of = {name: [drives[(k[0], k[1], name, *k[2:])] for k in keys] for name in given.assist}
    lines = ["", "Successes [%], and drives with a contact that the chair caused"]
    for place, head, rows in (0, "driver", given.drivers), (1, "scene", given.scenes):
        lines += ["", f"| {head} | {' | '.join(f'`{name}`' for name in given.assist)} |"]
        lines += ["| --- |" + " ---: |" * len(given.assist)]
        for row in rows:
            cells = []
            for name in given.assist:
                some = [one for key, one in zip(keys, of[name], strict=True) if key[place] == row]
                share = 100 * np.mean([one["success"] for one in some])
                cells.append(f"{share:.0f}, {sum(bool(one['contacts']) for one in some)}")
            lines.append(f"| `{row}` | {' | '.join(cells)} |")
    lines += ["", f"All drivers, in pairs with `{first}`", ""]
    lines += [
        f"| assistant | success [%] (95 %) | contacts | only one succeeds: it; `{first}` | "
        f"p (McNemar) | time beside `{first}` | off the stick [deg] | intervention [% of time] | "
        "authority | effort [s/m] |",
        "| --- |" + " ---: |" * 9,
    ]
    for name in given.assist:
        both = list(zip(of[name], of[first], strict=True))
        well = sum(one["success"] for one in of[name])
        low, high = wilson(well, len(both))
        alone = sum(a["success"] and not b["success"] for a, b in both)
        other = sum(b["success"] and not a["success"] for a, b in both)
        p = binomtest(alone, alone + other).pvalue if alone + other else 1.0
        logs = np.log([a["time"] / b["time"] for a, b in both if a["success"] and b["success"]])
        ratio, least, most = np.exp(interval(logs))
        means = [  # of drives that have the measure: without any deflection there is no authority
            np.mean([one[key] for one in of[name] if math.isfinite(one[key])])
            for key in ("angle", "intervention", "authority", "effort")
        ]
        lines.append(
            f"| `{name}` | {100 * well / len(both):.0f} ({100 * low:.0f} to {100 * high:.0f}) | "
            f"{sum(bool(one['contacts']) for one in of[name])} | {alone}; {other} | {p:.3f} | "
            f"{ratio:.2f} ({least:.2f} to {most:.2f}) | {math.degrees(means[0]):.1f} | "
            f"{100 * means[1]:.0f} | {means[2]:.2f} | {means[3]:.1f} |"
        )
    return "\n".join(lines)


def names(text: str) -> list[str]:
    """Names between commas."""
    return text.split(",")


def parse(parser: argparse.ArgumentParser, drives: int, out: str) -> argparse.Namespace:
    """What is given, with the options of drives in batches; ends the program where it is wrong."""
    text = "of a driver in a scene; a multiple of --rows"
    parser.add_argument("--drives", type=int, default=drives, help=text)
    parser.add_argument("--rows", type=int, default=25, help="of a batch")
    parser.add_argument("--worlds", type=int, default=120, help="of a scene, which drives share")
    parser.add_argument("--cache", default="runs/assisted_drives/worlds", help="folder of worlds")
    text = "of the time limit, for slow interfaces; use another --out"
    parser.add_argument("--limit", type=float, default=1.0, help=f"times {text}")
    text = "a second scanner looks back; use another --out"
    parser.add_argument("--rear", action="store_true", help=text)
    parser.add_argument("--out", default=out, help="file of drives")
    given = parser.parse_args()
    if given.rows < 1 or given.drives < given.rows or given.drives % given.rows:
        parser.error(f"--drives is {given.drives}; expected a multiple of --rows, {given.rows}")
    return given


def main() -> int:
    """Drive, and print tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drivers", type=names, default=list(DRIVERS))
    text = f"{', '.join(SCENES)}, or courses: {', '.join(COURSES)}"
    parser.add_argument("--scenes", type=names, default=list(SCENES), help=text)
    parser.add_argument("--assist", type=names, default=["shared_dwa"], help=", ".join(ASSISTANTS))
    parser.add_argument("--no-expert", action="store_true", help="no drives of expert beside")
    given = parse(parser, drives=75, out="runs/assisted_drives/drives.jsonl")
    for name in given.scenes:
        if name not in SCENES and name not in COURSES:
            parser.error(f"--scenes: {name!r} is neither of {', '.join(SCENES)} nor a course")
    found = run(given)
    print(tables(found, given))
    print(side_by_side(found, given))
    return 0


if __name__ == "__main__":
    sys.exit(main())
