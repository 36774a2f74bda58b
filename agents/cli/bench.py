"""`wheelchair bench` and `warm-up`: speeds, a comparison of planners, and compiling it all once."""

import argparse
import importlib.util
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from agents import StoppedError, read_data
from agents.benchmarks.entrants import small_problem
from agents.cli import arguments
from agents.control import FOLLOWERS
from agents.evaluation.evaluate import warm
from agents.evaluation.provenance import command_line, cores, provenance, write_json, write_text
from planners import PLANNERS, make_planner
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv
from wheelchair_gym.people.assistance import make_compiled
from wheelchair_gym.people.drivers import make_driver


def env(given: argparse.Namespace) -> int:
    """Measure the speed of environments; print each figure at once, and write all of them."""
    from agents.benchmarks.environments import measure, measure_driver

    arguments.check_assist(given)
    if given.seconds <= 0.0:
        raise InputError(f"--seconds is {given.seconds:g}; expected more than 0")
    peer = not given.no_peers and importlib.util.find_spec("irsim") is not None
    sizes = {name: getattr(given, name) for name in ("beams", "envs", "threads")}
    more = {"bank": given.bank, "seconds": given.seconds}
    source = {"settings": sizes | more, **provenance(load=os.getloadavg()[0])}
    rows = []
    if given.driver is None:
        found = measure(*sizes.values(), **more, peer=peer)
    else:
        make_driver(given.driver)  # which refuses what is wrong
        if given.assist is not None:
            make_compiled(given.assist)
        found = measure_driver(given.driver, given.assist, *sizes.values(), **more)
    for row in found:
        rows.append(row)
        print(_line(row), file=sys.stderr if given.json == "-" else sys.stdout, flush=True)
    value = {"command": command_line(), "rows": rows, **source}
    path = Path(given.out) / "env.json"
    write_json(path, value)
    arguments.report(given, value, str(path))
    return 0


def _line(row: dict[str, Any]) -> str:
    if "rate" not in row:
        return f"{row['what']:<32}{row['value']:>12,.4g} {row['unit']}"
    where = f"{row['beams']} beams, {row['envs']} envs, {row['threads']} threads"
    ratio = f"   {row['ratio']:.1f} x IR-SIM" if "ratio" in row else ""
    if "share" in row:
        of = (f"{100 * share:.0f} % of {name}" for name, share in row["share"].items())
        ratio = "   " + ", ".join(of)
    return f"{row['what']:<18}{where:<38}{row['rate']:>12,.0f} steps/s{ratio}"


def train(given: argparse.Namespace) -> int:
    """Train, and print where the seconds went."""
    from agents.cli.train import training_content
    from agents.learning.run import measure_parts, parts_text
    from agents.learning.settings import read_training

    content, where = training_content(given)
    config = read_training(arguments.changed(content, given.set), where, given.algorithm)
    found = measure_parts(config)
    arguments.report(given, found, parts_text(found))
    return 0


def planners(given: argparse.Namespace) -> int:
    """Make the missing runs of planners, write the results, and print tables."""
    from agents.benchmarks.entrants import PEERS, select_peers
    from agents.benchmarks.planner_benchmark import PlannerBenchmark, draw, one_core

    arguments.check_picture(given.plot)
    arguments.refuse(given, ("problems", "only") if given.map else (), "expected without --map")
    asked = given.planners
    ours: list[Any] = list(PLANNERS)
    named: list[str] | None = None
    if asked is not None:
        ours = [arguments.labelled(name) for name in asked if name not in PEERS]
        named = [name for name in asked if name in PEERS] or None
    peers: list[str] = []
    if given.peers is not False and (named or given.peers or asked is None):
        peers, missing = select_peers(None if given.peers else named)
        for text in missing if given.peers else ():
            print(f"wheelchair: {text}", file=sys.stderr)
    file = given.resume or (
        given.json if given.json not in (None, "-") else f"{given.out}/planners.json"
    )
    for path in filter(None, (file, given.json)):
        if Path(path).suffix in (".jsonl", ".md"):
            raise InputError(f"{path}: runs and tables end so; expected a name such as FILE.json")
    with one_core() as core:
        benchmark = PlannerBenchmark(
            ours, peers, given.problems, given.only, range(given.seeds), given.deadlines, file,
            scenes=arguments.map_scenes(given), resume=bool(given.resume), core=core,
        )  # fmt: skip
        try:
            benchmark.run(not given.quiet)
            stop = None
        except StoppedError as error:
            stop = error
    if given.plot:
        draw(benchmark, benchmark.rows(), given.plot)
    table = Path(file).with_suffix(".md")
    write_text(table, benchmark.text(full=True))
    arguments.report(given, benchmark.result(), f"{benchmark.text()}all columns: {table}")
    more = "" if given.resume else f" --resume {file}"
    return 0 if stop is None else arguments.stopped(stop, more)


# Environments whose kernels differ, by what they are for.
ENVIRONMENTS: dict[str, dict[str, Any]] = read_data("warm_up.yaml")


def warm_up(given: argparse.Namespace) -> int:
    """Compile environments, planners and followers, and say what is ready."""
    from joblib import Parallel, delayed

    works: list[tuple[Any, ...]] = [  # a name, a function that calls kernels, and its arguments
        *((f"environment: {name}", _drive, name) for name in ENVIRONMENTS),
        ("vector environment", _drive_many, "crowd"),
        *((f"planner {name}", _plan, name) for name in PLANNERS.built_in),
        *((f"follower {f}", warm, f"a_star+{f}", "clutter", {}) for f in FOLLOWERS.built_in),
    ]
    begun = time.monotonic()
    jobs = given.jobs or os.cpu_count()
    pool = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
    for number, what in enumerate(pool(delayed(_compile)(*each) for each in works), 1):
        seconds = time.monotonic() - begun
        print(f"{number:2} of {len(works)}, {seconds:4.0f} s: {what}", flush=True)
    return 0


def _compile(what: str, work: Callable[..., None], *given: Any) -> str:
    """Do some work that calls kernels, and return what it was."""
    work(*given)
    return what


def _drive(name: str) -> None:
    env = NavigationEnv(**ENVIRONMENTS[name])
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros(2, np.float32))
    env.close()


def _drive_many(scene: str) -> None:
    envs = NavigationVectorEnv(2, scene, shield=True)
    envs.reset(seed=0)
    envs.step(np.zeros((2, 2), np.float32))
    envs.close()


def _plan(name: str) -> None:
    make_planner(name).plan(small_problem(), np.random.default_rng(0))


def run_track(given: argparse.Namespace) -> int:
    """Drive a track of the benchmark, and print its figures."""
    from agents.benchmarks.tracks import run

    result, path = run(
        arguments.labelled(given.policy), given.track, Path(given.out), given.development,
        given.jobs or cores(), not given.quiet, given.episodes,
    )  # fmt: skip
    scenes: dict[str, list[bool]] = {}
    for one in result["episodes"]:
        scenes.setdefault(one["scene"], []).append(one["success"])
    lines = "".join(f"{scene}: {sum(of)} of {len(of)}\n" for scene, of in scenes.items())
    contacts = f"{result['contacts']} contacts, {result['at_fault']} at fault"
    text = (
        f"{result['policy']} on {given.track}: {result['success']:.1%} of {result['n']} arrive "
        f"({result['low']:.1%} to {result['high']:.1%}), {contacts}\n{lines}{path}"
    )
    arguments.report(given, result, text)
    return 0


def verify_track(given: argparse.Namespace) -> int:
    """Drive some episodes of a result file again, and say whether they agree."""
    from agents.benchmarks.tracks import verify

    agrees, text = verify(Path(given.file), given.episodes, given.jobs or cores(), not given.quiet)
    print(text)
    return 0 if agrees else 1
