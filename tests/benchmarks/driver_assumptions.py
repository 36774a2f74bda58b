"""Effect of the settings of simulated people for which no published value was found.

`python -m tests.benchmarks.driver_assumptions [--drives N]`: each such setting is driven at both
ends of its plausible range and at its default, N times in homes with the shield alone and with an
assistant, in the same worlds; the others stay. A table states the successes, and whether the
assistant helps at each value. Drives are stored as in `assisted_drives`, so that a run that was
ended goes on.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import numpy as np

from agents.evaluation.statistics import mean_interval
from agents.evaluation.tables import markdown_table
from tests.benchmarks.assisted_drives import parse, run

# A driver, a setting of it, and the ends of the range that counts as plausible.
ASSUMED = [
    ("expert", "intention.period", 0.3, 0.5),
    ("expert", "intention.patience", 1.5, 6.0),
    ("expert", "intention.retreat", 0.75, 3.0),
    ("expert", "intention.adaptation", 1.0, 4.0),
    ("novice", "intention.indecision", 0.1, 0.5),
    ("novice", "perception.anticipation", 0.3, 1.0),
    ("ataxia", "perception.reaction", 0.4, 1.0),
    ("ataxia", "hand.tremor", 0.1, 0.35),
    ("weak_left", "hand.leftward", 0.3, 0.7),
    ("hemineglect", "perception.noticed", 0.1, 0.5),
    ("inattentive", "perception.lapses", 1.0, 3.0),
    ("wavering", "intention.mind_changes", 1.0, 4.0),
    ("sip_and_puff", "interface.delay", 0.15, 0.6),
    ("sip_and_puff", "interface.error", 0.0, 0.1),
]


def difference(helped: Sequence[bool], alone: Sequence[bool]) -> str:
    """Points of success that help brings, over pairs, with a 95 % interval."""
    mean, low, high = mean_interval(100.0 * (np.array(helped, float) - np.array(alone, float)))
    return f"{mean:+.0f} ({low:+.0f} to {high:+.0f})"


def main() -> int:
    """Drive, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    given = parse(parser, drives=50, out="runs/driver_assumptions/drives.jsonl")
    given.scenes, given.assist, given.no_expert = ["home"], ["shield", "shared_dwa"], True
    values = [
        (driver, setting, [f"{driver}+{setting}={low}", driver, f"{driver}+{setting}={high}"])
        for driver, setting, low, high in ASSUMED
    ]
    given.drivers = list(dict.fromkeys(name for *_, three in values for name in three))
    found = run(given)
    heads = ("driver", "setting", "value", "`shield` [%]", "`shared_dwa` [%]",
             "help [points] (95 %)")  # fmt: skip
    rows = []
    for driver, setting, three in values:
        for name in three:
            alone, helped = (
                [one["success"] for key, one in found.items() if key[0] == name and key[2] == how]
                for how in given.assist
            )
            value = name.partition("=")[2] or "default"
            shares = (f"{100 * np.mean(each):.0f}" for each in (alone, helped))
            rows.append([
                f"`{driver}`", f"`{setting}`", value, *shares, difference(helped, alone),
            ])  # fmt: skip
    print(markdown_table(heads, rows, [False] * 3 + [True] * 3))
    return 0


if __name__ == "__main__":
    sys.exit(main())
