"""Data sets of episodes for offline learning, in Minari's format (Younis et al. 2024).

They hold drives of a policy, or recorded drives: the simulator's, the studio's, a real chair's.
"""

from __future__ import annotations

import os
import re
import sys
import warnings
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from agents import is_interrupt
from agents.evaluation.evaluate import make_env
from agents.evaluation.provenance import command_line
from agents.policies import GymPolicy, make_policy
from wheelchair_gym.base.settings import InputError

ABOUT: dict[str, Any] = {"ref_min_score": 0.0, "requirements": ["wheelchair_gym"]}
_STORED_AT_ONCE = 50  # episodes that are held in memory
_NAME = re.compile(r"([\w-]{2,}/)*[\w-]+-v\d+")


def write_dataset(
    name: str,
    policy: Any,
    scene: Any,
    env: Mapping[str, Any],
    seeds: Sequence[int],
    folder: str | Path,
    progress: bool = True,
) -> dict[str, Any]:
    """Drive episodes of training worlds and write them as a Minari data set.

    Ctrl-C keeps those driven so far.

    Args:
        name: of the data set, such as `wheelchair/homes-v0`.
        policy: spec for `make_policy`.
        scene: spec for `make_scene`.
        env: further settings of the environment.
        seeds: of the episodes.
        folder: where data sets lie; `minari` finds them there by MINARI_DATASETS_PATH.
        progress: show a bar on standard error.

    Returns:
        Name, folder, and how many episodes and steps it has and how many succeeded.

    Raises:
        InputError: Minari is not installed, or the name is taken or malformed.
    """
    prepare(name, Path(folder))
    world = make_env(scene, {"split": "train", **env}, None)
    driver = GymPolicy(make_policy(policy), world)
    about = {
        "env": world,
        "algorithm_name": str(policy),
        "description": f"{policy} on {scene}; made by: {command_line()}",
    } | ABOUT
    found = {"episodes": 0, "steps": 0, "successes": 0}
    waiting: list[Any] = []
    stored: Any = None
    try:
        with tqdm(total=len(seeds), unit="episode", disable=not progress) as bar:
            for seed in seeds:
                waiting.append(_drive(world, driver, seed, found))
                bar.update()
                if len(waiting) == _STORED_AT_ONCE:
                    stored = store(stored, name, waiting, about)
    except (KeyboardInterrupt, SystemError) as error:
        if not is_interrupt(error) or not found["episodes"]:
            raise
        print(f"wheelchair: stopped after {found['episodes']} episodes", file=sys.stderr)
    finally:
        if waiting:
            store(stored, name, waiting, about)
        world.close()
    return {"name": name, "folder": str(Path(folder) / name), **found}


def prepare(name: str, folder: Path) -> None:
    """Check the name of a new data set, and make the folder, where Minari is to look for it.

    Raises:
        InputError: Minari is not installed, or the name is taken or malformed.
    """
    if find_spec("minari") is None or find_spec("h5py") is None:
        raise InputError("data sets need minari; pip install 'wheelchair_gym[dataset]'")
    if _NAME.fullmatch(name) is None:
        rule = "letters, digits, _ and -, after parts of two or more and /, and -v0, ... at the end"
        raise InputError(f"{name!r}: expected a name such as wheelchair/homes-v0: {rule}")
    place = folder / name
    if place.exists():
        raise InputError(f"{place} exists; expected a new name or version of a data set")
    os.environ["MINARI_DATASETS_PATH"] = str(folder.resolve())
    folder.mkdir(parents=True, exist_ok=True)


def _drive(world: Any, driver: GymPolicy, seed: int, found: dict[str, int]) -> Any:
    """An episode as Minari keeps one, and its metadata."""
    from minari.data_collector import EpisodeBuffer

    space: Any = world.action_space
    observation, info = world.reset(seed=seed)
    driver.reset()
    observations, steps = [observation], []
    over = False
    while not over:
        action = np.clip(driver.act(observation), space.low, space.high).astype(np.float32)
        observation, reward, terminated, truncated, info = world.step(action)
        observations.append(observation)
        steps.append((action, reward, terminated, truncated))
        over = terminated or truncated
    columns = map(np.array, zip(*steps, strict=True))
    actions, rewards, terminations, truncations = columns
    found["steps"] += len(steps)
    found["successes"] += bool(info["is_success"])
    found["episodes"] += 1
    episode = EpisodeBuffer(
        seed=seed,
        observations={key: np.array([each[key] for each in observations]) for key in observation},
        actions=actions,
        rewards=rewards,
        terminations=terminations,
        truncations=truncations,
    )
    return episode, {"success": bool(info["is_success"])}


def store(stored: Any, name: str, episodes: list[Any], about: dict[str, Any]) -> Any:
    """Add episodes and their metadata to a data set, or make it of them; then the list is empty."""
    import minari

    buffers, metadata = map(list, zip(*episodes, strict=True))
    if stored is None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of authors and links, which it lacks
            stored = minari.create_dataset_from_buffers(name, buffers, **about)
    else:
        stored.update_dataset_from_buffer(buffers)
    first = stored.storage.total_episodes - len(buffers)
    stored.storage.update_episode_metadata(metadata, range(first, first + len(buffers)))
    episodes.clear()
    return stored
