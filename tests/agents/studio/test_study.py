"""An experiment in the browser, from consent to the data, by keys; and what is refused."""

from __future__ import annotations

import csv
import threading
from types import SimpleNamespace

import pytest

from agents.cli import main
from agents.people.folder import read_folder
from agents.people.progress import CUT_OFF, GIVEN_UP
from agents.people.protocol import Condition, Protocol, Questionnaire, Task
from agents.studio.experimenter import Desk
from agents.studio.study import PATIENCE, STUDY_FIELDS, StudySession
from tests.agents.studio.served import (
    axe,
    browsing,
    looked_at,
    messages,
    room_map,
    send,
    serving,
    until,
)

STEPS = [
    "consent", "help 0/hall", "help 0/room", "help 0/nasa_tlx", "help 0/trust",
    "help 1/hall", "help 1/room", "help 1/nasa_tlx", "help 1/trust",
]  # fmt: skip


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    """A studio with an experiment, and its page in a browser."""
    folder = tmp_path_factory.mktemp("study")
    scene = room_map(folder, goal=2.3)
    weak, half = {"forward": 0.6}, {"right": 0.0}
    conditions = (
        Condition("help 0", "slide"), Condition("help 1", "shield", hand=weak, perception=half)
    )  # fmt: skip
    task = Task("room", scene, text="Drive to the circle.")
    protocol = Protocol(
        "Rooms", "You may stop at any time.", conditions, (task,), (Task("hall", scene),),
        questionnaires=(Questionnaire("trust", ("I felt safe.", "It obeyed.")),),
        devices=("keyboard", "touch", "switch"), tries=2, order="listed",
    )  # fmt: skip
    with (
        serving(folder, protocol) as served,
        browsing() as browser,
        looked_at(browser, f"{served.url}#study") as page,
    ):
        until(page, "window.studio?.ready && studio.title")
        yield served, page


def drive(page):
    """Begin a drive and hold a key until it has ended."""
    page.evaluate("studio.now = studio.result = null")
    page.click("#go")
    until(page, "studio.running && studio.now?.waits")
    page.keyboard.down("ArrowUp")
    until(page, "!studio.running")
    page.keyboard.up("ArrowUp")
    return page.evaluate("studio.now.sight")


def test_a_participant_goes_from_consent_to_the_data(opened, capsys):
    served, page = opened
    page.fill("#number", "3")
    page.keyboard.press("Enter")
    until(page, "document.querySelector('#agreed')")
    axe(page)
    assert "You may stop at any time." in page.inner_text(".panel")
    assert page.is_disabled("#go")
    page.check("#agreed")
    page.click("#go")
    for condition in range(2):
        until(page, "document.querySelector('#go[data-t=begin_drive]')")
        assert "does not count" in page.inner_text(".panel")
        sight = drive(page)
        assert sight is None if condition == 0 else sight[1] == 0.0
        until(
            page, "document.querySelector('#go[data-t=begin_drive]') && studio.due.task == 'room'"
        )
        assert "Drive to the circle." in page.inner_text(".panel")
        if condition == 0:  # ended too early, and driven again
            page.click("#go")
            until(page, "studio.running && studio.now?.waits")
            page.keyboard.down("ArrowDown")
            until(page, "studio.now.twist[0] < -0.01")
            page.keyboard.up("ArrowDown")
            page.keyboard.press("Escape")
            until(page, "document.querySelector('#go[data-t=begin_drive]')")
            assert "You ended the drive before its goal." in page.inner_text(".banner.alarm")
            axe(page)
            drive(page)
        else:
            drive(page)
        for items in (6, 2):
            until(page, f"document.querySelectorAll('.panel fieldset').length == {items}")
            axe(page)
            page.click("#go")
            until(page, "!document.getElementById('error').hidden")
            for k in range(items):
                page.locator(f"input[name=q{k}]").nth(k).check()
            page.click("#go")
            until(page, f"document.querySelectorAll('.panel fieldset').length != {items}")
    until(page, "document.querySelector('[data-t=study_done]')")
    (one,) = (one for one in read_folder(served.studio.folder)[1] if one.participant == 3)
    assert list(one.done) == STEPS
    assert all(one.done[key]["figures"]["success"] for key in STEPS if key.endswith("m"))
    drives = one.done
    assert drives["help 1/room"]["figures"]["time"] > drives["help 0/room"]["figures"]["time"]
    assert drives["help 0/room"]["recording"] == "003_help_0_room_2.mcap"
    assert drives["help 0/room"]["device"] == "keyboard"
    assert drives["help 0/room"]["scan_period"] is None
    assert [attempt["outcome"] for attempt in one.attempts] == [
        "success", GIVEN_UP, "success", "success", "success",
    ]  # fmt: skip
    assert list(drives["help 0/nasa_tlx"]["answers"].values()) == [0, 5, 10, 15, 20, 25]
    assert list(drives["help 0/trust"]["answers"].values()) == [1, 2]
    assert main(["report", str(served.studio.folder)]) == 0
    capsys.readouterr()
    with (served.studio.folder / "data.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["device"] for row in rows if row["source"] == "drive"} == {"keyboard"}
    assert {(row["condition"], row["source"]) for row in rows} >= {
        (condition, source)
        for condition in ("help 0", "help 1")
        for source in ("drive", "nasa_tlx", "trust")
    }
    recordings = sorted((served.studio.folder / "participant_0003").glob("*.mcap"))
    assert len(recordings) == 5
    assert main(["replay", str(recordings[3])]) == 0
    assert "the same rewards" in capsys.readouterr().out


@pytest.mark.long
def test_the_device_is_chosen_before_a_drive_and_stays(opened):
    served, page = opened
    page.reload()
    until(page, "window.studio?.ready && studio.title")
    page.fill("#number", "5")
    page.keyboard.press("Enter")
    page.check("#agreed")
    page.click("#go")
    until(page, "document.querySelector('#go[data-t=begin_drive]')")
    assert page.eval_on_selector_all("#device option", "all => all.map(one => one.value)") == [
        "keyboard", "touch", "switch",
    ]  # fmt: skip
    page.select_option("#device", "switch")
    page.fill("#period", "0.5")
    axe(page)
    page.click("#go")
    until(page, "studio.running && studio.now?.waits")
    assert not page.is_visible("#device")
    assert not page.is_visible("#stick")
    page.keyboard.down("ArrowUp")  # no key drives
    until(page, "studio.now.lit === 'right'")
    until(page, "studio.now.lit === 'forward'")
    assert page.evaluate("studio.now.waits")
    page.keyboard.up("ArrowUp")
    page.keyboard.press("Space")
    until(page, "document.querySelector('#go[data-t=begin_drive]')")
    page.select_option("#device", "touch")
    assert not page.is_visible("#period")
    page.click("#go")
    until(page, "studio.running && studio.now?.waits")
    assert page.is_visible("#stick")
    page.keyboard.press("ArrowUp")
    assert page.evaluate("studio.now.waits")
    page.keyboard.press("Escape")  # before it has begun: another device may be chosen
    until(page, "document.querySelector('#go[data-t=begin_drive]')")
    assert page.is_visible("#device")
    (one,) = (one for one in read_folder(served.studio.folder)[1] if one.participant == 5)
    (record,) = one.attempts
    assert (record["device"], record["scan_period"]) == ("switch", 0.5)


@pytest.mark.parametrize("width", [390, 820])
def test_questions_are_not_cut_off(opened, width):
    _, page = opened
    page.set_viewport_size({"width": width, "height": 900})
    values = list(range(0, 101, 5))
    page.evaluate(
        "values => studio.questions({number: 1, count: 2, questionnaire: 'nasa_tlx',"
        " items: [['How?', 'very low', 'very high', values]]})", values,
    )  # fmt: skip
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.set_viewport_size({"width": 1280, "height": 900})


def joined(socket, number):
    """Go on with a session on another socket, once the server has noticed that the last is gone."""
    while True:
        send(socket, "participant", number=number, resume=True)
        found = messages(socket, "step", "done", "error")
        if found["type"] != "error":
            return found
        assert "open in another tab" in found["text"]


def test_steps_that_are_not_due_are_refused(opened):
    served, _ = opened
    with served.socket("study") as socket:
        assert messages(socket, "study")["title"] == "Rooms"
        socket_says = lambda: messages(socket, "error", "step", "done")  # noqa: E731
        send(socket, "consent", step=1)
        assert "expected a number first" in socket_says()["text"]
        send(socket, "participant", number=8, resume=False)
        assert socket_says()["kind"] == "consent"
        for kind, more in (("begin", {}), ("answer", {"values": [1], "step": 1})):
            send(socket, kind, **more)
            assert socket_says()["type"] == "error"
        send(socket, "participant", number=0, resume=False)
        assert "participant.number is 0" in socket_says()["text"]
    assert set(STUDY_FIELDS) >= {"participant", "consent", "begin", "answer"}


def test_a_page_that_is_closed_in_a_drive_leaves_the_step_open(opened):
    served, _ = opened
    with served.socket("study") as socket:
        send(socket, "participant", number=9, resume=False)
        messages(socket, "step")
        send(socket, "consent", step=1)
        messages(socket, "step")
        send(socket, "begin")
        assert "expected a device first" in messages(socket, "error")["text"]
        send(socket, "device", name="gamepad", scan_period=1.0)
        assert "expected keyboard, touch, switch" in messages(socket, "error")["text"]
        send(socket, "device", name="touch", scan_period=1.0)
        send(socket, "begin")
        messages(socket, "world")
        for _ in range(5):  # another device than that of the drive
            send(socket, "stick", forward=1.0, left=0.0, by="keyboard")
        for name in ("keyboard", "switch", "touch"):
            send(socket, "device", name=name, scan_period=1.0)
            assert "expected touch until this drive has ended" in messages(socket, "error")["text"]
        assert messages(socket, "picture")["waits"]
        for _ in range(20):
            send(socket, "stick", forward=1.0, left=0.0, by="touch")
            picture = messages(socket, "picture")
        assert picture["twist"][0] > 0.1
    with served.socket("study") as socket:
        assert joined(socket, 9)["task"] == "hall"
    (one,) = (one for one in read_folder(served.studio.folder)[1] if one.participant == 9)
    (attempt,) = one.attempts
    assert (attempt["outcome"], attempt["counts"]) == (CUT_OFF, False)
    assert attempt["figures"]["length"] > 0.0
    assert attempt["at"] < attempt["end"]


def test_the_environment_of_a_task_is_set_in_its_scene(tmp_path):
    """As in a suite of `wheelchair compare`; the rest is the same for all."""
    scene = {"name": "empty", "env": {"pose_source": "truth", "beams": 64}}
    plan, ordered = Protocol("Rooms", "Yes.", (Condition("help"),), (Task("room", scene),)), []

    class Asked(StudySession):
        def _begin_when_ready(self, order):
            ordered.append(order)

    box = SimpleNamespace(send=lambda *_, **__: None)
    session = Asked(Desk(tmp_path, plan), box, threading.Event())
    session.on_participant({"number": 1, "resume": False})
    session.on_consent({"step": 1})
    session.on_device({"name": "keyboard", "scan_period": 1.0})
    session.on_begin({})
    session.close()
    (order,) = ordered
    assert order.place.scene == {"name": "empty"}
    assert order.place.env == {"pose_source": "truth", "beams": 64, "config": PATIENCE}
