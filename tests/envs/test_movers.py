"""Laws of many chairs among actors: row i is the single env, bit for bit; truth reaches info."""

from __future__ import annotations

import numpy as np
import pytest

from tests.conftest import long_but
from tests.envs.test_vector import NEXT, SAME, compare
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv

CROWDED = {
    "split": "test",
    "scene": {
        "name": "crowd",
        "people": {"density": (0.05, 0.15), "crossing_share": 0.3, "inattentive_share": 0.3},
    },
    "bank": {"size": 12, "turnover": 0.5},
    "beams": 64,
}
SHORT = {"task": {"time_base": 6.0, "time_factor": 0.0}}
TRACKED = {"task": {**SHORT["task"], "tracks": 4}}


@pytest.mark.parametrize(("mode", "threads"), long_but([(NEXT, 2), (SAME, 1)], [(NEXT, 2)]))
def test_each_row_is_a_single_env_among_movers(mode, threads):
    """Worlds with many actors, few and none in one batch, over thousands of steps and resets."""
    ends = compare(mode, threads, n=6, steps=300, config=TRACKED, randomize=True, **CROWDED)
    assert ends >= 25


def test_each_row_is_a_single_env_where_things_appear_and_every_episode_has_its_own_world():
    settings = {"scene": {"name": "temporary", "count": (3, 6)}, "pose_source": "modelled"}
    settings["guidance"] = "geodesic"
    assert compare(NEXT, 2, n=3, steps=80, config=SHORT, **settings) >= 3


@pytest.mark.parametrize("model", ["orca", "social_force"])
def test_each_row_is_a_single_env_among_people_of_every_kind(model):
    scene = {"name": "people", "people": {"model": model}}
    settings = CROWDED | {"scene": scene, "pose_source": "modelled"}
    assert compare(NEXT, 2, n=4, steps=120, config=SHORT, randomize=True, **settings) >= 4


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
