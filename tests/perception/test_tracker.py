"""Laws of the tracker: who walks is found and kept, what stands is not, and no scan breaks it."""

import math

import numpy as np
import pytest

from tests.benchmarks.tracking import measure_log, two_legs, wandered
from tests.copies import same_fields
from tests.sim.worlds import box, cluttered
from wheelchair_gym.actors.records import NOBODY, door, person
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.compiled.kernel import borrowing_kernel
from wheelchair_gym.geometry.kinematics import arc_step
from wheelchair_gym.geometry.planar import to_world
from wheelchair_gym.maps import FREE, OCCUPIED, OccupancyGrid
from wheelchair_gym.perception import track_state
from wheelchair_gym.perception.tracker import Tracker, point_to_trackers, update, update_tracker
from wheelchair_gym.sensors.laser import WORKSPACE_ROWS, LaserArrays, sense_laser
from wheelchair_gym.sensors.settings import LaserSettings, SensorSettings
from wheelchair_gym.sim.chair import SimulatedChair

LASER, STILL = LaserSettings(), np.zeros(2)
ARRAYS = LaserArrays.of(LASER, True)
WALLS = box(6.0).walls
POSE = np.array([-4.0, 0.0, 0.0])


def scan(discs, step, walls=WALLS, pose=POSE, arrays=ARRAYS):
    out = np.empty(len(arrays.cosine), np.float32)
    workspace = np.empty((WORKSPACE_ROWS, len(walls) + 8), np.float32)
    discs = np.reshape(np.asarray(discs, np.float64), (-1, 3))
    sense_laser(arrays, pose, walls, discs, np.uint64(7), step, workspace, out)
    return out


def follow(discs_at, seconds, period=0.1, tracker=None, **seen):
    """Tracks of each reading of a chair that stands; discs_at: time -> discs."""
    tracker = tracker or Tracker()
    return [
        tracker.update(scan(discs_at(k * period), k, **seen), POSE, STILL, k * period)
        for k in range(round(seconds / period))
    ]


def crossing(t, speed=1.2):
    """Someone who walks across 4 m ahead."""
    return [(0.0, -3.0 + speed * t, 0.25)]


def drive(episode, seconds, twist, sensors=None):
    """Drive a chair in a world; yields tracks, the truth and whose poses these are."""
    sensors = sensors or SensorSettings(pose_source="odometry")
    chair, tracker = SimulatedChair(sensors=sensors), Tracker()
    reading = chair.reset(episode, 5)
    for _ in range(round(seconds / 0.1)):
        tracks = tracker.update(reading.laser, reading.pose, reading.twist, reading.stamp)
        yield tracks, reading, chair.truth
        reading = chair.drive(np.asarray(twist, float))


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.6])
def test_a_walker_is_confirmed_soon_as_a_person_with_their_speed(speed):
    history = follow(lambda t: crossing(t, speed), 3.5)
    first = next(k for k, tracks in enumerate(history) if tracks.confirmed.any())
    assert 0.1 * first <= 0.35 + 0.3 / speed
    for k in range(first + 5, len(history)):
        (i,) = np.flatnonzero(history[k].confirmed)
        x, y, _ = crossing(0.1 * k, speed)[0]
        assert math.dist(history[k].place[i], (x, y)) < 0.08
        assert np.hypot(*(history[k].velocity[i] - (0.0, speed))) < 0.25
        assert history[k].kind[i] == track_state.PERSON
        assert history[k].radius[i] == pytest.approx(0.25, abs=0.05)
    assert history[-1].id[history[-1].confirmed] == history[first].id[history[first].confirmed]
    assert history[-1].travelled[history[-1].confirmed] > 0.9 * speed * 3.0


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_confirmed_where_nothing_moves(seed):
    sensors = SensorSettings(pose_source="odometry")
    tracker, way = Tracker(), 0.0
    for _, reading in wandered(cluttered(seed), seed, 200, sensors):
        tracks = tracker.update(reading.laser, reading.pose, reading.twist, reading.stamp)
        assert not tracks.confirmed.any()
        way += 0.1 * float(np.abs(reading.twist).max())
    assert way > 2.0


@pytest.mark.parametrize("seed", range(3))
def test_twists_that_come_late_are_corrected_by_what_stands(seed):
    """Else everything static would move while the chair changes its speed."""
    sensors = SensorSettings(pose_source="truth")
    tracker, before, off, plain, pose = Tracker(), np.zeros(2), [], [], np.zeros(3)
    for k, (_, reading) in enumerate(wandered(cluttered(seed), seed, 200, sensors)):
        tracks = tracker.update(reading.laser, reading.pose, before, reading.stamp)
        assert not tracks.confirmed.any()
        pose = np.array(arc_step(*pose, *before, 0.1)) if k else pose
        off.append(np.hypot(*(tracker.state["pose"][0] - reading.pose)[:2]))
        plain.append(np.hypot(*(pose - reading.pose)[:2]))
        before = reading.twist
    assert max(off) < 0.06
    assert max(plain) > 2.0 * max(off)


def test_a_person_alone_in_the_open_does_not_shift_the_chair():
    tracker, nowhere = Tracker(), np.empty((0, 4))
    for k in range(30):
        pose = POSE + np.array([0.05 * k, 0.0, 0.0])
        seen = scan(crossing(0.1 * k), k, walls=nowhere, pose=pose)
        tracks = tracker.update(seen, pose, np.array([0.5, 0.0]), 0.1 * k)
    assert tracker.state["pose"][0] == pytest.approx([1.45, 0.0, 0.0], abs=1e-9)
    assert np.hypot(*(tracks.velocity[tracks.confirmed][0] - (0.0, 1.2))) < 0.15


def test_a_log_of_a_real_robot_confirms_little(shared, monkeypatch):
    """Nobody is known to walk in it; its scans come some 0.15 s after its encoders."""
    monkeypatch.setattr("tests.benchmarks.tracking.SHARED", shared)
    assert measure_log()["confirmed"] <= 14


@pytest.mark.parametrize("twist", [(0.5, 0.0), (0.0, 0.6), (0.4, -0.4)])
def test_a_chair_that_moves_knows_their_speed_over_ground(twist):
    walker = person([(0.5, -3.5), (0.5, 4.5)], 1.0, avoids=NOBODY)
    episode = box(6.0, (-4.0, 0.0, -0.4), actors=[walker])
    errors, before = [], None
    for tracks, reading, truth in drive(episode, 4.0, twist):
        at = truth.actor_poses[0, :2]
        i = np.flatnonzero(tracks.confirmed)
        if len(i) and reading.stamp > 2.0:
            turn = truth.pose[2] - reading.pose[2]
            velocity = to_world(tracks.velocity[i[0]], (0.0, 0.0, turn))
            errors.append(np.hypot(*(velocity - (at - before) / 0.1)))
        assert len(i) <= 1
        before = at
    assert len(errors) > 15
    assert np.sqrt(np.mean(np.square(errors))) < 0.2


@pytest.mark.parametrize("travel", [1.5, -1.5])
def test_a_leaf_that_swings_is_a_door(travel):
    leaf = door((1.0, 0.45), -0.5 * math.pi, 0.9, travel, since=2.0, stay=2.0)
    walls = [(1.0, -5.0, 1.0, -0.46), (1.0, 0.46, 1.0, 5.0)]
    episode = box(5.0, (-3.0, 0.0, 0.0), walls, actors=[leaf])
    kinds = [
        int(kind)
        for tracks, reading, _ in drive(episode, 4.4, STILL)
        for kind in tracks.kind[tracks.confirmed & (tracks.place[:, 0] < 3.0)]
    ]
    assert kinds
    assert track_state.PERSON not in kinds
    assert kinds[-1] == track_state.DOOR


def test_a_person_behind_a_pillar_keeps_their_track_and_is_predicted():
    pillar = (-1.5, 0.0, 0.2)
    history = follow(lambda t: [*crossing(t), pillar], 4.5)
    ids = {int(number) for tracks in history for number in tracks.id[tracks.confirmed]}
    assert len(ids) == 1
    assert any(tracks.hidden[tracks.confirmed].any() for tracks in history)
    (i,) = np.flatnonzero(history[-1].confirmed)
    assert math.dist(history[-1].place[i], crossing(4.4)[0][:2]) < 0.1


def test_two_who_pass_each_other_keep_their_names():
    def discs(t):
        return [(0.0, -3.0 + 1.2 * t, 0.25), (0.9, 3.0 - 1.2 * t, 0.25)]

    history = follow(discs, 5.0)
    early, late = history[12], history[-1]

    def names(tracks, t):
        gaps = np.hypot(*(tracks.place[None] - np.array(discs(t))[:, None, :2]).transpose(2, 0, 1))
        return tracks.id[gaps.argmin(axis=1)].tolist()

    assert early.confirmed.sum() == late.confirmed.sum() == 2
    assert names(early, 1.2) == names(late, 4.9)


def test_a_track_is_dropped_once_its_place_is_seen_to_be_empty():
    history = follow(lambda t: crossing(t) if t < 2.0 else [], 3.0)
    assert history[19].confirmed.any()
    assert not history[24].confirmed.any()


def test_a_person_who_stands_still_after_a_walk_is_kept():
    history = follow(lambda t: crossing(min(t, 2.0)), 20.0)
    (i,) = np.flatnonzero(history[-1].confirmed)
    assert history[-1].unseen[i] < 0.5
    assert history[-1].still[i] > 15.0
    assert np.hypot(*history[-1].velocity[i]) < 0.1


def test_two_legs_are_one_person():
    history = follow(lambda t: two_legs(-2.5 + 1.2 * t, np.array([0.0, 1.0])), 4.0)
    late = [tracks for k, tracks in enumerate(history) if k >= 10]
    assert {int(number) for t in late for number in t.id[t.confirmed]} == set(
        late[-1].id[late[-1].confirmed].tolist()
    )
    speeds = np.array([t.velocity[t.confirmed][0] for t in late])
    assert np.abs(speeds.mean(axis=0) - (0.0, 1.2)).max() < 0.15


def test_what_a_map_shows_is_not_tracked():
    cells = np.full((240, 240), FREE, np.int8)
    cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = OCCUPIED
    pillars = [(1.0, 1.0, 0.15), (2.0, -2.0, 0.15), (-1.0, 3.0, 0.15)]
    grid = OccupancyGrid(cells, 0.05, (-6.0, -6.0, 0.0))
    rows, cols = np.indices(cells.shape)
    x, y = 0.05 * (cols + 0.5) - 6.0, 0.05 * (rows + 0.5) - 6.0
    for px, py, radius in pillars:
        cells[np.hypot(x - px, y - py) < radius] = OCCUPIED
    counts = []
    for known in (None, grid):
        tracker = Tracker()
        for k in range(15):
            discs = [*crossing(0.1 * k), *pillars]
            tracks = tracker.update(scan(discs, k), POSE, STILL, 0.1 * k, known)
            counts += [len(tracks)] if k == 0 else []
        assert tracks.confirmed.sum() == 1
    assert counts[0] >= 4
    assert counts[1] == 1


@pytest.mark.parametrize("beams", [2, 16, 64, 1081, 3000])
def test_no_scan_and_no_pose_breaks_it(beams):
    laser = LaserSettings(beams=beams)
    tracker, rng = Tracker(laser=laser), np.random.default_rng(beams)
    values = np.array([np.nan, np.inf, -np.inf, 0.0, -1.0, 0.05, 1.0, 1.2, 5.0, 1e30], np.float32)
    poses = np.array([np.nan, np.inf, 1e300, 0.0, 1.0])
    for k in range(60):
        pose, twist = rng.choice(poses, 3), rng.choice(poses, 2)
        tracks = tracker.update(rng.choice(values, beams), pose, twist, 0.1 * k)
        assert len(tracks) <= track_state.TRACKS
        assert np.isfinite(tracker.state["pose"]).all()
    arrays = LaserArrays.of(laser, False)
    for k in range(40):
        discs = [(0.0, -2.0 + 0.08 * k, 0.25)]
        seen = scan(discs, k, arrays=arrays)
        seen[::7] = np.nan if k % 2 else np.inf
        tracks = tracker.update(seen, POSE, STILL, 10.0 + 0.1 * k)
        for name in ("place", "velocity", "covariance", "radius", "travelled"):
            assert np.isfinite(getattr(tracks, name)).all()
    if beams >= 64:
        (i,) = np.flatnonzero(tracks.confirmed)
        assert math.dist(tracks.place[i], discs[0][:2]) < 0.3


def test_more_things_than_fit_displace_none_that_is_confirmed():
    rng = np.random.default_rng(0)

    def posts(t):
        around = rng.uniform(-6.0, 6.0, (300, 2))
        around = around[np.hypot(around[:, 0], around[:, 1] + 3.0 - 1.2 * t) > 0.6]
        around = around[np.hypot(*(around - POSE[:2]).T) > 5.5]
        return np.vstack([crossing(t), np.column_stack([around, np.full(len(around), 0.05)])])

    history = follow(posts, 2.0)
    assert max(map(len, history)) == track_state.TRACKS
    at = crossing(1.9)[0][:2]
    mine = np.hypot(*(history[-1].place - at).T) < 0.2
    assert history[-1].confirmed[mine].any()


def test_an_earlier_stamp_begins_anew_and_the_same_changes_nothing():
    tracker = Tracker()
    history = follow(crossing, 2.0, tracker=tracker)
    again = tracker.update(scan([], 0), POSE, STILL, 0.1 * 19)
    assert again.id.tolist() == history[-1].id.tolist()
    assert not tracker.update(scan(crossing(0.0), 0), POSE, STILL, 0.0).confirmed.any()


def test_misuse_is_named():
    with pytest.raises(InputError, match="laser"):
        Tracker(laser=LaserSettings(beams=0))
    with pytest.raises(ValueError, match=r"scan has shape \(5,\); expected \(1081,\)"):
        Tracker().update(np.zeros(5, np.float32), POSE, STILL, 0.0)


@borrowing_kernel
def _update_nested(constants, row, static_map, pose, twist, laser, stamp):
    update(constants[0], row[0].tracker, static_map[0], pose, twist, laser, stamp)


@pytest.mark.parametrize("beams", [64, 1081])
def test_a_row_of_a_batch_and_one_inside_another_record_equal_a_single_tracker(beams):
    laser = LaserSettings(beams=beams)
    arrays = LaserArrays.of(laser, True)
    constants, states = track_state.TrackerConstants(laser), np.zeros(3, track_state.TRACKER)
    batch = point_to_trackers(constants, states, [None] * 3)
    singles = [Tracker(laser=laser) for _ in range(3)]
    for single in singles:
        single.state[:] = 0
    nested = np.zeros(
        1,
        np.dtype([("before", "f8"), ("tracker", track_state.TRACKER), ("after", "f8")], align=True),
    )
    nowhere = np.zeros(1, track_state.STATIC_MAP)
    assert constants.record.dtype == track_state.CONSTANTS
    for k in range(25):
        for i, single in enumerate(singles):
            seen = scan([(0.5 * i, -2.0 + 0.1 * k, 0.25)], k + 100 * i, arrays=arrays)
            pose, twist = POSE + 0.01 * k, np.array([0.1, 0.05 * i])
            single.update(seen, pose, twist, 0.1 * k)
            update_tracker(i, batch.record, pose, twist, seen, 0.1 * k)
            if i == 1:
                _update_nested(constants.record, nested, nowhere, pose, twist, seen, 0.1 * k)
    for i, single in enumerate(singles):
        assert same_fields(single.state[0], states[i])
        assert single.state["n_tracks"][0] > 0
    assert same_fields(nested["tracker"][0], states[1])
    assert nested["before"][0] == nested["after"][0] == 0.0
