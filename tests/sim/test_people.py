"""Simulated people: models of motion, behaviours, reactions, and the bounds that hold."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from tests.sim.worlds import box, drives, exact_chair, placed, wall_gaps
from wheelchair_gym.actors.bodies import LEG_FORCE
from wheelchair_gym.actors.records import (
    CURIOUS,
    CUTS_IN,
    FASTEST,
    INDIFFERENT,
    MODELS,
    ORCA,
    PAUSES,
    PEOPLE,
    PERSON,
    READS_PHONE,
    REGULAR,
    RUNS,
    SOCIAL_FORCE,
    SURPRISED,
    WALKS,
    WALKS_BESIDE,
    WARY,
    Actors,
    combine,
    furniture,
    group,
    person,
    with_trolley,
)
from wheelchair_gym.actors.social_force import _turn
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.geometry.planar import compose, to_frame
from wheelchair_gym.safety.settings import ShieldSettings
from wheelchair_gym.scenes import make_scene
from wheelchair_gym.types import Episode

STILL = np.zeros(2)
LEGS = LEG_FORCE / 75.0  # m/s2
BOTH = pytest.mark.parametrize("model", [ORCA, SOCIAL_FORCE], ids=MODELS)


def watch(things, seconds, twist=STILL, half=6.0, start=(0.0, 0.0, 0.0), key=0, walls=()):
    """Poses (n, k, 3) of actors and (n, 3) of the chair, one after each 0.1 s, and the chair."""
    chair = placed(exact_chair(), box(half, start, walls, actors=things), key)
    poses, own, contacts = [chair.truth.actor_poses], [chair.truth.pose], 0
    for _ in drives(chair, np.asarray(twist, float), round(10 * seconds)):
        poses.append(chair.truth.actor_poses)
        own.append(chair.truth.pose)
        contacts += chair.truth.contact
    return np.array(poses), np.array(own), contacts


def speeds(poses):
    return np.hypot(*np.diff(poses[:, :2], axis=0).T) / 0.1


def distances(a, b):
    return np.hypot(*(a[:, :2] - b[:, :2]).T)


# --- the headed social force model


def test_a_start_by_social_forces_takes_the_published_relaxation_time():
    """V = v0 (1 - exp(-t / 0.5 s)): Helbing and Molnar 1995, and Farina et al. 2017, equation 4."""
    speed = 1.2  # the force that it takes, 180 N, is what legs give
    poses, _, _ = watch([person([(-5.0, 3.0), (5.0, 3.0)], speed, model=SOCIAL_FORCE)], 3.0)
    tau = 0.5  # s
    times = 0.1 * np.arange(len(poses))
    # The place, which the velocity's integral is.
    expected = -5.0 + speed * (times - tau * (1.0 - np.exp(-times / tau)))
    assert np.abs(poses[:, 0, 0] - expected).max() < 0.02
    assert np.abs(poses[:, 0, 1] - 3.0).max() < 0.02


def test_a_heading_decays_with_the_two_published_rates():
    """Turn stiffness k f and damping (1 + alpha) sqrt(k f / alpha): rates q and alpha q.

    Somebody who is pushed against a wall wants to walk on: the driving force, and so q, is constant
    once they stand; then their goal is put elsewhere.
    """
    force, dt, state = 120.0, 1e-4, SimpleNamespace(heading=0.0, facing=1.0, turn_rate=0.0)
    q = math.sqrt(0.3 * force / 3.0)
    for k in range(1, 15_001):
        _turn.py_func(state, force, dt)
        if k % 1000 == 0:
            t = k * dt
            expected = 1.0 - 1.5 * math.exp(-q * t) + 0.5 * math.exp(-3.0 * q * t)
            assert state.heading == pytest.approx(expected, abs=2e-3)


def test_a_person_who_walks_by_social_forces_faces_their_motion():
    """Like a unicycle in the open (Farina et al. 2017): no sideways speed, also round a corner."""
    route = [(-4.0, -4.0), (4.0, -4.0), (4.0, 4.0)]
    chair = placed(exact_chair(), box(6.0, actors=[person(route, 1.2, model=SOCIAL_FORCE)]))
    state = chair.chairs.pointers.array("actor_states")
    aside, turned = [], 0.0
    for _ in drives(chair, STILL, 110):
        vx, vy, _ = state["twist"][0]
        heading = state["heading"][0]
        aside.append(abs(math.cos(heading) * vy - math.sin(heading) * vx))
        turned = max(turned, heading)
    assert turned > 1.4
    assert np.mean(aside) < 0.05
    assert np.max(aside) < 0.5


@BOTH
def test_two_who_meet_pass_each_other_and_the_chair(model):
    poses, _, _ = watch(
        [
            person([(-5.0, 3.0), (5.0, 3.0)], 1.3, model=model),
            person([(5.0, 3.3), (-5.0, 3.3)], 1.3, model=model),
            person([(-5.0, 0.5), (5.0, 0.5)], 1.3, model=model),
        ],
        9.0,
    )
    assert poses[:, 0, 0].max() > 4.0
    assert poses[:, 1, 0].min() < -4.0
    assert poses[:, 2, 0].max() > 1.0
    assert distances(poses[:, 0], poses[:, 1]).min() > 0.49


# --- behaviours


@BOTH
def test_a_pause_has_the_set_duration(model):
    kind = {"model": model, "behaviour": PAUSES, "since": 2.0, "stay": 3.0, "every": 9.0}
    thing = person([(-5.0, 3.0), (5.0, 3.0)], 1.2, **kind)
    slow = speeds(watch([thing], 14.0)[0][:, 0]) < 0.1
    times = 0.1 * np.flatnonzero(slow)
    assert slow[36:50].all()
    assert not slow[6:20].any()
    assert not slow[56:110].any()
    assert slow[126:138].all()
    assert 2.0 < times[times > 1.0].min() < 3.6


@BOTH
def test_a_person_who_cuts_in_walks_right_before_the_chair_and_goes_on(model):
    route = [(-5.5, 1.2), (5.5, 1.2)]
    beside = []
    for behaviour in (CUTS_IN, WALKS):
        thing = person(route, 1.4, model=model, behaviour=behaviour, near=3.0, stay=4.0, every=20.0)
        poses, own, contacts = watch([thing], 16.0, (0.4, 0.0), start=(-4.5, 0.0, 0.0))
        at = np.array([to_frame(a[:2], b) for a, b in zip(poses[:, 0], own, strict=True)])
        before = (at[:, 0] > 0.8) & (at[:, 0] < 2.0) & (np.abs(at[:, 1]) < 0.35)
        assert contacts == 0
        beside.append(before.sum())
        if behaviour == CUTS_IN:
            first, last = np.flatnonzero(before)[[0, -1]]
            assert first < 70
            assert last < first + 70
            assert poses[last:, 0, 0].max() > own[last, 0] + 2.0  # on their own way
    assert beside[0] >= 30
    assert beside[1] == 0


@BOTH
def test_a_person_who_reads_a_phone_swerves_late(model):
    """Towards somebody who stands: a reader of a phone turns aside when they are a step away."""
    noticed = []
    for behaviour in (WALKS, READS_PHONE):
        walker = person([(-5.0, 3.3), (5.0, 3.3)], 1.0, model=model, behaviour=behaviour)
        alone, _, _ = watch([walker], 9.0)
        poses, _, _ = watch([walker, person([(1.0, 3.0)], 0.01, model=model)], 9.0)
        changed = np.flatnonzero(distances(poses[:, 0], alone[:, 0]) > 0.08)
        noticed.append(distances(poses[:, 0], poses[:, 1])[changed[0]])
    assert noticed[1] < 0.9
    assert noticed[0] > noticed[1] + 0.25
    assert person([(0.0, 0.0)], behaviour=READS_PHONE).row["avoids"] == PEOPLE


@BOTH
def test_a_person_who_walks_beside_the_chair_stays_there(model):
    companion = person(
        [(-2.0, 1.0), (5.0, 1.0)], 1.3, model=model, behaviour=WALKS_BESIDE, offset=(0.0, 0.85)
    )
    poses, own, contacts = watch([companion], 20.0, (0.6, 0.25), half=8.0, start=(0.0, -2.0, 0.0))
    at = np.array([to_frame(a[:2], b) for a, b in zip(poses[:, 0], own, strict=True)])
    assert np.hypot(*(at[60:] - (0.0, 0.85)).T).max() < 0.2
    assert contacts == 0
    # Where a wall leaves no place beside the chair, they come behind.
    walls = [(0.0, 0.7, 7.0, 0.7), (0.0, 0.7, 0.0, 7.0)]
    poses, own, contacts = watch(
        [companion], 12.0, (0.5, 0.0), half=8.0, start=(-5.0, 0.0, 0.0), walls=walls
    )
    at = np.array([to_frame(a[:2], b) for a, b in zip(poses[:, 0], own, strict=True)])
    assert np.hypot(*(at[60:65] - (0.0, 0.85)).T).max() < 0.2
    assert np.abs(at[-5:, 1]).max() < 0.3
    assert at[-5:, 0].max() < -1.0
    assert contacts == 0


@BOTH
def test_a_child_runs_turns_aside_and_stands_within_the_bounds(model):
    route = [(-5.0, 4.0), (5.0, 4.0), (5.0, -4.0), (-5.0, -4.0)]
    child = person(route, FASTEST, radius=0.18, mass=25.0, model=model, behaviour=RUNS, every=1.5)
    poses, _, _ = watch([child], 30.0)
    fast = speeds(poses[:, 0])
    gained = np.hypot(*np.diff(poses[:, 0, :2], 2, axis=0).T) / 0.1**2
    assert 1.45 < fast.max() < FASTEST + 1e-6
    assert gained.max() < LEGS + 1e-6  # as an adult's, although it weighs a third
    assert 0.05 < (fast < 0.2).mean() < 0.5
    assert (np.hypot(*np.diff(np.diff(poses[::5, 0, :2], axis=0), axis=0).T) > 0.25).sum() > 8


@BOTH
@pytest.mark.parametrize("size", [2, 3, 4])
def test_a_group_stays_together(model, size):
    route = [(-6.0, 5.0), (6.0, 5.0), (6.0, -5.0), (-6.0, -5.0)]
    people = group(person(route, 1.0, model=model), size, FASTEST)
    poses, _, _ = watch(people, 40.0, half=8.0)
    for k in range(1, size):
        away = distances(poses[:, 0], poses[:, k])
        assert away.max() < 2.5
        assert away.mean() < 1.3
    assert poses[:, 0, 0].max() > 5.0
    assert poses[:, 0, 1].min() < -4.0
    alone, _, _ = watch([people[0], person(route[::-1], 1.0, model=model)], 40.0, half=8.0)
    assert distances(alone[:, 0], alone[:, 1]).mean() > 4.0


def test_a_group_walks_in_single_file_where_walls_leave_no_more_room():
    """Through a gate of 1 m, which three abreast do not fit."""
    walls = [(0.0, -8.0, 0.0, -0.5), (0.0, 0.5, 0.0, 8.0)]
    people = group(person([(-6.0, 0.0), (6.0, 0.0)], 1.0), 3, FASTEST)
    poses, _, _ = watch(people, 16.0, half=8.0, start=(-6.0, 6.0, 0.0), walls=walls)
    assert (poses[:, :, 0].max(axis=0) > 2.0).all()


@BOTH
@pytest.mark.parametrize("ahead", [True, False])
def test_a_trolley_goes_with_its_person(model, ahead):
    alone = person([(-6.0, 5.0), (6.0, 5.0), (6.0, -5.0), (-6.0, -5.0)], 1.0, model=model)
    poses, _, _ = watch(with_trolley(alone, ahead), 45.0, half=8.0)
    assert alone.row["mass"] == 75.0  # as it was
    walker, cart = poses[:, 0], poses[:, 1]
    away = distances(walker, cart)
    assert np.abs(away - 0.65).max() < 0.12
    assert np.ptp(walker[:, :2], axis=0).min() > 9.0
    side = [to_frame(b[:2], (*a[:2], b[2]))[0] for a, b in zip(walker, cart, strict=True)]
    assert (np.sign(side) == (1.0 if ahead else -1.0)).all()
    for corner in np.array([(x, y) for x in (-0.3, 0.3) for y in (-0.2, 0.2)]):
        assert speeds(compose(cart, (*corner, 0.0))).max() < FASTEST


@BOTH
def test_a_trolley_does_not_touch_a_standing_chair(model):
    """Neither straight on, nor where its person turns about beside the chair."""
    for route in ([(-5.0, 0.0), (5.0, 0.0)], [(-5.0, 0.9), (0.5, 0.9), (0.5, -5.0)]):
        for ahead in (True, False):
            cart = with_trolley(person(route, 1.0, model=model, avoids=PEOPLE), ahead)
            poses, _, contacts = watch(cart, 20.0)
            assert contacts == 0
            assert np.hypot(*poses[:, 1, :2].T).min() < 2.0
            assert distances(poses[:, 0], poses[:, 1]).min() > 0.4


# --- reactions to the chair


@BOTH
def test_reactions_to_a_standing_chair_are_what_they_are_called(model):
    nearest, stood, ways = {}, {}, {}
    for reaction in (REGULAR, CURIOUS, WARY, SURPRISED, INDIFFERENT):
        thing = person([(-5.0, 2.2), (5.0, 2.2)], 1.2, model=model, reaction=reaction)
        poses, own, contacts = watch([thing], 8.0)
        away = distances(poses[:, 0], own)
        slow = speeds(poses[:, 0])[10:] < 0.05
        nearest[reaction], stood[reaction] = away.min(), 0.1 * slow.sum()
        ways[reaction] = poses[:, 0]
        assert contacts == 0
    assert nearest[REGULAR] == pytest.approx(2.2, abs=0.2)
    assert nearest[CURIOUS] < 1.7
    assert nearest[WARY] > nearest[REGULAR] + 0.15
    assert stood[SURPRISED] > 3.0
    assert stood[REGULAR] == stood[INDIFFERENT] == 0.0
    # Surprised: as soon as the chair is 4 m away; then they look at it.
    first = distances(ways[SURPRISED], np.zeros((81, 3)))
    assert first[speeds(ways[SURPRISED]).argsort()[:10].min()] == pytest.approx(3.7, abs=0.6)


def test_the_indifferent_keep_less_from_a_chair_that_drives_up_to_them():
    """It comes towards them: others give way to it in time, as to a person."""
    aside = []
    for reaction in (REGULAR, INDIFFERENT):
        thing = person([(5.0, 0.1), (-5.0, 0.1)], 1.2, reaction=reaction)
        poses, own, _ = watch([thing], 5.0, (0.6, 0.0), start=(-3.0, 0.0, 0.0))
        far = distances(poses[:, 0], own) > 1.3
        aside.append(np.abs(poses[far, 0, 1] - 0.1).max())
    assert aside[0] > 0.3
    assert aside[1] < 0.1


def test_nobody_reacts_to_a_chair_behind_a_wall_or_behind_their_back():
    walls = [(-6.0, 1.0, 6.0, 1.0)]
    for reaction in (CURIOUS, WARY, SURPRISED):
        for route, hidden in (([(-5.0, 2.0), (5.0, 2.0)], walls), ([(0.5, 2.0), (5.0, 2.0)], [])):
            with_it, plain = (
                watch([person(route, 1.2, reaction=r)], 3.0, walls=hidden)[0]
                for r in (reaction, REGULAR)
            )
            np.testing.assert_allclose(with_it[:, 0, :2], plain[:, 0, :2], atol=0.02)


# --- bounds, walls, equality


@pytest.mark.parametrize("model", MODELS)
def test_bounds_hold_and_nobody_leaves_in_the_scene_of_all_people(model):
    """While the chair drives at random: speed and acceleration as the shield expects, and walls.

    Who is touched by others may be pushed a little faster.
    """
    shield = ShieldSettings()
    assert shield.person_speed >= FASTEST
    assert shield.person_acceleration >= LEGS
    scene, fast, steps = make_scene({"name": "people", "people": {"model": model}}), 0, 0
    for seed in range(3):
        episode = scene.sample(np.random.default_rng(seed))
        rows = episode.actors.rows
        who = np.flatnonzero(rows["kind"] == PERSON)
        assert rows["speed"][who].max() <= FASTEST
        chair, rng = placed(exact_chair(), episode, seed), np.random.default_rng(seed)
        states = chair.chairs.pointers.array("actor_states")
        before, free = None, None
        for k in range(250):
            if k % 20 == 0:
                twist = rng.uniform((0.0, -0.6), (0.6, 0.6))
            chair.drive(twist)
            now = states["twist"][: len(rows), :2][who].copy()
            touching = states["in_space"][: len(rows)][who].copy()
            size = np.hypot(*now.T)
            assert size.max() < FASTEST + 0.15
            fast, steps = fast + (size > FASTEST + 1e-6).sum(), steps + len(who)
            if before is not None:
                # Per control period; who touched nothing has only legs.
                gained = np.hypot(*(now - before).T)[~touching & free]
                assert gained.max(initial=0.0) < LEGS * 0.1 + 1e-6
            before, free = now, ~touching
            if k % 5 == 0:
                gaps = wall_gaps(states["pose"][who, :2], episode.walls)
                assert (gaps > rows["size"][who, 0] - 0.02).all()
    assert fast <= 0.01 * steps


# --- bad input


@pytest.mark.parametrize(
    ("field", "value"), [("leader", 1), ("leader", 7), ("model", 5), ("every", 0.0)]
)
def test_an_episode_refuses_wrong_rows(field, value):
    round_thing = combine([person([(0.0, 0.0)]), furniture((1.0, 0.0, 0.0), (0.2, 0.0), 5.0)])
    round_thing.rows["leader"][1] = 1  # a trolley has corners
    with pytest.raises(InputError, match="actor 1: leader is 1"):
        Episode(None, np.zeros(3), np.zeros(3), actors=round_thing)  # type: ignore[arg-type]
    actors = combine([person([(0.0, 0.0)], behaviour=PAUSES, stay=1.0, every=2.0)])
    rows = actors.rows.copy()
    rows[field] = value
    with pytest.raises(InputError, match=f"actor 0: {field} is {value}"):
        Episode(None, np.zeros(3), np.zeros(3), actors=Actors(rows, actors.routes))  # type: ignore[arg-type]
