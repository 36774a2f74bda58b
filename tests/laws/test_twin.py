"""Law 3: the hardware env over the twin equals the simulated env, both controlled at 200 Hz."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import pytest

from agents.policy import make_policy
from tests.hardware.hosted import Hosted
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.hardware.chairs import placed

pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")

# The boards' control runs at 200 Hz: so does the simulation's here.
CONFIG = {
    "physics": {"step": 0.005},
    "chair": {"motor": {"rate": 200.0}},
    "sensors": {"pose_source": "odometry", "noise": False},
}
SCENES = ("floor_plan", "clutter", "thesis_1", "chaotic_pso", "lab_1")
COUNT = 1.0 / 4346.0  # m
PERIOD, TRACK = 0.1, 0.54
QUANTUM = np.array([COUNT, 2.0 * COUNT / TRACK]) / PERIOD  # of both wheels' counts in a period
LATE = 0.8 * 0.005  # m: a board's control runs up to 5 ms after a command came


class Both:
    """The same actions for both, chosen by a policy in the simulated one."""

    def __init__(self, scene):
        settings = env_settings(CONFIG, scene=scene)
        self.sim = gym.make("wheelchair_gym/Navigation-v0", config=settings).unwrapped
        self.hosted = Hosted(chair=settings.chair, sensors=settings.sensors)
        self.real = gym.make(
            "wheelchair_gym/Hardware-v0",
            config=settings,
            chair=placed(self.hosted.chair, settings),
            disable_env_checker=True,
        ).unwrapped
        self.twists, self.within = [], []

    def run(self, seed, seconds):
        """Drive from an episode's start for so long, or to its end; the seconds driven."""
        sim, real, policy = self.sim, self.real, make_policy("visibility+window")
        seen, _ = sim.reset(seed=seed)
        self.hosted.chair.reset(None, 0)  # at rest before it is carried to the start
        self.hosted.clock.wait(self.hosted.clock.now() + 1.0)
        self.hosted.twin.reset(sim.episode, 0)
        told, _ = real.reset(seed=seed, options={"episode": sim.episode})
        assert {name: value.shape for name, value in told.items()} == {
            name: value.shape for name, value in seen.items()
        }
        policy.reset(sim.task)
        done = False
        while not done and sim.task.reading.stamp < seconds - 1e-6:
            action = policy.act(seen)
            seen, _, *ends, info = sim.step(action)
            _, _, *others, _ = real.step(action)
            assert not info["contact"]
            assert real.task.reading.halted == ""
            done = any(ends) or any(others)
            a, b = real.task.reading, sim.task.reading
            assert a.stamp == pytest.approx(b.stamp)
            allowed = np.maximum(0.02 * np.abs(b.twist), QUANTUM)
            off = np.abs(a.twist - b.twist) / allowed
            self.twists.append(off)
            way = info["distance"]
            apart = a.pose - b.pose
            assert np.hypot(*apart[:2]) < LATE + 0.01 * way
            turned = (apart[2] + math.pi) % (2 * math.pi) - math.pi
            assert abs(turned) < math.radians(0.5)
            true = np.hypot(*(self.hosted.twin.plant.pose - sim.chair.truth.pose)[:2])
            assert true < LATE + 0.01 * way
        return sim.task.reading.stamp

    def judge(self):
        off = np.array(self.twists)
        assert (off <= 1.0).mean() > 0.95
        assert off.max() < 2.0  # where a command changes, by those 5 ms
        return off

    def close(self):
        self.real.close()
        self.hosted.close()
        self.sim.close()


def test_the_hardware_env_over_the_twin_is_the_simulated_env():
    both = Both("clutter")
    assert type(both.real) is type(both.sim)
    both.run(0, 5.0)
    both.judge()
    both.close()


@pytest.mark.long
@pytest.mark.parametrize("scene", SCENES)
def test_it_is_for_a_minute_in_five_scenes(scene):
    both, driven, seed = Both(scene), 0.0, 0
    while driven < 60.0:
        driven += both.run(seed, 60.0 - driven)
        seed += 1
    both.judge()
    both.close()
