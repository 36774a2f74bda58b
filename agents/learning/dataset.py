"""Data sets of episodes for offline learning, in Minari's format (Younis et al. 2024).

They hold drives of a policy, or recorded drives: the simulator's, the studio's, a real chair's.
"""

import os
import re
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from shutil import rmtree
from typing import Any

import gymnasium
import numpy as np
from tqdm import tqdm

from agents import is_interrupt
from agents.evaluation.evaluate import ENV, make_env
from agents.evaluation.provenance import command_line
from agents.policies import GymPolicy, make_policy
from wheelchair_gym.base.settings import InputError, dump
from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.envs.guidance import make_guidance
from wheelchair_gym.envs.settings import read_env_settings
from wheelchair_gym.envs.world_banks import prepare_world
from wheelchair_gym.recording.replay import RecordedEpisode, read_recording, replay_env
from wheelchair_gym.task.task import Task

CHOSEN = ("task", "guidance")  # settings of the observation, which need not be those recorded
_SAME = ("rate", "chair", "sensors", "task", "guidance", "physics")  # in one data set
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
    _prepare(name, Path(folder))
    world = make_env(scene, {"split": "train", **env}, None)
    driver = GymPolicy(make_policy(policy), world)
    about = _about(world, str(policy), f"{policy} on {scene}")
    found = {"episodes": 0, "steps": 0, "successes": 0}
    waiting: list[Any] = []
    stored: Any = None
    try:
        with tqdm(total=len(seeds), unit="episode", disable=not progress) as bar:
            for seed in seeds:
                waiting.append(_drive(world, driver, seed, found))
                bar.update()
                if len(waiting) == _STORED_AT_ONCE:
                    stored = _store(stored, name, waiting, about)
    except (KeyboardInterrupt, SystemError) as error:
        if not is_interrupt(error) or not found["episodes"]:
            raise
        print(f"wheelchair: stopped after {found['episodes']} episodes", file=sys.stderr)
    finally:
        if waiting:
            _store(stored, name, waiting, about)
        world.close()
    return {"name": name, "folder": str(Path(folder) / name), **found}


def _prepare(name: str, folder: Path) -> None:
    """Check Minari and the name of a new data set, and make the folder, where Minari is to look."""
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


def _about(env: Any, algorithm: str, contents: str) -> dict[str, Any]:
    """Return the description of a data set, with an environment of its settings."""
    return {
        "env": env,
        "algorithm_name": algorithm,
        "description": f"{contents}; made by: {command_line()}",
        "ref_min_score": 0.0,
        "requirements": ["wheelchair_gym"],
    }


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
    names = ("actions", "rewards", "terminations", "truncations")
    columns = dict(zip(names, map(np.array, zip(*steps, strict=True)), strict=True))
    success = bool(info["is_success"])
    found["steps"] += len(steps)
    found["successes"] += success
    found["episodes"] += 1
    seen = {key: np.array([each[key] for each in observations]) for key in observation}
    return EpisodeBuffer(seed=seed, observations=seen, **columns), {"success": success}


def _store(stored: Any, name: str, episodes: list[Any], about: dict[str, Any]) -> Any:
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


def write_recorded(
    name: str, sources: Sequence[str | Path], chosen: Mapping[str, Any], folder: str | Path
) -> dict[str, Any]:
    """Write recorded drives as a Minari data set.

    Observations are those of a policy, computed again from the recorded readings: they hold the
    goal also where a person drove. Actions are what the policy or the person's assistant made,
    before the shield; rewards and ends are as recorded, and a drive that a person ended is
    truncated at its last step. Further arrays of an episode of n steps
    (Minari's `infos`): `stick` (n, 3), the person's deflections forward and to the left, and 1 if
    they last by themselves, NaN without a person; `asked` and `given` (n, 2) m/s, rad/s, before and
    after the shield; `intervened` (n,), where they differ. Metadata of an episode: `file`,
    `number` in the file, `split`, `success`, `driver` (policy, person or simulated person), and
    labels such as `assistant` and `interface`.

    Args:
        name: of the data set, such as `wheelchair/mine-v0`.
        sources: recordings, and folders that are searched for them.
        chosen: settings of `task` and `guidance` in place of the recorded ones.
        folder: where data sets lie.

    Returns:
        Name, folder, how many episodes and steps it has, how many succeeded, how many are of `test`
        worlds; `unread`, a line for each file that could not be read; `empty`, how many drives had
        no step.

    Raises:
        InputError: Minari is not installed, the name is taken or malformed, nothing was found or
            could be read, or recordings differ in what one data set shares.
    """
    _prepare(name, Path(folder))
    counts = dict.fromkeys(("episodes", "steps", "successes", "test", "empty"), 0)
    found: dict[str, Any] = {**counts, "unread": []}
    stored = first = None
    for file in recordings_in(sources):
        try:
            chapters = read_recording(file)
        except InputError as error:
            found["unread"].append(str(error))
            print(f"wheelchair: not read: {error}", file=sys.stderr)
            continue
        for number, recorded in enumerate(chapters):
            if not recorded.actions:
                found["empty"] += 1
                continue
            settings = settings_of(recorded, chosen)
            if first is None:
                world = gymnasium.make(ENV, config=dump(settings))
                of = f"recordings of {', '.join(map(str, sources))}"
                first = file, settings, _about(world, "recordings", of)
            elif differ := [k for k in _SAME if getattr(settings, k) != getattr(first[1], k)]:
                rmtree(Path(folder) / name)  # which holds a part only
                raise InputError(
                    f"{file}: episode {number} differs in {differ[0]} from {first[0]}; expected "
                    f"recordings of the same {', '.join(_SAME)} in one data set"
                )
            episode, success = _recorded_episode(recorded, settings)
            labels = {key: str(told) for key, told in recorded.labels.items()}
            person = "person" if recorded.settings.driver is None else "simulated person"
            who = person if recorded.has_person else "policy"
            metadata = {"file": str(file), "number": number, "split": recorded.split}
            metadata |= {"success": success, "driver": who}
            stored = _store(stored, name, [(episode, labels | metadata)], first[2])
            found["test"] += recorded.split == "test"
            found["episodes"] += 1
            found["steps"] += len(recorded.actions)
            found["successes"] += success
    if stored is None:
        raise InputError(f"{' '.join(map(str, sources))}: expected recordings that can be read")
    return {"name": name, "folder": str(Path(folder) / name), **found}


def recordings_in(sources: Sequence[str | Path]) -> Iterator[Path]:
    """The recordings among paths, and in folders and their folders, in order of their names.

    Raises:
        InputError: a path does not exist.
    """
    for path in map(Path, sources):
        if not path.exists():
            raise InputError(f"{path}: no such file or folder; expected recordings")
        if not path.is_dir() or (path / "metadata.yaml").exists():
            yield path
        else:
            bags = {file.parent for file in path.rglob("metadata.yaml")}
            files = {file for file in path.rglob("*.mcap") if file.parent not in bags}
            yield from sorted(bags | files)


def settings_of(recorded: RecordedEpisode, chosen: Mapping[str, Any]) -> EnvSettings:
    """The settings of a recorded episode as a policy would drive it, with others in their place."""
    guidance = "geodesic" if isinstance(recorded.path, np.ndarray) else recorded.path
    kept = dump(recorded.settings) | {"driver": None, "assistant": None, "guidance": guidance}
    return read_env_settings({**kept, **chosen}, "settings")


def _recorded_episode(recorded: RecordedEpisode, settings: EnvSettings) -> tuple[Any, bool]:
    """An episode as Minari keeps one, and whether it was a success."""
    from minari.data_collector import EpisodeBuffer

    env = replay_env(recorded)
    _, info = env.reset(seed=0, options={"episode": recorded.episode})
    limits, sensors, shield = env.task.limits, env.settings.sensors, recorded.settings.shield
    seen_by = Task(
        settings.task, settings.chair, sensors, env.task.period, make_guidance(settings.guidance),
        shield, has_driver=False,
    )  # fmt: skip
    seen_by.built_map = env.task.built_map
    prepared = prepare_world(seen_by, recorded.episode)
    observations = [seen_by.begin(prepared, env.task.reading, 0, shield is not None)]
    columns: dict[str, list[Any]] = {"stick": [], "asked": [], "given": [], "intervened": []}
    actions = []
    for action in recorded.actions:
        stick = env.task.stick
        columns["stick"].append([np.nan] * 3 if stick is None else list(stick))
        *_, info = env.step(action)
        answer, less = env.task.action, env.task.shield_intervention
        observations.append(seen_by.assess(env.task.reading, answer, less))
        actions.append(answer)
        asked = limits.twist(np.clip(answer, -1.0, 1.0))
        columns["asked"].append(asked)
        columns["given"].append(asked - less)
        columns["intervened"].append(any(less))
    env.close()
    last = recorded.verdicts[-1]
    last["truncated"] |= not last["terminated"]
    names = {"rewards": "reward", "terminations": "terminated", "truncations": "truncated"}
    buffer = EpisodeBuffer(
        seed=recorded.seed,
        observations={k: np.array([each[k] for each in observations]) for k in seen_by.spaces},
        actions=np.clip(np.array(actions, np.float32), -1.0, 1.0),
        infos={key: np.array(values) for key, values in columns.items()},
        **{key: np.array([v[name] for v in recorded.verdicts]) for key, name in names.items()},
    )
    return buffer, bool(info["is_success"])
