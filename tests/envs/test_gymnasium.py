"""Gymnasium's and stable-baselines3's own tools work with every id; worlds of each split."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.play import play
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import AddRenderObservation, RecordEpisodeStatistics, RecordVideo
from gymnasium.wrappers import vector as wrappers
from hypothesis import given
from hypothesis import strategies as st

from agents.learning.sb3 import SB3VecEnv
from tests.conftest import steps_of
from wheelchair_gym.compiled.random import SEEDS, bits, episode_key, world_seed
from wheelchair_gym.envs import EnvSettings, NavigationEnv, NavigationVectorEnv
from wheelchair_gym.scenes import make_scene

IDS = [  # the id of the real chair needs one
    name for name in gym.registry if name.startswith("wheelchair_gym/") and "Hardware" not in name
]
SMALL = {"scene": "clutter", "beams": 16, "max_episode_steps": 6}
FRAMES = {"render_mode": "rgb_array", "render_width": 96, "render_height": 64}
AHEAD = np.array([0.4, 0.1], np.float32)


@pytest.mark.parametrize("name", IDS)
def test_specs_make_the_same_environment_again(name):
    """As those of Gymnasium's own: by `make_vec`, and not by `make`."""
    envs = gym.make_vec(name, 2, autoreset_mode=AutoresetMode.SAME_STEP, split="test", **SMALL)
    assert envs.autoreset_mode is envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    spec = EnvSpec.from_json(envs.spec.to_json())
    again = gym.make_vec(spec)
    assert again.spec == envs.spec
    assert again.settings == envs.settings
    assert (again.num_envs, again.autoreset_mode, again.split) == (2, envs.autoreset_mode, "test")
    with pytest.raises(TypeError, match="unexpected keyword argument 'autoreset_mode'"):
        gym.make(spec)
    assert gym.spec(name).kwargs["split"] == "train"
    old = pytest.raises(gym.error.DeprecatedEnv, match=name)
    with pytest.warns(DeprecationWarning, match="out of date"), old:
        gym.make(name.replace("-v1", "-v0"))


def films(folder):
    return [path for path in folder.glob("*.mp4") if path.stat().st_size > 500]


@pytest.mark.parametrize("name", IDS)
def test_wrappers_of_one_environment(name, tmp_path):
    env = RecordVideo(
        RecordEpisodeStatistics(gym.make(name, **SMALL, **FRAMES)),
        str(tmp_path / "films"),
        disable_logger=True,
    )
    env.reset(seed=0)
    *_, (*_, info) = steps_of(env, AHEAD)
    env.close()
    assert info["episode"]["l"] == 6
    assert len(films(tmp_path / "films")) == 1
    pixels = AddRenderObservation(gym.make(name, **SMALL, **FRAMES))
    assert pixels.reset(seed=0)[0].shape == (64, 96, 3)


@pytest.mark.parametrize("name", IDS)
def test_a_game_is_played_by_keys_over_several_episodes(name, monkeypatch):
    """A person holds a key, and closes the window after some frames."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    pygame = pytest.importorskip("pygame", reason="pip install 'wheelchair_gym[view]'")
    env = gym.make(name, **SMALL, **FRAMES)
    keys = {("w",): np.array([0.8, 0.0], np.float32)}
    driven, ends = [], []

    def follow(before, after, action, reward, terminated, truncated, info):
        driven.append((action.tolist(), float(info["distance"])))
        ends.append(terminated or truncated)
        kind, key = pygame.KEYDOWN, ord("w")
        if len(driven) == 15:
            kind = pygame.QUIT
        pygame.event.post(pygame.event.Event(kind, key=key))

    play(env, keys_to_action=keys, callback=follow, noop=np.zeros(2, np.float32), fps=1000, seed=0)
    assert len(driven) >= 15
    assert driven[0][0] == [0.0, 0.0]
    assert [0.8, 0.0] in [[round(v, 6) for v in action] for action, _ in driven]
    assert max(way for _, way in driven) > 0.0
    assert sum(ends) >= 2


@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("kind", ["sync", "async", "vector_entry_point"])
@pytest.mark.parametrize("name", IDS)
def test_every_kind_of_vector_in_every_autoreset_mode(name, kind, mode):
    more = {"vector_kwargs": {"autoreset_mode": mode}}
    if kind == "async":  # this process has threads: it must not fork
        more["vector_kwargs"]["context"] = "forkserver"
    if kind == "vector_entry_point":
        more = {"autoreset_mode": mode}
    envs = gym.make_vec(name, 2, vectorization_mode=kind, **more, **SMALL)
    envs = wrappers.RecordEpisodeStatistics(envs)
    observations, _ = envs.reset(seed=0)
    assert envs.observation_space.contains(observations)
    ends = 0
    for _ in range(9):
        observations, _, terminated, truncated, _ = envs.step(np.tile(AHEAD, (2, 1)))
        assert envs.observation_space.contains(observations)
        over = terminated | truncated
        ends += over.sum()
        if mode is AutoresetMode.DISABLED and over.any():
            envs.reset(options={"reset_mask": over})
    assert ends == 2
    envs.close()


@pytest.mark.parametrize("name", IDS)
def test_videos_of_many(name, tmp_path):
    from stable_baselines3.common.vec_env import VecVideoRecorder

    envs = wrappers.RecordVideo(
        gym.make_vec(name, 2, **SMALL, **FRAMES), str(tmp_path / "a"),
        episode_trigger=lambda episode: True, disable_logger=True,
    )  # fmt: skip
    envs.reset(seed=0)
    for _ in range(8):
        envs.step(np.tile(AHEAD, (2, 1)))
    envs.close()
    assert films(tmp_path / "a")
    kwargs = dict(gym.spec(name).kwargs)
    many = NavigationVectorEnv(2, autoreset_mode="SameStep", **kwargs, **SMALL, **FRAMES)
    recorder = VecVideoRecorder(SB3VecEnv(many), str(tmp_path / "b"), lambda step: step == 0, 5)
    recorder.reset()
    for _ in range(7):
        recorder.step(np.tile(AHEAD, (2, 1)))
    recorder.close()
    assert films(tmp_path / "b")


QUICK = {"scene": "clutter", "beams": 8}
PARTS = st.integers(0, SEEDS - 1)
NUMBERS = st.one_of(st.integers(0, 20), st.integers(0, 2**32 - 1))


@given(PARTS, NUMBERS, PARTS, NUMBERS)
def test_no_state_belongs_to_both_splits(seed, number, other, its):
    test, train = world_seed("test", seed, number), world_seed("train", other, its)
    # numpy makes a state of the words of the entropy; those of a spawn key follow at least four.
    words = sum(max(1, -(-value.bit_length() // 32)) for value in test.entropy)
    assert words <= test.pool_size == 4
    assert (test.spawn_key, len(train.spawn_key)) == ((), 1)
    assert (test.generate_state(4) != train.generate_state(4)).any()
    assert episode_key(seed, number, "test") != episode_key(seed, number, "train")


@given(PARTS, NUMBERS)
def test_the_test_stream_is_numbered_as_ever(seed, number):
    plain = np.random.SeedSequence((seed, number)).generate_state(4)
    assert (world_seed("test", seed, number).generate_state(4) == plain).all()
    assert episode_key(seed, number, "test") == bits(np.uint64(seed), number, 0, 0)


@pytest.mark.parametrize("bank", [0, 3])
def test_an_environment_trains_unless_it_is_told_to_test(bank):
    """Standard seeding, row i with seed + i, reaches no test world."""
    scene = make_scene(EnvSettings(scene="clutter").scene)
    judged = {scene.sample(np.random.default_rng((seed, 0))).discs.tobytes() for seed in range(4)}
    for split in (None, "train", "test"):
        given = QUICK | {"bank": bank} | ({} if split is None else {"split": split})
        env, envs = NavigationEnv(**given), NavigationVectorEnv(4, **given)
        _, infos = envs.reset(seed=0)
        assert infos["split"].tolist() == [split or "train"] * 4
        rows = [episode.discs.tobytes() for episode in envs.chairs.episodes]
        for seed in range(4):
            assert env.reset(seed=seed)[1]["split"] == split or "train"
            assert env.episode.discs.tobytes() == rows[seed]
        assert len(judged & set(rows)) == (4 if split == "test" and not bank else 0)
