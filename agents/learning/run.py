"""A training run: it learns from checkpoint to checkpoint, and can be stopped and resumed at each.

At each checkpoint all environments reset, with seeds derived from the run's seed and the number of
the checkpoint, and so do all random generators. A run that was killed and resumed therefore equals
one that was not, bit for bit, on the same machine with the same number of threads.
"""

import dataclasses
import gc
import json
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from stable_baselines3.common.utils import set_random_seed

from agents import read_data
from agents.evaluation.provenance import provenance, write_json
from agents.evaluation.runs import LostError, in_workers
from agents.learning import folder as stored
from agents.learning import networks
from agents.learning.folder import BEST, POLICY, Row
from agents.learning.sb3 import SB3VecEnv, flatten_observations
from agents.learning.settings import Evaluation, Training
from agents.learning.weights import Layout, Network, Weights, find_weights, load_weights, make_card
from agents.learning.weights import save_weights as save
from agents.watch import ignore
from wheelchair_gym.base.settings import InputError, dotted, dump
from wheelchair_gym.envs import EnvSettings, NavigationVectorEnv
from wheelchair_gym.envs.settings import BankSettings
from wheelchair_gym.envs.world_banks import WorldBank

# Columns of the curve that a card keeps.
CURVE_COLUMNS = ("frames", "success", "timeout", "curriculum_time", "eval_success")
BATCH = 8  # worlds that a process makes before it reports
FIRST_WORLDS = 256  # that are drawn before the first frames
PARTS: dict[str, str] = read_data("training_parts.yaml")  # of a run, and what of it they are
LOGGED = (
    "train/loss", "train/value_loss", "train/explained_variance", "train/approx_kl", "train/std",
    "train/actor_loss", "train/critic_loss", "train/ent_coef",
)  # fmt: skip


def _differences(before: str, now: str) -> list[str]:
    """Differences of a run's settings, seed and teacher; more frames extend it."""
    old, new = (
        dotted(settings) | {"seed": seed, "the teacher's digest": teacher}
        for settings, seed, teacher in map(json.loads, (before, now))
    )
    if new["frames"] > old.get("frames", math.inf):
        old["frames"] = new["frames"]
    return [
        f"{key} {json.dumps(old.get(key))}, not {json.dumps(new.get(key))}"
        for key in sorted({*old, *new})
        if old.get(key) != new.get(key)
    ]


def _keep_worlds(settings: EnvSettings, numbers: Sequence[int]) -> None:
    NavigationVectorEnv(config=settings).worlds.keep(numbers)


def _drawn_beside(worlds: WorldBank, settings: EnvSettings, workers: int) -> Iterator[int]:
    """Make the worlds of a bank in several processes, where a folder keeps them.

    Gives the number of worlds of each batch when it is ready; the processes go on meanwhile.
    """
    missing = worlds.missing() if workers > 1 and settings.bank.cache is not None else []
    batches = [missing[k : k + BATCH] for k in range(0, len(missing), BATCH)]
    if len(batches) > 1:
        with suppress(LostError):  # then this process makes the rest
            for k, _ in in_workers(partial(_keep_worlds, settings), batches, workers, True):
                yield len(batches[k])


class Run:
    """One training run of one seed in one folder.

    Args:
        config: its settings.
        seed: of all random numbers.
        folder: where it is kept; a run of the same settings in it is resumed; with more
            frames, also a finished one.
        on_prepared: called with the number of worlds that are ready, and of all worlds.
        on_evaluated: called with the number of episodes of an evaluation that have ended, and
            of all its episodes.

    Raises:
        InputError: the folder holds another run, or settings do not fit each other.
    """

    def __init__(
        self, config: Training, seed: int, folder: Path,
        on_prepared: Callable[[int, int], None] = ignore,
        on_evaluated: Callable[[int, int], None] = ignore,
    ) -> None:  # fmt: skip
        self.config, self.seed, self.folder = config, seed, folder
        self._on_evaluated = on_evaluated
        name = config.kickstarting.teacher
        teacher = None if name is None else load_weights(find_weights(name))
        self._teacher_digest = None if teacher is None else teacher.digest
        self._fingerprint = json.dumps([dump(config), seed, self._teacher_digest], sort_keys=True)
        content = stored.load_checkpoint(folder)
        differ = [] if content is None else _differences(content["identity"], self._fingerprint)
        if differ:
            some = ", ".join(differ[:3]) + (", ..." if len(differ) > 3 else "")
            raise InputError(
                f"{folder}: holds a run with {some}; choose another folder, or delete it"
            )
        initial = load_weights(find_weights(config.warm_start)) if config.warm_start else None
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "settings.json", dump(config))
        torch.set_num_threads(config.threads)
        self._env_settings = config.env_settings()
        env = NavigationVectorEnv(
            config.n_envs, config=self._env_settings, autoreset_mode="SameStep",
            num_threads=min(config.threads, config.n_envs),
        )  # fmt: skip
        self.worlds: WorldBank = env.worlds
        self.checkpoint_number = 0 if content is None else content["number"]
        self._drawing = _drawn_beside(self.worlds, self._env_settings, config.threads)
        self._draw_worlds(on_prepared)
        gc.collect()
        gc.freeze()  # worlds are permanent: scanning them takes a tenth of the run's time
        self.env = SB3VecEnv(env, flat=True)
        self.layout = Layout.of_task(env.task)
        self._eval_env: NavigationVectorEnv | None = None
        needs = self.layout, self._env_settings
        tutor = None if teacher is None else networks.Teacher(teacher, *needs)
        self.model = networks.make_model(config, seed, self.env, self.layout, tutor)
        self.sums: Counter[str] = Counter()  # over the episodes since the last checkpoint
        self.worlds.max_time = config.curriculum.initial_time or self._env_settings.starts_within
        self._curriculum_mark = [0, 0]  # episodes and successes at the last advance
        self.best_success = -1.0
        self.rows: list[Row] = []  # of checkpoints: a curve may hold one that was not saved
        if content is not None:
            stored.load_model_state(self.model, content["model"])
            self.best_success = content["best"]
            self.worlds.max_time = content["within"]
            self.rows = stored.read_curve(folder)[: self.checkpoint_number]
        elif initial is not None:
            networks.load_actor_arrays(self.model, config.algorithm, initial.arrays)

    @property
    def frames(self) -> int:
        """Environment steps so far."""
        return int(self.model.num_timesteps)

    @property
    def done(self) -> bool:
        """Whether all frames were driven."""
        return self.frames >= self.config.frames

    @property
    def frames_per_checkpoint(self) -> int:
        """Frames between two checkpoints."""
        return self.config.n_envs * self.config.steps_per_checkpoint

    def learn(self, on_step: Callable[[int], None] = ignore) -> Row:
        """Learn until the next checkpoint, and save it; the new row of the curve.

        Args:
            on_step: called with the frames so far after each step.
        """
        started = time.perf_counter()
        self._draw_worlds()
        sequence = np.random.SeedSequence([self.seed, self.checkpoint_number])
        model_seed, env_seed = map(int, sequence.generate_state(2))
        set_random_seed(model_seed)
        self.model.action_space.seed(model_seed)
        self.env.seed(env_seed)
        self.model._last_obs = None
        self.sums.clear()
        self._curriculum_mark = [0, 0]
        self._anneal_kickstart()

        def callback(local: dict[str, Any], _: dict[str, Any]) -> bool:
            stored.add_ended_episodes(self.sums, local["infos"], local["dones"])
            self._advance_curriculum()
            on_step(self.frames)
            return True

        before = self.frames
        frames = min(self.frames_per_checkpoint, max(1, self.config.frames - before))
        self.model.learn(frames, callback, log_interval=None, reset_num_timesteps=False)
        logged = self.model.logger.name_to_value
        learned = time.perf_counter()
        row: Row = {
            "frames": self.frames, **stored.episode_row(self.sums),
            "curriculum_time": self.worlds.max_time,
            **{name.partition("/")[2]: float(logged[name]) for name in LOGGED if name in logged},
        }  # fmt: skip
        weights = self.weights(row)
        row |= self._evaluate(weights)
        row["frames_per_second_s"] = round((self.frames - before) / (learned - started))
        row["wall_time_s"] = round(time.perf_counter() - started, 2)
        self.checkpoint_number += 1
        self.rows.append(row)
        self._save(weights)
        return row

    def _draw_worlds(self, report: Callable[[int, int], None] = ignore) -> None:
        """Wait for the worlds of this checkpoint: at first few, then twice as many at each.

        So processes draw further ones during the first frames, and no result depends on when.
        """
        worlds, size = self.worlds, self._env_settings.bank.size
        worlds.limit = min(size, FIRST_WORLDS << min(self.checkpoint_number, 32))
        ready = worlds.limit - sum(number < worlds.limit for number in worlds.missing())
        while ready < worlds.limit and (batch := next(self._drawing, 0)):
            ready += batch
            report(min(ready, worlds.limit), worlds.limit)
        worlds.fill(None if ready else report)

    def _anneal_kickstart(self) -> None:
        """Decrease the weight of the teacher's actions linearly over the run."""
        kickstarting = self.config.kickstarting
        if kickstarting.teacher is not None:
            left = max(0.0, 1.0 - self.frames / (kickstarting.duration * self.config.frames))
            weight = kickstarting.coefficient * left / self.config.on_policy.ent_coef
            self.model.policy.kickstart_weight = weight

    def _advance_curriculum(self) -> None:
        """Move starts away from the goal when enough episodes succeed."""
        curriculum = self.config.curriculum
        episodes = self.sums["episodes"] - self._curriculum_mark[0]
        if curriculum.initial_time == 0.0 or episodes < curriculum.episodes:
            return
        share = (self.sums["success"] - self._curriculum_mark[1]) / episodes
        self._curriculum_mark = [self.sums["episodes"], self.sums["success"]]
        if share > curriculum.success_threshold:
            further = self.worlds.max_time * curriculum.growth
            self.worlds.max_time = min(curriculum.max_time, further)

    def _evaluate(self, weights: Weights) -> Row:
        """Evaluate the actor where an evaluation is due, and keep the best weights."""
        config = self.config.evaluation
        due = (self.checkpoint_number + 1) % config.frequency == 0 or self.done
        if config.episodes == 0 or not due:
            return {}
        if self._eval_env is None:
            self._eval_env = make_eval_env(self._env_settings, config, self.config.threads)
        network = Network(weights)
        figures = evaluate_network(self._eval_env, network, config.seed, self._on_evaluated)
        weights.card["evaluation"] = figures | {"episodes": config.episodes, "seed": config.seed}
        if figures["success"] >= self.best_success:
            self.best_success = figures["success"]
            save(self.folder / BEST, weights)
        return {f"eval_{name}": value for name, value in figures.items()}

    def weights(self, row: Row) -> Weights:
        """The current actor with its card."""
        algorithm = self.config.algorithm
        head = "clip" if algorithm == "ppo" else "tanh"  # how its outputs come into [-1, 1]
        card = make_card(
            algorithm, head, self.layout, self._env_settings, self.config, self.seed,
            limits="trained and evaluated in simulation only; it guarantees nothing: drive it "
            "behind a shield",
        )  # fmt: skip
        card |= {
            "teacher": self._teacher_digest,
            "in_bfloat16": getattr(self.model.policy, "in_bfloat16", False),  # by this processor
            "frames": self.frames,
            "row": row,
            "curve": [[r.get(key, "") for key in CURVE_COLUMNS] for r in (*self.rows, row)],
        }
        return Weights(networks.actor_arrays(self.model, algorithm), card)

    def _save(self, weights: Weights) -> None:
        stored.write_curve(self.folder, self.rows)
        save(self.folder / POLICY, weights)
        write_json(self.folder / "card.json", weights.card)
        content = {
            "identity": self._fingerprint,
            "number": self.checkpoint_number,
            "best": self.best_success,
            "within": self.worlds.max_time,
            "model": stored.model_state(self.model),
        }
        stored.save_checkpoint(self.folder, content)

    def close(self) -> None:
        """Close the environments, and free their worlds; no further ones are drawn."""
        del self._drawing
        gc.unfreeze()
        self.env.close()
        if self._eval_env is not None:
            self._eval_env.close()


def train(
    config: Training,
    seed: int,
    folder: Path,
    *,
    on_step: Callable[[int], None] = ignore,
    on_row: Callable[[Row], None] = ignore,
    on_prepared: Callable[[int, int], None] = ignore,
    on_evaluated: Callable[[int, int], None] = ignore,
) -> list[Row]:
    """Train to the end, or resume the run in the folder; the rows of the curve.

    Arguments are those of `Run`; `on_row` is called with each new row.

    Raises:
        InputError: the folder holds another run, or settings do not fit each other.
    """
    run = Run(config, seed, folder, on_prepared, on_evaluated)
    logged = find_spec("tensorboard") is not None
    logger = Logger(None, [TensorBoardOutputFormat(str(folder / "tensorboard"))] if logged else [])
    try:
        while not run.done:
            row = run.learn(on_step)
            for key, value in row.items():
                if key != "frames" and isinstance(value, int | float):
                    logger.record(key, value)
            logger.dump(int(row["frames"]))
            on_row(row)
    finally:
        logger.close()
        run.close()
    return run.rows


def make_eval_env(env: EnvSettings, config: Evaluation, threads: int) -> NavigationVectorEnv:
    """Make environments whose first episodes are the evaluation, without the curriculum.

    Their worlds are training worlds, too, since weights are chosen on them, but of another bank.
    """
    bank = BankSettings(config.episodes, 0.0, config.seed, env.bank.cache)
    settings = dataclasses.replace(env, bank=bank, starts_within=0.0)
    return NavigationVectorEnv(
        config.episodes, config=settings, autoreset_mode="SameStep",
        num_threads=min(threads, config.episodes),
    )  # fmt: skip


def evaluate_network(
    env: NavigationVectorEnv,
    network: Network,
    seed: int,
    on_evaluated: Callable[[int, int], None] = ignore,
) -> dict[str, float]:
    """Shares of success, collision and timeout of the first episode of each row, and mean time.

    Success is measured by true poses and without contact, and any contact counts as a collision;
    the mean time [s] is over successes.
    `on_evaluated` is called with the number of episodes that have ended, and of all episodes.
    """
    n = env.num_envs
    observations, _ = env.reset(seed=seed)
    running = np.ones(n, bool)
    success, touched, times = np.zeros(n, bool), np.zeros(n, bool), np.zeros(n)
    on_evaluated(0, n)
    while running.any():
        actions = network(flatten_observations(observations))
        observations, _, terminated, truncated, infos = env.step(actions)
        ended = (terminated | truncated) & running
        touched |= (infos["bumped"] | infos["contact"]) & running & ~ended
        if ended.any():
            final = infos["final_info"]
            success[ended] = final["is_success"][ended]
            touched |= (final["bumped"] | final["contact"]) & ended
            times[ended] = final["time"][ended]
            running &= ~ended
        on_evaluated(n - int(running.sum()), n)
    return {
        "success": float(success.mean()),
        "collision": float(touched.mean()),
        "timeout": float((~success & ~touched).mean()),
        "time": float(times[success].mean()) if success.any() else 0.0,
    }


def measure_parts(config: Training) -> dict[str, Any]:
    """Train in a folder that is removed, and measure each part.

    Returns:
        `seconds` by part of PARTS, `frames`, `frames_per_second` without the part `worlds`, the
        `device` of the networks, and the provenance.

    Raises:
        InputError: settings do not fit each other.
    """
    seconds: dict[str, float] = dict.fromkeys((*PARTS, "steps"), 0.0)

    def timed(part: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def measured(*arguments: Any, **named: Any) -> Any:
            began = time.perf_counter()
            try:
                return call(*arguments, **named)
            finally:
                seconds[part] += time.perf_counter() - began

        return measured

    with TemporaryDirectory() as folder:
        run: Any = timed("worlds", Run)(config, 0, Path(folder))
        try:
            run.env.reset = timed("environments", run.env.reset)
            run.env.step = timed("steps", run.env.step)
            run.model.collect_rollouts = timed("actor", run.model.collect_rollouts)
            run.model.train = timed("learning", run.model.train)
            run._evaluate = timed("evaluation", run._evaluate)
            run._save = timed("saving", run._save)
            began = time.perf_counter()
            while not run.done:
                run.learn()
            whole = time.perf_counter() - began
        finally:
            run.close()
    seconds["environments"] += seconds["steps"]
    seconds["actor"] -= seconds["steps"]
    return {
        "seconds": {part: round(seconds[part], 2) for part in PARTS}, "frames": run.frames,
        "frames_per_second": round(run.frames / whole), "device": run.model.device.type,
        **provenance(),
    }  # fmt: skip


def parts_text(found: dict[str, Any]) -> str:
    """Return a table of what `measure_parts` returns."""
    whole = sum(found["seconds"].values())
    lines = [f"{part:<14}{found['seconds'][part]:>9.1f} s{found['seconds'][part] / whole:>7.0%}   "
             f"{what}" for part, what in PARTS.items()]  # fmt: skip
    rate = f"{found['frames_per_second']:,} frames/s without worlds"
    return "\n".join([*lines, f"{found['frames']:,} frames, {rate}, networks on {found['device']}"])
