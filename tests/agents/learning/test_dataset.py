"""Data sets for offline learning, of policies and of recorded drives, read back by Minari."""

import json
from unittest.mock import DEFAULT, Mock

import numpy as np
import pytest

from agents.cli import main
from agents.learning import dataset
from agents.learning.dataset import write_recorded
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.recording.record import RecordEpisodes, RecordingSettings

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
    struck = Mock(wraps=dataset._drive, side_effect=[DEFAULT, DEFAULT, KeyboardInterrupt])
    monkeypatch.setattr(dataset, "_drive", struck)
    found = dataset.write_dataset(NAME, "straight", "clutter", ENV, range(5), tmp_path, False)
    assert found["episodes"] == minari.load_dataset(NAME).total_episodes == 2
    assert "stopped after 2 episodes" in capsys.readouterr().err


def test_a_malformed_name_is_refused(tmp_path):
    for name in ("homes", "../homes-v0", "/homes-v0", "a b-v0", "a/b-v0"):
        with pytest.raises(InputError, match=r"expected a name such as .*: letters, digits"):
            dataset.write_dataset(name, "straight", "clutter", ENV, range(1), tmp_path)


pytest.importorskip("mcap")
MINE = "wheelchair/mine-v0"
TASK = {"beams": 16, "max_episode_steps": 25, "last_action": True, "shield_state": True}


def drive(file, person=False, episodes=2, form="foxglove", task=TASK):
    """Record episodes; observations, actions, and infos of each."""
    config = {"task": task, "sensors": {"pose_source": "modelled"}, "shield": {}}
    config |= {"driver": "novice"} if person else {"guidance": "poses"}
    env = RecordEpisodes(
        NavigationEnv("clutter", config), file, recording=RecordingSettings(format=form)
    )
    told, rng = [], np.random.default_rng(0)
    for k in range(episodes):
        observations, steps, over = [env.reset(seed=k)[0]], [], False
        sticks = [env.unwrapped.task.stick]
        while not over:
            action = rng.uniform(-1.0, 1.0, 2)
            observation, reward, terminated, truncated, info = env.step(action)
            observations.append(observation)
            sticks.append(env.unwrapped.task.stick)
            steps.append((action, reward, terminated, truncated, info["shield"]))
            over = terminated or truncated
        told.append((observations, sticks, steps, info["is_success"]))
    env.close()
    return told


@pytest.mark.parametrize("form", ["foxglove", "ros2"])
def test_a_policy_that_was_recorded_gives_the_data_that_it_saw(tmp_path, form):
    pytest.importorskip("rosbags" if form == "ros2" else "mcap")
    told = drive(tmp_path / "drives" / ("a.mcap" if form == "foxglove" else "a"), form=form)
    assert write_recorded(MINE, [tmp_path / "drives"], {}, tmp_path / "sets")["episodes"] == 2
    data = minari.load_dataset(MINE)
    for episode, (observations, _, steps, success) in zip(data, told, strict=True):
        actions, rewards, terminations, truncations, shield = zip(*steps, strict=True)
        for key, values in episode.observations.items():
            assert np.array_equal(values, [each[key] for each in observations]), key
        assert np.array_equal(episode.actions, np.array(actions, np.float32))
        assert np.array_equal(episode.rewards, rewards)
        assert np.array_equal(episode.terminations, terminations)
        assert np.array_equal(episode.truncations, truncations)
        for key in ("asked", "given"):
            expected = np.array([each[key] for each in shield])
            np.testing.assert_allclose(episode.infos[key], expected, atol=1e-6)
        changed = [bool((each["asked"] != each["given"]).any()) for each in shield]
        assert np.array_equal(episode.infos["intervened"], changed)
        assert np.isnan(episode.infos["stick"]).all()
        (about,) = data.storage.get_episode_metadata([episode.id])
        assert (about["driver"], about["success"]) == ("policy", success)
        assert about["split"] == "train"
    env = data.recover_environment()
    assert set(env.observation_space) == set(data[0].observations)


def test_a_person_that_was_recorded_gives_stick_and_goal(tmp_path):
    told = drive(tmp_path / "a.mcap", person=True)
    write_recorded(MINE, [tmp_path], {"task": TASK, "guidance": "poses"}, tmp_path / "sets")
    data = minari.load_dataset(MINE)
    for episode, (observations, sticks, *_) in zip(data, told, strict=True):
        assert {"goal", "path"} < set(episode.observations)
        assert np.array_equal(episode.observations["laser"], [o["laser"] for o in observations])
        assert np.array_equal(episode.infos["stick"], np.array(sticks, float)[:-1])
    (about,) = data.storage.get_episode_metadata([0])
    assert (about["driver"], about["interface"]) == ("simulated person", "stick")


def test_a_drive_that_was_ended_early_is_truncated_and_test_worlds_are_counted(tmp_path, capsys):
    env = RecordEpisodes(NavigationEnv("empty", split="test"), tmp_path / "a.mcap")
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros(2))
    env.close()
    assert main(["dataset", MINE, "--recordings", str(tmp_path), "--out", str(tmp_path)]) == 0
    assert "1 in test worlds (judge on other seeds)" in capsys.readouterr().out
    assert minari.load_dataset(MINE)[0].truncations.tolist() == [False, False, True]


def test_bc_learns_from_recorded_drives(tmp_path, monkeypatch, capsys):
    drive(tmp_path / "drives" / "a.mcap")
    out = str(tmp_path / "sets")
    assert main(["dataset", MINE, "--recordings", str(tmp_path / "drives"), "--out", out]) == 0
    monkeypatch.setenv("MINARI_DATASETS_PATH", out)
    trained = ["train", "bc", "--set", f"dataset={MINE}", "--set", "net_arch=[16]", "--quiet"]
    assert main([*trained, "--out", str(tmp_path / "bc")]) == 0
    (row,) = json.loads((tmp_path / "bc" / "rounds.json").read_text())
    steps = minari.load_dataset(MINE).total_steps
    assert (row["driver"], row["steps"], row["success"]) == ("data set", steps, 0.0)
    capsys.readouterr()
    assert main(["train", "bc", "--set", "dataset=no/such-v0", "--out", str(tmp_path / "x")]) == 2
    assert "no/such-v0" in capsys.readouterr().err


def test_what_cannot_be_a_data_set_is_said(tmp_path, capsys):
    drive(tmp_path / "a.mcap", episodes=1)
    (tmp_path / "b.mcap").write_bytes(b"no recording")
    found = write_recorded(MINE, [tmp_path], {}, tmp_path / "sets")
    assert found["episodes"] == 1
    assert [str(tmp_path / "b.mcap") in line for line in found["unread"]] == [True]
    assert "not read" in capsys.readouterr().err
    with pytest.raises(InputError, match="expected recordings that can be read"):
        write_recorded("ours/b-v0", [tmp_path / "b.mcap"], {}, tmp_path / "sets")
    with pytest.raises(InputError, match="no such file"):
        write_recorded("ours/c-v0", [tmp_path / "c.mcap"], {}, tmp_path / "sets")
    (tmp_path / "b.mcap").unlink()
    drive(tmp_path / "b.mcap", episodes=1, task={**TASK, "beams": 8})
    with pytest.raises(InputError, match=r"b\.mcap: episode 0 differs in task from .*a\.mcap"):
        write_recorded("ours/d-v0", [tmp_path], {}, tmp_path / "sets")
    assert not (tmp_path / "sets" / "ours" / "d-v0").exists()
    assert write_recorded("us/e-v0", [tmp_path], {"task": TASK}, tmp_path / "sets")["episodes"] == 2
    (tmp_path / "c.json").write_text('{"rate": 5.0}')
    for more in (["--policy", "random"], ["--config", str(tmp_path / "c.json")]):
        assert main(["dataset", "ours/f-v0", "--recordings", str(tmp_path), *more]) == 2
        assert "what was recorded cannot be changed" in capsys.readouterr().err
