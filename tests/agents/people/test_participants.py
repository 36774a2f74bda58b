"""Experiments with participants: orders, sessions that go on, answers, paired tests."""

import itertools
from collections import Counter

import numpy as np
import pytest
from scipy import stats

from agents.cli import main
from agents.evaluation.tables import csv_table
from agents.people.protocol import NASA_TLX, Condition, Protocol, Questionnaire, Task
from agents.people.report import tables, write_report
from agents.people.session import COLUMNS, Session, read_folder, tidy
from tests.conftest import ROOT, refusal
from wheelchair_gym.base.settings import InputError, dump, load, read

EXAMPLE = ROOT / "examples" / "participants.json"


def protocol(conditions=2, tasks=2, **more):
    names = [f"help {k}" for k in range(conditions)]
    return Protocol(
        "title", "consent", tuple(map(Condition, names)),
        tuple(Task(f"task {k}", seed=k) for k in range(tasks)), **more,
    )  # fmt: skip


def figures(success=True, time=20.0):
    return {"success": success, "time": time, "length": 9.0, "outcome": "success",
            "clearance_min": float("inf")}  # fmt: skip


def take_part(folder, plan, participant, figures_of):
    session = Session(folder, plan, participant)
    while step := session.next():
        if step.kind == "consent":
            session.consent()
        elif step.kind == "drive":
            session.drive(step, figures_of(step))
        else:
            items = plan.items(step.questionnaire)
            session.answer(step, [item.values[participant % 3] for item in items])


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_a_balanced_order_has_each_condition_at_each_place_and_after_each_other_as_often(n):
    plan = protocol(n)
    people = range(1, 1 + (n if n % 2 == 0 else 2 * n))
    orders = [[c.name for c in plan.conditions_of(person)] for person in people]
    places = Counter((k, name) for order in orders for k, name in enumerate(order))
    pairs = Counter(pair for order in orders for pair in itertools.pairwise(order))
    assert len(places) == n * n
    assert len(set(places.values())) == 1
    assert len(pairs) == n * (n - 1)
    assert len(set(pairs.values())) <= 1
    assert plan.conditions_of(1) == plan.conditions_of(1 + len(people))
    listed = protocol(n, order="listed")
    assert {listed.conditions_of(person) for person in people} == {listed.conditions}


def test_the_steps_are_consent_practice_tasks_and_questions_of_each_condition_then_the_end():
    last = Questionnaire("end", ("This was fun.",), after="experiment")
    trust = Questionnaire("trust", ("I felt safe.", "It obeyed."))
    plan = protocol(2, 1, practice=(Task("hall"),), questionnaires=(trust, last))
    keys = [step.key for step in plan.steps(1)]
    of_one = ["hall", "task 0", NASA_TLX, "trust"]
    assert keys == ["consent"] + [f"help {c}/{k}" for c in (0, 1) for k in of_one] + ["end"]
    assert [step.practice for step in plan.steps(1)].count(True) == 2
    assert [item.values[-1] for item in plan.items("trust")] == [7, 7]
    assert len(plan.items(NASA_TLX)) == 6


def test_a_session_goes_on_where_it_ended_and_nothing_is_written_twice(tmp_path):
    plan = protocol()
    session = Session(tmp_path, plan, 3)
    consent = session.next()
    with pytest.raises(InputError, match="consent is next"):
        session.drive(next(s for s in plan.steps(3) if s.kind == "drive"), figures())
    session.consent()
    drive = session.next()
    first = session.recording(drive)
    assert first == session.recording(drive)
    first.write_text("a try that was cut off")
    assert session.recording(drive) != first
    session.drive(drive, figures(), str(first))
    again = Session(tmp_path, plan, 3)
    assert again.next() == session.next() not in (None, consent, drive)
    before = (again.folder / "steps.jsonl").read_bytes()
    with pytest.raises(InputError, match=r"is next$"):
        again.drive(drive, figures())
    assert (again.folder / "steps.jsonl").read_bytes() == before
    with open(again.folder / "steps.jsonl", "ab") as file:
        file.write(b'{"key": "help 0/task 1", "rec')  # the machine went off in the middle of a line
    cut = Session(tmp_path, plan, 3)
    assert cut.next() == again.next()
    cut.drive(cut.next(), figures())
    assert Session(tmp_path, plan, 3).next() == cut.next()


def test_another_protocol_does_not_enter_the_folder(tmp_path):
    Session(tmp_path, protocol(), 1)
    with pytest.raises(InputError, match="holds data of another protocol"):
        Session(tmp_path, protocol(3), 1)
    for number in (0, -1, 10_000):
        with pytest.raises(InputError, match="expected a number from 1 to 9999"):
            Session(tmp_path, protocol(), number)


@pytest.mark.parametrize("last", [[], [51], [True], [105], ["50"], [None]])
def test_answers_off_the_scale_are_refused(tmp_path, last):
    plan = protocol(1, 1)
    session = Session(tmp_path, plan, 1)
    session.consent()
    session.drive(session.next(), figures())
    with pytest.raises(InputError, match=r"expected (6|0 to 100 in steps of 5)"):
        session.answer(session.next(), [50] * 5 + last)
    assert session.next().kind == "answers"


@pytest.mark.parametrize(("change", "expected"), [
    ({"conditions": []}, "at least one condition"),
    ({"tasks": [{"name": "a"}, {"name": "a"}]}, "is taken"),
    ({"tasks": [{"name": "../a"}]}, "expected no slash"),
    ({"consent": " "}, "expected text"),
    ({"devices": []}, "expected some of keyboard, gamepad, touch, switch"),
    ({"devices": ["mouse"]}, "mouse"),
    ({"scan_period": 0.1}, "expected 0 or >= 0.3"),
    ({"order": "random"}, "must be one of balanced, listed"),
    ({"conditions": [{"name": "a", "hand": {"tremors": 1.0}}]}, "tremor"),
    ({"conditions": [{"name": "a", "perception": {"reaction": 1.0}}]}, "reaction is the particip"),
    ({"conditions": [{"assist": "slide"}]}, r"conditions\[0\] lacks name"),
    ({"conditions": [{"name": "a", "assist": "slid"}]}, "did you mean slide"),
    ({"tasks": [{"name": "a", "scene": "flor_plan"}]}, "did you mean floor_plan"),
    ({"questionnaires": [{"name": "a", "statements": []}]}, "at least one statement"),
    ({"questionnaires": [{"name": NASA_TLX, "statements": ["a"]}]}, "is taken"),
    ({"questionnaires": [{"name": "home", "statements": ["a"]}]}, "is taken"),  # as a task
    ({"questionnaires": [{"name": "consent", "statements": ["a"]}]}, "is taken"),
])  # fmt: skip
def test_a_wrong_protocol_is_one_line_that_names_the_key(change, expected):
    with pytest.raises(InputError, match=expected):
        load(Protocol, dump(read(Protocol, EXAMPLE)) | change, "protocol.json")


def test_paired_tests_are_those_of_scipy_and_failed_drives_have_no_time(tmp_path):
    plan, rng = protocol(2, 2), np.random.default_rng(0)
    times = rng.uniform(20.0, 30.0, (9, 2, 2))
    times[:, 1] += 3.0

    def drive(step):
        c, t = int(step.condition[-1]), int(step.task[-1])
        failed = person == 4 and (c, t) == (1, 0)
        return figures(not failed, 999.0 if failed else times[person - 1, c, t])

    for person in range(1, 10):
        take_part(tmp_path, plan, person, drive)
    rows = tidy(read_folder(tmp_path)[1])
    means, tests, *_ = tables(plan, rows)
    off = times[:, 1] - times[:, 0]
    expected = off.mean(axis=1)
    expected[3] = off[3, 1]  # of the task that succeeded in both
    (row,) = (r for group in tests.groups for r in group if r[0].text.startswith("time"))
    assert row[2].key == 9
    assert row[3].key == pytest.approx(np.median(expected))
    assert row[4].key < row[3].key < row[5].key
    assert row[6].key == pytest.approx(stats.wilcoxon(expected).pvalue)
    (mean, _) = (r for group in means.groups for r in group if r[0].text.startswith("time"))
    assert mean[3].key == pytest.approx(times[:, 0].mean())


def test_three_conditions_are_adjusted_by_holm_and_all_rows_are_in_the_data(tmp_path):
    plan = protocol(3, 1)
    for person in range(1, 8):
        take_part(
            tmp_path, plan, person,
            lambda s: figures(time=20.0 + 2.0 * int(s.condition[-1]) + 0.01 * person),  # noqa: B023
        )  # fmt: skip
    made, page = write_report(tmp_path)
    times = [r for group in made[1].groups for r in group if r[0].text.startswith("time")]
    p = stats.wilcoxon(np.full(7, 2.0)).pvalue
    assert [row[7].key for row in times] == pytest.approx([3 * p] * 3)
    assert "7 participants, 7 did every step" in page.read_text()
    rows = tidy(read_folder(tmp_path)[1])
    assert len(rows) == 7 * 3 * (3 + 6)
    assert (tmp_path / "data.csv").read_text() == csv_table(rows, COLUMNS)


def test_answers_at_the_end_are_in_the_report(tmp_path):
    last = Questionnaire("end", ("This was fun.",), after="experiment")
    plan = protocol(2, 1, questionnaires=(last,))
    for person in (1, 2, 3):
        take_part(tmp_path, plan, person, lambda _: figures())
    (row,) = tables(plan, tidy(read_folder(tmp_path)[1]))[-1].groups[0]
    assert [cell.text for cell in row] == ["This was fun.", "all", "3", "2", "1"]


def test_practice_is_not_evaluated(tmp_path):
    plan = protocol(1, 1, practice=(Task("hall"),), nasa_tlx=False)
    take_part(tmp_path, plan, 1, lambda step: figures(time=500.0 if step.practice else 20.0))
    assert {row["task"] for row in tidy(read_folder(tmp_path)[1])} == {"task 0"}


def test_the_command_tells_what_is_missing_in_one_line(tmp_path, capsys):
    refusal(["report", tmp_path], capsys)
    Session(tmp_path, protocol(), 1)
    assert "has no participants yet" in refusal(["report", tmp_path], capsys)
    take_part(tmp_path, protocol(), 1, lambda _: figures())
    assert main(["report", str(tmp_path)]) == 0
    assert str(tmp_path / "report.html") in capsys.readouterr().out
