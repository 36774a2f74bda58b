"""Laws of a chair of one's own: outline, mass and sensors from one config."""

import numpy as np
import pytest

from agents.evaluation.evaluate import drive_episode
from agents.policies import make_policy
from tests.conftest import ROOT
from wheelchair_gym.base.settings import InputError, dump, read
from wheelchair_gym.envs import EnvSettings, NavigationEnv
from wheelchair_gym.hardware.settings import check_boards
from wheelchair_gym.rendering.picture import TopView
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings, UltrasonicSettings

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
    with pytest.raises(InputError, match="shield: it needs a laser"):
        NavigationEnv(config=config, shield=True, split="test")


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
    env = NavigationEnv(config=FILE, shield=False, split="test")
    env.reset(seed=1)
    s, reading = env.settings, env.reading
    view = TopView(env.episode, s.chair.footprint, s.chair.drive, s.sensors)
    whole = view.draw(env.episode.start, reading)
    for at in s.sensors.slices:
        ranges = reading.laser.copy()
        ranges[at] = np.nan
        assert (view.draw(env.episode.start, reading._replace(laser=ranges)) != whole).any()


def test_real_chairs_refuse_other_sensors_in_one_line():
    own_sensors = read(EnvSettings, FILE).sensors
    none = SensorSettings(laser=LaserSettings(beams=0))
    for sensors, why in (
        (none, "laser.beams is 0; a real chair has a laser"),
        (own_sensors, "mounted has 4 rangers; the range board serves 8 or 10"),
    ):
        with pytest.raises(InputError, match=why):
            check_boards(sensors)
    check_boards(SensorSettings())


def test_a_localizer_uses_the_first_scanner():
    env = NavigationEnv(config=FILE, pose_source="mcl", split="test")
    env.reset(seed=0)
    for _ in range(10):
        env.step(np.array([0.3, 0.1]))
    off = env.reading.pose - env.chair.truth.pose
    assert np.hypot(off[0], off[1]) < 0.3
