"""Prioritised level replay, by the equations of its paper."""

import numpy as np
import pytest

from agents.learning.level_replay import LevelReplay, LevelScores
from wheelchair_gym.base.settings import InputError


def test_levels_are_drawn_by_rank_and_by_age():
    replay = LevelReplay(beta=0.5, rho=0.25)
    levels = LevelScores(4, replay)
    assert np.allclose(levels.weights(), 0.25)  # all are unseen
    levels.update(np.array([0, 1, 1]), np.array([3.0, 1.0, 0.0]))
    assert levels.scores.tolist() == [3.0, 0.5, np.inf, np.inf]
    levels.update(np.array([2, 3]), np.array([9.0, 1.0]))
    by_rank = np.array([1 / 4, 1 / 16, 1.0, 1 / 9])  # of ranks 2, 4, 1, 3
    expected = 0.75 * by_rank / by_rank.sum() + 0.25 * np.array([0.5, 0.5, 0.0, 0.0])
    assert np.allclose(levels.weights(), expected)
    levels.replace(np.array([1]))
    assert levels.weights()[1] > levels.weights()[3]


def test_nothing_is_drawn_without_levels():
    with pytest.raises(InputError, match="expected 1 at least"):
        LevelScores(0)
    with pytest.raises(InputError, match="expected 0 to 2"):
        LevelScores(3).update(np.array([-1, 1]), np.ones(2))  # -1: a world of no bank
