"""Laws of copies: a copy steps on as its original does, to the bit, or refuses in one line.

Copies of planners and of scenes: tests/planners/test_planners.py, tests/scenes/test_scenes.py.
"""

import copy
import pickle
from operator import methodcaller

import gymnasium as gym
import numpy as np
import pytest

from agents.control import FOLLOWERS
from agents.learning.sb3 import SB3VecEnv
from agents.learning.weights import shipped
from agents.policies import GymPolicy, make_policy
from tests.conftest import ROOT, at_start, python
from tests.copies import COPIERS, by_pickle, differences, drive_copies
from tests.envs.test_gymnasium import IDS
from tests.laws.test_policies import SCRIPTED
from tests.sim.worlds import busy, cluttered, placed
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv
from wheelchair_gym.hardware.chair import HardwareChair
from wheelchair_gym.hardware.ros.chair import RosChair
from wheelchair_gym.hardware.twin.board import EmulatedBoard
from wheelchair_gym.sim.chair import SimulatedChair
from wheelchair_gym.types import Chair, NotCopyable

LASER = {"laser": {"beams": 64}}
BRIEF = {"sensors": LASER, "task": {"beams": 32, "time_base": 6.0, "time_factor": 0.0}}
TRACKED = BRIEF | {"task": {**BRIEF["task"], "tracks": 4}}
LATE = BRIEF | {"chair": {"command_delay": 0.17}}
FAULTS = {"faults": {"share": 1.0, "onset": [0.2, 1.0]}}
BANK = {"size": 3, "turnover": 0.0}
PERSON = {"driver": "essential_tremor", "assistant": "slide"}
# What may differ in the state of an environment: pose sources, shield, actors and tracks of them,
# late commands, guidance, faults, a person with an assistant, sensors.
SINGLE = {
    "clutter": {"scene": "clutter", "config": BRIEF},
    "unrepeated": {"scene": "doorway", "config": BRIEF, "bank": 0},
    "shield": {"scene": "floor_plan", "config": BRIEF, "shield": True},
    "crowd": {"scene": "crowd", "config": TRACKED, "shield": True, "pose_source": "odometry"},
    "temporary": {"scene": "temporary", "config": LATE, "pose_source": "modelled"},
    "poses": {"scene": "clutter", "config": BRIEF, "guidance": "poses", "randomize": True},
    "faults": {"scene": "clutter", "config": BRIEF | {"sensors": LASER | FAULTS}, "shield": True},
    "mcl": {"scene": "clutter", "config": BRIEF, "pose_source": "mcl"},
    "slam": {"scene": "empty", "config": BRIEF, "pose_source": "slam"},
    "person": {"scene": "clutter", "config": BRIEF, **PERSON},
    "own chair": {"config": str(ROOT / "examples" / "own_robot.json")},
}  # fmt: skip
ROWS = "clutter", "shield", "crowd", "temporary", "faults", "person"
MANY = {name: SINGLE[name] for name in ROWS}


def settings_of(settings):
    return {"bank": BANK} | settings


def forward(rng, shape=(2,)):
    """An action that gets somewhere, into things too."""
    action = rng.uniform(-1.0, 1.0, shape)
    action[..., 0] = np.abs(action[..., 0])
    return action.astype(np.float32)


begin = methodcaller("reset")


def step_single(env, rng):
    told = env.step(forward(rng))
    return None if told[2] or told[3] else told


def step_many(env, rng):
    told = env.step(forward(rng, (env.num_envs, 2)))
    if "final_obs" in told[4]:  # the other rows are arbitrary
        ended = told[4]["_final_obs"]
        told[4]["final_obs"] = {key: rows[ended] for key, rows in told[4]["final_obs"].items()}
    return told


def vector(settings, **more):
    return NavigationVectorEnv(3, **settings_of(settings), **more)


@pytest.mark.parametrize("copies", [6, pytest.param(700, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", SINGLE)
def test_a_copy_of_an_env_steps_on_as_the_original(name, copies):
    env = at_start(NavigationEnv(**settings_of(SINGLE[name])), 5)
    drive_copies(begin, step_single, env, copies, seed=5)


@pytest.mark.parametrize("name", IDS)
def test_a_copy_of_every_registered_env_steps_on_as_the_original(name):
    """With its wrappers."""
    env = at_start(gym.make(name, config=BRIEF, bank=BANK), 2)
    drive_copies(begin, step_single, env, 3, seed=2)


@pytest.mark.parametrize("copies", [3, pytest.param(370, marks=pytest.mark.long)])
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("name", MANY)
def test_a_copy_of_many_chairs_steps_on_as_the_original(name, mode, copies):
    env = vector(MANY[name], autoreset_mode=mode, num_threads=2)
    env.reset(seed=5)
    drive_copies(begin, step_many, env, copies, seed=5, steps=12)


@pytest.mark.parametrize("flat", [False, True])
def test_a_copy_for_stable_baselines_steps_on_as_the_original(flat):
    def step(env, rng):
        told = env.step(forward(rng, (3, 2)))
        for info in told[3]:
            info.get("episode", {}).pop("t", None)  # wall time
        return told

    env = SB3VecEnv(vector(SINGLE["shield"], autoreset_mode="SameStep"), flat)
    env.seed(4)
    drive_copies(begin, step, env, 3, seed=4, steps=40)


def test_a_copy_before_the_first_reset_is_that_env():
    for make in (NavigationEnv, NavigationVectorEnv):
        for copied in COPIERS:
            env = make(**settings_of(SINGLE["crowd"]))
            env.action_space.seed(1)
            other = copied(env)
            assert not list(differences(env.reset(seed=3), other.reset(seed=3)))
            assert not list(differences(env.action_space.sample(), other.action_space.sample()))


@pytest.mark.long
def test_a_copy_in_another_process_steps_on_as_the_original(tmp_path):
    """There the engine's functions and all arrays lie elsewhere."""
    env, many = NavigationEnv(**settings_of(SINGLE["crowd"])), vector(SINGLE["shield"])
    rng = np.random.default_rng(0)
    for one, step in ((env, step_single), (many, step_many)):
        one.reset(seed=6)
        step(one, rng)
    (tmp_path / "envs").write_bytes(pickle.dumps((env, many)))
    program = (
        "import pickle, sys, numpy as np\n"
        "from tests.laws.test_copies import drive_on\n"
        "path = sys.argv[1]\n"
        "told = drive_on(*pickle.loads(open(path, 'rb').read()))\n"
        "open(path, 'wb').write(pickle.dumps(told))\n"
    )
    assert python(program, tmp_path / "envs").returncode == 0
    told = pickle.loads((tmp_path / "envs").read_bytes())
    assert not list(differences(told, drive_on(env, many)))


def drive_on(env, many):
    rng = np.random.default_rng(1)
    return [(step_single(env, rng), step_many(many, rng)) for _ in range(20)]


def step_policy(driven, rng):
    env, policy, seen = driven
    action = policy.act(seen[0])
    told = env.step(np.asarray(action, np.float32))
    seen[0] = told[0]
    return None if told[2] or told[3] else (action, told)


def begin_policy(driven):
    env, policy, seen = driven
    seen[:] = [env.reset()[0]]
    policy.reset()
    return seen


@pytest.mark.parametrize("name", [*SCRIPTED, *(f"a_star+{name}" for name in FOLLOWERS), *shipped()])
def test_a_copy_of_env_and_policy_drives_on_as_the_original(name):
    scene = "clutter" if name != "explore" else "empty"
    own = {"explore": {"pose_source": "slam"}, "ppo_rear": {"model": "rear"}}.get(name, {})
    env = at_start(NavigationEnv(scene, bank=BANK, **own), 1)
    driven = env, GymPolicy(make_policy(name), env), [None]
    drive_copies(begin_policy, step_policy, driven, 1, seed=1)


class Foreign(NotCopyable, Chair):
    """Stands for a chair behind a line."""

    reset = drive = truth = None


@pytest.mark.parametrize("copied", COPIERS)
def test_what_is_outside_refuses_in_one_line(copied):
    for chair in (HardwareChair, RosChair, EmulatedBoard):
        assert issubclass(chair, NotCopyable)
    env = NavigationEnv(bank=BANK, chair=Foreign())
    with pytest.raises(TypeError, match="neither copied nor pickled") as told:
        copied(env)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("copied", COPIERS)
def test_a_copied_chair_has_the_latest_reading_and_truth(copied):
    chair = SimulatedChair()
    for one in (chair, copied(chair)):
        with pytest.raises(ValueError, match="never reset"):
            one.reading()
    placed(chair, busy(1)).drive(np.array([0.5, 0.0]))
    known, other = (chair.reading(), chair.truth), copied(chair)
    assert not list(differences(known, (other.reading(), other.truth)))
    other.close()
    assert not list(differences(known[0], other.reading()))
    with pytest.raises(ValueError, match="or it was closed"):
        _ = other.truth


@pytest.mark.parametrize("copied", COPIERS)
def test_a_chair_that_was_moved_by_other_means_is_not_copied(copied):
    chair = placed(SimulatedChair(), cluttered(1))
    chair.drive(np.array([0.5, 0.0]))
    chair.chairs.worlds[0].body.position += (0.5, 0.0)
    chair.drive(np.array([0.5, 0.0]))
    with pytest.raises(TypeError, match="moved by other means"):
        copied(chair)


def test_a_copy_that_was_pickled_shares_nothing_with_what_it_is_a_copy_of():
    """A write into the arrays of the original does not change the copy."""
    settings = settings_of(SINGLE["shield"])
    known, env = NavigationEnv(**settings), NavigationEnv(**settings)
    for one in (known, env):
        one.reset(seed=3)
        one.step(np.array([0.5, 0.1]))
    made = copy.deepcopy(by_pickle(copy.deepcopy(env)))
    for array in (env.episode.walls, env.episode.discs, env._prepared.geodesic.extended):
        array[:] = np.nan
    scanners = [env.chair.chairs.suite.scanners, env.shield._constants.scanners]
    rays = [each.array(name) for each in scanners for name in ("cosine", "sine")]
    for array in rays:
        array[:] = np.nan
    for _ in range(5):
        action = np.array([0.5, 0.1])
        assert not list(differences(known.step(action), made.step(action)))
