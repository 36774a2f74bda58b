import re

import numpy as np
import pytest

from planners.problem_files import read_problems
from tests.maps.test_importers import put
from wheelchair_gym.base.settings import InputError

GOOD = {"name": "a", "size": 5.0, "rects": [[1, 1, 2, 2]], "start": [0.5, 0.5], "goal": [4, 4]}


def test_a_file_reads_back(tmp_path):
    (problem, optimum), (_, none) = read_problems(
        put(tmp_path, "problems.json", [{**GOOD, "optimum": 5.1}, {**GOOD, "optimum": None}])
    )
    assert (problem.name, optimum, none) == ("a", 5.1, None)
    assert problem.space.bounds == (0, 0, 5, 5)
    assert problem.space.solid.area == 1.0
    np.testing.assert_array_equal(problem.goal, (4, 4))


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"name": 3}, "name"),
        ({"size": 0}, "size"),
        ({"size": "big"}, "size"),
        ({"size": True}, "size"),
        ({"rects": {}}, "rects"),
        ({"rects": [[1, 1, 2]]}, "rects[0]"),
        ({"rects": [[1, 1, 2, 2], [2, 2, 1, 1]]}, "rects[1]"),
        ({"rects": [[1, 1, float("nan"), 2]]}, "rects[0][2]"),
        ({"start": [1]}, "start"),
        ({"start": [float("nan"), 1]}, "start[0]"),
        ({"goal": "here"}, "goal"),
        ({"optimum": -1}, "optimum"),
        ({"gaol": [1, 1]}, "gaol"),
        *(({key: ...}, f"{key} is missing; a problem has") for key in sorted(GOOD)),
    ],
)
def test_errors_name_file_index_and_key(tmp_path, change, key):
    wrong = {key: value for key, value in {**GOOD, **change}.items() if value is not ...}
    with pytest.raises(InputError, match=re.escape(f"problems.json: problem [1].{key} ")):
        read_problems(put(tmp_path, "problems.json", [GOOD, wrong]))


@pytest.mark.parametrize("content", ["{", "{}", "[3]", "null"])
def test_other_files_are_refused(tmp_path, content):
    with pytest.raises(InputError, match=r"problems.json"):
        read_problems(put(tmp_path, "problems.json", content))
