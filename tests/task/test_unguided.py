"""Laws of ways that are hidden: a critic and a teacher see what an actor is not shown."""

import numpy as np
import pytest

from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.task.observations import PRIVILEGED
from wheelchair_gym.task.side_clearance import fan_poses, side_clearance

TASK = {"beams": 32, "side_clearance": True, "privileged": True}


def make(**task):
    return NavigationEnv("floor_plan", guidance="poses", config={"task": {**TASK, **task}})


def test_what_is_hidden_is_what_a_guided_policy_is_shown():
    guided, hide_guidance = make(), make(hide_guidance=True)
    rng = np.random.default_rng(0)
    shown, hidden = guided.reset(seed=3)[0], hide_guidance.reset(seed=3)[0]
    assert list(hide_guidance.task.spaces)[-3:] == list(PRIVILEGED)
    for _ in range(6):
        assert "path" not in hidden
        assert hide_guidance.observation_space.contains(hidden)
        assert np.array_equal(hidden["privileged_path"], shown["path"])
        assert np.array_equal(hidden["privileged_side_clearance"], shown["side_clearance"])
        for key in set(shown) - {"path", "side_clearance"}:
            assert np.array_equal(hidden[key], shown[key])
        action = rng.uniform(-1.0, 1.0, 2)
        shown, hidden = guided.step(action)[0], hide_guidance.step(action)[0]
    assert hide_guidance.points_ahead is None


def test_nothing_is_hidden_where_no_critic_looks():
    env = make(hide_guidance=True, privileged=False)
    assert not {"path", *PRIVILEGED} & set(env.reset(seed=0)[0])
    seen = make(hide_guidance=True, side_clearance=False).reset(seed=0)[0]
    assert "privileged_side_clearance" not in seen


@pytest.mark.parametrize("guidance", [None, "geodesic", "poses"])
def test_a_policy_without_poses_ahead_sees_gaps_at_a_fan_of_poses(guidance):
    task = {**TASK, "privileged": False, "hide_guidance": guidance == "poses"}
    env = NavigationEnv("floor_plan", guidance=guidance, config={"task": task})
    seen = env.reset(seed=1)[0]["side_clearance"]
    expected, laser = np.empty_like(seen), env.settings.sensors.laser
    mount, outline = np.array([laser.x, laser.y]), env.task.footprint.array
    side_clearance(env.task.reading.laser, laser.directions, mount, outline, fan_poses(), expected)
    assert np.array_equal(seen, expected)


def test_the_fan_lies_on_arcs_to_both_sides_and_on_the_spot():
    x, y, c, s = fan_poses().reshape(-1, 4).T
    assert np.hypot(c, s) == pytest.approx(1.0)
    turn = np.arctan2(s, c)
    assert np.arctan2(y, x) == pytest.approx(np.where(np.hypot(x, y) > 0.0, 0.5 * turn, 0.0))
    assert sorted(turn) == pytest.approx(sorted(-turn))
    assert (np.hypot(x, y) < 1e-6).sum() == 4


@pytest.mark.parametrize("scene", ["empty", "skill"])
def test_a_pose_that_is_no_number_has_not_arrived(scene):
    env = NavigationEnv(scene)
    env.reset(seed=0)
    goal, still = np.array(env.episode.goal, float), np.zeros(2)
    assert env.task.at_goal(goal, still)
    for k in range(2):
        assert not env.task.at_goal(np.where(np.arange(3) == k, np.nan, goal), still)
