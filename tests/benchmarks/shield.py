"""Attacks on the shield, counted: `python -m tests.benchmarks.shield --attacks 102400`.

Attackers of many kinds (`tests.attacks`) drive in every scene, at every rate, some with sensors
that fail; two fifths of them drive at the ends of leaves, at slabs, posts and what stands behind a
corner. Things too thin for any promise, and those as wide as is promised with a laser of 181 or 64
beams, are attacked beside that, and counted apart. Each finished chunk is stored: the same command
after Ctrl-C goes on with what is missing. A chunk is stored under what it depends on, this
project's code among it.
"""

import argparse
import math
import sys
from functools import lru_cache
from pathlib import Path

from agents import StoppedError
from agents.evaluation.provenance import commit, machine, write_json
from agents.evaluation.runs import compute, run_key, source_digest
from agents.evaluation.statistics import wilson
from tests.attacks import APART, HARM, SCENES, SLOW, Attack, Event, Report

ROWS, EACH = 256, 4  # attacks of a chunk: ROWS times EACH
RATES = "5,10,20,50"  # Hz
WEIGHTS = {"edges": 10} | dict.fromkeys(APART, 1)  # chunks of a scene for 3 of any other


def main() -> int:
    """Attack, print what came of it, and say by the exit code whether the shield held."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--attacks", type=int, default=102_400, metavar="N")
    parser.add_argument("--first-seed", type=int, default=0, metavar="S")
    parser.add_argument("--scenes", default=",".join({**SCENES, **APART}), metavar="A,B")
    parser.add_argument("--rates", default=RATES, metavar="HZ,HZ", help="of control")
    parser.add_argument("--shield", choices=("on", "off"), default="on")
    parser.add_argument("--faults", type=float, default=0.2, metavar="SHARE")
    parser.add_argument("--rear", action="store_true", help="a second scanner looks back")
    parser.add_argument("--threads", type=int, metavar="N")
    parser.add_argument("--out", default="runs/shield", metavar="DIR")
    given = parser.parse_args()
    scenes, rates = given.scenes.split(","), [float(rate) for rate in given.rates.split(",")]
    folder = Path(given.out)
    weights = {scene: WEIGHTS.get(scene, 3) for scene in scenes}
    share = sum(weight for scene, weight in weights.items() if scene not in APART) or 1
    unit = given.attacks / (ROWS * EACH * len(rates) * share)  # chunks of a weight of 1
    chunks = [
        (scene, rate, given.first_seed + k * ROWS)
        for scene, weight in weights.items()
        for rate in rates
        for k in range(max(1, math.ceil(unit * weight - 1e-9)))
    ]
    options = {"faults": given.faults, "threads": given.threads, "rear": given.rear}

    @lru_cache(1)
    def attack(scene: str, rate: float) -> Attack:
        return Attack(scene, ROWS, given.shield == "on", rate=rate, **options)

    def run(chunk: tuple[str, float, int]) -> dict[str, object]:
        scene, rate, seed = chunk
        return vars(attack(scene, rate).run(seed, EACH))

    asked = [given.shield, given.faults, given.rear]
    jobs = {run_key(source_digest(), *chunk, *asked): chunk for chunk in chunks}
    found = compute(jobs, run, folder / f"attacks-{given.shield}.jsonl", unit="chunk")
    whole, own = Report(), {scene: Report() for scene in scenes}
    for (scene, *_), told in zip(chunks, found.values(), strict=True):
        report = Report(**(told | {"events": [Event(*event) for event in told["events"]]}))
        for total in (own[scene], *([] if scene in APART else [whole])):
            total.add(report)
    per_scene = {scene: summary(report) for scene, report in own.items()}
    apart = {scene: report for scene, report in own.items() if scene in APART}
    result = summary(whole) | {"scenes": per_scene}
    result["provenance"] = {
        "commit": commit(), "machine": machine(), "first_seed": given.first_seed,
        "faults": given.faults, "shield": given.shield, "rates": rates, "rear": given.rear,
    }  # fmt: skip
    write_json(folder / f"attacks-{given.shield}.json", result)
    print(table(whole))
    print(
        f"{result['attacks']} attacks, {result['contacts']} contacts of any kind; caused by the "
        f"chair above {HARM:g} m/s: {result['harmful']} with what could have been seen, "
        f"{result['unseen']} with what could not, at {result['unseen_fastest']:.3f} m/s at most; "
        f"seeds {given.first_seed} and on, sensors of {given.faults:g} of them fail"
    )
    print(bounds(whole))
    for event in whole.events:
        if event.seen:
            print("  ", event)
    for scene, report in apart.items():
        print(f"Counted apart, {scene}:\n{table(report)}")
        print(bounds(report))
    return 0 if result["harmful"] == 0 and result["unseen_fastest"] <= SLOW else 1


def summary(report: Report) -> dict[str, object]:
    blind = [event.closing for event in report.events if not event.seen]
    return {
        "attacks": report.attacks,
        "contacts": report.contacts,
        "harmful": sum(event.seen for event in report.events),
        "unseen": len(blind),
        "unseen_fastest": max(blind, default=0.0),
        "reasons": report.reasons,
        "cells": report.cells,
    }


def bounds(report: Report) -> str:
    """Return 95 % bounds of the share of harmful attacks, from those that did harm."""
    harmful = len({(e.seed, e.episode, e.cell) for e in report.events if e.seen})
    low, high = wilson(harmful, report.attacks)
    told = f"harmful: {harmful} of {report.attacks}, Wilson's 95 %: {low:.2g} to {high:.2g}"
    if report.attacks and not harmful:
        told += f"; rule of three: below {3.0 / report.attacks:.2g}"
    return told


def table(report: Report) -> str:
    """Attacks by kind, by rate and by mass, and by all three: counts and the fastest contacts."""
    lines = [
        f"{'kind, rate [Hz], mass [kg]':<34}{'attacks':>9}{'contacts':>10}{'harmful':>9}"
        f"{'fastest':>9}{'unseen':>8}{'fastest':>9}"
    ]
    groups: dict[str, list[str]] = {}
    for cell in report.cells:
        kind, rate, mass = cell.split(",")
        for name in (f"{kind}", f"{rate} Hz", f"{mass} kg", f"{kind}, {rate} Hz, {mass} kg"):
            groups.setdefault(name, []).append(cell)
    order = sorted(groups, key=lambda name: (name.count(","), name[0].isdigit(), _natural(name)))
    for name in order:
        cells = set(groups[name])
        attacks = sum(report.cells[cell][0] for cell in cells)
        contacts = sum(report.cells[cell][1] for cell in cells)
        events = [event for event in report.events if event.cell in cells]
        seen = [event.closing for event in events if event.seen]
        blind = [event.closing for event in events if not event.seen]
        lines.append(
            f"{name:<34}{attacks:>9}{contacts:>10}{len(seen):>9}{max(seen, default=0.0):>9.3f}"
            f"{len(blind):>8}{max(blind, default=0.0):>9.3f}"
        )
    return "\n".join(lines)


def _natural(name: str) -> list[tuple[str, float]]:
    """Return a key that sorts names by the numbers in them."""
    words = name.replace("-", " ").replace(",", " ").split()
    return [("", float(word)) if word[0].isdigit() else (word, 0.0) for word in words]


if __name__ == "__main__":
    try:
        sys.exit(main())
    except StoppedError as error:
        print(f"stopped; {error}; the same command goes on", file=sys.stderr)
        sys.exit(130)
