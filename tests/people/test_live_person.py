"""Laws of a living person's input and sight, which are those of simulated people."""

import numpy as np
import pytest

from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.people.drivers import DRIVERS, live_person, make_driver
from wheelchair_gym.people.drivers.state import SECTORS
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings

PERIOD = 0.05


def live(driver, key=1):
    one = live_person.LiveInput(driver, ChairSettings(), SensorSettings(), PERIOD)
    one.begin(key)
    return one


def held(one, forward, left, seconds=3.0):
    """Return the interface's output (n, 2) while a deflection is held."""
    return np.array([one.step(forward, left, 0.0)[:2] for _ in range(round(seconds / PERIOD))])


@pytest.mark.parametrize("name", live_person.IMPAIRMENTS)
def test_each_hand_is_a_simulated_persons(name):
    assert name in DRIVERS
    one = live(make_driver(name))
    ahead = held(one, 1.0, 0.0, 6.0)
    assert np.abs(ahead).max() <= 1.0
    assert ahead[20:, 0].mean() > 0.1
    again = held(live(make_driver(name)), 1.0, 0.0, 6.0)
    assert ahead.tobytes() == again.tobytes()  # the same key, the same hand


def test_a_hand_without_impairment_gives_what_is_meant():
    one = live(make_driver("expert"))
    assert held(one, 1.0, 0.0)[-1] == pytest.approx([1.0, 0.0], abs=0.02)
    assert held(one, -0.5, 0.5)[-1] == pytest.approx([-0.5, 0.5], abs=0.02)
    assert (held(one, 0.0, 0.0)[-1] == 0.0).all()


def test_a_tremor_shakes_and_another_key_shakes_otherwise():
    one, other = (held(live(make_driver("essential_tremor"), key), 0.6, 0.0) for key in (1, 2))
    assert one[20:].std() > 0.02
    assert not np.array_equal(one, other)


def test_a_weak_side_turns_less():
    left = held(live(make_driver("weak_left")), 0.0, 1.0)[-1, 1]
    right = held(live(make_driver("weak_left")), 0.0, -1.0)[-1, 1]
    assert 0.0 < left < 0.6 * -right


@pytest.mark.parametrize("command", live_person.COMMANDS[1:])
def test_a_press_picks_the_lit_command_and_another_one_stops(command):
    one = live(live_person.scanning(0.5))
    seen = []
    while one.lit != command:
        assert one.step(0.0, 0.0, 0.0)[:2] == (0.0, 0.0)
        seen.append(one.lit)
        assert len(seen) < 100
    one.press()
    signs = {"forward": (1, 0), "left": (0, 1), "right": (0, -1), "back": (-1, 0)}
    given = held(one, 0.0, 0.0, 2.0)
    assert (np.sign(given) == signs[command]).all()
    one.press()
    assert (held(one, 0.0, 0.0, 0.2)[-1] == 0.0).all()
    assert one.lit == "forward"  # the scan begins again


def test_without_a_press_a_scan_never_drives():
    one = live(live_person.scanning(0.3))
    lit = set()
    for _ in range(200):
        assert one.step(1.0, 1.0, 0.0)[:2] == (0.0, 0.0)
        lit.add(one.lit)
    assert lit == set(live_person.COMMANDS[1:])


@pytest.mark.parametrize("name", [*live_person.SIGHTS, "expert"])
def test_what_is_hidden_is_what_a_simulated_person_does_not_see(name):
    env = NavigationEnv("empty", driver=name, split="test")  # walls all around
    env.reset(seed=1)
    sight = live_person.LiveSight(make_driver(name).perception, env.task.key)
    seen = sight.perception
    laser, looks = env.settings.sensors.laser, 0
    for _ in range(40):
        before = env.drivers.states[0].copy()
        env.step(np.zeros(2))
        state, clock = env.drivers.states[0], float(before["clock"])
        if state["decisions"] == before["decisions"] or abs(clock - round(clock)) < 1e-6:
            continue  # it has not looked, or at the very change of a second
        looks += 1
        places = state["points"][: state["n_points"]]
        side = np.arctan2(places[:, 1], places[:, 0])
        bearing = np.arctan2(places[:, 1] - laser.y, places[:, 0] - laser.x)
        beam = np.rint((bearing - laser.yaw + 0.5 * laser.fov) * (laser.beams - 1) / laser.fov)
        sector = np.searchsorted(np.arange(1, SECTORS) * laser.beams // SECTORS, beam, "right")
        hidden = set(sight.unnoticed(clock))
        assert ((side < seen.left) & (side > -seen.right)).all()
        assert not hidden & set(sector[side > seen.neglect].tolist())
        assert (np.abs(side) < np.radians(8.0)).any()
    assert looks > 4
    assert bool(sight.unnoticed(0.0)) == (name == "hemineglect")
    if name == "hemineglect":
        shares = [len(sight.unnoticed(second)) / SECTORS for second in range(100)]
        assert np.mean(shares) == pytest.approx(1.0 - seen.noticed, abs=0.02)
        assert sight.unnoticed(3.0) == sight.unnoticed(3.9) != sight.unnoticed(4.0)
