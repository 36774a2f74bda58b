"""Search for settings by Optuna: each trial is judged on the same episodes, and all is kept.

Trials follow one another, their episodes run side by side. Trial 0 is what is set already. The best
trial is the best of many on those episodes, which flatters it: both are judged again on others.
"""

from __future__ import annotations

import csv
import io
import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.evaluation.evaluate import STORE, Spec, evaluate
from agents.evaluation.provenance import write_json, write_text
from agents.evaluation.runs import StoppedError, compute, run_key, source_digest
from agents.evaluation.search_space import Range, value_at
from agents.interrupt import by_hand
from agents.studies.evidence import estimate
from wheelchair_gym.config import InputError, dump, with_values

if TYPE_CHECKING:
    import optuna

METRICS = ("sct", "spl", "success", "barn", "barn_own")  # of episodes; the higher, the better
WHO = ("folder", "jobs", "engine")  # changes no score
JOURNAL = "trials.log"
Scores = list[float]
Judge = Callable[[Spec, Sequence[int]], Scores]  # of settings on seeds: one score each


def _named(spec: Spec) -> Mapping[str, Any]:
    return {"name": spec} if isinstance(spec, str) else spec


def is_planner(spec: Spec) -> bool:
    """Whether a person means a planner, to be judged by its plans, and not a policy."""
    from planners import PLANNERS

    return _named(spec).get("name") in PLANNERS


def all_settings(spec: Spec) -> dict[str, Any]:
    """Every setting of a planner or policy, with what is set.

    Raises:
        InputError: there is none such, or a setting is wrong.
    """
    from agents.control import make_follower
    from agents.policies import settings_of
    from planners import make_planner

    if is_planner(spec):
        return dict(dump(make_planner(spec)))
    found = dict(dump(settings_of(spec)))
    for part, make in (("planner", make_planner), ("follower", make_follower)):
        if isinstance(found.get(part), Mapping):
            found[part] = dump(make(found[part]))
    return found


@dataclass(frozen=True)
class Drives:
    """Judges policies by driving episodes."""

    scenes: Sequence[Spec]
    env: Mapping[str, Any]
    metric: str
    folder: Path
    jobs: int
    engine: str

    def __call__(self, spec: Spec, seeds: Sequence[int]) -> Scores:
        """One score an episode: each scene's seeds."""
        records = evaluate(
            [spec], self.scenes, seeds, env=self.env, folder=self.folder, jobs=self.jobs,
            engine=self.engine, progress=False,
        )  # fmt: skip
        return [float(record[self.metric]) for record in records]


@dataclass(frozen=True)
class Plans:
    """Judges planners by their plans: the shortest path's length over theirs, 0 without one.

    Worlds in which the widest disc that a planner is asked for finds no path count for nobody.
    """

    scenes: Sequence[Spec]
    deadline: float | None
    folder: Path
    jobs: int
    engine: str

    def __call__(self, spec: Spec, seeds: Sequence[int]) -> Scores:
        """One score a world."""
        source = source_digest("wheelchair_gym", "planners")
        runs = {
            run_key(source, spec, scene, seed, self.deadline): (scene, seed)
            for scene in self.scenes
            for seed in seeds
        }
        records = compute(
            runs, partial(_planned, spec=spec, deadline=self.deadline), self.folder / STORE,
            workers=self.jobs, engine=self.engine, unit="plan", progress=False,
        )  # fmt: skip
        return [record["score"] for record in records.values() if record["score"] is not None]


@cache
def _case(scene: str, seed: int) -> Any:
    from agents.benchmarks.cases import scene_case

    return scene_case(json.loads(scene), seed)


def _planned(job: tuple[Spec, int], spec: Spec, deadline: float | None) -> dict[str, Any]:
    from agents.benchmarks.entrants import make_plan
    from planners import make_planner

    case = _case(json.dumps(job[0]), job[1])
    if case.optimum is None:
        return {"score": None}
    plan, problem = make_plan(make_planner(spec), case.problem, job[1], deadline), case.problem
    good = len(plan.path) and not case.judge.faults(plan.path, problem.start, problem.goal)
    return {"score": case.optimum / max(plan.length, case.optimum) if good else 0.0}


def tune(
    spec: Spec,
    ranges: Sequence[Range],
    judge: Drives | Plans,
    seeds: Sequence[int],
    others: Sequence[int],
    *,
    trials: int,
    folder: Path,
    seed: int = 0,
    progress: bool = True,
) -> dict[str, Any]:
    """Search, and judge the best and what was set on other episodes.

    The same call goes on where it was stopped; more trials continue a search.

    Args:
        spec: what is tuned.
        ranges: the settings that are searched.
        judge: gives a score for settings.
        seeds: of the episodes that trials are judged on.
        others: of those that the best is judged on again.
        trials: in all, the first of them with what is set.
        folder: for Optuna's journal, trials.csv and best.json.
        seed: of Optuna's draws; they are the same however often the search was stopped.
        progress: show a bar on standard error.

    Returns:
        What trials.csv and best.json say, and the scores on other episodes.

    Raises:
        InputError: a setting is unknown, or the folder holds another search.
        StoppedError: Ctrl-C; the same call goes on.
    """
    import optuna
    from tqdm import tqdm

    own = all_settings(spec)
    before = {vary.key: value_at(own, vary.key) for vary in ranges}
    asked = {key: value for key, value in vars(judge).items() if key not in WHO}
    what = run_key(source_digest(), spec, [vars(v) for v in ranges], list(seeds), seed, asked)
    study = _study(folder, what)
    if not study.trials and all(vary.has(before[vary.key]) for vary in ranges):
        study.enqueue_trial(before)
    try:
        with tqdm(total=trials, disable=not progress, unit="trial") as bar:
            for number, values in _drawn(study, ranges, trials, seed):
                if values is not None:
                    try:
                        score = float(np.mean(judge(with_values(_named(spec), values), seeds)))
                        study.tell(number, score)
                    except InputError as error:  # settings that do not go together
                        study.tell(number, state=optuna.trial.TrialState.FAIL)
                        if progress:
                            tqdm.write(f"trial {number}: {error}", file=sys.stderr)
                bar.update(number + 1 - bar.n)
                if done := _done(study):
                    bar.set_postfix_str(f"best {max(t.value or 0.0 for t in done):.4g}")
        return _result(spec, study, before, judge, others, folder)
    except (KeyboardInterrupt, SystemError, StoppedError) as error:
        if not (isinstance(error, StoppedError) or by_hand(error)):
            raise
        raise StoppedError(f"{len(_done(study))} of {trials} trials are done") from None


def _study(folder: Path, what: str) -> optuna.Study:
    """The search that a folder keeps, or a new one."""
    import optuna
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend

    from wheelchair_gym.files import write_error

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        storage = JournalStorage(JournalFileBackend(str(folder / JOURNAL)))
        study = optuna.create_study(
            study_name="tune", storage=storage, direction="maximize", load_if_exists=True
        )
    except OSError as error:
        raise write_error(folder / JOURNAL, error) from None
    except (ValueError, KeyError, AssertionError):
        raise InputError(f"{folder / JOURNAL}: not the journal of a search by Optuna") from None
    if study.trials and study.user_attrs.get("what") != what:
        raise InputError(
            f"{folder} holds another search (settings, ranges, episodes or code differ); "
            "give another --out"
        )
    study.set_user_attr("what", what)
    return study


def _drawn(
    study: optuna.Study, ranges: Sequence[Range], trials: int, seed: int
) -> Iterator[tuple[int, dict[str, Any] | None]]:
    """Number and values of every trial to be judged; None for one that was cut off unnamed."""
    import optuna

    for frozen in study.get_trials(states=(optuna.trial.TrialState.RUNNING,)):
        if len(frozen.params) == len(ranges):
            yield frozen.number, dict(frozen.params)
        else:  # killed while it was drawn
            study.tell(frozen.number, state=optuna.trial.TrialState.FAIL)
            yield frozen.number, None
    while True:
        number = sum(trial.state.is_finished() for trial in study.trials)
        if number >= trials:
            return
        # Draws depend on the trial and those before it alone, so that a search can be stopped.
        draws = int(np.random.SeedSequence((seed, number)).generate_state(1)[0])
        study.sampler = optuna.samplers.TPESampler(seed=draws)
        trial = study.ask({vary.key: vary.distribution for vary in ranges})
        yield trial.number, dict(trial.params)


def _done(study: optuna.Study) -> list[optuna.trial.FrozenTrial]:
    return [trial for trial in study.trials if trial.value is not None]


def _result(
    spec: Spec, study: optuna.Study, before: Mapping[str, Any], judge: Judge,
    others: Sequence[int], folder: Path,
) -> dict[str, Any]:  # fmt: skip
    """Judge the best trial again, and write everything down."""
    done = _done(study)
    if not done:
        raise InputError("no trial could be judged: none of the settings go together")
    best = max(done, key=lambda trial: (trial.value or 0.0, -trial.number))
    tuned = with_values(_named(spec), best.params)
    name = str(tuned.pop("name"))
    new, old = (np.array(judge(s, others)) for s in ({"name": name, **tuned}, spec))
    gain = estimate([{"": new - old}], [1.0])
    write_json(folder / "best.json", {name: tuned})
    lines = io.StringIO()
    rows = csv.writer(lines, lineterminator="\n")
    rows.writerow(["trial", "score", "state", *before])
    for trial in study.trials:
        values = (trial.params.get(key) for key in before)
        rows.writerow([trial.number, trial.value, trial.state.name.lower(), *values])
    write_text(folder / "trials.csv", lines.getvalue())
    return {
        "name": name,
        "trials": len(study.trials),
        "best": {"trial": best.number, "score": best.value, "settings": dict(best.params)},
        "before": dict(before),
        "others": {
            "episodes": len(new),
            "before": float(old.mean()),
            "best": float(new.mean()),
            "gain": gain.value,
            "gain_interval": gain.interval,
        },
    }
