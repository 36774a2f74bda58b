"""Many chairs at once: the same step as one chair's, looped by a compiled function.

Returned arrays are never overwritten while a caller holds them (`results`).
"""

import math
import secrets
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from numbers import Integral
from pathlib import Path
from typing import Any

import gymnasium as gym
import numba
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array, Mask
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled.address import Pointers
from wheelchair_gym.compiled.random import Split, episode_key
from wheelchair_gym.envs.batch import BATCH, BATCH_TARGETS, begin_chairs, step_chairs
from wheelchair_gym.envs.drawing import EpisodeRenderer
from wheelchair_gym.envs.guidance import make_guidance
from wheelchair_gym.envs.results import EPISODE_KEYS, ROW_SIZE, ResultPool, Results
from wheelchair_gym.envs.settings import (
    EnvSettings,
    check_options,
    check_seed,
    check_split,
    env_settings,
    is_integer,
    make_assistants,
)
from wheelchair_gym.envs.world_banks import NO_LEVEL, WorldBank, prepare_world
from wheelchair_gym.people.drivers import make_drivers
from wheelchair_gym.people.drivers.step import Drivers
from wheelchair_gym.perception.track_state import TRACKER
from wheelchair_gym.safety.shield import SHIELDS, point_to_shields
from wheelchair_gym.safety.state import SHIELD, ShieldConstants
from wheelchair_gym.sim.chairs import SimulatedChairs, size_workspace
from wheelchair_gym.task.assessment import PROGRESS
from wheelchair_gym.task.prepared_episode import PREPARED, PreparedEpisode
from wheelchair_gym.task.rewards import compiled_rewards, make_reward
from wheelchair_gym.task.task import Observation, Task
from wheelchair_gym.types import Episode

Info = dict[str, Any]

_BLOCKS_A_THREAD = 8  # some chairs take longer than others
_ROWS_A_THREAD = 64  # fewer take less time than a second thread needs to wake up
_ALSO = ("num_envs", "split", "autoreset_mode", "num_threads", "render_mode")  # arguments
_CORES: int = vars(numba.config)["NUMBA_NUM_THREADS"]  # that this process may use


class NavigationVectorEnv(VectorEnv[Observation, Any, Any]):
    """`NavigationEnv` for many chairs: row i is the single env seeded with seed + i, to the bit.

    Observations, actions, rewards and infos are as there, with a first axis of `num_envs`; infos
    are arrays with their masks. An episode's end begins the next one by itself: in the step after
    (NEXT_STEP, its action is ignored) or in the same step (SAME_STEP, with `final_obs` and
    `final_info`). With DISABLED, rows that are over are to be reset, by `reset_mask`. Arrays that
    were handed out are never written again. A deep copy, or one by pickle, steps on as the original
    does, to the bit. `NavigationEnv` says what the arguments mean that are not named here.

    Args:
        num_envs: number of chairs.
        autoreset_mode: NEXT_STEP, SAME_STEP or DISABLED.
        num_threads: that share the work; None: as many as are of use.
        render_mode: 'rgb_array': `render` gives a picture of each row; or None.

    Raises:
        InputError: an argument or a setting is unknown or out of bounds.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: Any = None,
        config: str | Path | Mapping[str, Any] | EnvSettings | None = None,
        *,
        split: Split = "train",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        num_threads: int | None = None,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        if not is_integer(num_envs, 1):
            raise InputError(f"num_envs is {shorten(num_envs)}; expected at least 1, an integer")
        if render_mode not in (None, "rgb_array"):
            raise InputError(f"render_mode is {render_mode!r}; expected rgb_array or None")
        if num_threads is not None and not is_integer(num_threads, 1):
            expected = "expected at least 1, an integer, or None"
            raise InputError(f"num_threads is {shorten(num_threads)}; {expected}")
        modes = {m.value: m for m in AutoresetMode}
        mode = modes.get(str(getattr(autoreset_mode, "value", autoreset_mode)))
        if mode is None:
            raise InputError(f"autoreset_mode is {autoreset_mode}; expected {' or '.join(modes)}")
        self.settings = s = env_settings(config, also=_ALSO, scene=scene, **settings)
        if s.sensors.localizes:
            raise InputError(
                f"sensors.pose_source is {s.sensors.pose_source!r}; expected truth, odometry or "
                "modelled: mcl and slam take milliseconds a step, so use single environments in "
                "gymnasium.vector.AsyncVectorEnv"
            )
        self.num_envs = n = num_envs
        self.split, self.autoreset_mode = check_split(split), mode
        self.metadata = {
            "autoreset_mode": mode, "render_modes": ["rgb_array"], "render_fps": s.rate
        }  # fmt: skip
        self.render_mode = render_mode
        self._drawings = [EpisodeRenderer(s) for _ in range(n if render_mode else 0)]
        guidance = make_guidance(s.guidance)
        people = make_drivers(s.driver)
        self.drivers = Drivers(people, s.chair, s.sensors, 1.0 / s.rate, n)
        self.assistants = make_assistants(s, n, bool(people))
        self.task = Task(s.task, s.chair, s.sensors, 1.0 / s.rate, guidance, s.shield, bool(people))
        self.worlds = WorldBank(s, self.task, self.split)
        self._reward = make_reward(s.reward)
        self.single_observation_space = self.task.space
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, n)
        self.action_space = batch_space(self.single_action_space, n)
        threads = num_threads or min(_CORES, n // _ROWS_A_THREAD)
        self.num_threads = max(1, min(n, threads))
        blocks = 1 if self.num_threads == 1 else min(n, _BLOCKS_A_THREAD * self.num_threads)
        self._blocks = list(pairwise(np.linspace(0, n, blocks + 1).astype(int).tolist()))
        self.chairs = SimulatedChairs(s.chair, s.sensors, s.physics, 1.0 / s.rate, n)
        self._guard: ShieldConstants | None = None
        if s.shield is not None:
            self._guard = ShieldConstants(s.shield, s.chair, s.sensors, 1.0 / s.rate)
        self._progress = np.zeros(n, PROGRESS)
        self._tracked = np.zeros(n if s.task.tracks else 0, TRACKER)
        self._shields = np.zeros(n if s.shield else 0, SHIELD)
        self._over = np.zeros(n, np.bool_)
        self._held: list[PreparedEpisode | None] = [None] * n  # driven now
        self._next: list[PreparedEpisode | None] = [None] * n
        self._next_worlds: list[int | Episode | None] = [None] * n  # where `set_next` chose them
        # Of rows that no seed is given for.
        self._seeds = secrets.randbits(48) + np.arange(n, dtype=np.int64)
        self._counts = np.zeros(n, np.int64)  # episodes begun of the present seeds
        self._levels, self._next_levels = (np.full(n, NO_LEVEL, np.int64) for _ in range(2))
        self._max_times = np.full(n, math.nan)  # s, of `set_next`; NaN: as the settings say
        self._weights: dict[int, Array] = {}  # of the bank's worlds, cumulative, by row
        self._episodes: dict[str, NDArray[Any]] = {}  # which ones rows drive, by key of infos
        self._spec: EnvSpec | None = None
        self._bind()

    def _bind(self) -> None:
        """Find the rows that kernels take, and make what they work in."""
        n, chairs = self.num_envs, self.chairs
        self._prepared, self._next_prepared = np.zeros(n, PREPARED), np.zeros(n, PREPARED)
        self._keys, self._actions = np.zeros(n, np.uint64), np.zeros((n, 2))
        self._task_rows = self.task.row_pointers(self._progress, self._prepared, self._tracked)
        self._shield_rows: Any = np.zeros(1, SHIELDS)
        if self._guard is not None:
            self._shield_rows = point_to_shields(self._guard, self._shields)
        self._rows = [chairs.row_pointers() for _ in range(self.num_threads)]
        self._columns = 0  # of the workspaces
        beams = self.settings.sensors.beams
        self._batches = [
            Pointers(np.zeros(1, BATCH), BATCH_TARGETS).fill(
                n=n, unshielded=self.settings.unshielded, beams=beams, task=self._task_rows,
                chairs=rows, shields=self._shield_rows, drivers=self.drivers.pointers,
                assistants=self.assistants.pointers, actions=self._actions, keys=self._keys,
                next_prepared=self._next_prepared, is_over=self._over,
                ranges=np.zeros(beams, np.float32),
            )
            for rows in self._rows
        ]  # fmt: skip
        self._pool: ThreadPoolExecutor | None = None
        make, size = partial(Results, self.task, n), n * (ROW_SIZE + 4 * self.task.observation_size)
        self._results, self._finals = ResultPool(make, size), ResultPool(make, size)
        self._last: Results | None = None  # of the last step or reset
        self._spare: Results | None = None  # for last steps: zeros
        self._write_rewards = None if self._reward is None else compiled_rewards(self._reward)
        self._make_workspace(0)
        for i, (now, following) in enumerate(zip(self._held, self._next, strict=True)):
            if now is not None:
                self._prepared[i] = now.record[0]
                self._make_workspace(now.columns)
            if following is not None:
                self._keys[i] = episode_key(int(self._seeds[i]), int(self._counts[i]), self.split)
                self._make_ready(i, following)

    def __getstate__(self) -> dict[str, Any]:
        """Without threads, memory that is worked in, and what `_bind` makes."""
        made = {
            "_actions", "_batches", "_finals", "_keys", "_last", "_next_prepared", "_pool",
            "_prepared", "_results", "_rows", "_spare", "_task_rows", "_write_rewards",
        }  # fmt: skip
        state = {name: value for name, value in self.__dict__.items() if name not in made}
        state["last"] = None if self._last is None else (self._last.block, self._last.out)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state of a copy."""
        last = state.pop("last")
        self.__dict__.update(state)
        self._bind()
        if last is not None:
            self._last = self._results.take()
            self._last.block[:], self._last.out[:] = last

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, Info]:
        """Begin an episode in every row, or in those of a mask.

        Args:
            seed: row i takes up the sequence of seed + i; a list names the seed of each row. A row
                without a seed (None) begins the next episode of its sequence, and at first a
                sequence of its own that is drawn at random.
            options: {"reset_mask": (n,) bool} leaves the other rows as they are; {"episodes":
                [...]} names the world of each row, as `set_next` does.

        Raises:
            InputError: a seed is no integer or out of bounds, the seeds or the mask are not as
                many as the rows, or another option is given.
        """
        n = self.num_envs
        mask, worlds = check_options(options, "reset_mask", "episodes")
        if mask is not None and (np.shape(mask) != (n,) or np.asarray(mask).dtype != np.bool_):
            raise InputError(f"options: reset_mask is {shorten(mask)}; expected ({n},) bool")
        seeds = self._seeds_of_rows(seed)
        chosen = np.ones(n, np.bool_) if mask is None else np.asarray(mask, np.bool_)
        self._check_next(np.flatnonzero(chosen), worlds)
        if self._last is None and not chosen.all():
            raise gym.error.ResetNeeded("the first reset() must be of every row")
        super().reset(seed=seeds[0] if isinstance(seed, Integral) else None)
        for i in np.flatnonzero(chosen).tolist():
            given = seeds[i]
            if given is not None:
                self._seeds[i], self._counts[i] = given, 0
            if given is not None or self._next[i] is None:
                self._draw(i, self._next_worlds[i])
        if worlds is not None:
            self.set_next(np.flatnonzero(chosen), worlds)
        results = self._results.take()
        if self._last is not None:  # the rows that go on keep what they saw
            results.block[:], results.out[:] = self._last.block, self._last.out
        self._check_filled(chosen)
        begin_chairs(self._batches[0].address, chosen, results.address)
        self._draw_next(np.flatnonzero(chosen))
        self._last = results
        if self._drawings:
            self._follow(chosen)
        return results.observation(), self._infos(results)

    def set_next(
        self,
        rows: Sequence[int] | NDArray[Any],
        worlds: Sequence[int | Episode | None] | None = None,
        starts_within: Any = None,
        weights: Any = None,
    ) -> None:
        """Choose what rows drive in their next episodes; seed and number draw all else.

        A `reset` with a seed keeps what is chosen.

        Args:
            rows: their numbers (k,).
            worlds: of the next episode, (k,): numbers of worlds of the bank, `Episode`s, or None
                for the one that is drawn, as if no worlds are given.
            starts_within: largest plan time from the start to the goal in this and later episodes
                [s], (k,) or one number; 0: the scene's start. None: as before.
            weights: how often each world of the bank is drawn for these rows from now on (size,);
                their sum is not restricted. None: as before, which at first is all alike.

        Raises:
            InputError: rows or worlds are unknown, not as many, or there is no bank; a time is
                below 0, there is no guidance 'poses', or see `WorldBank.cumulative`.
        """
        found, each = self._check_next(rows, worlds)
        sums = None if weights is None else self.worlds.cumulative(weights)
        if starts_within is not None:
            times = np.asarray(starts_within)
            fits = times.shape in ((), (len(found),)) and times.dtype.kind in "fiu"
            if not fits or not (times >= 0.0).all() or not self.task.has_poses:
                expected = "expected at least 0, one or as many as rows, and guidance 'poses'"
                raise InputError(f"starts_within is {shorten(starts_within)}; {expected}")
            self._max_times[found] = times
        if sums is not None:
            self._weights.update(dict.fromkeys(found, sums))
        for row, world in zip(found, each, strict=True):
            self._draw(row, world)

    def _check_next(self, rows: Any, worlds: Any) -> tuple[list[int], list[Any]]:
        """Rows and worlds as lists, before anything is changed; see `set_next`."""
        try:
            found = list(rows)
            each = [None] * len(found) if worlds is None else list(worlds)
        except TypeError:
            text = f"rows are {shorten(rows)}, worlds {shorten(worlds)}; expected a list of each"
            raise InputError(text) from None
        n = self.num_envs
        if not all(is_integer(row) and row < n for row in found) or len({*found}) < len(found):
            raise InputError(f"rows {shorten(rows)}: expected 0 to {n - 1}, integers, each once")
        if len(each) != len(found):
            raise InputError(f"{len(each)} worlds were given for {len(found)} rows")
        for world in each:
            number = isinstance(world, Integral)
            if number and not (self.settings.bank.size > 0 and is_integer(world)):
                raise InputError(f"world {shorten(world)}: expected a bank, and a number from 0")
            if not number and not isinstance(world, Episode | None):
                raise InputError(f"world {shorten(world)}: expected a number, an Episode or None")
        return [int(row) for row in found], each

    def _seeds_of_rows(self, seed: Any) -> list[int | None]:
        """Return the seed that is given for each row, or None."""
        n = self.num_envs
        if seed is None:
            return [None] * n
        if isinstance(seed, Integral):
            first = check_seed(seed)
            check_seed(first + n - 1, f"seed of row {n - 1}")
            return [first + i for i in range(n)]
        if not isinstance(seed, Sequence) and np.ndim(seed) != 1:
            raise InputError(
                f"seed is {shorten(seed)}; expected an integer, a list of one for each row, or None"
            )
        if len(seed) != n:
            raise InputError(f"{len(seed)} seeds were given for {n} environments")
        return [None if s is None else check_seed(s, f"seed[{i}]") for i, s in enumerate(seed)]

    def _check_filled(self, chosen: Mask) -> None:
        """Refuse to begin an episode of a row for which none could be drawn."""
        empty = np.flatnonzero(chosen & ~self._next_prepared["is_filled"]).tolist()
        if empty:
            raise gym.error.ResetNeeded(f"rows {empty} have no next episode; call reset()")

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each row; `reset` with them begins the same episodes again."""
        return tuple(self._seeds.tolist())

    def _infos(self, results: Results) -> dict[str, Any]:
        """Return infos of results, and which episodes they are of."""
        mask = results.columns.mask
        return results.info() | self._episodes | {f"_{name}": mask for name in EPISODE_KEYS}

    def step(
        self, actions: Any
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Info]:
        """Drive every chair for one control period.

        Args:
            actions: (n, 2) in [-1, 1]; beyond is clipped.

        Raises:
            InputError: the actions are not finite, or not (n, 2).
            gymnasium.error.ResetNeeded: there was no reset yet.
        """
        n = self.num_envs
        if self._last is None:
            raise gym.error.ResetNeeded("call reset() before step()")
        try:
            found = np.asarray(actions)
        except ValueError:  # some rows are longer than others
            raise self._wrong(actions) from None
        if found.shape != (n, 2) or found.dtype.kind not in "biuf":
            raise self._wrong(actions)
        self._actions[:] = chosen = found.astype(np.float64, "C")
        mode = self.autoreset_mode
        if mode is AutoresetMode.DISABLED and self._over.any():
            over = np.flatnonzero(self._over).tolist()
            raise gym.error.ResetNeeded(f"rows {over} are over; reset them with reset_mask")
        self._check_filled(np.ones(n, np.bool_))
        same_step = mode is AutoresetMode.SAME_STEP
        results = finals = self._results.take()
        if same_step:
            if self._spare is None:
                self._spare = self._finals.take()
                self._spare.block[:] = 0
            finals = self._spare
        self.chairs.expect_drive()
        begun = self._share(same_step, results.address, finals.address)
        if begun < 0:
            raise self._wrong(chosen)
        verdicts, rows = results.columns.verdicts, results.columns.begun
        rewards: Array = verdicts["reward"].copy()
        terminated, truncated = verdicts["terminated"].copy(), verdicts["truncated"].copy()
        self._replace_rewards(rewards, results, chosen, ~rows)
        self._last = results
        more: Info = {}
        if begun and same_step:
            self._spare, ends = None, finals.columns.verdicts[rows]
            rewards[rows] = ends["reward"]
            terminated[rows], truncated[rows] = ends["terminated"], ends["truncated"]
            self._replace_rewards(rewards, finals, chosen, rows)
            more = {"final_obs": finals.observation(), "final_info": self._infos(finals)}
            more |= {"_final_obs": rows, "_final_info": rows}
        if begun:
            self._draw_next(np.flatnonzero(rows))
        if self._drawings:
            self._follow(rows)
        infos = self._infos(results) | more
        return results.observation(), rewards, terminated, truncated, infos

    def _wrong(self, actions: Any) -> InputError:
        expected = f"expected finite ({self.num_envs}, 2)"
        return InputError(f"actions are {shorten(actions)}; {expected}")

    def _follow(self, begun: Mask) -> None:
        """Keep the trails that pictures show; of rows that began an episode, new ones."""
        assert self._last is not None
        for i, drawing in enumerate(self._drawings):
            if begun[i]:
                drawing.begin()
            drawing.follow(self._last.columns.sensed["true_pose"][i])

    @property
    def spec(self) -> EnvSpec | None:
        """The spec that it was made by, whose arguments can be written as JSON."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None and isinstance(spec.kwargs.get("autoreset_mode"), AutoresetMode):
            spec.kwargs["autoreset_mode"] = spec.kwargs["autoreset_mode"].value
        self._spec = spec

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A picture of each row, RGB (render_height, render_width, 3); None without render_mode."""
        if self.render_mode is None:
            gym.logger.warn("render() needs render_mode='rgb_array'")
            return None
        if self._last is None:
            raise gym.error.ResetNeeded("call reset() before render()")
        pictures, sensed = [], self._last.columns.sensed
        for i, (drawing, prepared) in enumerate(zip(self._drawings, self._held, strict=True)):
            assert prepared is not None
            actors = self.chairs.worlds[i].actor_poses() if len(prepared.episode.actors) else None
            v, w = sensed["twist"][i].tolist()
            caption = f"{sensed['stamp'][i]:6.1f} s   {v:5.2f} m/s  {w:5.2f} rad/s"
            picture = drawing.draw(
                prepared.episode, self.task.tolerance_of(prepared.episode),
                sensed["true_pose"][i], path=prepared.path, actors=actors, caption=caption,
            )  # fmt: skip
            pictures.append(picture)
        return tuple(pictures)

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """An attribute of this environment, called if it is a method, once for each row."""
        found = getattr(self, name)
        value = found(*args, **kwargs) if callable(found) else found
        return (value,) * self.num_envs

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """An attribute of this environment, which all rows share, once for each row."""
        return (getattr(self, name),) * self.num_envs

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of this environment, which all rows share.

        Raises:
            InputError: there is none of this name, or rows are given different values.
        """
        if not hasattr(self, name):
            raise InputError(f"set_attr: the vector environment has no attribute {name!r}")
        if isinstance(values, list | tuple):
            if len(values) != self.num_envs or any(value != values[0] for value in values):
                raise InputError(f"set_attr {name}: rows share it; expected one value for all")
            values = values[0]
        setattr(self, name, values)

    def _replace_rewards(
        self, rewards: Array, results: Results, actions: Array, rows: Mask
    ) -> None:
        """Write rewards (n,) by the function of the settings, if any, of rows that made a step."""
        if self._write_rewards is None:
            return
        found = np.zeros_like(rewards)
        self._write_rewards(results.columns.verdicts, results.columns.sensed, actions, found)
        if not np.isfinite(found[rows]).all():
            raise InputError("reward: the function gave a number that is not finite")
        rewards[rows] = found[rows]

    def _share(self, *arguments: Any) -> int:
        """Step all rows with all threads, the calling one among them; how many began an episode.

        Each thread takes the next block when it is done with one, so that all end together.
        """
        blocks = iter(self._blocks)

        def work(batch: Pointers) -> int:
            return sum(step_chairs(*block, batch.address, *arguments) for block in blocks)

        first, *others = self._batches
        if others and self._pool is None:
            self._pool = ThreadPoolExecutor(len(others))
        started = [self._pool.submit(work, each) for each in others if self._pool]
        return work(first) + sum(each.result() for each in started)

    def _draw(self, i: int, world: int | Episode | None = None) -> None:
        """Draw row i's next episode, its key, and shapes for its walls; in a world, if given."""
        seed, count = int(self._seeds[i]), int(self._counts[i])
        self._keys[i] = episode_key(seed, count, self.split)
        if isinstance(world, Episode):
            level, prepared = NO_LEVEL, prepare_world(self.task, world)
        else:
            drawn = self.worlds.draw(seed, count, self._weights.get(i)) if world is None else world
            level = int(drawn)
            prepared = self.worlds.episode(seed, count, level, float(self._max_times[i]))
        self._next_levels[i], self._next[i], self._next_worlds[i] = level, prepared, world
        self._make_ready(i, prepared)

    def _make_ready(self, i: int, prepared: PreparedEpisode) -> None:
        """Make a prepared episode row i's next, without a change to the present one."""
        self._next_prepared[i] = prepared.record[0]
        self.chairs.worlds[i].reserve_shapes(prepared.episode)
        self._make_workspace(prepared.columns)

    def _make_workspace(self, columns: int) -> None:
        if columns >= self._columns:
            self._columns = columns
            for rows in self._rows:
                size_workspace(rows, columns)

    def _draw_next(self, rows: NDArray[np.intp]) -> None:
        """Draw the episodes after those that rows have begun."""
        for i in rows.tolist():
            prepared = self._held[i] = self._next[i]
            self.chairs.episodes[i] = None if prepared is None else prepared.episode
            self._next[i] = None
        self._counts[rows] += 1
        self._levels[rows] = self._next_levels[rows]
        self._next_prepared["is_filled"][rows] = False
        split = np.full(self.num_envs, self.split)
        episodes = self._seeds.copy(), self._counts - 1, split, self._levels.copy()
        self._episodes = dict(zip(EPISODE_KEYS, episodes, strict=True))
        for i in rows.tolist():
            self._draw(i)
        self.worlds.drop_before(int(self._counts.min()))

    def close_extras(self, **kwargs: Any) -> None:
        """Shut down the threads."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
