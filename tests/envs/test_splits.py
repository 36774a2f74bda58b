"""Training worlds and test worlds come from streams that share no state of a generator."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wheelchair_gym.compiled.random import SEEDS, bits, episode_key, world_seed
from wheelchair_gym.envs import EnvSettings, NavigationEnv, NavigationVectorEnv
from wheelchair_gym.scenes import make_scene

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
