"""Twenty million steps with random actions: nothing breaks, nothing leaks, nobody stands still."""

import numpy as np
import pytest

from agents.benchmarks.environments import resident_bytes
from wheelchair_gym.envs import NavigationVectorEnv
from wheelchair_gym.geometry.outline import footprint_clearance

N, MILLION = 1000, 1_000_000
DEPTH = 0.02  # m: how far a wall may reach into the outline


@pytest.mark.long
def test_twenty_million_steps():
    env = NavigationVectorEnv(
        N,
        config={
            "bank": {"size": 256, "turnover": 1.0},
            "sensors": {"laser": {"beams": 128}, "pose_source": "modelled"},
            "task": {"beams": 64, "time_base": 30.0, "time_factor": 0.0},
        },
        guidance="geodesic",
        randomize=True,
    )
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (512, N, 2))
    footprint = env.settings.chair.footprint.array - DEPTH
    low = {k: b.low[0] for k, b in env.observation_space.spaces.items()}
    high = {k: b.high[0] for k, b in env.observation_space.spaces.items()}
    env.reset(seed=0)
    ends, contacts, way = np.zeros(N, int), 0, np.zeros(N)
    memory = []
    for k in range(20 * MILLION // N):
        held = list(env._held)
        observations, rewards, terminated, truncated, infos = env.step(actions[k % 512])
        for key, value in observations.items():
            assert (value >= low[key]).all(), key  # NaN fails, too
            assert (value <= high[key]).all(), key
        assert np.isfinite(rewards).all()
        ends += terminated | truncated
        way = np.maximum(way, infos["distance"])
        for i in np.flatnonzero(infos["contact"]):
            episode = held[i].episode
            pose = infos["pose"][i]
            gap = footprint_clearance(*pose, footprint, episode.walls, episode.discs, 1.0)
            assert gap > 0.0, (i, k, pose)
            contacts += 1
        if (k + 1) % (MILLION // N) == 0:
            memory.append(resident_bytes())
            if (k + 1) % (5 * MILLION // N) == 0:
                assert (way > 0.1).all()  # each chair has moved in the last five million
                way[:] = 0.0
    print(f"{ends.sum()} episodes, {contacts} steps in contact, memory {memory} bytes")
    assert ends.min() >= 20 * MILLION // N // 301
    assert contacts > 10_000
    # A window of worlds that slides has its ups and downs; a leak would go on.
    assert np.mean(memory[-5:]) < 1.05 * np.mean(memory[5:10])
