"""Laws of a person's drive, over drivers and assistants: the stick limits, and its centre stops.

Laws of an assistant's answer alone are in tests/agents/people and tests/people.
"""

import copy

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents.people import ASSISTANTS, is_shielded, make_assistant
from agents.people.drive import open_space
from agents.policies import GymPolicy, make_policy
from tests.conftest import long_but
from tests.copies import differences
from wheelchair_gym.envs import NavigationEnv, NavigationVectorEnv
from wheelchair_gym.people.assistance import COMPILED
from wheelchair_gym.people.drivers import DRIVERS
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Stick

LIMITS = ChairSettings().limits
BRAKING, COMFORT, PROTECTIVE = 0.12, 2.0, 0.8  # s from the centred stick
REST = 0.05  # m/s, rad/s: the odometry of a chair at rest is nearer to zero
CLOSE = 1e-5  # of a stick that was observed in single precision
DEAF = {"task": {"bump_ends": False, "time_base": 1e3}}

# Each driver with one assistant, so that each assistant is there; all pairs in the long tests.
SOME = [(driver, sorted(COMPILED)[k % len(COMPILED)]) for k, driver in enumerate(sorted(DRIVERS))]
EVERY = [(driver, assistant) for driver in sorted(DRIVERS) for assistant in sorted(COMPILED)]
REST_OF = sorted(set(EVERY) - set(SOME))


def check_drives(driver, assistant, seed, steps):
    """Whole drives in a batch: each answer is within the freedom, and each centred stick stops."""
    env = NavigationVectorEnv(
        4, scene="clutter", beams=32, driver=driver, assistant=assistant, shield=True,
        num_threads=1, bank={"size": 2, "turnover": 0.0, "seed": seed}, split="test"
    )  # fmt: skip
    freedom = make_assistant(assistant).freedom
    seen, _ = env.reset(seed=seed)
    centred, moved = np.zeros(4), np.zeros(4, bool)
    residual, rng = np.zeros((4, 2)), np.random.default_rng(seed)
    for _ in range(steps):
        stick = seen["stick"].astype(float)
        residual[2:] = rng.uniform(-1.0, 1.0, (2, 2))  # half of the rows are pushed aside
        seen, *_, info = env.step(residual)
        drove = info["time"] > 0.05  # not a row that began an episode
        size = np.minimum(1.0, np.hypot(*stick[:, :2].T))
        ahead = np.where(stick[:, 0] > 0.0, LIMITS.forward, LIMITS.backward) * stick[:, 0]
        aside, more = LIMITS.turn * stick[:, 1], freedom.turn * size + CLOSE
        v, w = info["shield"]["asked"].T
        assert (~drove | (v >= np.minimum(0.0, ahead) - CLOSE)).all()
        assert (~drove | (v <= np.maximum(0.0, ahead) + CLOSE)).all()
        assert (~drove | (w >= np.minimum(0.0, aside) - more)).all()
        assert (~drove | (w <= np.maximum(0.0, aside) + more)).all()
        # The stick at the centre is that of a released one, or the stop of a latched interface.
        centred = np.where((size == 0.0) & drove, centred + 0.1, 0.0)
        late = centred > COMFORT
        assert (np.abs(info["twist"][late]) < REST).all()
        moved |= np.abs(info["twist"]).max(axis=1) > REST
    env.close()
    return moved.any()


@pytest.mark.parametrize(("driver", "assistant"), long_but(SOME, SOME[:12]))
def test_drives_keep_to_the_stick(driver, assistant):
    assert check_drives(driver, assistant, 0, 150) or driver in ("scanning", "bci")


@pytest.mark.long
@pytest.mark.parametrize(("driver", "assistant"), REST_OF)
def test_drives_of_all_pairs_keep_to_the_stick(driver, assistant):
    for seed in range(4):
        check_drives(driver, assistant, 10 * seed, 600)


class Hand:
    """The stick of a person who pushes, and lets go."""

    stick = Stick(0.0, 0.0, False)

    def __call__(self):
        return self.stick


def pushed(name, push, periods, rate):
    """Push the stick of a chair in the open for n periods; return env, policy and hand."""
    hand = Hand()
    env = NavigationEnv(
        person=hand,
        shield=is_shielded(name),
        noise=False,
        rate=rate,
        beams=64,
        config=DEAF,
        split="test",
    )
    observation, _ = env.reset(seed=0, options={"episode": open_space()})
    policy = GymPolicy(make_policy({"name": "assisted", "assist": name}), env)
    policy.reset()
    hand.stick = Stick(*push)
    for _ in range(periods):
        observation, *_ = env.step(policy.act(observation))
    return env, policy, hand, observation


def after(state, stick, seconds):
    """The speeds (n,) [m/s, rad/s] and answers of a drive's copy that goes on with a stick."""
    env, policy, hand, observation = copy.deepcopy(state)
    hand.stick, speeds, answers = stick, [], []
    observation, *_ = env.step(policy.act(observation))  # the hand is read after each step
    for _ in range(round(seconds * env.settings.rate)):
        answers.append(env.reading.stick)
        observation, _, _, _, info = env.step(policy.act(observation))
        answers[-1] = (answers[-1], policy.command.twist)
        speeds.append(np.abs(info["twist"]).max())
    return np.array(speeds), answers


def check_release(name, push, periods):
    state = pushed(name, push, periods, 50.0)
    kept, _ = after(state, Stick(*push), BRAKING)
    freed, answers = after(state, Stick(0.0, 0.0, False), COMFORT)
    assert not np.any([twist for _, twist in answers])
    assert freed[-1] < REST
    env = copy.deepcopy(state[0])
    for _ in range(round(PROTECTIVE * 50.0)):
        env.chair.drive(np.zeros(2), True)
    assert np.abs(env.chair.truth.twist).max() < REST
    return kept[-1] - freed[len(kept) - 1]


@pytest.mark.parametrize("name", ASSISTANTS)
def test_a_stick_that_is_let_go_stops_the_chair(name):
    """It brakes within 120 ms, and rests within 2.0 s; protectively within 0.8 s."""
    for push, periods in ((1.0, 0.0, False), 200), ((1.0, 0.0, True), 40):  # latched: a stop signal
        assert check_release(name, push, periods) > 0.003  # jerk: 0.5 x 1 m/s3 x (0.1 s)^2


@pytest.mark.long
@pytest.mark.parametrize("name", ASSISTANTS)
def test_any_stick_that_is_let_go_stops_the_chair(name):
    deflections = st.floats(-1.0, 1.0, allow_nan=False)

    @settings(max_examples=25, deadline=None)
    @given(deflections, deflections, st.booleans(), st.integers(1, 150))
    def law(forward, left, latched, periods):
        check_release(name, (forward, left, latched), periods)

    law()


@pytest.mark.parametrize("driver", long_but(sorted(DRIVERS), sorted(DRIVERS)[1::2]))
def test_the_same_seed_gives_the_same_drive(driver):
    """Earlier drives and the row make no difference."""
    steps, assistant = 60, dict(SOME)[driver]
    more = {
        "scene": "clutter", "beams": 32, "driver": driver, "assistant": assistant, "shield": True,
        "num_threads": 1, "bank": {"size": 2, "turnover": 0.0},
    }  # fmt: skip
    runs = []
    for n, row, seed in ((3, 2, 5), (1, 0, 7)):
        env = NavigationVectorEnv(n, **more, split="test")
        env.reset(seed=seed - 3)
        env.step(np.ones((n, 2)))
        env.reset(seed=seed)
        infos = [env.step(np.zeros((n, 2)))[4] for _ in range(steps)]
        runs.append([(info["pose"][row], info["twist"][row]) for info in infos])
        env.close()
    assert not list(differences(*runs))
