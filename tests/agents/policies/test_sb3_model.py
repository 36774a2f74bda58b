"""Models of stable-baselines3 as policies: they observe and act as in training, or are refused."""

from types import SimpleNamespace

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import RescaleAction
from stable_baselines3 import A2C, PPO, SAC
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecNormalize

from agents.cli import main
from agents.learning.sb3 import SaveModel, SB3VecEnv, save_model
from agents.policies import GymPolicy, make_policy
from tests.conftest import put
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv

SAME_STEP = AutoresetMode.SAME_STEP
OTHER = {"beams": 16, "rate": 5.0, "guidance": "geodesic"}


def one(**settings):
    return DummyVecEnv([lambda: Monitor(NavigationEnv("clutter", **settings))])


def several(flat=False, **settings):
    env = NavigationVectorEnv(2, scene="clutter", autoreset_mode=SAME_STEP, **settings)
    return SB3VecEnv(env, flat)


@pytest.mark.parametrize(
    ("algorithm", "make", "settings"),
    [
        (PPO, one, {"beams": 16}),
        (A2C, lambda **s: VecNormalize(one(**s)), OTHER),
        (SAC, lambda **s: VecNormalize(several(**s), norm_obs_keys=["laser", "goal"]), OTHER),
        (PPO, lambda **s: VecNormalize(several(True, **s)), OTHER),
    ],
)
def test_a_model_acts_as_in_training(algorithm, make, settings, tmp_path, capsys):
    """Also where its environment differed from the default, and VecNormalize scaled what it saw."""
    venv, file = make(**settings), tmp_path / "model.zip"
    name = "MlpPolicy" if venv.observation_space.shape else "MultiInputPolicy"
    more = {PPO: {"n_steps": 16, "batch_size": 16}, SAC: {"buffer_size": 500}}.get(algorithm, {})
    model = algorithm(name, venv, seed=0, **more)
    model.learn(64, callback=SaveModel(file))
    said = capsys.readouterr().err
    driver = make_policy(str(file))
    assert driver.env.rate == settings.get("rate", 10.0)
    assert "assumed" not in capsys.readouterr().err + said
    env = NavigationEnv("clutter", **settings)
    policy = GymPolicy(driver, env)
    observation, _ = env.reset(seed=0)
    policy.reset()
    for _ in range(3):
        seen = {key: value[None] for key, value in observation.items()}
        seen = seen if name == "MultiInputPolicy" else np.concatenate([*seen.values()], axis=1)
        if isinstance(venv, VecNormalize):
            seen = venv.normalize_obs(seen)
        action = policy.act(observation)
        assert np.allclose(action, model.predict(seen, deterministic=True)[0][0], atol=1e-5)
        observation, *_ = env.step(action)


def test_what_was_trained_otherwise_is_refused_in_one_line(tmp_path, capsys, monkeypatch):
    file = tmp_path / "model.zip"

    def saved(venv, save=save_model):
        save(PPO("MultiInputPolicy", venv, n_steps=8, batch_size=8), file)
        return str(file)

    bare = saved(one(**OTHER), lambda model, path: model.save(path))
    with pytest.raises(InputError, match="does not hold the settings that it was trained in"):
        make_policy(bare)
    with pytest.raises(InputError, match=r"trained_in .*; expected the settings of its training"):
        make_policy({"name": bare, "trained_in": {}})
    settings = put(tmp_path / "env.json", {"rate": 5.0, "guidance": "geodesic"})
    compared = ["compare", "--scenes", "clutter", "--episodes", "1", "--no-video", "--quiet"]
    compared += ["--out", str(tmp_path / "out"), "--trained-in", str(settings), "--policies"]
    assert main([*compared, "straight"]) == 2
    assert "--trained-in needs a model" in capsys.readouterr().err
    assert main([*compared, bare]) == 0
    assert "assumed: trained at 5 Hz, without wrappers and" in capsys.readouterr().err
    with pytest.raises(InputError, match="holds the settings of its training; expected no"):
        make_policy({"name": saved(one(**OTHER)), "trained_in": OTHER})
    for mode in (Discrete(3), Box(0.0, 1.0, ()), Dict({"a": Discrete(3)}), Box(0.0, 1.0, (2, 3))):
        spaces = NavigationEnv("clutter", beams=16).observation_space.spaces
        network = SimpleNamespace(observation_space=Dict({**spaces, "laser": mode}))
        monkeypatch.setattr(PPO, "load", lambda *_, network=network, **__: network)
        words = "laser 2 x 3" if mode.shape == (2, 3) else r"laser \(no array\)"
        with pytest.raises(InputError, match=f"{words}.*; expected the settings of its training"):
            make_policy(str(file))
    monkeypatch.undo()
    rescaled = DummyVecEnv([lambda: RescaleAction(NavigationEnv("clutter", beams=16), -1, 1)])
    stacked = VecFrameStack(one(beams=16), 2)
    for venv, name in ((rescaled, "RescaleAction"), (stacked, "VecFrameStack")):
        with pytest.raises(InputError, match=f"trained behind {name}, which may change"):
            make_policy(saved(venv))
    (tmp_path / "other.zip").write_bytes(b"PK")
    for name, words in (("none.zip", "cannot be read"), ("other.zip", "expected a model")):
        with pytest.raises(InputError, match=words):
            make_policy(str(tmp_path / name))
