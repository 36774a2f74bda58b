"""Models of stable-baselines3 as policies."""

from __future__ import annotations

import numpy as np
import pytest
from stable_baselines3 import A2C, PPO, SAC

from agents.policies import GymPolicy, make_policy
from wheelchair_gym.config import InputError
from wheelchair_gym.envs import NavigationEnv


@pytest.mark.parametrize("algorithm", [PPO, A2C, SAC])
def test_a_model_acts_as_by_itself(algorithm, tmp_path, capsys):
    env = NavigationEnv("clutter", beams=16, split="test")
    more = {"buffer_size": 10} if algorithm is SAC else {}
    model = algorithm("MultiInputPolicy", env, seed=0, **more)
    model.save(tmp_path / "model.zip")
    policy = GymPolicy(make_policy(str(tmp_path / "model.zip")), env)
    assert "runs code that is in the file" in capsys.readouterr().err
    observation, _ = env.reset(seed=0)
    policy.reset()
    for _ in range(3):
        expected = model.predict(observation, deterministic=True)[0]
        action = policy.act(observation)
        assert np.allclose(action, expected, atol=1e-6)
        observation, *_ = env.step(action)


def test_what_does_not_fit_is_one_line(tmp_path):
    env = NavigationEnv("clutter", beams=16, guidance="geodesic", split="test")
    file = tmp_path / "model.zip"
    PPO("MultiInputPolicy", env, n_steps=8, batch_size=8).save(file)
    with pytest.raises(InputError, match="give what it was trained in as trained_in"):
        make_policy(str(file))
    made = make_policy({"name": str(file), "trained_in": {"guidance": "geodesic"}})
    assert dict(made.layout.sizes)["laser"] == 16
    (tmp_path / "other.zip").write_bytes(b"PK")
    for name, words in (("none.zip", "cannot be read"), ("other.zip", "expected a model")):
        with pytest.raises(InputError, match=words):
            make_policy(str(tmp_path / name))
