"""Thousands of whole drives of simulated people behind an assistant and the shield, in batches.

`python -m tests.benchmarks.assisted_drives [--drivers A,B] [--scenes A,B] [--assist A,B] [--drives
N]`: each driver drives N times in each scene with each assistant, with all noise of sensors, and
chairs drawn anew. A scene is one of `SCENES` or a course of driving skills. Each batch is a line of
`--out`, and one that stands there is not driven again, so that a run that was ended goes on. Then
tables: success, contacts that the chair caused at more than 0.05 m/s, and times by driver; a line
for each such contact; and assistants side by side.

`direct` is driven without the shield. The time limit is 60 s and ten times the time of the shortest
way; success within four times the time of `expert` through the same interface in the same world is
shown beside it. For this, each driver's interface is driven by `expert`, too. Where a twist moves
slower than the stick asks, the lost part of the control period is counted: for the assistant, and
for each reason of the shield.
"""

import argparse
import json
import math
import os
import sys
from collections import Counter
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.assisted import StickTrace
from agents.evaluation.runs import compute, run_key, source_digest
from agents.evaluation.statistics import mcnemar, ratio_interval, wilson
from agents.evaluation.tables import exists, markdown_table
from agents.people import ASSISTANTS, make_assistant
from agents.people.assistant import AssistMission
from tests.attacks import REAR
from tests.benchmarks.lattice import HOME
from wheelchair_gym.base.arrays import Array, Floats, Mask
from wheelchair_gym.base.settings import dump
from wheelchair_gym.envs import NavigationVectorEnv
from wheelchair_gym.people.assistance import COMPILED
from wheelchair_gym.people.drivers import DRIVERS, make_driver
from wheelchair_gym.scenes.skill import COURSES
from wheelchair_gym.types import Reading, Stick

SCENES = {
    "floor_plan": "floor_plan",
    "home": HOME,
    "clutter": "clutter",
    "crowd": "crowd",
}
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


def ranges(seen: Array, reach: Any) -> Floats:
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

    def actions(self, seen: Any, info: Any, begin: Mask) -> Array:
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


def measures(trace: StickTrace, steps: int, distance: float) -> dict[str, float | None]:
    """Return measures of a drive of n steps and a distance [m]; no direction is an angle of 0."""
    found = trace.figures(np.zeros((steps + 1, 2)), distance)
    angle = found["agreement_angle"]
    return {
        "angle": angle if math.isfinite(angle) else 0.0,
        "intervention": found["intervention_share"],
        "authority": found["authority"] if math.isfinite(found["authority"]) else None,
        "effort": found["stick_effort"],
    }


def scene_of(name: str) -> Any:
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
    period, minimum = 1.0 / env.settings.rate, np.full(n, math.inf)
    traces = [StickTrace(limits, period) for _ in range(n)]
    steps = np.zeros(n, int)
    contacts: list[list[Any]] = [[] for _ in range(n)]
    lost: list[Counter[str]] = [Counter() for _ in range(n)]
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
        minimum = np.where(drives, np.minimum(minimum, info["clearance"]), minimum)
        steps += drives
        for i in np.flatnonzero(drives).tolist():
            traces[i].add(Stick(sticks[i, 0], sticks[i, 1], False), twists[i])
            wanted = abs(asked[i, 0]) * full[0]
            if "shield" in info and wanted > 0.0:
                answer, given_v = (abs(info["shield"][key][i, 0]) for key in ("asked", "given"))
                lost[i]["assistant"] += period * max(0.0, wanted - answer) / wanted
                reason = str(info["shield"]["reason"][i])
                lost[i][reason] += period * max(0.0, min(answer, wanted) - given_v) / wanted
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
                "clearance": float(minimum[i]), "contacts": contacts[i], "lost": dict(lost[i]),
            })  # fmt: skip
            lost[i] = Counter()
            traces[i], steps[i], minimum[i] = StickTrace(limits, period), 0, math.inf
            contacts[i] = []
            number[i] += 1
    env.close()
    return found


def run(given: argparse.Namespace) -> dict[Any, Any]:
    """Drive what the file lacks; all drives that are asked for, by their keys."""
    os.makedirs(given.cache, exist_ok=True)
    names = list(given.drivers)
    if not given.no_expert:
        names = list(dict.fromkeys([*(with_expert(name) for name in names), *names]))
    of = [given.drives, given.rows, given.worlds, given.limit, given.rear]
    batches = [(d, scene, a) for scene, a, d in product(given.scenes, given.assist, names)]
    found = compute(
        {run_key(source_digest(), *batch, *of): batch for batch in batches},
        lambda batch: {"drives": drive(*batch, given)}, Path(given.out), unit="batch",
    )  # fmt: skip
    drives = [one for batch in found.values() for one in batch["drives"]]
    return {tuple(one[name] for name in KEY): one for one in drives}


def hits(drives: Any) -> int:
    return sum(bool(one["contacts"]) for one in drives)


def percent(drives: Any) -> str:
    """Return successes of drives [%] with their 95 % interval."""
    well = sum(one["success"] for one in drives)
    low, high = wilson(well, len(drives))
    return f"{100 * well / len(drives):.0f} ({100 * low:.0f} to {100 * high:.0f})"


def by_driver(drives: dict[Any, Any], driver: str, assistant: str) -> list[Any]:
    every = [
        (drives[key], drives.get((with_expert(driver), *key[1:])))
        for key in drives
        if key[0] == driver and key[2] == assistant
    ]
    mine = [one for one, _ in every]
    experts = [(one, of) for one, of in every if of is not None and of["success"]]
    timely = [one["success"] and one["time"] <= TIMES * of["time"] for one, of in experts]
    ratios = [math.log(one["time"] / of["time"]) for one, of in experts if one["success"]]
    return [
        f"`{driver}`", len(mine), hits(mine), percent(mine),
        f"{100 * np.mean(timely):.0f} of {len(timely)}" if timely else "-",
        f"{math.exp(float(np.mean(ratios))):.2f}" if ratios else "-",
        f"{math.degrees(float(np.median([one['angle'] for one in mine]))):.1f}",
    ]  # fmt: skip


def seconds_lost(drives: list[Any]) -> str:
    well = [one for one in drives if one["success"] and "lost" in one]
    lost = sum((Counter(one["lost"]) for one in well), Counter[str]())
    parts = (f"{name or 'nothing'} {value:.0f}" for name, value in lost.most_common())
    whole = sum(one["time"] for one in well)
    return f"seconds lost of {whole:.0f} s in successful drives: {', '.join(parts) or 'none'}"


def tables(drives: dict[Any, Any], given: argparse.Namespace) -> str:
    """Tables by driver, and a line for each contact that the chair caused."""
    lines = []
    heads = (
        "driver", "drives", "caused a contact", "success [%] (95 %)", "in time [%]",
        "time beside `expert`", "off the stick, median [deg]",
    )  # fmt: skip
    for assistant in given.assist:
        rows = [by_driver(drives, driver, assistant) for driver in given.drivers]
        its = {key: one for key, one in drives.items() if key[2] == assistant}
        hits_by = dict(Counter(key[1] for key, one in its.items() if one["contacts"]))
        lines += [
            "", f"{assistant}: {given.drives} drives of each driver in each of",
            ", ".join(given.scenes), "", markdown_table(heads, rows, [False] + [True] * 6),
            f"{len(its)} drives; drives with a caused contact: {hits_by}",
            seconds_lost(list(its.values())),
        ]  # fmt: skip
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
    of = {name: [drives[(k[0], k[1], name, *k[3:])] for k in mine] for name in given.assist}
    lines = ["", "Successes [%], and drives with a contact that the chair caused"]
    for place, head, groups in (0, "driver", given.drivers), (1, "scene", given.scenes):
        rows = []
        for group in groups:
            some = [k for k, key in enumerate(mine) if key[place] == group]
            its = ([of[name][k] for k in some] for name in given.assist)
            rows.append([f"`{group}`", *(
                f"{100 * np.mean([one['success'] for one in each]):.0f}, {hits(each)}"
                for each in its
            )])  # fmt: skip
        heads = [head, *(f"`{name}`" for name in given.assist)]
        lines += ["", markdown_table(heads, rows, [False] + [True] * len(given.assist)).rstrip()]
    heads = [
        "assistant", "success [%] (95 %)", "contacts", f"only one succeeds: it; `{first}`",
        "p (McNemar)", f"time beside `{first}`", "off the stick [deg]",
        "intervention [% of time]", "authority", "effort [s/m]",
    ]  # fmt: skip
    rows = []
    for name in given.assist:
        both = list(zip(of[name], of[first], strict=True))
        successes = [[one["success"] for one in each] for each in zip(*both, strict=True)]
        alone, other, p = mcnemar(*successes)
        times = [(a["time"], b["time"]) for a, b in both if a["success"] and b["success"]]
        ratio, low, high = ratio_interval(*zip(*times, strict=True))
        angle, intervention, authority, effort = (  # of drives that have the measure
            np.mean([one[key] for one in of[name] if exists(one[key])])
            for key in ("angle", "intervention", "authority", "effort")
        )
        rows.append([
            f"`{name}`", percent(of[name]), hits(of[name]), f"{alone}; {other}", f"{p:.3f}",
            f"{ratio:.2f} ({low:.2f} to {high:.2f})", f"{math.degrees(angle):.1f}",
            f"{100 * intervention:.0f}", f"{authority:.2f}", f"{effort:.1f}",
        ])  # fmt: skip
    table = markdown_table(heads, rows, [False] + [True] * 9)
    return "\n".join([*lines, "", f"All drivers, in pairs with `{first}`", "", table])


def names(text: str) -> list[str]:
    return text.split(",")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drivers", type=names, default=list(DRIVERS))
    text = f"{', '.join(SCENES)}, or courses: {', '.join(COURSES)}"
    parser.add_argument("--scenes", type=names, default=list(SCENES), help=text)
    parser.add_argument("--assist", type=names, default=["shared_dwa"], help=", ".join(ASSISTANTS))
    parser.add_argument("--no-expert", action="store_true", help="no drives of expert beside")
    text = "of a driver in a scene; a multiple of --rows"
    parser.add_argument("--drives", type=int, default=75, help=text)
    parser.add_argument("--rows", type=int, default=25, help="of a batch")
    parser.add_argument("--worlds", type=int, default=120, help="of a scene, which drives share")
    parser.add_argument("--cache", default="runs/assisted_drives/worlds", help="folder of worlds")
    text = "times of the time limit, for slow interfaces"
    parser.add_argument("--limit", type=float, default=1.0, help=text)
    parser.add_argument("--rear", action="store_true", help="a second scanner looks back")
    parser.add_argument("--out", default="runs/assisted_drives/drives.jsonl", help="file of drives")
    given = parser.parse_args()
    if given.rows < 1 or given.drives < given.rows or given.drives % given.rows:
        parser.error(f"--drives is {given.drives}; expected a multiple of --rows, {given.rows}")
    for name in given.scenes:
        if name not in SCENES and name not in COURSES:
            parser.error(f"--scenes: {name!r} is neither of {', '.join(SCENES)} nor a course")
    found = run(given)
    print(tables(found, given))
    print(side_by_side(found, given))
    return 0


if __name__ == "__main__":
    sys.exit(main())
