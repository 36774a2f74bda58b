"""Data sets for offline learning are read back by Minari itself."""

import numpy as np
import pytest

from agents.learning import dataset
from wheelchair_gym.base.settings import InputError

minari = pytest.importorskip("minari")
NAME = "wheelchair/test-v0"
ENV = {"beams": 16, "max_episode_steps": 12, "pose_source": "modelled"}


def test_what_is_written_is_what_was_driven(tmp_path, monkeypatch):
    monkeypatch.setattr(dataset, "_STORED_AT_ONCE", 2)
    found = dataset.write_dataset(NAME, "straight", "clutter", ENV, range(3), tmp_path, False)
    assert (found["episodes"], found["steps"]) == (3, 36)
    read = minari.load_dataset(NAME)
    assert read.total_steps == 36
    env, episode = read.recover_environment(), read[1]
    observation, _ = env.reset(seed=1)
    for k, action in enumerate(episode.actions):  # the same environment gives the same episode
        for key, values in episode.observations.items():
            assert np.array_equal(values[k], observation[key])
        observation, reward, terminated, truncated, _ = env.step(action)
        assert reward == pytest.approx(float(episode.rewards[k]), abs=1e-6)
        assert (terminated, truncated) == (episode.terminations[k], episode.truncations[k])
    with pytest.raises(InputError, match="exists"):
        dataset.write_dataset(NAME, "straight", "clutter", ENV, range(3), tmp_path, False)


def test_a_data_set_keeps_what_was_driven_before_ctrl_c(tmp_path, monkeypatch, capsys):
    drive, count = dataset._drive, []

    def interrupted(*arguments):
        if len(count) == 2:
            raise KeyboardInterrupt
        count.append(1)
        return drive(*arguments)

    monkeypatch.setattr(dataset, "_drive", interrupted)
    found = dataset.write_dataset(NAME, "straight", "clutter", ENV, range(5), tmp_path, False)
    assert found["episodes"] == minari.load_dataset(NAME).total_episodes == 2
    assert "stopped after 2 episodes" in capsys.readouterr().err


def test_a_malformed_name_is_refused(tmp_path):
    for name in ("homes", "../homes-v0", "/homes-v0", "a b-v0", "a/b-v0"):
        with pytest.raises(InputError, match=r"expected a name such as .*: letters, digits"):
            dataset.write_dataset(name, "straight", "clutter", ENV, range(1), tmp_path)
