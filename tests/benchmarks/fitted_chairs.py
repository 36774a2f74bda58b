"""Does it matter that the simulation is fitted to the chair? The plan stands in docs/studies.

`python -m tests.benchmarks.fitted_chairs FOLDER [SEEDS]` fits eight hidden chairs, trains, drives
and prints; it can be stopped and continued. Hidden chairs are the first of
`tests.benchmarks.identification`; the delay of their scans is that of their commands, too.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np

from agents.evaluation.evaluate import evaluate
from agents.evaluation.statistics import holm, mcnemar, wilson
from agents.learning.run import train
from agents.learning.settings import recipe
from tests.benchmarks.identification import HIDDEN, hidden_chair, true_settings
from tests.identification import drives
from wheelchair_gym.base.settings import dump
from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.identification.fit import Fit, fit
from wheelchair_gym.identification.predict import plant_for
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.randomization import Randomization, exactly
from wheelchair_gym.sim.settings import ChairSettings, PhysicsSettings

CHAIRS: Final = 8
SCENES: Final = ("doorway", "skill", "floor_plan")
FRAMES: Final = 1_000_000  # of each fine-tuning, from the shipped weights
PLANNER_SEEDS: Final = 30  # at most, of each scene
LONGEST_DELAY: Final = 0.12  # s, of commands in wide ranges
FIRST_SEED: Final = 7_000
SPARE: Final = 1.2  # a shielded chair must brake harder than its limits ask by this factor


def found_chair(number: int) -> Fit:
    """The fit of one log of a hidden chair."""
    log = drives.drive(hidden_chair(number)).log
    return fit([(f"chair {number}", log)], drives.CHAIR, drives.SENSORS)


def environment(number: int, chair: ChairSettings, sensors: SensorSettings) -> dict[str, Any]:
    """Settings of an environment of a hidden chair whose computer believes these settings."""
    hidden = hidden_chair(number)
    true = drives.truth(hidden)
    believed = sensors.laser
    errors = {
        "laser.sigma": true["sigma"],
        "laser.bias": 0.0,
        "laser.dropout": drives.LASER.dropout,
        "laser.x_error": true["x"] - believed.x,
        "laser.y_error": true["y"] - believed.y,
        "laser.yaw_error": true["yaw"] - believed.yaw,
        "laser.offset_error": true["offset"] - believed.offset,
        "command_delay": hidden["delay"],
    }
    plant = plant_for(true_settings(hidden), chair)
    config = EnvSettings(
        rate=5.0,
        chair=dataclasses.replace(plant, randomization=plant.randomization + exactly(errors)),
        sensors=dataclasses.replace(sensors, pose_source="modelled"),
        physics=PhysicsSettings(slope=hidden["slope"], downhill=hidden["downhill"]),
    )
    return dump(config)


def training_env(of: str, found: Fit | None) -> EnvSettings:
    """The training environment of an arm: that of the shipped weights with another chair."""
    base = recipe("ppo").env_settings()
    if of == "wide":
        ranges = HIDDEN | {"command_delay": (0.0, LONGEST_DELAY)}
        rows: Any = [
            Randomization(name, low=low, high=high)  # type: ignore[arg-type]
            for name, (low, high) in ranges.items()
            if name != "delay"
        ]
        chair = dataclasses.replace(base.chair, randomization=tuple(rows), randomize=False)
        return dataclasses.replace(base, chair=chair)
    if found is None:
        return base
    sensors = dataclasses.replace(found.sensors, pose_source=base.sensors.pose_source)
    chair = dataclasses.replace(found.chair, randomize=of == "posterior")
    if of == "posterior":
        chair = dataclasses.replace(chair, joint=found.joint)
        stop = min(chair.limits.protective, math.floor(10 * chair.braking / SPARE) / 10)
        chair = dataclasses.replace(
            chair, limits=dataclasses.replace(chair.limits, protective=stop)
        )
    return dataclasses.replace(base, chair=chair, sensors=sensors)


def trained(of: str, folder: Path, found: Fit | None = None) -> str:
    """Fine-tune the shipped weights; the file of the result."""
    env = training_env(of, found)
    config = dataclasses.replace(
        recipe("ppo"), env=dump(env), frames=FRAMES, warm_start="ppo_guided"
    )
    train(config, 0, folder)
    return str(folder / "policy.npz")


def main(words: list[str]) -> None:
    """Fit, train, drive and print."""
    folder, seeds = Path(words[0]), int(words[1]) if len(words) > 1 else 100
    of_all = {of: trained(of, folder / of) for of in ("default", "wide")}
    outcomes: dict[str, dict[Any, bool]] = {}  # by chair, scene and seed
    for number in range(CHAIRS):
        found, place = found_chair(number), folder / f"chair_{number}"
        weights = of_all | {of: trained(of, place / of, found) for of in ("point", "posterior")}
        beliefs = {
            "default": environment(number, drives.CHAIR, drives.SENSORS),
            "fitted": environment(number, found.chair, found.sensors),
        }
        arms = [("shipped", "ppo_guided", belief) for belief in beliefs]
        arms += [("planner", "lattice+window", belief) for belief in beliefs]
        arms += [(of, weights[of], "default") for of in of_all]
        arms += [(of, weights[of], "fitted") for of in ("point", "posterior")]
        for arm, policy, belief in arms:
            n = min(seeds, PLANNER_SEEDS) if arm == "planner" else seeds
            records = evaluate(
                [policy], SCENES, range(FIRST_SEED, FIRST_SEED + n),
                env={"config": beliefs[belief]}, folder=place, jobs=2, progress=False,
            )  # fmt: skip
            good = {
                (number, one["scene"], one["seed"]): one["success"] and not one["contact"]
                for one in records
            }
            outcomes.setdefault(f"{arm}, {belief}", {}).update(good)
            print(f"chair {number}  {arm:10} {belief:8} {np.mean(list(good.values())):7.1%}")
    _print(outcomes)


def _print(outcomes: dict[str, dict[Any, bool]]) -> None:
    """Print shares with intervals, and tests against the shipped weights with default settings."""
    base = outcomes["shipped, default"]
    others = [name for name in outcomes if name != "shipped, default"]
    tests = [
        mcnemar(list(outcomes[name].values()), [base[key] for key in outcomes[name]])[2]
        for name in others
    ]
    tested = dict(zip(others, holm(tests), strict=True))
    for name, of in outcomes.items():
        good, n = sum(of.values()), len(of)
        low, high = wilson(good, n)
        against = f"p {tested[name]:.3g}" if name in tested else ""
        print(f"{name:20} {good / n:7.1%} ({low:.1%} to {high:.1%})  n {n}  {against}")


if __name__ == "__main__":
    main(sys.argv[1:])
