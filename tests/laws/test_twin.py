"""Law 3: the hardware env over the twin equals the simulated env of the same configuration.

Both chairs count whole steps of their encoders, at phases of their own: where they move alike, each
reading still errs by up to a quantum. The motions agree within the law's bound, each reading with
its own chair's motion, and so two readings within two. A board's counts are some 5 ms old when they
are read; `WORKED_OUT` says what that leaves.

Measured over five minutes in five scenes: motions within 0.48 bounds; a reading of the twin within
1.13, of the simulated chair within 0.87; two readings within one in 95.3 to 99.7 % of the periods,
the worst 1.45 apart.

The simulated chair has no brakes to open: each episode begins with the twin's brakes as they are
after a second at zero.
"""

import hashlib
import math

import gymnasium as gym
import numpy as np
import pytest

from agents.policies import GymPolicy, make_policy
from tests.conftest import ROOT
from tests.hardware.hosted import Hosted
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.geometry.kinematics import twist_of_wheels
from wheelchair_gym.hardware.registry import localized

CONFIG = str(ROOT / "configs" / "hardware.json")  # both controlled at 200 Hz
SCENES = ("floor_plan", "clutter", "thesis_1", "chaotic_pso", "lab_1")
COUNT = 1.0 / 4346.0  # m
PERIOD, TRACK = 0.1, 0.54
QUANTUM = np.array([COUNT, 2.0 * COUNT / TRACK]) / PERIOD  # of both wheels' counts in a period
# The board hears a command up to 3 ms after its period began, and counts are whole.
HEED = 0.8 * 0.003 + COUNT  # m
# Share of a quantum that a reading of the twin may err by beyond its rounding. In the 5 ms since
# counts were made, the wheels' ways are worked out from speeds through a low-pass: its lag of 22 ms
# at the limits of jerk makes 0.12 counts, its ripple of 5 mm/s on whole counts 0.11 at either end.
WORKED_OUT = 0.35


def off(seen, other):
    """Return the difference of two twists (2,), in bounds of the law."""
    return np.abs(seen - other) / np.maximum(0.02 * np.abs(other), QUANTUM)


class Both:
    """The same actions for both, chosen by a policy in the simulated one.

    Attributes:
        offs: how far apart in each period: motions, each reading from its motion, readings.
    """

    def __init__(self, scene):
        settings = env_settings(CONFIG, scene=scene, pose_source="odometry", noise=False)
        self.sim = gym.make("wheelchair_gym/Navigation-v1", config=settings, split="test").unwrapped
        self.hosted = Hosted(chair=settings.chair, sensors=settings.sensors)
        self.real = gym.make(
            "wheelchair_gym/Hardware-v1",
            config=settings,
            chair=localized(self.hosted.chair, settings),
            disable_env_checker=True,
        ).unwrapped
        self.offs, self.digest = [], hashlib.sha256()

    def ways(self):
        """True ways (2, 2) [m] of both chairs' wheels so far: the simulated one's, the twin's."""
        turned = self.sim.chair.state["turned"][0] * self.sim.settings.chair.drive.wheel_radius
        motion = self.hosted.twin.motion
        return np.array([turned, (motion.left * COUNT, motion.right * COUNT)])

    def run(self, seed, seconds):
        """Drive from an episode's start for so long, or to its end; the seconds driven."""
        sim, real = self.sim, self.real
        policy = GymPolicy(make_policy("visibility+window"), sim)
        seen, _ = sim.reset(seed=seed)
        self.hosted.chair.reset(None, 0)  # at rest before it is carried to the start
        # A start from brakes that a stop closed at once waits 0.15 s until the motors have taken
        # the chair over; from brakes that closed after a second at zero it does not.
        for speed in (*[0.1] * 5, *[0.0] * 20):
            self.hosted.chair.drive(np.array([speed, 0.0]))
        self.hosted.twin.reset(sim.episode, 0)
        told, _ = real.reset(seed=seed, options={"episode": sim.episode})
        assert {name: value.shape for name, value in told.items()} == {
            name: value.shape for name, value in seen.items()
        }
        policy.reset()
        done, ways, turning = False, self.ways(), 0.0
        while not done and sim.task.reading.stamp < seconds - 1e-6:
            action = policy.act(seen)
            seen, _, *ends, info = sim.step(action)
            told, _, *others, _ = real.step(action)
            for value in told.values():
                self.digest.update(value.tobytes())
            assert not info["contact"]
            assert real.task.reading.halted == ""
            done = any(ends) or any(others)
            a, b = real.task.reading, sim.task.reading
            assert a.stamp == pytest.approx(b.stamp)
            before, ways = ways, self.ways()
            mine, its = (np.array(twist_of_wheels(*(way / PERIOD), TRACK)) for way in ways - before)
            self.offs.append(
                [off(its, mine), off(a.twist, its), off(b.twist, mine), off(a.twist, b.twist)]
            )
            turning += abs(info["twist"][1]) * PERIOD
            near = HEED + 0.01 * info["distance"]
            apart = a.pose - b.pose
            assert np.hypot(*apart[:2]) <= near
            turned = (apart[2] + math.pi) % (2 * math.pi) - math.pi
            assert abs(turned) <= math.radians(0.5) + 0.01 * turning
            assert np.hypot(*(self.hosted.twin.plant.pose - sim.chair.truth.pose)[:2]) <= near
        return sim.task.reading.stamp

    def judge(self):
        offs = np.array(self.offs)  # (periods, 4, 2)
        assert offs[:, 0].max() <= 1.0
        assert offs[:, 1].max() <= 1.0 + WORKED_OUT
        assert offs[:, 2].max() <= 1.0
        assert offs[:, 3].max() <= 2.0 + WORKED_OUT

    def close(self):
        self.real.close()
        self.hosted.close()
        self.sim.close()


def test_the_hardware_env_over_the_twin_is_the_simulated_env():
    digests = set()
    for _ in range(2):
        both = Both("clutter")
        assert type(both.real) is type(both.sim)
        both.run(0, 5.0)
        both.judge()
        both.close()
        digests.add(both.digest.hexdigest())
    assert len(digests) == 1  # and two runs of the twin are equal to the bit


@pytest.mark.long
@pytest.mark.parametrize("scene", SCENES)
def test_it_is_for_a_minute_in_five_scenes(scene):
    both, driven, seed = Both(scene), 0.0, 0
    while driven < 60.0 - 1e-3:
        driven += both.run(seed, 60.0 - driven)
        seed += 1
    both.judge()
    both.close()
