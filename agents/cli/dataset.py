"""`wheelchair dataset`: episodes of a policy as a data set for offline learning."""

from __future__ import annotations

import argparse
import shlex

from agents.cli.arguments import env_of, map_scenes, report, spec
from wheelchair_gym.config import InputError


def write(given: argparse.Namespace) -> int:
    """Drive the episodes, and write the data set."""
    from agents.learning.dataset import write_dataset

    scene = spec(given.scene or "floor_plan")
    if maps := map_scenes(given):
        if given.scene is not None:
            raise InputError("--map and --scene: expected one of them")
        (scene,) = maps
        del scene["label"]
    seeds = range(given.first_seed, given.first_seed + given.episodes)
    found = write_dataset(
        given.name, spec(given.policy), scene, env_of(given), seeds, given.out, not given.quiet
    )
    counts = (found["episodes"], "episode"), (found["steps"], "step")
    text = ", ".join(f"{count} {name}{'' if count == 1 else 's'}" for count, name in counts)
    where = f"export MINARI_DATASETS_PATH={shlex.quote(given.out)}"
    load = f"python -c \"import minari; print(minari.load_dataset('{given.name}'))\""
    arrived = f"{found['successes']} successful"
    report(given, found, f"{text}, {arrived}: {found['folder']}; read it with\n{where}\n{load}")
    return 0
