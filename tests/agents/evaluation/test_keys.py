"""Every key that is read of a record or a summary is written by a real evaluation."""

import pytest

from agents.evaluation.compare import COLUMNS, Suite, compare, markdown, write_report
from agents.evaluation.metrics import TIMING
from agents.evaluation.tuning import METRICS
from agents.learning.folder import RESULT_KEYS, _results

OPTIONAL = {"kinds", "authority"}  # older results have none; drives without a person have none


class Strict(dict):
    """A mapping in which a key that is missing is an error, also for `get`."""

    def get(self, key, default=None):
        return super().get(key, default) if key in OPTIONAL else self[key]


def strict(value):
    if isinstance(value, dict):
        return Strict({key: strict(item) for key, item in value.items()})
    return [strict(item) for item in value] if isinstance(value, list) else value


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("keys")
    suite = Suite("Keys", ("straight", "random"), ("empty", "temporary"), 1)
    return folder, compare(suite, folder, progress=False)


def test_columns_metrics_and_cards_read_what_is_written(evaluated):
    folder, evaluation = evaluated
    record, rows = set(evaluation["records"][0]), evaluation["summary"]
    assert {*METRICS, *TIMING} <= record
    for row in rows:
        for column in COLUMNS:
            ends = (
                ("", "_low", "_high") if column.interval and row[column.key] is not None else ("",)
            )
            assert {column.key + end for end in ends} <= set(row)
    assert set(RESULT_KEYS) <= set(next(row for row in rows if row["wide"] is not None))
    assert _results(folder / "results.json", {"straight": "0"}, "name")


def test_reports_are_written_of_nothing_but_keys_that_exist(evaluated, tmp_path):
    evaluation = strict(evaluated[1])
    assert not all(record["success"] for record in evaluation["records"])
    write_report(evaluation, tmp_path)
    assert markdown(evaluation)
