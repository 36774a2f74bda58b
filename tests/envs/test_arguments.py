"""Arguments of environments: paths and arrays as plain values; unknown ones are refused."""

import inspect
import json
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from tests.conftest import ROOT, at_start, put
from wheelchair_gym.base.settings import InputError, dump, load, read_json
from wheelchair_gym.envs import EnvSettings, NavigationEnv, NavigationVectorEnv
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.hardware.control_loop import WallClock
from wheelchair_gym.recording.replay import ReplayedChair
from wheelchair_gym.scenes.map_file import MapFile, example_map

ID = "wheelchair_gym/Navigation-v1"


@pytest.mark.parametrize("kind", [NavigationEnv, NavigationVectorEnv])
def test_an_unknown_argument_is_answered_with_all_that_are_known(kind):
    own = {
        name
        for name, parameter in inspect.signature(kind).parameters.items()
        if parameter.kind is not parameter.VAR_KEYWORD
    }
    fields = {"scene", "config", "rate", "bank", "shield", "beams", "pose_source", "randomize"}
    with pytest.raises(InputError, match="got an unexpected keyword argument 'shild'") as caught:
        kind(shild=True)
    said = str(caught.value)
    assert isinstance(caught.value, TypeError)  # as of every Python function
    assert "did you mean shield?" in said
    named = set(said.partition("it has ")[2].replace(";", ",").split(", "))
    assert own | fields <= named, (own | fields) - named


@pytest.mark.parametrize(
    ("make", "known"),
    [(lambda: gym.make(ID, scene="empty"), "episode"),
     (lambda: gym.make_vec(ID, 2, scene="empty"), "reset_mask")],
)  # fmt: skip
def test_an_unknown_option_of_reset_is_refused_and_nothing_has_begun(make, known):
    env = make()
    begun, _ = env.reset(seed=1)
    wrong = known[:-1]
    with pytest.raises(InputError, match=f"{wrong}.*known: {known}.*did you mean {known}"):
        env.reset(options={wrong: None})
    with pytest.raises(InputError, match=known):
        env.reset(options={known: "all of it"})
    for other in (5, [known], {known: np.zeros((9, 9))}):
        with pytest.raises(InputError, match=r"^options\b.*expected .*$"):  # one line
            env.reset(options=other)
    assert all((env.reset(seed=1, options={})[0][key] == begun[key]).all() for key in begun)
    env.close()


def as_arrays(value):
    """The same value in numpy's types, with paths for texts that name files."""
    if isinstance(value, dict):
        return {key: as_arrays(item) for key, item in value.items()}
    if isinstance(value, list):
        return np.array(value) if value and not isinstance(value[0], dict) else value
    if isinstance(value, str):
        return Path(value) if value.endswith(".yaml") else np.str_(value)
    if isinstance(value, float):
        return np.float64(value)
    return np.bool_(value) if isinstance(value, bool) else np.int64(value)


def test_arrays_scalars_and_paths_are_what_they_hold(tmp_path):
    clinic = str(example_map())
    scene = {"name": "map_file", "path": clinic, "start": [2.0, 2.0, 0.0], "goal": [13.0, 8.0, 0.0]}
    plain = {"rate": 5.0, "task": {"beams": 64}, "chair": {"random": {"mass": [100.0, 120.0]}}}
    file = put(tmp_path / "env.json", {**plain, "scene": scene})
    given = gym.make(ID, scene=as_arrays(scene), config=as_arrays(plain)).unwrapped
    same = gym.make(ID, config=file).unwrapped
    assert given.settings == same.settings
    assert json.loads(json.dumps(dump(given.settings))) == dump(same.settings)
    given.reset(seed=0)
    assert given.episode.start.tolist() == scene["start"]
    assert given.episode.goal.tolist() == scene["goal"]
    assert MapFile(path=example_map(), start=np.array(scene["start"])) == MapFile(
        path=clinic, start=tuple(scene["start"])
    )
    by_path = gym.make(ID, scene=example_map(), rate=np.float32(5), beams=np.int16(64)).unwrapped
    assert by_path.settings == env_settings(
        None, scene={"name": "map_file", "path": clinic}, rate=5.0, beams=64
    )


@pytest.mark.parametrize("wrong", [np.array([1.0, 2.0]), np.array("x"), np.float64("nan")])
def test_an_array_is_no_number(wrong):
    with pytest.raises(InputError, match=r"rate is"):
        gym.make(ID, rate=wrong)


def test_the_real_chair_is_made_with_the_shipped_settings_and_stands_where_it_is_not(monkeypatch):
    late = [0.0]  # s: what is waited for passes at once
    monkeypatch.setattr(WallClock, "now", lambda clock: time.monotonic() + late[0])
    monkeypatch.setattr(
        WallClock, "wait", lambda clock, until, gone=None: late.append(late.pop() + 0.1)
    )
    shipped = read_json(ROOT / "configs" / "hardware.json")
    env = gym.make("wheelchair_gym/Hardware-v1").unwrapped
    try:
        own = dump(env.settings)
        assert own.pop("shield") is not None  # a real chair always has one
        assert own == {key: value for key, value in shipped.items() if key != "shield"}
        with pytest.raises(InputError, match=r"/dev/ttyACM0|drive board"):
            env.reset(seed=0)
    finally:
        env.close()
    mine = {"sensors": {"pose_source": "odometry"}}
    env = gym.make("wheelchair_gym/Hardware-v1", config=mine).unwrapped
    assert env.settings == env_settings(EnvSettings(), pose_source="odometry", shield=True)
    env.close()


def test_what_is_refused_leaves_no_chair_connected(monkeypatch):
    closed = []
    chair = ReplayedChair([])
    chair.close = lambda: closed.append(chair)
    monkeypatch.setattr("wheelchair_gym.hardware.registry.make_chair", lambda *_: chair)
    wrong = ({"split": "tset"}, {"driver": "expert"}, {"reward": max}, {"guidance": "none"},
             {"scene": "nowhere"}, {"beams": 2000}, {"pose_source": "mcl", "split": 3})  # fmt: skip
    for count, argument in enumerate(wrong):
        with pytest.raises(InputError):
            NavigationEnv(**{"chair": "ros://chair:9090"} | argument)
        assert len(closed) == count + 1
    with pytest.raises(InputError):
        NavigationEnv(chair=chair, split="tset")  # whose owner may use it again
    assert len(closed) == len(wrong)


def test_a_shield_that_is_on_keeps_the_settings_of_the_config():
    mine = {"shield": {"person_speed": 1.2}}
    for switch, speed in (
        (None, 1.2), (True, 1.2), (np.True_, 1.2), ({"person_speed": 1.1}, 1.1), (False, None),
    ):  # fmt: skip
        made = env_settings(mine, shield=switch).shield
        assert (made and made.person_speed) == speed
    assert env_settings({}, shield=True).shield == env_settings({}, shield={}).shield is not None


def test_a_chair_is_chosen_by_its_name():
    """By an argument, which goes before the config, or in a file, which holds no other sensors."""
    rear = read_json("configs/chairs/rear.json")["sensors"]["more_lasers"]
    own = {"model": "rear", "sensors": {"pose_source": "odometry"}, "rate": 20.0}
    made = env_settings(own)
    assert [one.x for one in made.sensors.more_lasers] == [one["x"] for one in rear] == [-0.28]
    assert made.sensors.looks_back
    assert (made.sensors.pose_source, made.rate) == ("odometry", 20.0)
    assert env_settings(own, model="thesis").sensors.more_lasers == ()
    ten = env_settings(None, model="rear_ultrasonics")
    assert len(ten.sensors.ultrasonic.mounted) == 10
    assert ten.sensors.ultrasonic.mounted[:8] == made.sensors.ultrasonic.mounted
    assert ten.sensors.more_lasers == made.sensors.more_lasers
    for base in (None, ten):
        assert env_settings(base, model="thesis") == EnvSettings()
    assert load(EnvSettings, dump(made), "env") == made
    env = at_start(gym.make("wheelchair_gym/Navigation-v1", scene="empty", model="rear"))
    assert env.unwrapped.reading.laser.shape == (1081 + 541,)
    assert env_settings("configs/hardware.json", model="rear").sensors.looks_back
    with pytest.raises(InputError, match=r"config.sensors.more_lasers: expected none"):
        env_settings({"model": "rear", "sensors": EnvSettings().sensors})
    slower = env_settings(own | {"sensors": {"ultrasonic": {"interval": 0.08}}})
    assert slower.sensors.ultrasonic.interval == 0.08
