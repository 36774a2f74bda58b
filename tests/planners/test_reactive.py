"""Laws of planners that know no map: bugs, the potential field, the geometric method."""

import numpy as np
import pytest

from planners import Status
from tests.planners.test_planners import assert_valid, on, plan

U = [(4, 2, 8, 2.5), (4, 7.5, 8, 8), (7.5, 2, 8, 8)]  # open to the left


def test_bug1_walks_once_round_and_at_most_half_again():
    """Lumelsky and Stepanov 1987: at most the distance and 1.5 times round each thing met."""
    problem = on([(4, 3, 6, 8)], (1, 5), (9, 5))
    answer = plan("bug1", problem)
    assert_valid(answer, problem)
    assert answer.counters["hits"] == 1
    # 3 m to the wall, once round (14 m), the shorter way to (6, 5), 6 m, and 3 m on
    assert answer.length == pytest.approx(3 + 14 + 6 + 3, abs=1e-9)


@pytest.mark.parametrize(("turn", "round_it"), [("left", 3 + 2 + 3), ("right", 2 + 2 + 2)])
def test_bug2_turns_as_it_is_told_and_leaves_on_the_line(turn, round_it):
    problem = on([(4, 3, 6, 8)], (1, 5), (9, 5))
    answer = plan({"name": "bug2", "turn": turn}, problem)
    assert_valid(answer, problem)
    assert answer.length == pytest.approx(3 + round_it + 3, abs=1e-9)


@pytest.mark.parametrize("name", ["bug1", "bug2"])
def test_bugs_leave_a_dead_end(name):
    problem = on(U, (6, 5), (9, 5))
    assert_valid(plan(name, problem), problem)


def test_the_field_is_stuck_in_a_dead_end_and_says_where():
    answer = plan("potential_field", on(U, (6, 5), (9, 5)))
    assert answer.status == Status.STUCK
    assert "local minimum" in answer.note
    assert len(answer.tree) > 0  # how far it came
    assert answer.tree[-1, 2] < 7.5


@pytest.mark.parametrize("goal", [(9, 5), (9.99, 5), (10, 10)])
def test_the_field_reaches_a_goal_beside_a_wall_and_keeps_off_others(goal):
    problem = on([(4, 3, 5, 4.8)], (1, 5), goal)
    answer = plan("potential_field", problem)
    assert_valid(answer, problem)
    near = np.abs(answer.path[:, 0] - 4.5) < 0.5
    assert answer.path[near, 1].min() > 4.9


def test_the_geometric_method_takes_the_shorter_of_two_perpendiculars():
    """By hand: the line is y = 5; corners lie 2 m below it and 1 m above; above is nearer."""
    problem = on([(4, 3, 6, 6)], (1, 5), (9, 5))
    answer = plan("geometric", problem)
    np.testing.assert_array_equal(answer.path, [(1, 5), (4, 6), (6, 6), (9, 5)])


def test_the_geometric_method_goes_on_along_both_halves():
    problem = on([(2, 4, 3, 5.5), (5, 2, 6, 8.5), (7, 4.8, 8, 6)], (1, 5), (9, 5))
    answer = plan("geometric", problem)
    assert_valid(answer, problem)
    assert answer.counters["turns"] >= 3


def test_where_the_geometric_method_fails_the_limited_tree_answers():
    easy, hard = on([(4, 3, 6, 6)], (1, 5), (9, 5)), on(U, (6, 5), (9, 5))
    answer = plan("geometric_then_limited", easy)
    np.testing.assert_array_equal(answer.path, plan("geometric", easy).path)
    assert answer.counters["geometric"] == 1
    failed, tree = plan("geometric", hard), plan("rrt_star_limited", hard)
    answer = plan("geometric_then_limited", hard)
    assert failed.status == Status.EXHAUSTED
    assert failed.note
    assert answer.counters["geometric"] == 0
    assert_valid(answer, hard)
    np.testing.assert_array_equal(answer.path, tree.path)
    both = failed.counters["edges_tested"] + tree.counters["edges_tested"]
    assert answer.counters["edges_tested"] == both
