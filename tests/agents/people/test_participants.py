"""Experiments with participants: orders, sessions that go on, answers, paired tests."""

import dataclasses
import errno
import itertools
import json
from collections import Counter
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from scipy import stats

from agents.cli import main
from agents.evaluation.statistics import effect_size
from agents.evaluation.tables import csv_table
from agents.people import folder
from agents.people.folder import read_chain
from agents.people.protocol import NASA_TLX, Condition, Group, Protocol, Questionnaire, Task
from agents.people.report import COLUMNS, tables, tidy, write_report
from agents.people.session import ABORTED, CUT_OFF, GIVEN_UP, Session, State, read_folder
from tests.conftest import output_of, refusal
from wheelchair_gym.base.settings import InputError


def protocol(conditions=2, tasks=2, **more):
    names = [f"help {k}" for k in range(conditions)]
    return Protocol(
        "title", "consent", tuple(map(Condition, names)),
        tuple(Task(f"task {k}", seed=k) for k in range(tasks)), **more,
    )  # fmt: skip


def figures(success=True, time=20.0):
    return {"success": success, "time": time, "length": 9.0, "clearance_min": float("inf"),
            "outcome": "success" if success else "timeout"}  # fmt: skip


def take_part(folder, plan, participant, figures_of):
    session = Session(folder, plan, participant)
    while step := session.next():
        if step.kind == "consent":
            session.consent()
        elif step.kind == "drive":
            session.drive(step, lambda _: figures_of(step))
        else:
            items = plan.items(step.questionnaire)
            session.answer(step, [item.values[participant % 3] for item in items])
    session.close()


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
    again = [[c.name for c in plan.conditions_of(len(people) + person)] for person in people]
    assert sorted(again) == sorted(orders)
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
        session.drive(next(s for s in plan.steps(3) if s.kind == "drive"), lambda _: figures())
    session.consent()
    drive = session.next()
    first = session.recording(drive)
    assert first == session.recording(drive)
    first.write_text("a try that was cut off")
    assert session.recording(drive) != first
    with pytest.raises(InputError, match="participant 3 is open in another tab or program"):
        Session(tmp_path, plan, 3)
    session.start(first.name)
    session.close()  # as where the program is killed in mid-drive
    again = Session(tmp_path, plan, 3)
    (cut,) = again.progress.attempts
    assert (cut["outcome"], cut["recording"], cut["counts"]) == (CUT_OFF, first.name, False)
    assert again.next() == drive not in (None, consent)
    again.drive(drive, lambda _: figures())
    assert [one["attempt"] for one in again.progress.attempts] == [1, 2]
    path = again.folder / "steps.jsonl"
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"is next$"):
        again.drive(drive, lambda _: figures())
    again.close()
    assert path.read_bytes() == before
    with open(path, "ab") as file:
        file.write(b'{"previous": "help 0/task 1", "rec')  # the machine went off in mid-line
    cut = Session(tmp_path, plan, 3)
    assert cut.next() == again.next()
    cut.drive(cut.next(), lambda _: figures())
    cut.close()
    kinds = [record["kind"] for record in read_chain(path)[0]]
    drove = ["opened", "started", "ended"]
    assert kinds == ["opened", "consent", "started", "opened", *drove[::-1][:1], *drove[1:],
                     "cut_line", *drove]  # fmt: skip


@pytest.mark.parametrize("change", [
    lambda lines: [lines[0], lines[1].replace(b"consent", b"content"), *lines[2:]],
    lambda lines: [lines[0], *lines[2:]],
    lambda lines: [lines[0], lines[2], lines[1], *lines[3:]],
    lambda lines: [*lines[:-1], lines[-1].replace(b"21.5", b"11.5")],
    lambda lines: [b"", *lines],
])  # fmt: skip
def test_a_line_that_was_edited_is_named_and_refused(tmp_path, capsys, change):
    plan = protocol(1, 1, nasa_tlx=False)
    take_part(tmp_path, plan, 7, lambda _: figures(time=21.5))
    assert "every checksum is right" in output_of(["participants", "check", tmp_path], capsys)
    path = tmp_path / "participant_0007" / "steps.jsonl"
    lines = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join(change(lines)) + b"\n")
    for words in (["participants", "check", tmp_path], ["report", tmp_path]):
        assert "steps.jsonl: line " in refusal(words, capsys)
    with pytest.raises(InputError, match=r"steps.jsonl: line \d is damaged or was edited"):
        Session(tmp_path, plan, 7)


def full_disk(*before):
    return patch("os.fsync", side_effect=[*before, *9 * [OSError(errno.ENOSPC, "full")]])


def test_a_full_disk_loses_nothing(tmp_path):
    """A record that cannot be written is refused, or written later; the chain stays whole."""
    plan = protocol(1, 1)
    session = Session(tmp_path, plan, 1)
    session.consent()
    session.start()
    with full_disk():
        with pytest.raises(InputError, match=r"steps.jsonl: cannot be written \(full\)"):
            session.end("success", figures(time=17.0))
        with pytest.raises(InputError, match="cannot be written"):
            session.mark("note", text="later")
    assert session.save()
    assert session.next().kind == "answers"
    with full_disk(), pytest.raises(InputError, match="cannot be written"):
        session.answer(session.next(), [50] * 6)
    session.answer(session.next(), [50] * 6)
    session.close()
    (one,) = read_folder(tmp_path)[1]
    assert (one.state, one.attempts[0]["figures"]["time"]) == (State.FINISHED, 17.0)
    session = Session(tmp_path / "rule", protocol(1, 1, max_contacts=1), 1)
    session.consent()
    session.start()
    with full_disk(None), pytest.raises(InputError, match="cannot be written"):
        session.end("collision", figures())  # the stop has no room
    assert session.save()
    assert session.progress.state == State.STOPPED


def test_a_drive_is_repeated_as_the_protocol_says(tmp_path):
    """Practice until an arrival, a task that was given up, and what is not the participant's."""
    rules = {"practice_until": "arrived", "practice_tries": 3, "tries": 2, "nasa_tlx": False}
    plan = protocol(1, 1, practice=(Task("hall"),), **rules)
    session = Session(tmp_path, plan, 1)
    session.consent()
    ended = [
        ("hall", "collision"), ("hall", CUT_OFF), ("hall", "timeout"), ("hall", GIVEN_UP),
        ("task 0", GIVEN_UP), ("task 0", ABORTED), ("task 0", GIVEN_UP),
    ]  # fmt: skip
    for task, outcome in ended:
        assert session.next().task == task
        if task == "task 0":
            session.start()  # and it fails at its first step: that is no try
        session.start()
        session.mark("paused")
        session.end(outcome, figures())
    assert session.next() is None
    kinds = [record["kind"] for record in read_chain(session.folder / "steps.jsonl")[0]]
    assert kinds.count("resumed") == len(ended) - 1  # a step ends a pause
    attempts = [one for one in session.progress.attempts if "time" in one["figures"]]
    assert [one["counts"] for one in attempts] == 3 * [False] + [True] + 2 * [False] + [True]
    assert len({one["world"] for one in attempts if one["practice"]}) == 4
    session.close()
    session = Session(tmp_path, plan, 2)
    session.consent()
    session.drive(session.next(), lambda _: figures())
    assert session.next().task == "task 0"
    session.close()


@pytest.mark.parametrize(("rule", "outcomes"), [
    ({"max_contacts": 2}, ["collision", "success", "collision"]),
    ({"max_minutes": 1.0}, ["success", CUT_OFF, "timeout"]),
])  # fmt: skip
def test_a_rule_stops_the_session(tmp_path, rule, outcomes):
    plan = protocol(2, 3, nasa_tlx=False, **rule)
    session = Session(tmp_path, plan, 1)
    session.consent()
    for outcome in outcomes:
        assert session.progress.state == State.UNDER_WAY
        session.start()
        session.end(outcome, figures(time=20.0))
    assert session.progress.state == State.STOPPED
    with pytest.raises(InputError, match="the session is over"):
        session.start()
    session.close()
    path = session.folder / "steps.jsonl"
    path.write_bytes(b"".join(path.read_bytes().splitlines(True)[:-1]))  # the power failed
    Session(tmp_path, plan, 1).close()
    (one,) = read_folder(tmp_path)[1]
    assert (one.state, one.next()) == (State.STOPPED, None)


@pytest.mark.parametrize(("conditions", "tasks"), [(2, 3), (3, 2)])
def test_worlds_and_tasks_are_balanced_and_no_world_is_met_twice(conditions, tasks):
    plan = protocol(conditions, 1, seed=5, practice=(Task("hall"),))
    plan = dataclasses.replace(plan, tasks=tuple(Task(f"task {k}") for k in range(tasks)))
    people = range(1, 145)  # whole blocks of 4, 16 and 18
    places, worlds, pairs = Counter(), Counter(), Counter()
    for person in people:
        drives = [step for step in plan.steps(person) if step.kind == "drive"]
        met = [plan.world(person, step, attempt) for step in drives for attempt in (1, 2)]
        assert len(set(met)) == len(met)
        for position in range(1, conditions + 1):
            mine = [s for s in drives if s.position == position and not s.practice]
            places.update((position, k, step.task) for k, step in enumerate(mine))
            worlds.update((position, s.task, plan.world(person, s, 1)) for s in mine)
            pairs.update((s.condition, s.task, plan.world(person, s, 1)) for s in mine)
    assert len(places) == conditions * tasks * tasks
    assert len(worlds) == len(pairs) == conditions * tasks * conditions
    assert {len(set(of.values())) for of in (places, worlds, pairs)} == {1}
    other = dataclasses.replace(plan, seed=6)
    assert any(list(plan.steps(p)) != list(other.steps(p)) for p in people)
    asked = dataclasses.replace(plan, tasks=(Task("same", seed=4),))
    step = next(step for step in asked.steps(1) if step.task == "same")
    assert {asked.world(person, step, 1) for person in people} == {4}


def test_groups_are_as_large_and_each_has_balanced_orders_of_its_conditions():
    groups = Group("a", ("help 0", "help 1")), Group("b", ("help 2", "help 3"))
    plan = protocol(4, 1, groups=groups)
    of = {p: (plan.group_of(p).name, tuple(c.name for c in plan.conditions_of(p)))
          for p in range(1, 9)}  # fmt: skip
    assert set(Counter(of.values()).values()) == {2}
    assert {names for group, names in of.values() if group == "a"} == {
        ("help 0", "help 1"), ("help 1", "help 0"),
    }  # fmt: skip


def test_a_corrected_text_is_an_amendment_and_another_design_is_refused(tmp_path):
    plan = protocol(2, 1, questionnaires=(Questionnaire("trust", ("I feel save.",)),))
    Session(tmp_path, plan, 1).close()
    assert [path.name for path in tmp_path.iterdir()] == ["protocol.json"]  # it was only typed
    better = dataclasses.replace(
        plan, consent="Yes.", questionnaires=(Questionnaire("trust", ("I feel safe.",)),)
    )
    for _ in range(2):
        Session(tmp_path, better, 1).close()
    (amendment,) = tmp_path.glob("amendment_*.json")
    content = json.loads(amendment.read_text())
    assert content["changed"] == ["consent", "questionnaires.0.statements.0"]
    assert content["at"].endswith("+00:00")
    assert read_folder(tmp_path)[0] == better
    for key, change in {
        "conditions": {"conditions": plan.conditions[:1]}, "seed": {"seed": 1},
        "tasks.0.seed": {"tasks": (Task("task 0", seed=9),)},
    }.items():  # fmt: skip
        with pytest.raises(InputError, match=f"another protocol: {key} differs"):
            Session(tmp_path, dataclasses.replace(better, **change), 1)
    for number in (0, -1, 10_000):
        with pytest.raises(InputError, match="expected a number from 1 to 9999"):
            Session(tmp_path, better, number)


def test_everything_of_a_participant_is_deleted_and_the_number_is_not_used_again(
    tmp_path, capsys, monkeypatch
):
    plan = protocol(2, 1)
    for person in (1, 2):
        take_part(tmp_path, plan, person, lambda _: figures())
    (tmp_path / "participant_0002" / "002_drive_1.mcap").write_bytes(b"recording")
    write_report(tmp_path)
    words = ["participants", "delete", tmp_path, 2]
    monkeypatch.setattr("builtins.input", lambda _: "")
    assert "nothing was deleted" in refusal(words, capsys)
    session = Session(tmp_path, plan, 2)
    assert "participant 2 is open" in refusal([*words, "--yes"], capsys)
    session.close()
    own = session.folder.rename(tmp_path / "elsewhere")
    session.folder.symlink_to(own)
    assert "participant_0002 is a link; expected the data" in refusal([*words, "--yes"], capsys)
    session.folder.unlink()
    own.rename(session.folder)
    unlink, left = Path.unlink, [None] * 6
    crash = patch.object(Path, "unlink", lambda path, **more: unlink(left.pop() or path, **more))
    with crash, pytest.raises(IndexError):
        main([*map(str, words), "--yes"])
    assert "deleted 1 file;" in output_of([*words, "--yes"], capsys)
    assert {path.name for path in tmp_path.iterdir()} == {
        "protocol.json", "dictionary.csv", "participant_0001", "deleted_0002.json",
    }  # fmt: skip
    stone = json.loads((tmp_path / "deleted_0002.json").read_text())
    assert (stone["participant"], stone["files"], stone["at"][:2]) == (2, 6, "20")
    with pytest.raises(InputError, match="participant 2 was deleted"):
        Session(tmp_path, plan, 2)
    assert "holds nothing of participant 2" in refusal([*words, "--yes"], capsys)
    assert output_of(["participants", "list", tmp_path], capsys).count("finished") == 1
    empty = tmp_path / "participant_0003" / "steps.jsonl"  # of a program that was killed
    empty.parent.mkdir()
    empty.touch()
    assert "holds nothing of participant 3" in refusal([*words[:-1], 3, "--yes"], capsys)
    look, write = folder.folder_of, folder.write_json

    def delete_then(*where):
        monkeypatch.setattr(folder, "folder_of", look)
        output_of([*words[:-1], 1, "--yes"], capsys)
        return tmp_path / "participant_0001"

    def open_then(*content):
        with pytest.raises(InputError, match="participant 1 is open in another"):
            Session(tmp_path, plan, 1)
        write(*content)

    monkeypatch.setattr(folder, "folder_of", delete_then)  # just before the session locks it
    monkeypatch.setattr(folder, "write_json", open_then)
    with pytest.raises(InputError, match="participant 1 was deleted"):
        Session(tmp_path, plan, 1)
    assert not (tmp_path / "participant_0001").exists()
    removed = patch("agents.people.folder._lock", lambda _: empty.unlink())  # by another program
    with removed, pytest.raises(InputError, match="participant 3 is open in another"):
        Session(tmp_path, plan, 3)


@pytest.mark.parametrize("last", [[], [51], [True], [105], ["50"], [None]])
def test_answers_off_the_scale_are_refused(tmp_path, last):
    plan = protocol(1, 1)
    session = Session(tmp_path, plan, 1)
    session.consent()
    session.drive(session.next(), lambda _: figures())
    with pytest.raises(InputError, match=r"expected (6|0 to 100 in steps of 5)"):
        session.answer(session.next(), [50] * 5 + last)
    assert session.next().kind == "answers"


def test_a_language_is_a_file_of_texts(tmp_path, monkeypatch):
    (tmp_path / "texts").mkdir()
    for name in ("en", "fr"):
        (tmp_path / "texts" / f"{name}.json").write_text("{}")
    monkeypatch.setattr("agents.studio.PAGE", tmp_path)
    assert protocol(language="fr").language == "fr"


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
    assert row[6].key == pytest.approx(expected.mean() / expected.std(ddof=1))
    assert row[7].key == pytest.approx(stats.wilcoxon(expected).pvalue)
    assert tests.note == ""
    (mean, _) = (r for group in means.groups for r in group if r[0].text.startswith("time"))
    assert mean[3].key == pytest.approx(times[:, 0].mean())


def test_groups_are_compared_by_the_tests_of_scipy():
    """Each participant's mean over conditions and tasks counts once."""
    groups = Group("a", ("help 0", "help 1")), Group("b", ("help 1",))
    plan, rng, rows = protocol(2, 2, groups=groups), np.random.default_rng(3), []
    of = {"a": [], "b": []}
    for person in range(1, 9):
        group = plan.group_of(person)
        times = rng.uniform(20.0, 30.0, (len(group.conditions), 2)) + 4.0 * (group.name == "b")
        of[group.name].append(times.mean())
        same = {"participant": person, "group": group.name, "source": "drive", "position": 1}
        for (c, task), time in np.ndenumerate(times):
            step = same | {"condition": group.conditions[c], "task": task}
            rows.append(step | {"measure": "time", "unit": "s", "value": time})
            rows.append(step | {"measure": "success", "unit": "%", "value": 100.0})
    *_, means, tests = tables(plan, rows)
    mean, other = (r for group in means.groups for r in group if r[0].text.startswith("time"))
    assert [mean[3].key, other[3].key] == pytest.approx([np.mean(of["a"]), np.mean(of["b"])])
    assert mean[4].key == pytest.approx(np.std(of["a"], ddof=1))
    (row,) = (r for group in tests.groups for r in group if r[0].text.startswith("time"))
    welch = stats.ttest_ind(of["b"], of["a"], equal_var=False).confidence_interval()
    p = stats.mannwhitneyu(of["a"], of["b"]).pvalue
    assert (row[1].text, tests.note) == ("b - a", "")
    assert [cell.key for cell in row[2:]] == pytest.approx([
        8, np.mean(of["b"]) - np.mean(of["a"]), *welch, p, p,
    ])  # fmt: skip
    few = tables(plan, [row for row in rows if row["participant"] < 7])[-1]
    assert "n = 3 and 3, Mann and Whitney's test of 1 pairs cannot give" in few.note  # 2 of 20
    alone = tables(dataclasses.replace(plan, groups=()), rows)
    assert not any("group" in table.caption for table in alone)


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
    assert [row[8].key for row in times] == pytest.approx([3 * p] * 3)
    assert "7 participants, 7 did every step" in page.read_text()
    rows = tidy(read_folder(tmp_path)[1])
    assert len(rows) == 7 * 3 * (3 + 7)
    assert (tmp_path / "data.csv").read_text() == csv_table(rows, COLUMNS)


def test_an_effect_size_has_the_interval_of_the_noncentral_t():
    values = np.random.default_rng(1).normal(1.0, 1.0, 12)
    found = effect_size(values)
    t = found["d"] * np.sqrt(12)
    for end, p in (("d_low", 0.975), ("d_high", 0.025)):
        assert stats.nct.cdf(t, 11, found[end] * np.sqrt(12)) == pytest.approx(p, abs=1e-4)
    assert all(np.isnan(of) for of in effect_size(np.ones(5)).values())


def test_effects_of_periods_and_orders_are_tested_and_too_few_people_are_told(tmp_path, capsys):
    """Each drive is 5 s quicker than that of the condition before; one order is 9 s slower."""
    plan = protocol(2, 1, nasa_tlx=False)
    shift = np.random.default_rng(2).uniform(0.0, 1.0, 8)

    def drive(step):
        first = plan.conditions_of(person)[0].name == "help 0"
        return figures(time=30.0 - 5.0 * step.position + 9.0 * first + shift[person - 1])

    for person in range(1, 9):
        take_part(tmp_path, plan, person, drive)
        if person == 4:
            said = output_of(["report", tmp_path], capsys)
            assert "n = 4, Wilcoxon's test of 1 pairs cannot give" in said
    found = tables(plan, tidy(read_folder(tmp_path)[1]))[2]
    (row,) = (r for group in found.groups for r in group if r[0].text.startswith("time"))
    _, people, first, last, period, orders, order = (cell.key for cell in row)
    assert (people, orders) == (8, 2)
    assert first - last == pytest.approx(5.0)
    assert period == pytest.approx(2**-7)
    assert order == pytest.approx(stats.kruskal([0, 1, 2, 3], [4, 5, 6, 7]).pvalue)
    assert (tmp_path / "report.html").read_text().count("<figure>") == 3


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
    Session(tmp_path, protocol(), 1).close()  # a number that was only typed leaves no records
    assert "has no participants yet" in refusal(["report", tmp_path], capsys)
    take_part(tmp_path, protocol(), 1, lambda _: figures())
    assert str(tmp_path / "report.html") in output_of(["report", tmp_path], capsys)
