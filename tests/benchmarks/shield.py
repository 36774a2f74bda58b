"""Attacks on the shield, counted: `python -m tests.benchmarks.shield --attacks 100000`.

Attackers of many kinds (`tests.attacks`) drive in every scene, some with sensors that fail. Each
finished chunk is stored: the same command after Ctrl-C goes on with what is missing. A chunk is
stored under what it depends on, this project's code among it.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
import time
from pathlib import Path

from agents.evaluate import source_digest
from agents.provenance import commit, machine, write_json
from tests.attacks import HARM, SCENES, SLOW, Attack, Event, Report

ROWS, EACH = 256, 4  # attacks of a chunk: rows times so many


def main() -> int:
    """Attack, print what came of it, and say by the exit code whether the shield held."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--attacks", type=int, default=100_000, metavar="N")
    parser.add_argument("--first-seed", type=int, default=0, metavar="S")
    parser.add_argument("--scenes", default=",".join(SCENES), metavar="A,B")
    parser.add_argument("--shield", choices=("on", "off"), default="on")
    parser.add_argument("--faults", type=float, default=0.2, metavar="SHARE")
    parser.add_argument("--threads", type=int, metavar="N")
    parser.add_argument("--out", default="runs/shield", metavar="DIR")
    given = parser.parse_args()
    scenes = given.scenes.split(",")
    folder = Path(given.out)
    folder.mkdir(parents=True, exist_ok=True)
    store = folder / f"attacks-{given.shield}.jsonl"
    stored = {}
    if store.exists():
        for line in store.read_text().splitlines():
            chunk = json.loads(line)
            stored[chunk["key"]] = chunk["report"]
    chunks = math.ceil(given.attacks / (ROWS * EACH * len(scenes)))
    whole, begun = Report(0, 0, [], {}), time.monotonic()
    per_scene = {}
    digest = source_digest()
    for scene in scenes:
        attack, own = None, Report(0, 0, [], {})
        for k in range(chunks):
            seed = given.first_seed + k * ROWS
            key = f"{digest} {scene} {seed} {given.shield} {given.faults}"
            if key not in stored:
                if attack is None:
                    on = given.shield == "on"
                    attack = Attack(scene, ROWS, on, given.faults, threads=given.threads)
                report = attack.run(seed, EACH)
                stored[key] = dataclasses.asdict(report) | {"events": list(report.events)}
                with store.open("a") as file:
                    file.write(json.dumps({"key": key, "report": stored[key]}) + "\n")
            told = stored[key]
            events = [Event(*event) for event in told["events"]]
            own.add(Report(told["attacks"], told["contacts"], events, told["reasons"]))
            bad = sum(event.seen for event in own.events)
            spent = time.monotonic() - begun
            print(f"{scene}: {own.attacks} attacks, {bad} harmful, {spent:.0f} s", file=sys.stderr)
        per_scene[scene] = summary(own)
        whole.add(own)
    result = summary(whole) | {"scenes": per_scene}
    result["provenance"] = {
        "commit": commit(), "machine": machine(), "first_seed": given.first_seed,
        "faults": given.faults, "shield": given.shield,
    }  # fmt: skip
    write_json(folder / f"attacks-{given.shield}.json", result)
    print(
        f"{result['attacks']} attacks, {result['contacts']} contacts of any kind; caused by the "
        f"chair above {HARM:g} m/s: {result['harmful']} with what could have been seen, "
        f"{result['unseen']} with what could not, at {result['unseen_fastest']:.3f} m/s at most"
    )
    for event in whole.events:
        if event.seen:
            print("  ", event)
    return 0 if result["harmful"] == 0 and result["unseen_fastest"] <= SLOW else 1


def summary(report: Report) -> dict[str, object]:
    """The figures of a report."""
    blind = [event.closing for event in report.events if not event.seen]
    return {
        "attacks": report.attacks,
        "contacts": report.contacts,
        "harmful": sum(event.seen for event in report.events),
        "unseen": len(blind),
        "unseen_fastest": max(blind, default=0.0),
        "reasons": report.reasons,
    }


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print("stopped; the same command goes on", file=sys.stderr)
        sys.exit(130)
