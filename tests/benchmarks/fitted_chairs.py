"""Does it matter that the simulation is fitted to the chair? The plan stands in docs/studies.

`python -m tests.benchmarks.fitted_chairs FOLDER [SEEDS]` fits eight hidden chairs, trains, drives
and prints; it can be stopped and continued. Hidden chairs are the first of
`tests.benchmarks.identification`; the delay of their scans is that of their commands, too.
"""

import dataclasses
import math
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np

from agents.evaluation.evaluate import evaluate
from agents.evaluation.metrics import Record
from agents.evaluation.statistics import holm, mcnemar, wilson
from agents.learning.run import train
from agents.learning.settings import recipe
from tests.benchmarks.identification import HIDDEN, hidden_chair, true_settings
from tests.identification import drives
from wheelchair_gym.base.settings import dump
from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.identification.fit import Fit, fit
from wheelchair_gym.identification.predict import plant_for
from wheelchair_gym.safety.state import SPARE
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.randomization import Randomization, exactly
from wheelchair_gym.sim.settings import ChairSettings, PhysicsSettings

CHAIRS: Final = 8
SCENES: Final = ("doorway", "skill", "floor_plan")
FRAMES: Final = 1_000_000  # of each fine-tuning, from the shipped weights
PLANNER_SEEDS: Final = 30  # at most, of each scene
ON_BOARDS: Final = 2  # of the chairs, whose commands and scans are not late there
BOARD_SEEDS: Final = 50  # at most, of `doorway`
LONGEST_DELAY: Final = 0.12  # s, of commands in wide ranges
FIRST_SEED: Final = 7_000


def found_chair(number: int) -> Fit:
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


def on_boards(number: int, chair: ChairSettings, sensors: SensorSettings) -> dict[str, Any]:
    """An environment in which emulated boards drive a hidden chair with believed settings."""
    hidden = hidden_chair(number)
    true, whole = drives.truth(hidden), true_settings(hidden)
    plant = {
        "chair": {name: dump(getattr(whole, name)) for name in ("drive", "body", "battery")},
        "sensors": {"laser": {name: true[name] for name in ("x", "y", "yaw", "offset", "sigma")}},
        "physics": {name: hidden[name] for name in ("slope", "downhill")},
    }
    plant["chair"]["motor"] = {"gain": whole.motor.gain}
    config = EnvSettings(
        rate=5.0, chair=chair, sensors=dataclasses.replace(sensors, pose_source="mcl")
    )
    return {"config": dump(config), "chair": {"name": "twin", "plant": plant}}


def compare_boards(number: int, of: str, believed: Any, folder: Path, drives: int) -> None:
    """Print success and time of the shipped weights on emulated boards, and in simulation.

    Boards have a shield. A simulated one would know, and keep as margin, what is hidden.
    """
    simulated = environment(number, *believed)
    simulated["sensors"]["pose_source"] = "mcl"
    rows = simulated["chair"]["randomization"]
    simulated["chair"]["randomization"] = [r for r in rows if r["quantity"] != "command_delay"]
    for where, env in (
        ("boards", on_boards(number, *believed)), ("simulated", {"config": simulated}),
    ):  # fmt: skip
        records = driven("ppo_guided", ("doorway",), drives, env, folder)
        good = [one["time"] for one in records if one["success"] and not one["contact"]]
        time = f", {np.mean(good):.1f} s" if good else ""
        print(f"chair {number}  {where:9} {of:8} {len(good)} of {drives}{time}")


def driven(policy: str, scenes: Any, n: int, env: dict[str, Any], folder: Path) -> list[Record]:
    seeds = range(FIRST_SEED, FIRST_SEED + n)
    return evaluate([policy], scenes, seeds, env=env, folder=folder, jobs=2, progress=False)


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
    folder, seeds = Path(words[0]), int(words[1]) if len(words) > 1 else 100
    of_all = {of: trained(of, folder / of) for of in ("default", "wide")}
    outcomes: dict[str, dict[Any, bool]] = {}  # by chair, scene and seed
    for number in range(CHAIRS):
        found, place = found_chair(number), folder / f"chair_{number}"
        weights = of_all | {of: trained(of, place / of, found) for of in ("point", "posterior")}
        beliefs = {
            "default": (drives.CHAIR, drives.SENSORS), "fitted": (found.chair, found.sensors),
        }  # fmt: skip
        arms = [("shipped", "ppo_guided", belief) for belief in beliefs]
        arms += [("planner", "lattice+window", belief) for belief in beliefs]
        arms += [(of, weights[of], "default") for of in of_all]
        arms += [(of, weights[of], "fitted") for of in ("point", "posterior")]
        for arm, policy, belief in arms:
            n = min(seeds, PLANNER_SEEDS) if arm == "planner" else seeds
            env = {"config": environment(number, *beliefs[belief])}
            records = driven(policy, SCENES, n, env, place)
            good = {
                (number, one["scene"], one["seed"]): one["success"] and not one["contact"]
                for one in records
            }
            outcomes.setdefault(f"{arm}, {belief}", {}).update(good)
            print(f"chair {number}  {arm:10} {belief:8} {np.mean(list(good.values())):7.1%}")
        for belief, believed in beliefs.items():
            if number < ON_BOARDS:
                compare_boards(number, belief, believed, place, min(seeds, BOARD_SEEDS))
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
