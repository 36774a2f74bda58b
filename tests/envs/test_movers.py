"""Laws of environments with actors: worlds share a batch; truth reaches info."""

from __future__ import annotations

import numpy as np

from tests.envs.test_vector import CROWD, SHORT
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv

CROWDED = {"split": "test", "scene": CROWD, "bank": {"size": 12, "turnover": 0.5}, "beams": 64}


def test_worlds_with_and_without_movers_share_a_batch():
    """A batch row that goes from a crowd to an empty floor and back is as fresh."""
    crowd = NavigationEnv(config=SHORT, **CROWDED)
    crowd.reset(seed=3)
    episode = crowd.episode
    plain = type(episode)(episode.map, episode.start, episode.goal, episode.walls, episode.discs)
    seen = []
    for given in (episode, plain, episode, plain):
        crowd.reset(seed=5, options={"episode": given})
        seen.append(np.array([crowd.step(np.array([0.6, 0.1]))[0]["laser"] for _ in range(20)]))
    assert np.array_equal(seen[0], seen[2])
    assert np.array_equal(seen[1], seen[3])
    assert not np.array_equal(seen[0], seen[1])


def test_truth_reaches_info_and_never_the_observation():
    env = NavigationEnv(config={"task": {"time_base": 60.0}}, **CROWDED)
    observation, info = env.reset(seed=1)
    assert set(observation) == {"laser", "ultrasonic", "twist", "goal"}
    told = [
        info[name]
        for name in ("at_fault", "contact_with", "approach_speed", "other_approach_speed")
    ]
    assert told == [False, -1, 0.0, 0.0]
    assert env.chair.truth.actor_poses.shape == (len(env.episode.actors), 3)
    batch = NavigationVectorEnv(2, config=SHORT, **CROWDED)
    _, infos = batch.reset(seed=1)
    assert infos["approach_speed"].shape == infos["other_approach_speed"].shape == (2,)
    assert infos["contact_with"].tolist() == [-1, -1]
