"""Laws of the ultrasonics: first echo in the cone, its losses, its age."""

import math

import numpy as np
import pytest

from tests.sensors.test_laser import NO_DISCS, ROOM, nearest_in_cone, random_world
from tests.sim.worlds import box, drive_for, exact_chair, placed
from wheelchair_gym.sensors.settings import SensorSettings, UltrasonicSettings
from wheelchair_gym.sensors.ultrasonic import RANGER, first_echo, ranger_rows, sense_ultrasonic
from wheelchair_gym.sim.chair import SimulatedChair

NO_WALLS = np.empty((0, 4))
NARROW = math.radians(7.5)  # half of a cone
NEVER = (100.0, 200.0)  # incidences from which echoes are lost
LOSSES = math.radians(15), math.radians(25)


def wall(distance, slant=0.0, half=20.0):
    """A long wall at a distance, slanted against the sensor's axis."""
    c, s = math.cos(slant), math.sin(slant)
    return np.array([(distance - half * s, -half * c, distance + half * s, half * c)])


def ranger(half, reach, losses):
    """A ranger with a cone of half an angle, and incidences of losses."""
    return np.array([(0, (0.0, 0.0, 0.0), math.tan(half), reach, 0.0, 0.0, *losses)], RANGER)[0]


def heard(draw, walls):
    """The first echo [m] in a narrow cone that loses some, with a draw."""
    return first_echo(0.0, 0.0, 0.0, ranger(NARROW, 4.0, LOSSES), draw, walls, NO_DISCS, ROOM)


@pytest.mark.parametrize("worlds", [150, pytest.param(500, marks=pytest.mark.long)])
@pytest.mark.parametrize("half", [NARROW, math.radians(27.5)])
def test_cone_equals_brute_force_on_random_worlds(half, worlds):
    """Without losses, the first echo is the nearest of densely cast rays in the cone."""
    rng = np.random.default_rng(3)
    hits = 0
    for _ in range(worlds):
        walls, discs = random_world(rng)
        yaw = rng.uniform(-10, 10)
        echo = first_echo(0.0, 0.0, yaw, ranger(half, 6.0, NEVER), 0.0, walls, discs, ROOM)
        nearest = nearest_in_cone(0.0, 0.0, yaw, half, walls, discs, 6.0)
        if nearest >= 6.0:
            assert math.isinf(echo)
            continue
        hits += 1
        # Rays stand up to 5e-5 rad apart, so they may only miss by a little what is nearest.
        assert nearest - 1e-4 <= echo <= nearest + 1e-9
    assert hits > 0.3 * worlds


def test_slanted_wall_answers_from_the_cone_edge_or_not_at_all():
    # A wall slanted by 20 degrees: its nearest point in the cone lies at the cone's edge, where
    # the sound arrives at 12.5 degrees, so it is heard; at 40 degrees it is not.
    slant = math.radians(20)
    edge = 2.0 * math.cos(slant) / math.cos(slant - NARROW)
    assert heard(0.0, wall(2.0, slant)) == pytest.approx(edge, rel=1e-9)
    assert math.isinf(heard(0.999, wall(2.0, math.radians(40))))


@pytest.mark.parametrize(("incidence", "share"), [(10, 0.0), (17.5, 0.25), (20, 0.5), (26, 1.0)])
def test_losses_rise_linearly_with_incidence(incidence, share):
    slanted = wall(2.0, math.radians(incidence) + NARROW)
    draws = (np.arange(1000) + 0.5) / 1000
    lost = [math.isinf(heard(draw, slanted)) for draw in draws]
    assert np.mean(lost) == pytest.approx(share, abs=0.002)


def test_a_lost_echo_does_not_let_the_sound_through_the_wall():
    """Behind a slanted, silent wall stands another that would answer; it stays hidden."""
    walls = np.vstack([wall(1.0, math.radians(50)), wall(3.0)])
    assert math.isinf(heard(0.0, walls))


def test_noise_ghosts_blind_zone_and_reach():
    one, pose = ranger_rows(UltrasonicSettings(), True)[0], np.zeros(3)

    def sensed(walls, key, k):
        return sense_ultrasonic(one, 0.010, pose, walls, NO_DISCS, np.uint64(key), k, ROOM)

    ahead = wall(0.70 + 2.0)
    readings = np.array([sensed(ahead, 5, k) for k in range(20000)])
    expected = 2.0  # the cone of +-7.5 degrees about 5 degrees holds the perpendicular
    near = np.abs(readings - expected) < 0.05
    assert np.std(readings[near]) == pytest.approx(0.010, rel=0.05)
    ghosts = (~near).mean()
    assert ghosts == pytest.approx(0.01 * expected / 4.0, abs=0.0025)
    quiet = np.array([sensed(NO_WALLS, 6, k) for k in range(20000)])
    assert np.isfinite(quiet).mean() == pytest.approx(0.01, abs=0.003)
    touching = sensed(wall(0.705), 5, 3)
    assert touching == pytest.approx(0.02, abs=0.03)
    assert touching >= 0.02


@pytest.mark.parametrize("round_", [False, True])
def test_a_ranger_does_not_see_through_what_it_presses_on(round_):
    """Contact leaves it a millimetre behind a thin wall, or in something round."""
    walls = np.vstack([wall(0.699), wall(0.799), wall(3.0)])[2 if round_ else 0 :]
    discs = np.array([(0.699 + 0.3, 0.12, 0.3)])[: int(round_)]
    one, noise = ranger_rows(UltrasonicSettings(), False)[0], (np.uint64(5), 3)
    assert sense_ultrasonic(one, 0.0, np.zeros(3), walls, discs, *noise, ROOM) == 0.02


def test_ages_run_through_one_cycle_and_never_beyond():
    """Eight rangers, one every 60 ms: each reading is 0 to 0.48 s old, each in its turn."""
    chair = SimulatedChair(sensors=SensorSettings(noise=False))
    reading = chair.reset(box(), 0)
    seen = []
    for _ in range(40):
        assert np.all((reading.age >= 0) & (reading.age < 0.48))
        assert len(set(reading.age.round(4).tolist())) == 8
        seen.append(reading.age)
        reading = chair.drive(np.zeros(2))
    assert np.max(seen) == pytest.approx(0.47, abs=0.02)


def test_a_reading_is_taken_where_the_ranger_was_when_it_fired():
    """Driving at a wall, old readings are longer than fresh ones by the way since they fired."""
    chair = placed(exact_chair(), box(8, (1.0, 0.0, 0.0)))
    reading = drive_for(chair, np.array([0.8, 0.0]), 60)
    truth = 8.0 - chair.truth.pose[0] - 0.70
    for k in (0, 1):
        heard = float(reading.ultrasonic[k])
        assert heard == pytest.approx(truth + 0.8 * reading.age[k], abs=0.01)
