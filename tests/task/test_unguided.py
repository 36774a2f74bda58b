"""Laws of ways that are hidden: a critic and a teacher see what an actor is not shown."""

from __future__ import annotations

import numpy as np
import pytest

from wheelchair_gym.config import InputError
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.task.observation_layout import PRIVATE
from wheelchair_gym.task.side_clearance import fan, gaps

TASK = {"beams": 32, "gaps": True, "privileged": True}


def make(**task):
    return NavigationEnv("floor_plan", guidance="poses", config={"task": {**TASK, **task}})


def test_what_is_hidden_is_what_a_guided_policy_is_shown():
    guided, unguided = make(), make(unguided=True)
    rng = np.random.default_rng(0)
    shown, hidden = guided.reset(seed=3)[0], unguided.reset(seed=3)[0]
    assert list(unguided.task.boxes)[-3:] == list(PRIVATE)
    for _ in range(6):
        assert "path" not in hidden
        assert unguided.observation_space.contains(hidden)
        assert np.array_equal(hidden["hidden_path"], shown["path"])
        assert np.array_equal(hidden["hidden_gaps"], shown["gaps"])
        for key in set(shown) - {"path", "gaps"}:
            assert np.array_equal(hidden[key], shown[key])
        action = rng.uniform(-1.0, 1.0, 2)
        shown, hidden = guided.step(action)[0], unguided.step(action)[0]
    assert unguided.points_ahead is None


def test_nothing_is_hidden_where_no_critic_looks():
    env = make(unguided=True, privileged=False)
    assert not {"path", *PRIVATE} & set(env.reset(seed=0)[0])
    assert make(unguided=True, gaps=False).reset(seed=0)[0].get("hidden_gaps") is None
    with pytest.raises(InputError, match=r"task\.unguided needs the guidance"):
        NavigationEnv("floor_plan", guidance="geodesic", config={"task": {"unguided": True}})


@pytest.mark.parametrize("guidance", [None, "geodesic", "poses"])
def test_who_sees_no_poses_ahead_sees_the_gaps_at_a_fan_of_them(guidance):
    task = {**TASK, "privileged": False, "unguided": guidance == "poses"}
    env = NavigationEnv("floor_plan", guidance=guidance, config={"task": task})
    seen = env.reset(seed=1)[0]["gaps"]
    expected, laser = np.empty_like(seen), env.settings.sensors.laser
    mount, outline = np.array([laser.x, laser.y]), env.task.footprint.array
    gaps(env.task.reading.laser, laser.directions, mount, outline, fan(), expected)
    assert np.array_equal(seen, expected)


def test_the_fan_lies_on_arcs_to_both_sides_and_on_the_spot():
    x, y, c, s = fan().reshape(-1, 4).T
    assert np.hypot(c, s) == pytest.approx(1.0)
    turn = np.arctan2(s, c)
    assert np.arctan2(y, x) == pytest.approx(np.where(np.hypot(x, y) > 0.0, 0.5 * turn, 0.0))
    assert sorted(turn) == pytest.approx(sorted(-turn))
    assert (np.hypot(x, y) < 1e-6).sum() == 4
