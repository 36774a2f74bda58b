import numpy as np

from planners.problem_files import read_problems
from tests.conftest import put

GOOD = {"name": "a", "size": 5.0, "rects": [[1, 1, 2, 2]], "start": [0.5, 0.5], "goal": [4, 4]}


def test_a_file_reads_back(tmp_path):
    (problem, optimum), (_, none) = read_problems(
        put(tmp_path / "problems.json", [{**GOOD, "optimum": 5.1}, {**GOOD, "optimum": None}])
    )
    assert (problem.name, optimum, none) == ("a", 5.1, None)
    assert problem.space.bounds == (0, 0, 5, 5)
    assert problem.space.solid.area == 1.0
    np.testing.assert_array_equal(problem.goal, (4, 4))
