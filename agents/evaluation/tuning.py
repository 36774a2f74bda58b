"""Search for settings by Optuna: each trial is scored on the same episodes, and all are stored.

Trials run one after another, the episodes of a trial in parallel. Trial 0 has the current settings.
The score of the best of many trials is biased upwards, so that it and the current settings are
scored again on other episodes.
"""

import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optuna
from optuna import distributions
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from tqdm import tqdm

from agents.control import make_follower
from agents.evaluation import provenance, runs, statistics, tables
from agents.evaluation.evaluate import Spec, evaluate, named
from agents.policies import settings_of
from planners import make_planner
from wheelchair_gym.base.files import write_error
from wheelchair_gym.base.settings import InputError, dump, value_of, with_values

METRICS = ("sct", "spl", "success", "barn", "barn_own")  # of episodes; the higher, the better
EXECUTION = ("folder", "jobs")  # settings that change no score
JOURNAL = "trials.log"
Ranges = Mapping[str, distributions.BaseDistribution]  # by the dotted key of a setting
Scores = list[float]
Judge = Callable[[Spec, Sequence[int]], Scores]  # of settings on seeds: one score each


def covers(distribution: distributions.BaseDistribution, value: Any) -> bool:
    """Return True if a distribution can draw a value; true and false are no numbers."""
    if isinstance(distribution, distributions.CategoricalDistribution):
        choices = [(isinstance(one, bool), one) for one in distribution.choices]
        return (isinstance(value, bool), value) in choices
    number = isinstance(value, int | float) and not isinstance(value, bool)
    whole = isinstance(distribution, distributions.IntDistribution)
    bounds: Any = distribution
    return number and bounds.low <= value <= bounds.high and not (whole and value % 1)


def read_range(text: str) -> tuple[str, distributions.BaseDistribution]:
    """A setting and its range as a person writes it: KEY=LOW:HIGH, KEY=LOW:HIGH:log or KEY=A,B,C.

    Bounds that are integers give integers.

    Raises:
        InputError: the text is not a range.
    """
    key, _, what = text.partition("=")
    if not (key and what):
        raise InputError(f"--vary {text}: expected KEY=LOW:HIGH, KEY=LOW:HIGH:log or KEY=A,B,C")
    ends = re.fullmatch(r"([^:,]+):([^:,]+)(:log)?", what)
    if not ends:
        if ":" in what or "," not in what:
            raise InputError(f"--vary {text}: expected LOW:HIGH, LOW:HIGH:log or A,B,C")
        return key, distributions.CategoricalDistribution([*map(value_of, what.split(","))])
    low, high, log = value_of(ends[1]), value_of(ends[2]), ends[3] is not None
    for end in (low, high):
        if isinstance(end, bool) or not isinstance(end, int | float) or not np.isfinite(end):
            raise InputError(f"--vary {text}: {end!r} is not a finite number")
    if low >= high or (log and low <= 0):
        raise InputError(f"--vary {text}: expected LOW < HIGH{', LOW > 0' if log else ''}")
    whole = isinstance(low, int) and isinstance(high, int)
    of = distributions.IntDistribution if whole else distributions.FloatDistribution
    return key, of(low, high, log=log)


def value_at(everything: Mapping[str, Any], key: str) -> Any:
    """The value at a dotted key of settings.

    Raises:
        InputError: there is no such setting, or it holds several settings.
    """
    place: Any = everything
    for part in key.split("."):
        if not isinstance(place, Mapping) or part not in place:
            known = ", ".join(sorted(place)) if isinstance(place, Mapping) else "no settings"
            raise InputError(f"--vary {key}: {part} is not a setting; there are {known}")
        place = place[part]
    if isinstance(place, Mapping):
        raise InputError(f"--vary {key}: holds several settings: {', '.join(sorted(place))}")
    return place


def all_settings(spec: Spec) -> dict[str, Any]:
    """Return every setting of a policy, with its current value.

    Raises:
        InputError: the name is unknown, or a setting is wrong.
    """
    found = dict(dump(settings_of(spec)))
    for part, make in (("planner", make_planner), ("follower", make_follower)):
        if isinstance(found.get(part), Mapping):
            found[part] = dump(make(found[part]))
    return found


@dataclass(frozen=True)
class Drives:
    """Scores policies by driving episodes."""

    scenes: Sequence[Spec]
    env: Mapping[str, Any]
    metric: str
    folder: Path
    jobs: int

    def __call__(self, spec: Spec, seeds: Sequence[int]) -> Scores:
        """One score an episode: each scene's seeds."""
        records = evaluate(
            [spec], self.scenes, seeds, env=self.env, folder=self.folder, jobs=self.jobs,
            progress=False,
        )  # fmt: skip
        return [float(record[self.metric]) for record in records]


def tune(
    spec: Spec,
    ranges: Ranges,
    judge: Judge,
    seeds: Sequence[int],
    others: Sequence[int],
    *,
    trials: int,
    folder: Path,
    seed: int = 0,
    progress: bool = True,
) -> dict[str, Any]:
    """Search, and score the best trial and the current settings on other episodes.

    The same call resumes a search that was stopped; more trials extend a search.

    Args:
        spec: the policy.
        ranges: the settings that are searched, and where.
        judge: scores settings.
        seeds: of the episodes that trials are scored on.
        others: of the episodes that the best trial is scored on again.
        trials: their total number; the first one has the current settings.
        folder: for Optuna's journal, trials.csv and best.json.
        seed: of Optuna's draws, which do not depend on interruptions.
        progress: show a bar on standard error.

    Returns:
        The content of trials.csv and best.json, and the scores on other episodes.

    Raises:
        InputError: a setting is unknown, a range lacks its current value, or the folder holds
            another search.
        StoppedError: Ctrl-C; the same call resumes.
    """
    current = all_settings(spec)
    before = {key: value_at(current, key) for key in ranges}
    for key, each in ranges.items():
        if not covers(each, before[key]):
            raise InputError(
                f"--vary {key}: the range lacks the current value {before[key]!r}, which the first "
                "trial has; expected a range with it (integer bounds give integers), or a policy "
                "FILE.json:NAME with a value in the range"
            )
    asked = {key: value for key, value in vars(judge).items() if key not in EXECUTION}
    where = {key: distributions.distribution_to_json(each) for key, each in ranges.items()}
    what = runs.run_key(runs.source_digest(), spec, where, list(seeds), seed, asked)
    study = _study(folder, what)
    if not study.trials:
        study.enqueue_trial(before)
    with runs.stopped_by_ctrl_c(lambda: f"{len(_done(study))} of {trials} trials are done"):
        with tqdm(total=trials, disable=not progress, unit="trial") as bar:
            for number, values in _drawn(study, ranges, trials, seed):
                if values is not None:
                    try:
                        score = float(np.mean(judge(with_values(named(spec), values), seeds)))
                        study.tell(number, score)
                    except InputError as error:  # settings that do not fit together
                        study.tell(number, state=optuna.trial.TrialState.FAIL)
                        if progress:
                            tqdm.write(f"trial {number}: {error}", file=sys.stderr)
                bar.update(number + 1 - bar.n)
                if done := _done(study):
                    bar.set_postfix_str(f"best {max(t.value or 0.0 for t in done):.4g}")
        return _result(spec, study, before, judge, others, folder)


def _study(folder: Path, what: str) -> optuna.Study:
    """The search that is stored in a folder, or a new one."""
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
    study: optuna.Study, ranges: Ranges, trials: int, seed: int
) -> Iterator[tuple[int, dict[str, Any] | None]]:
    """Number and values of every trial to be scored; None for one that was killed while drawn."""
    for frozen in study.get_trials(states=(optuna.trial.TrialState.RUNNING,)):
        if len(frozen.params) == len(ranges):
            yield frozen.number, dict(frozen.params)
        else:
            study.tell(frozen.number, state=optuna.trial.TrialState.FAIL)
            yield frozen.number, None
    while True:
        number = sum(trial.state.is_finished() for trial in study.trials)
        if number >= trials:
            return
        # Draws depend on the trial and those before it alone, so that a search can be stopped.
        draws = int(np.random.SeedSequence((seed, number)).generate_state(1)[0])
        study.sampler = optuna.samplers.TPESampler(seed=draws)
        trial = study.ask(dict(ranges))
        yield trial.number, dict(trial.params)


def _done(study: optuna.Study) -> list[optuna.trial.FrozenTrial]:
    return [trial for trial in study.trials if trial.value is not None]


def _result(
    spec: Spec, study: optuna.Study, before: Mapping[str, Any], judge: Judge,
    others: Sequence[int], folder: Path,
) -> dict[str, Any]:  # fmt: skip
    """Score the best trial again, and write everything."""
    done = _done(study)
    if not done:
        raise InputError("no trial could be judged: no settings fit together")
    best = max(done, key=lambda trial: (trial.value or 0.0, -trial.number))
    tuned = with_values(named(spec), best.params)
    name = str(tuned.pop("name"))
    new, old = (np.array(judge(s, others)) for s in ({"name": name, **tuned}, spec))
    _, *interval = statistics.mean_interval(new - old)  # NaN of a single episode
    provenance.write_json(folder / "best.json", {name: tuned})
    rows = [
        {"trial": trial.number, "score": trial.value, "state": trial.state.name.lower()}
        | {key: trial.params.get(key) for key in before}
        for trial in study.trials
    ]
    provenance.write_text(folder / "trials.csv", tables.csv_table(rows))
    return {
        "name": name,
        "trials": len(study.trials),
        "best": {"trial": best.number, "score": best.value, "settings": dict(best.params)},
        "before": dict(before),
        "others": {
            "episodes": len(new),
            "before": float(old.mean()),
            "best": float(new.mean()),
            "gain": float(np.mean(new - old)),
            "gain_interval": [*map(tables.json_value, interval)],
        },
    }
