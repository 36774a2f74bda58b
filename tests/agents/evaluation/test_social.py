"""Social measures, against values worked out by hand."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from agents.evaluation import compare, metrics
from agents.evaluation.assisted import PeopleTrace, time_to_collision
from agents.evaluation.evaluate import drive_episode, make_env
from agents.evaluation.metrics import EFFICIENCIES, SOCIAL_MEANS, Trace, measure, summarise
from agents.policies import make_policy
from tests.agents.evaluation.test_metrics import info
from tests.agents.evaluation.test_report import evaluation
from wheelchair_gym.actors.records import WALKS_BESIDE, combine, furniture, person
from wheelchair_gym.geometry.outline import Footprint
from wheelchair_gym.scenes.arena import make_arena
from wheelchair_gym.types import Episode, Truth

OUTLINE = Footprint(front=0.7, rear=0.3, half_width=0.31)
PERIOD = 0.5


def trace_of(tracks, poses, twists, walls=(), speed=1.0, points=2, companions=0):
    """The figures of a chair among people of 0.25 m radius who go along tracks (n, 2)."""
    arena = make_arena((-20.0, -20.0, 20.0, 20.0))
    route = [(0.0, 0.0), (9.0, 0.0)][:points]
    people = [person(route, speed, radius=0.25, at=track[0]) for track in tracks]
    for companion in people[:companions]:
        companion.row["behaviour"] = WALKS_BESIDE
    box = furniture((9.0, 9.0, 0.0), (0.4, 0.4), 5.0)  # is no person, though it comes first
    world = Episode(
        arena.map, np.zeros(3), np.array([5.0, 0.0, 0.0]),
        np.vstack([arena.walls, *np.reshape(walls, (-1, 4))]), arena.discs,
        actors=combine([box, *people]),
    )  # fmt: skip
    trace = PeopleTrace(world, OUTLINE)
    for places in np.stack(tracks, axis=1):
        at = np.vstack([(9.0, 9.0), places])
        trace.add(Truth._make([None] * (len(Truth._fields) - 1) + [np.c_[at, np.zeros(len(at))]]))
    return trace.figures(np.array(poses, float), np.array(twists, float), PERIOD)


def rest(n):
    return np.zeros((n, 3)), np.zeros((n, 2))


def line(start, velocity, n):
    return np.array(start) + PERIOD * np.arange(n)[:, None] * velocity


def test_somebody_who_walks_past_beside_the_chair():
    track = line((-6.0, 0.31 + 0.25 + 0.6), (1.0, 0.0), 25)  # x = -6, -5.5, ..., 6
    figures = trace_of([track], *rest(25))
    assert figures["person_distance_min"] == pytest.approx(0.6)
    # Less than 1.2 + 0.25 m from the outline, 0.85 m aside: less than 1.17 m beyond it along x,
    # -1.47 to 1.87 m.
    assert figures["personal_share"] == pytest.approx(6 / 25)
    assert figures["intimate_share"] == 0.0
    assert figures["ttc_min"] == math.inf


def test_a_person_beside_the_chair_is_left_out():
    passer, companion = line((-6.0, 1.16), (1.0, 0.0), 25), line((0.0, -0.85), (0.0, 0.0), 25)
    alone = trace_of([passer], *rest(25))
    assert trace_of([companion, passer], *rest(25), companions=1) == alone
    figures = trace_of([companion], *rest(25), companions=1)
    assert figures["person_distance_min"] == figures["ttc_min"] == math.inf
    assert figures["intimate_share"] == figures["people_delay"] == 0.0


def test_somebody_who_stands_in_the_way():
    """The chair drives at 0.5 m/s from x = 0 to 2 towards somebody at 4 m, then stands."""
    n = 9
    poses = np.zeros((n, 3))
    poses[:, 0] = 0.25 * np.arange(n)
    twists = np.tile((0.5, 0.0), (n, 1))
    figures = trace_of([line((4.0, 0.0), (0.0, 0.0), n)], poses, twists)
    gaps = 4.0 - 0.7 - 0.25 - poses[:, 0]  # 3.05 to 1.05 m
    assert figures["person_distance_min"] == pytest.approx(1.05)
    assert figures["ttc_min"] == pytest.approx(1.05 / 0.5)
    assert figures["personal_share"] == pytest.approx((gaps < 1.2).mean())


def test_somebody_who_nears_the_right_side_of_a_turned_chair():
    poses, twists = rest(5)
    poses[:, 2] = math.pi / 2
    figures = trace_of([line((3.0, 0.2), (-1.0, 0.0), 5)], poses, twists)
    assert figures["person_distance_min"] == pytest.approx(3.0 - 2.0 - 0.31 - 0.25)
    assert figures["ttc_min"] == pytest.approx(3.0 - 2.0 - 0.31 - 0.25)
    assert figures["intimate_share"] == pytest.approx(1 / 5)  # at 0.44 m, the last instant


@pytest.mark.parametrize(
    ("offset", "velocity", "time"),
    [
        ((3.0, 0.0), (-1.0, 0.0), 3.0 - 0.7 - 0.25),
        ((3.0, 0.0), (1.0, 0.0), math.inf),
        ((3.0, 0.0), (0.0, 0.0), math.inf),
        ((-3.0, 0.2), (0.5, 0.0), (3.0 - 0.3 - 0.25) / 0.5),
        ((0.1, -2.0), (0.0, 2.0), (2.0 - 0.31 - 0.25) / 2.0),
        # The corner is met sideways by 0.20 m: 0.15 m before it, as 0.15² + 0.20² = 0.25².
        ((3.7, 0.51), (-1.0, 0.0), 3.0 - 0.15),
        ((3.7, 0.57), (-1.0, 0.0), math.inf),  # passes at 0.26 m
        ((0.0, 0.0), (1.0, 1.0), 0.0),  # inside
        ((0.8, 0.4), (0.0, 0.0), 0.0),  # touches the corner
    ],
)
def test_times_to_collision(offset, velocity, time):
    found = time_to_collision(np.array([offset]), np.array([velocity]), 0.25, OUTLINE)
    assert found[0] == pytest.approx(time)


def test_times_to_collision_are_those_of_small_steps():
    rng = np.random.default_rng(0)
    offsets, velocities = rng.uniform(-4.0, 4.0, (2, 600, 2))
    found = time_to_collision(offsets, velocities, 0.25, OUTLINE)
    t = np.arange(0.0, 8.0, 0.005)
    at = offsets[:, None] + t[:, None] * velocities[:, None]
    beyond = np.maximum(0.0, np.abs(at - (0.2, 0.0)) - (0.5, 0.31))
    touches = np.hypot(*np.moveaxis(beyond, -1, 0)) <= 0.25
    first = np.where(touches.any(axis=1), t[touches.argmax(axis=1)], np.inf)
    assert np.isfinite(found).sum() > 50
    grazes = np.isfinite(found) != np.isfinite(first)  # for less than a step
    assert grazes.mean() < 0.02
    np.testing.assert_allclose(found[~grazes], first[~grazes], atol=0.0051)


def test_a_person_behind_a_wall_is_not_met():
    behind, far = line((2.0, 0.0), (0.0, 0.0), 3), line((-3.0, 0.0), (0.0, 0.0), 3)
    wall = (1.5, -1.0, 1.5, 1.0)
    figures = trace_of([behind, far], *rest(3), walls=[wall])
    assert figures["person_distance_min"] == pytest.approx(3.0 - 0.3 - 0.25)
    assert trace_of([behind], *rest(3), walls=[wall])["person_distance_min"] == math.inf
    assert trace_of([behind], *rest(3))["person_distance_min"] == pytest.approx(2.0 - 0.95)


def test_the_delay_of_people_is_their_lost_way_over_their_speed():
    free, half = line((5.0, 5.0), (1.0, 0.0), 21), line((5.0, 7.0), (0.0, 0.5), 21)
    assert trace_of([free], *rest(21))["people_delay"] == pytest.approx(0.0)
    # In 10 s somebody who would walk 10 m walks 5 m and loses 5 s: 30 s a minute.
    assert trace_of([half], *rest(21))["people_delay"] == pytest.approx(30.0)
    assert trace_of([free, half, half], *rest(21))["people_delay"] == pytest.approx(60.0)
    stands = line((5.0, 5.0), (0.0, 0.0), 21)  # and never meant to go anywhere
    assert trace_of([stands], *rest(21), points=1)["people_delay"] == 0.0


def test_figures_exist_only_among_people():
    social = {*SOCIAL_MEANS, *EFFICIENCIES}
    hall = {"name": "crowd", "place": "hall", "people": {"density": (0.0, 0.0)}}
    for density in (0.0, 0.1):
        hall["people"] = {"density": (density, density)}
        env = make_env(hall, {"config": {"task": {"time_base": 3.0, "time_factor": 0.0}}})
        record = drive_episode(env, make_policy("straight"), 2)
        env.close()
        assert social & set(record) == (social if density else set())
        if density:
            assert record["person_distance_min"] >= record["clearance_min"] - 1e-9
            assert record["people_delay"] >= 0.0


def test_efficiencies_are_those_of_successes():
    told = dict.fromkeys(SOCIAL_MEANS, 1.0) | {"ttc_min": math.inf}
    people = SimpleNamespace(figures=lambda *_: told)
    trace = Trace(0.5, shortest=metrics.Shortest(1.0, True), people=people)
    steps = [info(0.0), info(1.25, is_success=True, arrived=True)]
    for step in steps:
        trace.add(step)
    record = measure(trace, steps[-1], False)
    assert record["path_efficiency"] == pytest.approx(1.0 / 1.25)  # 1 m is the shortest
    assert record["time_efficiency"] == pytest.approx(1.0 / 0.8 / 2.5)
    assert record["ttc_min"] is None
    failed = measure(trace, info(1.25), True)
    assert failed["path_efficiency"] is None

    names = {"policy": "p", "scene": "a", "seed": 0}
    alone = measure(Trace(0.5, poses=trace.poses, twists=trace.twists, clearances=[0.3]),
                    steps[-1], False)  # fmt: skip
    rows = summarise([names | record, names | failed, names | alone | {"scene": "b"}])
    of = {row["scene"]: row for row in rows}
    assert of["a"]["path_efficiency"] == of["all"]["path_efficiency"] == pytest.approx(0.8)
    assert "path_efficiency" not in of["b"]
    assert of["all"]["ttc_min"] is None


def test_reports_have_columns_of_people_only_where_there_are_some(tmp_path):
    what = evaluation()
    assert "personal space" not in compare.markdown(what)
    assert "personal space" not in compare.write_report(what, tmp_path).read_text(encoding="utf-8")
    brief, everything = compare.terminal_table(what), compare.terminal_table(what, ["all"])
    for row in what["summary"]:
        if row["scene"] != "clutter":
            row |= dict.fromkeys((*SOCIAL_MEANS, *EFFICIENCIES), 0.25)
    assert "in personal space [% of time]" in compare.markdown(what)
    text = compare.write_report(what, tmp_path).read_text(encoding="utf-8")
    assert "contacts first: among people" in text
    assert "least time after which chair and a person" in text
    assert compare.terminal_table(what) == brief
    table = compare.terminal_table(what, ["personal_share"]).splitlines()
    assert table[1].split()[-1] == "25.0"
    assert [line.split()[-1] for line in table if "clutter" in line] == ["-", "-"]
    assert "personal space" in compare.terminal_table(what, ["all"])
    assert "personal space" not in everything
