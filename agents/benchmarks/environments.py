"""The speed of environments on this machine, and of IR-SIM (extra `peers`) in the same world."""

import contextlib
import io
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import shapely

from agents.evaluation.tables import templates
from wheelchair_gym.envs import EnvSettings, NavigationVectorEnv
from wheelchair_gym.envs.settings import BankSettings, env_settings
from wheelchair_gym.envs.world_banks import WorldBank
from wheelchair_gym.safety import ShieldSettings
from wheelchair_gym.types import Episode

ENV = "wheelchair_gym/Navigation-v1"
EPISODE = 300  # steps at most
BANK = {"size": 2048, "turnover": 0.1}

Row = dict[str, Any]


def bench_settings(beams: int, bank: int) -> EnvSettings:
    """Floor plans, 10 Hz, ten physics steps, noise, and a laser with this number of beams."""
    chosen = {
        "scene": "floor_plan",
        "bank": {**BANK, "size": bank},
        "sensors": {"laser": {"beams": beams}, "pose_source": "modelled"},
        "task": {"beams": beams, "time_base": EPISODE / 10, "time_factor": 0.0},
    }
    return env_settings(chosen)


def measure_bank(worlds: WorldBank, size: int) -> tuple[float, float]:
    """Make all worlds of a new bank; milliseconds and bytes per world."""
    before, begun = resident_bytes(), time.perf_counter()
    before_worlds = len(worlds)
    seed = 0
    while len(worlds) < size:
        worlds.episode(seed, 0)
        seed += 1
    made = max(1, len(worlds) - before_worlds)
    spent = time.perf_counter() - begun
    return 1e3 * spent / made, (resident_bytes() - before) / made


def resident_bytes() -> int:
    """Resident memory of this process [bytes]; 0 where the system does not report it."""
    statm = Path("/proc/self/statm")
    if not statm.exists():
        return 0
    return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def measure_rate(step: Callable[[int], int], seconds: float) -> float:
    """Steps per second, the median of three parts of a measurement.

    `step` takes the number of a call, and returns how many steps it made.
    """
    rates, k = [], 0
    for _ in range(3):
        done, begun = 0, time.perf_counter()
        while time.perf_counter() - begun < seconds / 3:
            for _ in range(8):
                done += step(k)
                k += 1
        rates.append(done / (time.perf_counter() - begun))
    return statistics.median(rates)


def single_env_rate(settings: EnvSettings, worlds: WorldBank, seconds: float) -> float:
    """Steps per second of one Gymnasium environment with resets."""
    env = gym.make(ENV, config=settings, disable_env_checker=True)
    env.unwrapped.worlds = worlds  # type: ignore[attr-defined]
    actions = np.random.default_rng(0).uniform(-1, 1, (1024, 2)).astype(np.float32)
    env.reset(seed=0)

    def step(k: int) -> int:
        _, _, terminated, truncated, _ = env.step(actions[k % 1024])
        if terminated or truncated:
            env.reset()
        return 1

    for k in range(EPISODE):
        step(k)
    found = measure_rate(step, seconds)
    env.close()
    return found


def vector_env_rate(
    settings: EnvSettings, worlds: WorldBank, n: int, threads: int, seconds: float
) -> tuple[float, NavigationVectorEnv]:
    """Steps per second of a vector environment with resets, and the environment."""
    env = NavigationVectorEnv(n, config=settings, num_threads=threads)
    env.worlds = worlds
    rng = np.random.default_rng(0)
    actions = [rng.uniform(-1, 1, (n, 2)).astype(np.float32) for _ in range(32)]
    env.reset(seed=0)

    def step(k: int) -> int:
        env.step(actions[k % 32])
        return n

    for k in range(8):
        step(k)
    return measure_rate(step, seconds), env


def driver_rates(
    driver: str, assistant: str | None, beams: int, bank: int, n: int, threads: int, seconds: float
) -> dict[str, float]:
    """Steps per second of a vector environment without and with a shield, and with a person.

    All of them drive the same actions, the person's stick, in turn, each for `seconds`. With
    an assistant, the person drives with it, too, in an environment of its own. No world is made
    meanwhile: those of people take longer to make. Time is that of the processor, all threads
    together: other programs make the clock on the wall pass faster, and at any moment.
    """
    plain = replace(bench_settings(beams, bank), bank=BankSettings(bank, 0.0))
    shielded = replace(plain, shield=ShieldSettings())
    every = {"plain": plain, "shield": shielded, "driver": replace(shielded, driver=driver)}
    if assistant is not None:
        every["assistant"] = replace(every["driver"], assistant=assistant)
    envs = {
        name: NavigationVectorEnv(n, config=s, num_threads=threads) for name, s in every.items()
    }
    actions, observed = [], envs["driver"].reset(seed=0)[0]
    for _ in range(EPISODE):
        actions.append(observed["stick"][:, :2].copy())
        observed = envs["driver"].step(actions[-1])[0]
    alone = [np.zeros((n, 2))] * EPISODE
    rates: dict[str, list[float]] = {name: [] for name in envs}
    begun, rounds = time.perf_counter(), 0
    while rounds < 4 or time.perf_counter() - begun < seconds * len(envs):
        for name, env in envs.items():
            env.reset(seed=0)
            before = time.process_time()
            for action in alone if name == "assistant" else actions:
                env.step(action)
            if rounds:  # the first one meets worlds that are still to be made
                rates[name].append(n * len(actions) / (time.process_time() - before))
        rounds += 1
    for env in envs.values():
        env.close()
    return {name: statistics.median(found) for name, found in rates.items()}


def measure_driver(
    driver: str, assistant: str | None, beams: Sequence[int], envs: Sequence[int],
    threads: Sequence[int], *, bank: int, seconds: float,
) -> Iterator[Row]:  # fmt: skip
    """Rows of figures of batches with a person, and an assistant, beside those without."""
    names = {"driver": driver, "assistant": f"{driver}, {assistant}"}
    for count, n, used in product(beams, envs, threads):
        if used <= n:
            rates = driver_rates(driver, assistant, count, bank, n, used, seconds)
            for name, found in rates.items():
                row = _row(names.get(name, name), count, n, used, found, None)
                yield row | {"share": {k: found / rates[k] for k in ("plain", "shield")}}


def measure(
    beams: Sequence[int],
    envs: Sequence[int],
    threads: Sequence[int],
    *,
    bank: int,
    seconds: float,
    peer: bool,
) -> Iterator[Row]:
    """Rows of figures, one after another, with `seconds` for each measurement."""
    worlds: WorldBank = gym.make(ENV, config=bench_settings(beams[0], bank)).unwrapped.worlds  # type: ignore[attr-defined]
    worlds.episode(0, 0)
    made_ms, world_bytes = measure_bank(worlds, bank)
    yield {"what": "a world of the bank, made", "value": made_ms, "unit": "ms"}
    yield {"what": "a world of the bank, kept", "value": world_bytes / 1024, "unit": "kB"}
    for count in beams:
        settings = bench_settings(count, bank)
        peer_rate = None
        if peer:
            peer_rate = irsim_rate(settings, worlds.episode(0, 0).episode, seconds)
            yield {"what": "IR-SIM", "beams": count, "envs": 1, "threads": 1, "rate": peer_rate}
        found = single_env_rate(settings, worlds, seconds)
        yield _row("one env", count, 1, 1, found, peer_rate)
        for n in envs:
            for used in [t for t in threads if t <= n]:
                before = resident_bytes()
                found, env = vector_env_rate(settings, worlds, n, used, seconds)
                yield _row("batch", count, n, used, found, peer_rate)
                if n == max(envs) and used == min(threads):
                    # Later ones reuse memory that the first ones freed.
                    yield from _batch_facts(env, n, before, count == beams[0])
                env.close()


def _row(what: str, beams: int, n: int, threads: int, found: float, peer_rate: float | None) -> Row:
    ratio = {} if peer_rate is None else {"ratio": found / peer_rate}
    return {"what": what, "beams": beams, "envs": n, "threads": threads, "rate": found, **ratio}


def _batch_facts(env: NavigationVectorEnv, n: int, before: int, first: bool) -> Iterator[Row]:
    if first:
        value = (resident_bytes() - before) / n / 1024
        yield {"what": "memory of an env", "value": value, "unit": "kB"}
    env.reset(seed=0)
    begun = time.perf_counter()
    for seed in range(3):
        env.reset(seed=seed)
    spent = (time.perf_counter() - begun) / 3
    yield {"what": "resets with worlds of the bank", "value": n / spent, "unit": "1/s"}


def wall_loops(walls: np.ndarray[Any, Any]) -> list[list[list[float]]]:
    """Walls (n, 4) as the longest possible polylines."""
    lines = np.asarray(walls).reshape(-1, 2, 2).tolist()
    merged = shapely.line_merge(shapely.MultiLineString(lines))
    return [np.array(line.coords).tolist() for line in getattr(merged, "geoms", [merged])]


def irsim_world(settings: EnvSettings, episode: Episode) -> str:
    """IR-SIM's description of an episode in YAML: the same walls, chair and laser."""
    template = templates().get_template("irsim.yaml")
    return template.render(settings=settings, episode=episode, loops=wall_loops(episode.walls))


def irsim_rate(settings: EnvSettings, episode: Episode, seconds: float) -> float:
    """Steps per second of IR-SIM with a scan at each, driven by uniform actions.

    Args:
        settings: of our environment.
        episode: its world.
        seconds: duration of the measurement.

    Raises:
        ImportError: it is not installed.
    """
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        os.environ.setdefault("MPLBACKEND", "Agg")
        import irsim
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "world.yaml"
        path.write_text(irsim_world(settings, episode))
        env = irsim.make(str(path), display=False, disable_all_plot=True, log_level="ERROR")
    rng = np.random.default_rng(0)
    limits = settings.chair.limits
    twists = rng.uniform((-limits.backward, -limits.turn), (limits.forward, limits.turn), (64, 2))
    env.step(twists[0].reshape(2, 1))
    done, begun = 0, time.perf_counter()
    while time.perf_counter() - begun < seconds:
        env.step(twists[done % 64].reshape(2, 1))
        env.get_lidar_scan()
        if env.robot.collision:
            env.robot.reset()
        done += 1
    spent = time.perf_counter() - begun
    env.end()
    return done / spent
