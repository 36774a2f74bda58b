"""`wheelchair compare`, `study` and `tune`, all of which can be resumed.

Their options are declared in agents/data/commands.toml, as those of all commands.
"""

import argparse
import dataclasses
import importlib.util
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from agents.cli.arguments import check_assist, labelled, map_scenes, report, shield_of, spec, watch
from agents.cli.options import DEFAULT_POSE
from agents.evaluation import compare as comparison
from agents.evaluation.compare import BRIEF, terminal_table
from agents.evaluation.evaluate import Spec, label, labelled_with
from agents.evaluation.provenance import cores
from wheelchair_gym.base.settings import InputError, read_json, suggest
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.hardware.twin.plant import PlantSettings
from wheelchair_gym.people.drivers import make_driver
from wheelchair_gym.scenes import SCENES
from wheelchair_gym.scenes.barn import world_numbers

NAMED = 3  # scenes in the name of a folder
# Columns of a terminal beside the usual ones, where persons drive.
STICK_COLUMNS = ("agreement_angle", "intervention_share", "stick_movements", "stick_effort")
SEED_OFFSET = 500_000  # from the seeds of trials to those on which the best is evaluated again


def scenes_of(names: Sequence[str] | None, suite: Sequence[Spec]) -> list[Spec]:
    """Return scenes by their name or label in the suite; FILE.json means all worlds of the file."""
    found, of_suite = list[Spec](), {label(scene): scene for scene in suite}
    for name in names or ():
        if name.endswith(".json"):
            barn, stem = {"name": "barn", "path": name}, Path(name).stem
            found += [{**barn, "world": n, "label": f"{stem} {n}"} for n in world_numbers(name)]
        else:
            if ":" not in name and name not in (known := {**of_suite, **dict.fromkeys(SCENES)}):
                unknown = f"scene {name!r} is unknown; there are {', '.join(known)}"
                raise InputError(unknown + suggest(name, known))
            found.append(of_suite.get(name, labelled(name)))
    return found


def compare(given: argparse.Namespace) -> int:
    """Compare policies, and write everything to the folder."""
    check_assist(given)
    columns = [*given.columns]
    if given.driver is not None and columns == list(BRIEF):
        columns += STICK_COLUMNS
    terminal_table({"summary": [], "scenes": []}, columns)  # before hours of driving
    suite = comparison.suite(given.suite)
    env = dict(suite.env) if given.config is None else {"config": given.config}
    scenes = [*scenes_of(given.scenes, suite.scenes), *map_scenes(given)] or suite.scenes
    if given.pose is not None and len(given.pose) == 1:
        env["pose_source"] = given.pose[0]
    elif given.pose is not None:
        scenes = [
            labelled_with(scene, pose, pose_source=pose) for pose in given.pose for scene in scenes
        ]
    env |= {"shield": shield_of(given), "split": "train" if given.training_seeds else "test"}
    env["model"] = given.model
    if given.chair is not None:
        plant = None
        if given.plant is not None:  # it is refused by its name, and at once
            PlantSettings.read(given.plant, env_settings(given.config, model=given.model))
            plant = read_json(given.plant)
        env["chair"] = {"name": given.chair, "plant": plant}
        if given.pose is None:
            env["pose_source"] = "mcl"
    elif given.plant is not None:
        raise InputError("--plant needs --chair twin")
    policies: Sequence[Spec] = tuple(map(labelled, given.policies or ())) or suite.policies
    if given.trained_in is not None:
        policies = trained_in(policies, given.trained_in)
    if given.driver is not None:
        if given.policies is not None:
            raise InputError("--policies and --driver: expected one of them; see --assist")
        policies = assistants(given.assist)
        scenes = tuple(with_drivers(scenes, given.driver))
        if given.config is None:  # some interfaces take their time
            env["config"] = {"task": {"time_base": 60.0, "time_factor": 10.0}}
    if given.scenes or given.map:  # the title of the suite is of its scenes
        suite = dataclasses.replace(
            suite, title=f"Policies on {_first_few(map(label, scenes), ', ', ' and {} more')}"
        )
    suite = dataclasses.replace(
        suite,
        policies=tuple(policies),
        scenes=tuple(scenes),
        episodes=given.episodes or suite.episodes,
        env=env,
        video=suite.video and not given.no_video,
    )
    folder = Path(given.out or Path("runs") / comparison_name(given))
    first = given.first_seed
    evaluation = comparison.compare(
        suite, folder, jobs=given.jobs or cores(), progress=not given.quiet,
        seeds=range(first, first + suite.episodes), watch=watch(given),
    )  # fmt: skip
    table = terminal_table(evaluation, columns)
    report(given, evaluation, f"{table}\n{folder / 'report.html'}")
    return 0


def trained_in(policies: Sequence[Spec], file: str) -> list[Spec]:
    """Give policies that are stable-baselines3 models these settings of training.

    Raises:
        InputError: the file cannot be read, or no policy is such a model.
    """
    content = read_json(file)
    found = [
        {"name": spec, "trained_in": content, "label": spec}
        if isinstance(spec, str) and spec.endswith(".zip") else spec
        for spec in policies
    ]  # fmt: skip
    if found == list(policies):
        raise InputError("--trained-in needs a model of stable-baselines3 (.zip) in --policies")
    return found


def assistants(names: Sequence[str] | None) -> list[dict[str, Any]]:
    """Policies that drive by assistants; by every one without any name."""
    from agents.people import ASSISTANTS, is_shielded

    found = []
    for name in names or ASSISTANTS:
        assist = spec(name)
        shown = name if name.endswith(".npz") else Path(name).name
        policy: dict[str, Any] = {"name": "assisted", "assist": assist, "label": shown}
        found.append(policy if is_shielded(assist) else {**policy, "env": {"shield": False}})
    return found


def with_drivers(scenes: Sequence[Spec], names: Sequence[str]) -> list[dict[str, Any]]:
    """Return each scene with each driver, whose name is added to the label."""
    found = []
    for driver in names:
        make_driver(spec(driver))  # raises InputError for a bad driver
        name = Path(driver).name
        found += [labelled_with(scene, name, driver=spec(driver)) for scene in scenes]
    return found


def _first_few(names: Iterable[str], between: str, more: str) -> str:
    """Join the first `NAMED` of some names, and say how many more there are."""
    every = list(dict.fromkeys(names))
    rest = more.format(len(every) - NAMED) if len(every) > NAMED else ""
    return between.join(every[:NAMED]) + rest


def comparison_name(given: argparse.Namespace) -> str:
    """Return a comparison's name: its scenes and maps, or its suite where none are given."""
    names = [
        Path(name).stem if name.endswith(".json") else Path(name).name
        for name in given.scenes or ()
    ] + [Path(file).stem for file in given.map or ()]
    name = _first_few(names, "_", "_and_{}_more")
    return re.sub(r"[^\w.-]+", "_", name) or str(given.suite)


def study(given: argparse.Namespace) -> int:
    """Run studies, and write everything to the folder."""
    from agents.studies.runner import find_studies, run_studies, summary_text

    studies = find_studies(given.name)
    chapters = run_studies(
        studies, given.out, runs=given.runs, quick=given.quick, jobs=given.jobs or cores(),
        progress=not given.quiet,
        title=studies[0].title if len(studies) == 1 else None,
    )  # fmt: skip
    page = Path(given.out) / "report.html"
    report(given, chapters, f"{summary_text(list(chapters.values()))}\n{page}")
    return 0


def tune(given: argparse.Namespace) -> int:
    """Search for settings, and write everything to the folder."""
    if importlib.util.find_spec("optuna") is None:
        raise InputError("tune needs the package optuna; pip install 'wheelchair_gym[tune]'")
    from agents.evaluation import tuning

    what = spec(given.name)
    ranges = dict(map(tuning.read_range, given.vary))
    if len(ranges) < len(given.vary):
        raise InputError("--vary: a setting is given twice")
    folder = Path(given.out or Path("runs") / "tune" / Path(given.name).name.replace(":", "_"))
    found = tuning.tune(
        what, ranges, _objective(given, what, folder), range(given.episodes),
        range(SEED_OFFSET, SEED_OFFSET + given.episodes),
        trials=given.trials, folder=folder, seed=given.seed, progress=not given.quiet,
    )  # fmt: skip
    report(given, found, f"{_tuning_text(found)}\n{folder / 'best.json'}:{found['name']}")
    return 0


def _objective(given: argparse.Namespace, what: Any, folder: Path) -> Any:
    """Return the score of a trial's episodes; refuse a planner, and an unknown metric."""
    from agents.evaluation.tuning import METRICS, Drives
    from planners import PLANNERS

    name = what if isinstance(what, str) else what.get("name")
    if name in PLANNERS:
        raise InputError(f"{given.name} is a planner; expected a policy, such as {name}+window")
    metric = given.metric or METRICS[0]
    if metric not in METRICS:
        raise InputError(f"--metric {metric} is unknown; known: {', '.join(METRICS)}")
    env = {"config": given.config, "model": given.model, "pose_source": given.pose}
    env |= {"shield": shield_of(given), "split": "train"}
    if given.config is None and given.pose is None:
        env["pose_source"] = DEFAULT_POSE
    suite = comparison.suite(given.suite or "homes").scenes
    scenes = scenes_of(given.scenes, suite) or suite
    return Drives(scenes, env, metric, folder, given.jobs or cores())


def _tuning_text(found: dict[str, Any]) -> str:
    best, others = found["best"], found["others"]
    first = f"{found['name']}: the best of {found['trials']} trials is number {best['trial']}"
    lines = [f"{first}, {best['score']:.4g}"]
    for key, value in best["settings"].items():
        lines.append(f"  {key} = {value:.4g}" if isinstance(value, float) else f"  {key} = {value}")
        lines[-1] += f" (was {found['before'][key]})"
    low, high = others["gain_interval"]
    within = "no interval of one episode" if low is None else f"{low:+.4g} to {high:+.4g}"
    lines.append(
        f"on {others['episodes']} other episodes: {others['best']:.4g}, the current settings "
        f"{others['before']:.4g}; gain {others['gain']:+.4g} ({within})"
    )
    return "\n".join(lines)
