"""Episodes by seed, in parallel and resumable: an episode that is stored is not driven again."""

import inspect
import re
import sys
import time
from collections import ChainMap
from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from itertools import product
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from agents.evaluation import assisted, runs
from agents.evaluation.metrics import Record, Trace, given_map, measure, shortest_path
from agents.policies import GymPolicy, Policy, make_policy, spec_of
from agents.policies.learned import weights_digest
from agents.policies.planning import figures_of
from agents.watch import Watch, ignore
from wheelchair_gym.actors.records import PERSON
from wheelchair_gym.base.settings import InputError, read_json
from wheelchair_gym.envs.settings import read_env_settings
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.maps import bottleneck, footprint_margin
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.types import Episode

ENV = "wheelchair_gym/Navigation-v1"  # which importing the package registers
STORE = "episodes.jsonl"
TIGHT = 0.10  # m beside the chair: below it, the margin of turns is computed, which takes seconds
NO_WATCH = Watch()
Spec = Any  # a name, a mapping with a name, settings; of scenes, the Path of a map file, too


def label(spec: Spec) -> str:
    """The name of a policy or a scene in records: its `label`, else its name or its class."""
    if isinstance(spec, str):
        return spec
    if not isinstance(spec, Mapping):
        return type(spec).__name__
    return str(spec.get("label", spec.get("name", spec)))


def named(spec: Spec) -> dict[str, Any]:
    """Return a spec as a mapping with a name."""
    return {"name": spec} if isinstance(spec, str) else dict(spec)


def labelled_with(spec: Spec, words: str, **env: Any) -> dict[str, Any]:
    """Return a scene with more words in its label and more settings of its environment."""
    of = named(spec)
    return {**of, "label": f"{label(spec)}, {words}", "env": {**of.get("env", {}), **env}}


def without_labels(spec: Spec) -> Spec:
    """A spec without the keys that only an evaluation reads."""
    if not isinstance(spec, Mapping):
        return spec
    return {key: value for key, value in spec.items() if key not in ("label", "env")}


def distinct(specs: Sequence[Spec], what: str) -> tuple[Spec, ...]:
    """Policies or scenes as they are compared, each once.

    Raises:
        InputError: different ones have the same label.
    """
    found: dict[str, Spec] = {}
    for given in specs:
        if what == "policies":
            spec = spec_of(given)
        elif isinstance(given, PathLike):
            spec = {"name": "map_file", "path": fspath(given), "label": Path(given).stem}
        else:
            spec = given
        name = label(spec)
        if found.setdefault(name, spec) != spec:
            raise InputError(f"{name!r}: several {what} have this name; give each a label")
    return tuple(found.values())


def episode_env(scene: Spec, env: Mapping[str, Any], policy: Spec = "") -> dict[str, Any]:
    """Settings of the environment, with the scene's and the policy's `env` in place of any."""
    specs = (spec for spec in (scene, policy) if isinstance(spec, Mapping))
    return dict(ChainMap(*[dict(spec.get("env", {})) for spec in specs][::-1], dict(env)))


def episode_key(policy: Spec, scene: Spec, seed: int, env: Mapping[str, Any]) -> str:
    """A key that is equal for equal episodes: of code, settings, policy, scene and seed."""
    learned = weights_digest(without_labels(policy))
    parts = [without_labels(policy), without_labels(scene), seed, episode_env(scene, env, policy)]
    if not isinstance(policy, str | Mapping):  # a class from outside the project
        kind = type(policy)
        parts += [kind.__qualname__, runs.source_digest(inspect.getfile(kind))]
    return runs.run_key(runs.source_digest(), *parts, *([] if learned is None else [learned]))


def env_settings(**values: Any) -> dict[str, Any]:
    """Keyword settings of the environment, without those that are None; a config file is read.

    Raises:
        InputError: the config file cannot be read, or a setting in it is wrong.
    """
    path = values.get("config")
    if isinstance(path, str | Path):
        values["config"] = content = read_json(path)
        if isinstance(content, Mapping) and "env" in content:
            raise InputError(
                f"{path}: these are settings of a training run; expected those of the environment, "
                "which stand there under 'env': save them as a file of their own"
            )
        read_env_settings(content, Path(path).name)  # errors name the file
    return {key: value for key, value in values.items() if value is not None}


def make_env(
    scene: Spec, env: Mapping[str, Any], render_mode: str | None = "rgb_array", policy: Spec = ""
) -> Any:
    """Make an environment of a scene, as a policy is to drive there; by default of test worlds."""
    settings = {"split": "test", **episode_env(scene, env, policy)}
    return gymnasium.make(ENV, scene=without_labels(scene), render_mode=render_mode, **settings)


@lru_cache(1000)
def _margin(walls: bytes, discs: bytes, start: bytes, goal: bytes, footprint: Footprint) -> float:
    """`footprint_margin` of arrays by their bytes: others drive the same world next."""
    lines, rounds = np.frombuffer(walls).reshape(-1, 4), np.frombuffer(discs).reshape(-1, 3)
    return footprint_margin(lines, rounds, np.frombuffer(start), np.frombuffer(goal), footprint)


def drive_episode(
    env: Any, policy: Policy, seed: int, frames: Any = ignore, episode: Episode | None = None
) -> Record:
    """Drive one episode to its end.

    Args:
        env: an environment.
        policy: a policy.
        seed: of the episode.
        frames: called with the environment after reset and each step, to film it; the episode ends
            where it returns true.
        episode: to be driven, in place of the scene's.

    Returns:
        The figures of the episode, see `agents.evaluation.metrics.measure`.
    """
    observation, info = env.reset(seed=seed, options=episode and {"episode": episode})
    task = env.unwrapped.task
    world = env.unwrapped.episode
    narrowest = bottleneck(world.map, world.start[:2], world.goal[:2])
    margin = narrowest - task.footprint.half_width
    if margin < TIGHT:
        parts = (world.walls, world.discs, world.start, world.goal)
        margin = min(margin, _margin(*(part.tobytes() for part in parts), task.footprint))
    shortest = shortest_path(task, world, info["pose"])
    trace = Trace(task.period, margin, task.limits.forward, shortest, world.reference_length)
    trace.given_map = given_map(env.unwrapped)
    if (world.actors.rows["kind"] == PERSON).any():
        trace.people = assisted.PeopleTrace(world, task.footprint)
        trace.people.add(env.unwrapped.chair.truth)
    if task.has_driver:
        trace.sticks = assisted.StickTrace(task.limits, task.period)
    trace.add(info)
    begun = time.perf_counter()
    driver = GymPolicy(policy, env)
    driver.reset()
    trace.plan_s = time.perf_counter() - begun
    ended = truncated = False
    while not (ended or truncated):
        trace.planning = figures_of(policy)
        if frames(env):
            return measure(trace, info, truncated)
        begun = time.perf_counter()
        action = driver.act(observation)
        trace.acts_s.append(time.perf_counter() - begun)
        stick = task.stick
        observation, _, ended, truncated, info = env.step(action)
        trace.add(info)
        if trace.sticks is not None and stick is not None:
            given = task.limits.twist(action) - np.array(task.shield_intervention)
            trace.sticks.add(stick, given)
        if trace.people is not None:
            trace.people.add(env.unwrapped.chair.truth)
    frames(env)
    assert driver.command is not None
    trace.replans = max(0, driver.command.shown.plans - 1)
    return measure(trace, info, truncated and not ended)


def drive_on(env: Any, policy: Policy, observation: Any, steps: int) -> None:
    """Begin an episode that was just reset, and drive this number of steps at most."""
    driver = GymPolicy(policy, env)
    driver.reset()
    for _ in range(steps):
        observation, _, ended, truncated, _ = env.step(driver.act(observation))
        if ended or truncated:
            return


def warm(policy: Spec, scene: Spec, env: Mapping[str, Any]) -> None:
    """Compile (or load from the cache) all that an episode needs, outside its timings."""
    world = make_env(scene, env, policy=policy)
    observation, _ = world.reset(seed=0)
    drive_on(world, make_policy(without_labels(policy)), observation, 3)
    world.close()


_warmed: set[str] = set()


def _kind(policy: Spec, scene: Spec) -> str:
    """Jobs of one kind need the same kernels."""
    return f"{label(policy)} {episode_env(scene, {}, policy)}"


def picture_name(policy: Spec, scene: Spec, seed: int) -> str:
    """Return the path of a failed episode's picture in its folder; valid on every system."""
    name = re.sub(r"[^\w.,+-]", "_", f"{label(policy)}-{label(scene)}-{seed}")
    return f"pictures/{name}.png"


def run_episode(
    job: tuple[Spec, Spec, int], env: Mapping[str, Any], folder: Path, watch: Watch = NO_WATCH
) -> Record:
    """One episode, of policy, scene and seed; one that fails leaves a picture in the folder."""
    policy, scene, seed = job
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    if _kind(policy, scene) not in _warmed:
        warm(policy, scene, env)
        _warmed.add(_kind(policy, scene))
    world = make_env(scene, env, policy=policy)
    world, each = watch.of_episode(label(policy), label(scene), seed).on(world)
    try:
        record = drive_episode(world, make_policy(without_labels(policy)), seed, each)
        picture = None
        if not record["success"]:
            picture = picture_name(policy, scene, seed)
            from wheelchair_gym.rendering.video import write_png

            write_png(folder / picture, world.render())
    finally:
        world.close()
    record |= {"policy": label(policy), "scene": label(scene), "seed": seed, "picture": picture}
    return record


def evaluate(
    policies: Sequence[Spec],
    scenes: Sequence[Spec],
    seeds: Sequence[int],
    *,
    env: Mapping[str, Any] | None = None,
    folder: str | Path,
    jobs: int = 1,
    progress: bool = True,
    watch: Watch = NO_WATCH,
) -> list[Record]:
    """Records of every policy on every scene and seed, in that order.

    Args:
        policies: specs for `make_policy`, or dataclasses of settings; a `label` in a mapping names
            the policy in the records.
        scenes: specs for `make_scene`, likewise; settings of the environment in an `env`.
        seeds: of the episodes.
        env: further settings of the environment (pose_source, beams, rate, config).
        folder: where the store and the pictures of failed episodes go.
        jobs: worker processes; 1 stays in this one.
        progress: show a bar on stderr.
        watch: recording and viewers; an episode without a recording in that folder is driven
            again, and viewers can watch a single episode only.

    Raises:
        InputError: a spec or the folder is wrong.
        StoppedError: Ctrl-C; the same call computes only what is missing.
        ConnectionError: workers were lost over and over.
    """
    env, folder = env_settings(**(env or {})), Path(folder)
    policies, scenes = distinct(policies, "policies"), distinct(scenes, "scenes")
    for policy in policies:
        make_policy(without_labels(policy))
    for scene in scenes:
        make_scene(without_labels(scene))
    every = [(episode_key(*job, env), job) for job in product(policies, scenes, seeds)]
    wanted = dict(every)
    if watch.live is not None and len(wanted) != 1:
        raise InputError(f"--live shows a single episode; there are {len(wanted)}")

    def again(job: tuple[Spec, Spec, int]) -> bool:
        its = watch.of_episode(label(job[0]), label(job[1]), job[2])
        return its.live is not None or not (its.record is None or Path(its.record).exists())

    def before(missing: Sequence[tuple[Spec, Spec, int]]) -> None:
        if jobs > 1 and len(missing) > 1:  # workers then find every kernel in the cache
            for policy, scene in {_kind(p, s): (p, s) for p, s, _ in missing}.values():
                warm(policy, scene, env)

    records = runs.compute(
        wanted, partial(run_episode, env=env, folder=folder, watch=watch), folder / STORE,
        workers=jobs, unit="episode", progress=progress, again=again,
        before=before,
    )  # fmt: skip
    return [records[key] | {"policy": label(p), "scene": label(s)} for key, (p, s, _) in every]
