"""Worlds are dropped when no row needs them; a process with environments ends silently."""

import gc
import subprocess
import sys
import weakref

import numpy as np
import pytest

from tests.conftest import ROOT, at_start
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv
from wheelchair_gym.maps import Geodesic
from wheelchair_gym.task.prepared_episode import PreparedEpisode
from wheelchair_gym.task.rewards import compiled_rewards
from wheelchair_gym.types import Episode

QUICK = {"scene": "clutter", "beams": 8}
ROWS = 8


def count_worlds():
    """Number of objects of each kind that a world consists of and that are alive."""
    gc.collect()
    kinds = [type(each) for each in gc.get_objects()]
    return np.array([kinds.count(kind) for kind in (Episode, Geodesic, PreparedEpisode)])


def end_episodes(env, n):
    """End n episodes in all rows but the first, which thus falls behind."""
    for _ in range(n):
        env.reset(options={"reset_mask": np.arange(env.num_envs) > 0})


def test_a_row_that_falls_behind_does_not_keep_all_later_worlds():
    before, size = count_worlds(), 8
    env = at_start(NavigationVectorEnv(ROWS, bank={"size": size, "turnover": 1.0}, **QUICK))
    for _ in range(3):
        end_episodes(env, 50)
        assert len(env.worlds) <= size + 1
        # Beside the bank, each row may hold the world that it drives in and the next one.
        assert (count_worlds() - before <= size + 3 * ROWS).all()


def test_a_row_that_fell_behind_draws_the_worlds_that_it_would_have_drawn():
    settings = {"bank": {"size": 4, "turnover": 1.0}, **QUICK}
    env, alone = NavigationVectorEnv(2, **settings), NavigationEnv(**settings)
    env.reset(seed=0)
    end_episodes(env, 40)
    observations, _ = env.reset()
    alone.reset(seed=0)
    observation, _ = alone.reset()
    assert np.array_equal(observations["laser"][0], observation["laser"])


@pytest.mark.parametrize("kind", ["single", "vector", "vector with a bank that is begun anew"])
def test_worlds_of_past_episodes_are_dropped(kind):
    before, settings = count_worlds(), dict(QUICK)
    if kind.endswith("anew"):
        settings["bank"] = {"size": 4, "turnover": 1.0}
    env = NavigationEnv(**settings) if kind == "single" else NavigationVectorEnv(ROWS, **settings)
    for episode in range(60):
        env.reset(seed=0 if episode % 20 == 0 else None)
    assert (count_worlds() - before <= 3 * ROWS + 4).all()


def test_an_environment_that_is_gone_leaves_nothing():
    before = count_worlds()
    NavigationEnv(**QUICK).reset(seed=0)
    NavigationVectorEnv(ROWS, bank=4, **QUICK).reset(seed=0)
    assert (count_worlds() <= before).all()


def test_own_rewards_do_not_keep_the_environments_of_the_past():
    held = set()  # anything that can be referred to weakly
    first = weakref.ref(held)

    def make_reward(number, held):
        def reward(terms, sensed, action):
            return number

        reward.held = held
        return reward

    for number in range(10):
        compiled_rewards(make_reward(float(number), held))
        held = set()
    gc.collect()
    assert first() is None


PROGRAM = """
import gc, signal, sys
import numba
import wheelchair_gym
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv

@numba.njit
def own_function(x):
    return x + 1

def make(rows):
    env = NavigationVectorEnv(rows, **QUICK) if rows else NavigationEnv(**QUICK)
    env.reset(seed=0)
    return env

def end(way):
    of_the_frame = make(2), make(0)
    if way == "exit":
        sys.exit(0)
    if way == "raise":
        raise ValueError("as users do")
    if way == "interrupt":
        signal.signal(signal.SIGINT, signal.default_int_handler)
        print("ready", flush=True)
        sys.stdin.read()

own_function(1)
of_a_module = make(128), make(0)
gc.disable()
cycle = [make(2), make(0)]
cycle.append(cycle)
del cycle
end(sys.argv[1])
"""


@pytest.mark.parametrize(
    ("way", "code", "last"),
    [
        ("return", 0, ""),
        ("exit", 0, ""),
        ("raise", 1, "ValueError: as users do"),
        ("interrupt", -2, "KeyboardInterrupt"),
    ],
)
def test_a_process_with_environments_ends_silently(way, code, last):
    NavigationVectorEnv(2, **QUICK).reset(seed=0)  # compiles, which would be reported
    NavigationEnv(**QUICK).reset(seed=0)
    child = subprocess.Popen(
        [sys.executable, "-c", f"QUICK = {QUICK}\n{PROGRAM}", way], cwd=ROOT, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    if way == "interrupt":
        assert child.stdout.readline() == "ready\n"
        child.send_signal(2)
    _, stderr = child.communicate()
    assert child.returncode == code
    first, *middle, end = stderr.splitlines() or ["", ""]
    assert end == last, stderr
    assert first == ("Traceback (most recent call last):" if last else ""), stderr
    assert all(line.startswith("  ") for line in middle), stderr
