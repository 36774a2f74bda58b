"""Laws of the compiled loop over one chair, and of a chair of one's own, from one config."""

import numpy as np
import pytest

from agents.evaluation.evaluate import drive_episode
from agents.policies import make_policy
from tests.conftest import ROOT, at_start
from tests.copies import differences
from wheelchair_gym.base.settings import dump
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.envs.one_chair import LoopInParts, SimulatedLoop
from wheelchair_gym.rendering.picture import TopView
from wheelchair_gym.sensors.settings import SensorSettings, UltrasonicSettings
from wheelchair_gym.sim.chair import SimulatedChair

BANK = {"size": 4, "turnover": 0.5}


def gentle(terms, sensed, action):
    return terms.progress - 0.1 * abs(action[1]) + sensed.clearance


def seen_by_others(env):
    """Return the values that policies, recordings and pictures read after a step."""
    task, chair = env.task, env.chair
    return (
        env.reading._asdict(), chair.truth._asdict(), task.observation,
        task.action, task.shield_intervention, np.copy(chair.sensed), np.copy(task.judged),
    )  # fmt: skip


@pytest.mark.parametrize(
    "settings",
    [
        {"scene": "clutter", "pose_source": "modelled", "randomize": True},
        {"scene": "crowd", "shield": True, "guidance": "geodesic"},
        {"scene": "clutter", "reward": gentle, "noise": False},
        {"scene": "clutter", "config": {"shield": {}, "unshielded": 0.5}},
        {"scene": "clutter", "shield": True, "driver": "novice", "assistant": "slide"},
    ],
)
def test_the_compiled_loop_is_the_loop_in_parts(settings):
    settings = {"beams": 32, "bank": BANK, "max_episode_steps": 60} | settings
    env, other = NavigationEnv(**settings), NavigationEnv(**settings)
    assert isinstance(env._loop, SimulatedLoop)
    other._loop = LoopInParts(other._loop.parts, None)
    rng, ends = np.random.default_rng(0), 0
    assert not list(differences(env.reset(seed=3), other.reset(seed=3)))
    for k in range(200):
        action = rng.uniform((-0.2, -1.3), 1.3).astype(np.float32)
        one, another = env.step(action), other.step(action)
        assert [type(value) for value in one[4].values()] == [
            type(value) for value in another[4].values()
        ]
        assert list(one[4]) == list(another[4])
        assert not list(differences(one, another))
        if k % 3 == 0:  # made when asked for
            assert not list(differences(seen_by_others(env), seen_by_others(other)))
        if one[2] or one[3]:
            ends += 1
            assert not list(differences(env.reset(), other.reset()))
    assert ends > 1


def test_a_chair_of_another_class_drives_itself():
    class Counting(SimulatedChair):
        drives = 0

        def drive(self, twist, protective=False):
            self.drives += 1
            return super().drive(twist, protective)

    chair = Counting()
    env = at_start(NavigationEnv("empty", bank=BANK, chair=chair))
    env.step(np.zeros(2))
    assert chair.drives == 1


SHOWN = (
    lambda env, observation, info: observation.values(),
    lambda env, observation, info: info.values(),
    lambda env, observation, info: env.task.reading,
    lambda env, observation, info: env.chair.truth,
    lambda env, observation, info: (env.chair.sensed["pose"], env.chair.sensed["age"]),
)


def test_what_was_handed_out_is_never_written_again():
    """One array of many is kept, or what refers to it, for a random while."""
    env = NavigationEnv("clutter", beams=16, bank=BANK)
    rng, kept = np.random.default_rng(0), []
    ended = True
    for _ in range(3000):
        if ended:
            env.reset(seed=int(rng.integers(3)))
        observation, _, terminated, truncated, info = env.step(rng.uniform(-1.0, 1.0, 2))
        ended = terminated or truncated
        if rng.random() < 0.5:
            shown = SHOWN[rng.integers(len(SHOWN))](env, observation, info)
            arrays = [each for each in shown if isinstance(each, np.ndarray)]
            held = arrays[rng.integers(len(arrays))]
            held = (held, held[:1], held[::-1].view(), memoryview(held))[rng.integers(4)]
            kept.append((held, np.array(held, copy=True)))
            del shown, arrays, held
        del observation, info
        while len(kept) > rng.integers(1, 12):
            held, copied = kept.pop(rng.integers(len(kept)))
            assert np.asarray(held).tobytes() == copied.tobytes()
    for held, copied in kept:
        assert np.asarray(held).tobytes() == copied.tobytes()


def test_memory_is_used_again_once_nobody_holds_what_it_shows():
    env = at_start(NavigationEnv("empty", beams=16, bank=BANK))
    addresses = set()
    for _ in range(100):
        observation = env.step(np.zeros(2))[0]
        addresses.add(observation["laser"].ctypes.data)
    assert len(addresses) <= 4


FILE = str(ROOT / "examples" / "own_robot.json")  # 0.7 m x 1.1 m, two lasers and a camera's fan
BARE = {"laser": {"beams": 0}}  # ultrasonics and odometry only


@pytest.mark.parametrize("mounted", [0, 1, 8])
def test_an_observation_has_as_many_ultrasonics_as_are_mounted(mounted):
    rangers = UltrasonicSettings().mounted[:mounted]
    sensors = SensorSettings(ultrasonic=UltrasonicSettings(mounted=rangers))
    env = NavigationEnv(config={"scene": "clutter", "sensors": dump(sensors)}, split="test")
    observation, _ = env.reset(seed=0)
    assert ("ultrasonic" in observation) == (mounted > 0)
    assert observation.get("ultrasonic", np.zeros(0)).shape == (mounted,)


def test_without_a_laser_there_is_no_such_key_and_no_shield():
    config = {"scene": "clutter", "sensors": BARE}
    observation, info = NavigationEnv(config=config, split="test").reset(seed=0)
    assert "laser" not in observation
    assert info["valid_beams"] == 0


@pytest.mark.parametrize("observed", [541, 100, 10])
def test_each_scanner_is_pooled_by_itself(observed):
    env = NavigationEnv(config=FILE, beams=observed, split="test")
    observation, _ = env.reset(seed=1)
    sensors, counts = env.settings.sensors, env.settings.task.observed_beams(env.settings.sensors)
    assert counts[0] == observed
    assert sum(counts) == len(observation["laser"])
    parts = np.split(observation["laser"], np.cumsum(counts)[:-1])
    high = np.split(env.observation_space["laser"].high, np.cumsum(counts)[:-1])
    for laser, at, pooled, maximum in zip(sensors.lasers, sensors.slices, parts, high, strict=True):
        ranges = np.clip(env.reading.laser[at], 0.0, laser.reach)
        assert pooled.min() == ranges.min()
        assert (maximum == np.float32(laser.reach)).all()


def test_it_drives_behind_its_shield():
    env = NavigationEnv(config=FILE, split="test")
    for seed in (0, 1):
        record = drive_episode(env, make_policy("lattice+window"), seed)
        assert record["success"]


def test_a_picture_shows_each_scan_from_its_own_place():
    env = at_start(NavigationEnv(config=FILE, shield=False, split="test"), 1)
    s, reading = env.settings, env.reading
    view = TopView(env.episode, s.chair.footprint, s.chair.drive, s.sensors)
    whole = view.draw(env.episode.start, reading)
    for at in s.sensors.slices:
        ranges = reading.laser.copy()
        ranges[at] = np.nan
        assert (view.draw(env.episode.start, reading._replace(laser=ranges)) != whole).any()


def test_a_localizer_uses_the_first_scanner():
    env = at_start(NavigationEnv(config=FILE, pose_source="mcl", split="test"))
    for _ in range(10):
        env.step(np.array([0.3, 0.1]))
    off = env.reading.pose - env.chair.truth.pose
    assert np.hypot(off[0], off[1]) < 0.3
