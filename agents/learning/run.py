"""A training run: learning from checkpoint to checkpoint, which it may be stopped at and resumed.

At each checkpoint all environments begin anew, with seeds of the run's seed and the checkpoint's
number, and so do all random draws. So a run that was killed at any moment and is resumed equals one
that was not, to the bit, on the same machine with the same number of threads.
"""

from __future__ import annotations

import gc
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.utils import set_random_seed

from agents.evaluation.provenance import command_line, commit, machine, versions, write_json
from agents.learning.checkpoint import (
    load_checkpoint,
    save_checkpoint,
    seeds_of,
    state_of,
    take_state,
)
from agents.learning.curves import Board, Row, Tally, read_curve, write_curve
from agents.learning.features import Layout
from agents.learning.model import make_model
from agents.learning.networks import Teacher, arrays_of, head_of, take_arrays
from agents.learning.sb3 import SB3VecEnv
from agents.learning.settings import ON_POLICY, Training, plain
from agents.learning.trials import run_trials, trial_env
from agents.learning.weights import (
    FORMAT,
    Network,
    Weights,
    find_weights,
    load_weights,
    save_weights,
)
from wheelchair_gym.config import InputError, dump
from wheelchair_gym.envs import NavigationVectorEnv
from wheelchair_gym.envs.world_banks import Worlds

SHOWN = ("frames", "success", "timeout", "within", "trial_success")  # of the curve, in a card
POLICY, BEST = "policy.npz", "best.npz"
LOGGED = (
    "train/loss", "train/value_loss", "train/explained_variance", "train/approx_kl", "train/std",
    "train/actor_loss", "train/critic_loss", "train/ent_coef",
)  # fmt: skip
Report = Callable[[Row], None]


class Run:
    """One run of one seed in one folder.

    Args:
        own: its settings.
        seed: of everything.
        folder: where it is kept; what lies there is resumed if it is of the same settings.
        prepared: is told how many worlds of how many are ready.

    Raises:
        InputError: the folder holds another run, or settings do not fit.
    """

    def __init__(
        self,
        own: Training,
        seed: int,
        folder: Path,
        prepared: Callable[[int, int], None] | None = None,
    ) -> None:
        self.own, self.seed, self.folder = own, seed, folder
        teacher = own.teaching.teacher
        known = None if teacher is None else load_weights(find_weights(teacher))
        self._teacher = None if known is None else known.digest
        self._identity = json.dumps([plain(own), seed, self._teacher], sort_keys=True)
        content = load_checkpoint(folder)
        if content is not None and content["identity"] != self._identity:
            raise InputError(f"{folder}: holds a run of other settings or another seed; choose "
                             "another folder, or delete it")  # fmt: skip
        torch.set_num_threads(own.threads)
        self._env_settings = own.env_settings()
        env = NavigationVectorEnv(
            own.envs, self._env_settings, autoreset_mode="SameStep",
            num_threads=min(own.threads, own.envs),
        )  # fmt: skip
        self.worlds: Worlds = env.worlds
        self.worlds.fill(prepared)
        gc.collect()
        gc.freeze()  # worlds stay: looking them through for garbage takes a tenth of the time
        self.env = SB3VecEnv(env, flat=True)
        sizes = [(key, box.shape[0]) for key, box in env.task.boxes.items()]
        self.layout = Layout.of(sizes, env.task.posed)
        self._trials: NavigationVectorEnv | None = None
        self.model = make_model(own, seed, self.env, self.layout)
        if known is not None:
            self.model.policy.teacher = Teacher(known, self.layout, self._env_settings)
        self.tally = Tally()
        self.worlds.within = own.curriculum.begin
        self._judged = [0, 0]  # episodes and successes since the curriculum was last moved
        self.number, self.best, self.rows = 0, -1.0, read_curve(folder)
        if content is not None:
            take_state(self.model, content["model"])
            self.number, self.best = content["number"], content["best"]
            self.worlds.within = content["within"]
            self.rows = self.rows[: self.number]
        elif own.warm_start is not None:
            taken = load_weights(find_weights(own.warm_start))
            take_arrays(self.model, own.algorithm, taken.arrays)

    @property
    def frames(self) -> int:
        """Control periods so far."""
        return int(self.model.num_timesteps)

    @property
    def done(self) -> bool:
        """Whether all frames were driven."""
        return self.frames >= self.own.frames

    @property
    def part(self) -> int:
        """Frames between two checkpoints."""
        steps = self.own.on_policy.steps if self.own.algorithm in ON_POLICY else 1
        return self.own.envs * steps * self.own.checkpoint

    def learn(self, each: Callable[[int], None] | None = None) -> Row:
        """Learn until the next checkpoint, and keep it; the curve's new row.

        Args:
            each: is told the frames after each step.
        """
        begun = time.perf_counter()
        draws, envs = seeds_of(self.seed, self.number)
        set_random_seed(draws)
        self.model.action_space.seed(draws)
        self.env.seed(envs)
        self.model._last_obs = None
        self.tally.begin()
        self._judged = [0, 0]
        self._let_go()

        def step(local: dict[str, Any], _: dict[str, Any]) -> bool:
            self.tally.add(local["infos"], local["dones"])
            self._move_on()
            if each is not None:
                each(self.frames)
            return True

        before = self.frames
        wanted = min(self.part, max(1, self.own.frames - before))
        self.model.learn(wanted, step, log_interval=None, reset_num_timesteps=False)
        logger = self.model.logger.name_to_value
        learned = time.perf_counter()
        row: Row = {"frames": self.frames, **self.tally.row(), "within": self.worlds.within}
        row |= {name.partition("/")[2]: float(logger[name]) for name in LOGGED if name in logger}
        weights = self.weights(row)
        row |= self._judge(weights)
        row["frames_per_second_s"] = round((self.frames - before) / (learned - begun))
        row["wall_time_s"] = round(time.perf_counter() - begun, 2)
        self.number += 1
        self.rows.append(row)
        self._keep(weights)
        return row

    def _let_go(self) -> None:
        """Give the actor as much leash as it has learned for."""
        own = self.own.teaching
        if own.teacher is not None:
            left = max(0.0, 1.0 - self.frames / (own.until * self.own.frames))
            self.model.policy.leash = own.weight * left / self.own.on_policy.entropy

    def _move_on(self) -> None:
        """Let starts move away from the goal where enough episodes succeed."""
        c = self.own.curriculum
        episodes = self.tally.episodes - self._judged[0]
        if c.begin == 0.0 or episodes < c.episodes:
            return
        share = (self.tally.success - self._judged[1]) / episodes
        self._judged = [self.tally.episodes, self.tally.success]
        if share > c.above:
            self.worlds.within = min(c.most, self.worlds.within * c.factor)

    def _judge(self, weights: Weights) -> Row:
        trials = self.own.trials
        if trials.episodes == 0 or ((self.number + 1) % trials.every and not self.done):
            return {}
        if self._trials is None:
            self._trials = trial_env(self._env_settings, trials, self.own.threads)
        found = run_trials(self._trials, Network(weights), trials.seed)
        weights.card["trials"] = {**found, "episodes": trials.episodes, "seed": trials.seed}
        if found["success"] >= self.best:
            self.best = found["success"]
            save_weights(self.folder / BEST, weights)
        return {f"trial_{name}": value for name, value in found.items()}

    def weights(self, row: Row) -> Weights:
        """The actor as it is now, with its card."""
        card = {
            "format": FORMAT,
            "algorithm": self.own.algorithm,
            "head": head_of(self.own.algorithm),
            "layout": {
                "sizes": [list(pair) for pair in self.layout.sizes],
                "posed": self.layout.posed,
            },
            "env": dump(self._env_settings),
            "training": plain(self.own),
            "teacher": self._teacher,
            "seed": self.seed,
            "frames": self.frames,
            "row": row,
            "curve": [[r.get(key, "") for key in SHOWN] for r in (*self.rows, row)],
            "command": command_line(),
            "commit": commit(),
            "machine": machine(),
            "versions": versions(),
            "limits": "trained and judged in simulation only; it guarantees nothing: drive it "
            "behind a shield",
        }
        return Weights(arrays_of(self.model, self.own.algorithm), card)

    def _keep(self, weights: Weights) -> None:
        write_curve(self.folder, self.rows)
        save_weights(self.folder / POLICY, weights)
        write_json(self.folder / "settings.json", plain(self.own))
        write_json(self.folder / "card.json", weights.card)
        content = {
            "identity": self._identity,
            "number": self.number,
            "best": self.best,
            "within": self.worlds.within,
            "model": state_of(self.model),
        }
        save_checkpoint(self.folder, content)

    def close(self) -> None:
        """Close the environments, and let their worlds go."""
        gc.unfreeze()
        self.env.close()
        if self._trials is not None:
            self._trials.close()


def train(
    own: Training,
    seed: int,
    folder: Path,
    *,
    each: Callable[[int], None] | None = None,
    report: Report | None = None,
    prepared: Callable[[int, int], None] | None = None,
) -> list[Row]:
    """Train to the end, or go on with what the folder holds; the curve.

    Args:
        own: settings.
        seed: of everything.
        folder: where the run is kept.
        each: is told the frames after each step.
        report: is given each new row.
        prepared: is told how many worlds of how many are ready.

    Raises:
        InputError: the folder holds another run, or settings do not fit.
    """
    run = Run(own, seed, folder, prepared)
    board = Board(folder)
    try:
        while not run.done:
            row = run.learn(each)
            board.add(row)
            if report is not None:
                report(row)
    finally:
        board.close()
        run.close()
    return run.rows
