"""`wheelchair dataset`: episodes of a policy as a data set for offline learning."""

from __future__ import annotations

import argparse

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
    text = f"{found['episodes']} episodes, {found['steps']} steps, {found['successes']} successes"
    where = f"MINARI_DATASETS_PATH={given.out}; minari.load_dataset({given.name!r})"
    report(given, found, f"{text}: {found['folder']}\nread it with {where}")
    return 0
