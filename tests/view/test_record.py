"""Laws of recordings: any reader opens them; replayed, they are judged the same to the bit."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from mcap.reader import make_reader

from agents.cli import main
from agents.policy import make_policy
from wheelchair_gym import InputError
from wheelchair_gym.view.record import Recorded
from wheelchair_gym.view.replay import read_recording, replayed

KINDS = [("Navigation", "mcl"), ("GuidedNavigation", "modelled"), ("Navigation", "truth")]
STEPS = 25


@pytest.fixture(scope="module", params=KINDS, ids=lambda kind: "-".join(kind))
def run(request, tmp_path_factory):
    """A recording of two episodes, and what the environment handed out."""
    file = tmp_path_factory.mktemp("runs") / "run.mcap"
    name, pose_source = request.param
    env = gym.make(f"wheelchair_gym/{name}-v0", pose_source=pose_source)
    env, policy, seen = Recorded(env, file), make_policy("visibility+window"), []
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        policy.reset(env.unwrapped.task)
        chapter = [(observation, None, None)]
        for _ in range(STEPS):
            action = policy.act(observation)
            observation, reward, _, _, info = env.step(action)
            chapter.append((observation, reward, info))
        seen.append(chapter)
    env.close()
    return file, seen


def test_a_replayed_run_is_seen_and_judged_the_same(run):
    file, seen = run
    chapters = read_recording(file)
    assert len(chapters) == len(seen)
    for chapter, (first, *steps) in zip(chapters, seen, strict=True):
        assert len(chapter.actions) == len(steps) == STEPS
        env = replayed(chapter)
        observation, _ = env.reset(options={"episode": chapter.episode})
        assert_same(observation, first[0])
        for action, verdict, (was, reward, told) in zip(
            chapter.actions, chapter.verdicts, steps, strict=True
        ):
            observation, again, _, _, info = env.step(action)
            assert_same(observation, was)
            assert again == reward == verdict["reward"]
            assert info["reward_terms"] == told["reward_terms"] == verdict["terms"]
            np.testing.assert_array_equal(info["pose"], told["pose"])
        with pytest.raises(ValueError, match="ends here"):
            env.step(action)


def assert_same(observation, other):
    assert observation.keys() == other.keys()
    for key in observation:
        np.testing.assert_array_equal(observation[key], other[key])


def test_every_reader_opens_it(run):
    """Check sums hold; typed messages come at each step, in the order of time."""
    file, seen = run
    counts: dict[str, int] = {}
    schemas, times = {}, []
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_summary() is not None
        for schema, channel, message in reader.iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            schemas[channel.topic] = schema.name
            times.append(message.log_time)
    steps = len(seen) * (STEPS + 1)
    assert counts["/scan"] == counts["/tf"] == counts["/pose"] == counts["/reading"] == steps
    assert counts["/map"] == counts["/goal"] == counts["/episode"] == len(seen)
    assert counts["/command"] == counts["/verdict"] == len(seen) * STEPS
    assert schemas["/scan"] == "foxglove.LaserScan"
    assert schemas["/tf"] == "foxglove.FrameTransforms"
    assert schemas["/map"] == "foxglove.Grid"
    assert times == sorted(times)


def test_the_command_records_and_replays(tmp_path, capsys):
    file, picture = tmp_path / "a.mcap", tmp_path / "a.png"
    drive = ["simulate", "--scene", "empty", "--policy", "straight", "--record", str(file)]
    assert main(drive) == 0
    assert main(["replay", str(file), "--policy", "straight", "--picture", str(picture)]) == 0
    said = capsys.readouterr().out.splitlines()[-1]
    assert "the same rewards" in said
    assert "straight differs by 0.000 " in said
    assert picture.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "text", "missing", "other"])
def test_what_is_no_recording_is_one_line(run, damage, tmp_path, capsys):
    file = tmp_path / "b.mcap"
    whole = run[0].read_bytes()
    if damage == "cut":
        file.write_bytes(whole[: len(whole) // 2])
    elif damage == "flipped":
        broken = bytearray(whole)
        broken[len(broken) // 3] ^= 0xFF
        file.write_bytes(broken)
    elif damage == "empty":
        file.write_bytes(b"")
    elif damage == "text":
        file.write_text("no recording at all\n" * 50)
    elif damage == "other":
        from mcap.writer import Writer

        with file.open("wb") as stream:
            writer = Writer(stream)
            writer.start()
            writer.finish()
    assert main(["replay", str(file)]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert "b.mcap" in said[0]


def test_a_place_that_cannot_be_written_is_one_line(tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        Recorded(gym.make("wheelchair_gym/Navigation-v0"), tmp_path)


def test_movers_are_recorded_and_replayed_where_they_were(tmp_path):
    """Doors, people and what comes and goes; the picture of a replay is that of the run."""
    scene = {"name": "crowd", "people": {"density": (0.06, 0.08)}, "light": 0.05}
    env = Recorded(
        gym.make("wheelchair_gym/Navigation-v0", scene=scene, render_mode="rgb_array"),
        tmp_path / "run.mcap",
    )
    env.reset(seed=2)
    seen = []
    for _ in range(5):
        env.step(np.zeros(2, np.float32))
        seen.append(env.unwrapped.chair.truth.movers)
    picture, movers = env.render(), env.unwrapped.episode.movers
    env.close()
    (chapter,) = read_recording(tmp_path / "run.mcap")
    assert chapter.episode.movers.rows.tobytes() == movers.rows.tobytes()
    np.testing.assert_array_equal(chapter.episode.movers.routes, movers.routes)
    again = replayed(chapter, "rgb_array")
    again.reset(options={"episode": chapter.episode})
    for action, poses in zip(chapter.actions, seen, strict=True):
        again.step(action)
        np.testing.assert_array_equal(again.chair.truth.movers, poses)
    assert len(seen[-1]) >= 3
    np.testing.assert_array_equal(again.render(), picture)
    with (tmp_path / "run.mcap").open("rb") as stream:
        topics = [channel.topic for _, channel, _ in make_reader(stream).iter_messages()]
    assert topics.count("/movers") == 6
