"""`wheelchair train`, `export`, `inspect` and `dataset`: runs, their weights, and data sets."""

import argparse
import os
import re
import shlex
import subprocess
import sys
import threading
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from agents import is_interrupt
from agents.cli.arguments import changed, env_of, report, scene_of, spec
from agents.cli.options import parse_int
from agents.evaluation.runs import end_with
from wheelchair_gym.base.settings import InputError, dump, read_json

# What needs torch is imported late: export does not.
_PARENT = "WHEELCHAIR_TRAIN_PARENT"  # in a run's environment: the process that it ends with


class Case(NamedTuple):
    """One run of several."""

    name: str
    config: Any
    changes: list[str]
    seed: int
    folder: Path
    value: str  # of the setting that --vary varies, as it was typed


def run(given: argparse.Namespace) -> int:
    """Train once for each value of the varied setting and each seed."""
    from agents.learning.demonstrations import load_imitation
    from agents.learning.folder import write_sweep
    from agents.learning.settings import read_training

    try:
        seeds = list(dict.fromkeys(parse_int(text) for text in given.seeds))  # each once
    except argparse.ArgumentTypeError as error:
        raise InputError(f"--seeds: {error}") from None
    algorithm, imitates = given.algorithm, given.algorithm == "bc"
    content, where = training_content(given)
    if not imitates and find_spec("tensorboard") is None:
        needs = "TensorBoard's log needs pip install 'wheelchair_gym[learn]'"
        print(f"wheelchair: {needs}; curve.csv is written without", file=sys.stderr)
    out = Path(given.out or Path("runs") / algorithm)
    cases: list[Case] = []
    key, values = varied(given.vary)
    for value in values:
        name = f"{key.rpartition('.')[2]}_{value}" if key else ""
        changes = [*given.set, *([f"{key}={value}"] if key else [])]
        settings = changed(content, changes)
        config = (
            load_imitation(settings, where) if imitates
            else read_training(settings, where, algorithm)
        )  # fmt: skip
        if not imitates and not cases:
            _warn_of_short_checkpoints(config)
        for seed in seeds:
            folder = out / name / f"seed_{seed}" if len(seeds) > 1 else out / name
            cases.append(Case(f"{name} seed {seed}".strip(), config, changes, seed, folder, value))
    if given.jobs > 1 and len(cases) > 1:
        code = _in_processes(given, cases)
        if code != 0:
            return code
        results = {case.name: _last_row(imitates, case.folder) for case in cases}
    else:
        results = {case.name: _train(given, case) for case in cases}
    lines = [f"{name}: {_line(row)}" for name, row in results.items()]
    if key:
        lines.append(write_sweep(key, [(case.value, case.folder) for case in cases], out))
    report(given, results, "\n".join([*lines, str(out)]))
    return 0


def training_content(given: argparse.Namespace) -> tuple[dict[str, Any], str]:
    """Settings of a run before changes, from the file or the recipe, and the name of the file."""
    from agents.learning.settings import recipe

    imitates = given.algorithm == "bc"
    if given.config is not None:
        content = read_json(given.config)
    else:
        content = {} if imitates else dump(recipe(given.algorithm))
    if not isinstance(content, dict):
        raise InputError(f"{given.config}: expected an object with keys")
    if given.frames is not None and imitates:
        raise InputError("--frames: bc has none; expected --set episodes=N or --set rounds=N")
    if given.frames is not None:
        content["frames"] = given.frames
    return content, "settings" if given.config is None else Path(given.config).name


def _warn_of_short_checkpoints(config: Any) -> None:
    """Say where episodes may last longer than the time between two checkpoints."""
    env, steps = config.env_settings(), config.steps_per_checkpoint
    minimum = env.task.time_base
    if env.task.max_episode_steps is not None:
        minimum = min(minimum, env.task.max_episode_steps / env.rate)
    if steps / env.rate < minimum:
        print(
            f"wheelchair: all environments reset at a checkpoint, after {steps / env.rate:g} s of "
            f"driving ({steps} steps at {env.rate:g} Hz), and episodes may last {minimum:g} s and "
            "longer: only short ones end, so the success in training is of these, and no long one "
            "is learned to its end; set a larger checkpoint_frequency",
            file=sys.stderr,
        )


def varied(text: str | None) -> tuple[str, list[str]]:
    """Key and values of KEY=A,B as they were typed; an empty key and value where none varies.

    A value may be a list: KEY=[],[1,2].
    """
    if text is None:
        return "", [""]
    key, _, values = text.partition("=")
    if not (key and values):
        raise InputError(f"--vary {text}: expected KEY=A,B")
    split = dict.fromkeys(value.strip() for value in re.split(r",(?![^\[]*\])", values))
    return key, [value for value in split if value]


def _last_row(imitates: bool, folder: Path) -> dict[str, Any]:
    """The result of a run that another process has made."""
    from agents.learning.folder import read_curve

    rows: list[dict[str, Any]] = (
        read_json(folder / "rounds.json") if imitates else read_curve(folder)
    )
    return rows[-1]


def _train(given: argparse.Namespace, case: Case) -> dict[str, Any]:
    from tqdm import tqdm

    if parent := os.environ.get(_PARENT):
        threading.Thread(target=end_with, args=(int(parent),), daemon=True).start()
    if given.algorithm == "bc":
        from agents.learning.demonstrations import imitate

        return imitate(case.config, case.seed, case.folder, progress=not given.quiet)
    from agents.learning.run import train

    pause = 0.5 if sys.stderr.isatty() else 10.0
    style: dict[str, Any] = {"mininterval": pause, "maxinterval": pause, "disable": given.quiet}
    # A second bar moves the cursor, which a log does not have.
    inner = style | {"disable": given.quiet or not sys.stderr.isatty()}
    worlds = tqdm(total=0, unit="world", leave=False, desc="worlds", **inner)
    frames = tqdm(
        total=case.config.frames, unit="frame", unit_scale=True, desc=f"seed {case.seed}", **style
    )

    evaluation: list[Any] = []  # the bar of the evaluation that runs

    def on_prepared(ready: int, total: int) -> None:
        worlds.total = total
        worlds.update(ready - worlds.n)
        if worlds.disable:
            frames.set_postfix_str(f"{ready} of {total} worlds", refresh=False)
            frames.update(0)

    def on_step(done: int) -> None:
        worlds.close()
        frames.update(done - frames.n)

    def on_evaluated(done: int, total: int) -> None:
        if not evaluation:
            bar = tqdm(total=total, unit="episode", leave=False, desc="evaluation", **inner)
            evaluation.append(bar)
        evaluation[0].update(done - evaluation[0].n)
        if done == total:
            evaluation.pop().close()

    try:
        rows = train(
            case.config, case.seed, case.folder, on_step=on_step, on_prepared=on_prepared,
            on_evaluated=on_evaluated, on_row=lambda row: frames.set_postfix_str(_line(row)),
        )  # fmt: skip
    except (KeyboardInterrupt, SystemError) as error:
        if is_interrupt(error):
            again = "the same command resumes from its last checkpoint"
            print(f"\n{case.folder}: {again}", file=sys.stderr)
        raise
    finally:
        for bar in (worlds, *evaluation, frames):
            bar.close()
    return rows[-1]


def _line(row: dict[str, Any]) -> str:
    """The main figures of a row."""
    parts = []
    if row.get("eval_success") not in (None, ""):
        parts.append(f"success in evaluation {float(row['eval_success']):.2f}")
    if "episodes" in row:
        of = f"of {row['episodes']} episodes" if row["episodes"] else "no episode ended"
        share = f"{float(row['success']):.2f} " if row["episodes"] else ""
        parts.append(f"in training {share}({of})")
    elif "success" in row:
        parts.append(f"success of the {row['driver']} {float(row['success']):.2f}")
    if "frames_per_second_s" in row:
        parts.append(f"{float(row['frames_per_second_s']):,.0f} frames/s")
    return ", ".join(parts)


def _in_processes(given: argparse.Namespace, cases: list[Case]) -> int:
    """Each run in a separate process, `--jobs` at a time, with a log file; the exit code."""
    waiting, running = list(cases), dict[str, subprocess.Popen[bytes]]()
    codes: dict[str, int] = {}
    env = os.environ | {_PARENT: str(os.getpid())}
    try:
        while waiting or running:
            while waiting and len(running) < given.jobs:
                case = waiting.pop(0)
                case.folder.mkdir(parents=True, exist_ok=True)
                command = [sys.executable, "-m", "wheelchair_gym", "train", given.algorithm]
                command += ["--seeds", str(case.seed), "--out", str(case.folder)]
                for key in ("config", "frames"):
                    if getattr(given, key) is not None:
                        command += [f"--{key}", str(getattr(given, key))]
                one_thread = [] if given.algorithm == "bc" else ["threads=1"]
                for change in [*case.changes, *one_thread]:
                    command += ["--set", change]
                with (case.folder / "log.txt").open("ab") as log:  # the process keeps it open
                    running[case.name] = subprocess.Popen(command, stdout=log, stderr=log, env=env)
                print(f"{case.name}: {case.folder / 'log.txt'}", file=sys.stderr)
            for name, process in list(running.items()):
                try:
                    codes[name] = process.wait(timeout=0.5)
                except subprocess.TimeoutExpired:
                    continue
                del running[name]
                print(f"{name}: exit code {codes[name]}", file=sys.stderr)
    finally:
        for process in running.values():
            process.terminate()
    return max((code if code >= 0 else 128 - code for code in codes.values()), default=0)


def export(given: argparse.Namespace) -> int:
    """Write weights as ONNX, or with a model card."""
    if given.npz is not None:
        from agents.learning.folder import publish

        file = Path(given.npz)
        weights = publish(Path(given.policy), [Path(name) for name in given.results], file)
        report(given, weights.card, f"{file} and {file.with_suffix('.md')}")
        return 0
    from agents.learning.export import export_onnx
    from agents.learning.weights import load_weights
    from agents.policies import file_of

    path = file_of(spec(given.policy))
    if path is None or path.suffix != ".npz":
        kind = {"": "a policy without a network", ".zip": "a model of stable-baselines3"}
        found = kind.get("" if path is None else path.suffix, "an exported policy")
        raise InputError(f"{given.policy}: {found}; expected weights (.npz), by name or file")
    sidecar = export_onnx(load_weights(path), given.onnx)
    report(given, sidecar, f"{given.onnx} and {given.onnx}.json")
    return 0


def dataset(given: argparse.Namespace) -> int:
    """Drive the episodes or read recorded ones, and write the data set."""
    from agents.evaluation.evaluate import without_labels
    from agents.learning.dataset import write_dataset, write_recorded

    if given.recordings:
        found = write_recorded(given.name, given.recordings, _chosen(given), given.out)
    else:
        scene = without_labels(scene_of(given))
        seeds = range(given.first_seed, given.first_seed + given.episodes)
        found = write_dataset(
            given.name, spec(given.policy), scene, env_of(given), seeds, given.out, not given.quiet
        )
    counts = (found["episodes"], "episode"), (found["steps"], "step")
    text = ", ".join(f"{count} {name}{'' if count == 1 else 's'}" for count, name in counts)
    where = f"export MINARI_DATASETS_PATH={shlex.quote(given.out)}"
    load = f"python -c \"import minari; print(minari.load_dataset('{given.name}'))\""
    arrived = f"{found['successes']} successful"
    if given.recordings and found["test"]:
        arrived += f", {found['test']} in test worlds (judge on other seeds)"
    report(given, found, f"{text}, {arrived}: {found['folder']}; read it with\n{where}\n{load}")
    return 0


def _chosen(given: argparse.Namespace) -> dict[str, Any]:
    """The settings that take the place of those of a recording; refuse those of a drive."""
    from agents.evaluation.evaluate import env_settings
    from agents.learning.dataset import CHOSEN

    kept = {"command", "name", "recordings", "config", "out", "quiet", "json"}
    typed = {key for key in vars(given) if given.parser.get_default(key) != getattr(given, key)}
    chosen: dict[str, Any] = env_settings(config=given.config).get("config", {})
    wrong = [f"--{key.replace('_', '-')}" for key in typed - kept]
    wrong += [f"{key} in {given.config}" for key in chosen if key not in CHOSEN]
    if wrong:
        raise InputError(
            f"{', '.join(sorted(wrong))}: what was recorded cannot be changed; expected, with "
            f"--recordings, a --config of {' and '.join(CHOSEN)} only"
        )
    return chosen
