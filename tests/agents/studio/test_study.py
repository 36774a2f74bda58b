"""An experiment in the browser, from consent to the data, by keys; and what is refused."""

import csv
import dataclasses
import json
import re
import threading
from contextlib import closing, contextmanager
from types import SimpleNamespace
from urllib.parse import urlencode

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus

from agents.cli import main
from agents.evaluation.evaluate import without_labels
from agents.evaluation.provenance import write_json
from agents.people.folder import delete, read_chain
from agents.people.protocol import Condition, Protocol, Questionnaire, Task
from agents.people.session import ABORTED, CUT_OFF, GIVEN_UP, Session, State, read_folder
from agents.studio.experimenter import Desk
from agents.studio.messages import read_message
from agents.studio.study import PATIENCE, StudySession
from tests.agents.people.test_participants import figures, full_disk, protocol
from tests.agents.studio import served as pages
from tests.agents.studio.test_server import get
from tests.conftest import long_but, output_of, refusal
from tests.conftest import until as wait_until
from tests.hardware.served import Program
from wheelchair_gym.base.settings import dump
from wheelchair_gym.envs import NavigationEnv
from wheelchair_gym.people.drivers import make_driver
from wheelchair_gym.people.drivers.step import Drivers

STEPS = [
    "consent", "help 0/hall", "help 0/room", "help 0/nasa_tlx", "help 0/trust",
    "help 1/hall", "help 1/room", "help 1/nasa_tlx", "help 1/trust",
]  # fmt: skip


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    scene = pages.room_map(folder, goal=2.3)
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
        pages.serving(folder, protocol, locked=True) as served,
        pages.browsing() as browser,
        pages.looked_at(browser, f"{served.url}#study") as page,
    ):
        pages.until(page, "window.studio?.ready && studio.protocol")
        yield served, page


def press(page, wanted, *keys):
    """Press Tab until an element that a selector names has the focus, and then keys."""
    for _ in range(60):
        if page.evaluate("wanted => document.activeElement.matches(wanted)", wanted):
            break
        page.keyboard.press("Tab")
    else:
        pytest.fail(f"{wanted} is not reached by Tab")
    for key in keys:
        page.keyboard.press(key)


def begin(page):
    press(page, "#go", "Enter")
    pages.until(page, "studio.running && studio.now?.waits")


def enter(page, number):
    page.evaluate("sessionStorage.clear()")
    page.reload()
    pages.until(page, "window.studio?.ready && studio.protocol")
    page.fill("#number", f"{number}")
    page.keyboard.press("Enter")


def drive(page):
    page.evaluate("studio.now = studio.result = null")
    begin(page)
    page.keyboard.down("ArrowUp")
    pages.until(page, "!studio.running")
    page.keyboard.up("ArrowUp")
    return page.evaluate("studio.now.sight")


def test_a_participant_goes_from_consent_to_the_data_by_keys_alone(opened, capsys):
    served, page = opened
    press(page, "#number", "3", "Enter")
    pages.until(page, "document.querySelector('#agreed')")
    pages.axe(page)
    assert "You may stop at any time." in page.inner_text(".panel")
    assert page.is_disabled("#go")
    press(page, "#agreed", "Space")
    press(page, "#go", "Space")
    for condition in range(2):
        pages.until(page, "document.querySelector('#go[data-t=begin_drive]')")
        assert "does not count" in page.inner_text(".panel")
        sight = drive(page)
        assert sight is None if condition == 0 else sight[1] == 0.0
        pages.until(
            page, "document.querySelector('#go[data-t=begin_drive]') && studio.due.task == 'room'"
        )
        assert "Drive to the circle." in page.inner_text(".panel")
        if condition == 0:  # ended too early, and driven again
            begin(page)
            for width, height in pages.SCREENS:
                page.set_viewport_size({"width": width, "height": height})
                page.evaluate("studio.on.stick.hidden = false; studio.begin(studio.world)")
                assert pages.cut_off(page) == [], (width, height)
            page.set_viewport_size({"width": 1280, "height": 900})
            page.keyboard.down("ArrowDown")
            pages.until(page, "studio.now?.twist[0] < -0.01")
            page.keyboard.up("ArrowDown")
            page.keyboard.press("Escape")
            pages.until(page, "document.querySelector('#go[data-t=begin_drive]')")
            assert "You ended the drive before its goal." in page.inner_text(".banner.alarm")
            pages.axe(page)
        drive(page)
        for items in (6, 2):
            pages.until(page, f"document.querySelectorAll('.panel fieldset').length == {items}")
            pages.axe(page)
            press(page, "#go", "Enter")
            pages.until(page, "!document.getElementById('error').hidden")
            for k in range(items):
                press(page, f"input[name=q{k}]", *(["ArrowRight"] * k or ["Space"]))
            press(page, "#go", "Enter")
            pages.until(page, f"document.querySelectorAll('.panel fieldset').length != {items}")
    pages.until(page, "document.querySelector('[data-t=study_done]')")
    one = of(served, 3)
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
    assert "the same rewards" in output_of(["replay", recordings[3]], capsys)


@pytest.mark.long
def test_the_device_is_chosen_before_a_drive_and_stays(opened):
    served, page = opened
    enter(page, 5)
    page.check("#agreed")
    page.click("#go")
    pages.until(page, "document.querySelector('#go[data-t=begin_drive]')")
    assert page.eval_on_selector_all("#device option", "all => all.map(one => one.value)") == [
        "keyboard", "touch", "switch",
    ]  # fmt: skip
    page.select_option("#device", "switch")
    page.fill("#period", "0.5")
    pages.axe(page)
    begin(page)
    assert not page.is_visible("#device")
    assert not page.is_visible("#stick")
    page.keyboard.down("ArrowUp")  # no key drives
    pages.until(page, "studio.now.lit === 'right'")
    pages.until(page, "studio.now.lit === 'forward'")
    assert page.evaluate("studio.now.waits")
    page.keyboard.up("ArrowUp")
    page.keyboard.press("Space")
    pages.until(page, "document.querySelector('#go[data-t=begin_drive]')")
    page.select_option("#device", "touch")
    assert not page.is_visible("#period")
    begin(page)
    assert page.is_visible("#stick")
    page.keyboard.press("ArrowUp")
    assert page.evaluate("studio.now.waits")
    page.keyboard.press("Escape")  # before it has begun: another device may be chosen
    pages.until(page, "document.querySelector('#go[data-t=begin_drive]')")
    assert page.is_visible("#device")
    (record,) = of(served, 5).attempts
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


def of(served, number):
    (found,) = (one for one in read_folder(served.studio.folder)[1] if one.participant == number)
    return found


@contextmanager
def agreed(served, number):
    """A page's socket, on which a participant has agreed, and the step that is due."""
    with served.socket("study") as socket:
        assert pages.messages(socket, "study")["blind"]
        pages.send(socket, "participant", number=number, resume=False)
        pages.messages(socket, "step")
        pages.send(socket, "consent", step=1)
        yield socket, pages.messages(socket, "step")


def joined(socket, number):
    """Go on with a session on another socket, once the server has noticed that the last is gone."""
    while True:
        pages.send(socket, "participant", number=number, resume=True)
        found = pages.messages(socket, "step", "done", "error")
        if found["type"] != "error":
            return found
        assert "open in another tab" in found["text"]


def test_steps_that_are_not_due_are_refused(opened):
    served, _ = opened
    with served.socket("study") as socket:
        assert pages.messages(socket, "study")["title"] == "Rooms"
        socket_says = lambda: pages.messages(socket, "error", "step", "done")  # noqa: E731
        pages.send(socket, "consent", step=1)
        assert "expected a number first" in socket_says()["text"]
        pages.send(socket, "participant", number=8, resume=False)
        assert socket_says()["kind"] == "consent"
        for kind, more in (("begin", {}), ("answer", {"values": [1], "step": 1})):
            pages.send(socket, kind, **more)
            assert socket_says()["type"] == "error"
        pages.send(socket, "participant", number=0, resume=False)
        assert "participant.number is 0" in socket_says()["text"]
    assert set(StudySession.fields) >= {"participant", "consent", "begin", "answer"}


def test_a_page_that_is_closed_in_a_drive_leaves_the_step_open(opened):
    served, _ = opened
    with agreed(served, 9) as (socket, _):
        pages.send(socket, "begin")
        assert "expected a device first" in pages.messages(socket, "error")["text"]
        pages.send(socket, "device", name="gamepad", scan_period=1.0)
        assert "expected keyboard, touch, switch" in pages.messages(socket, "error")["text"]
        pages.send(socket, "device", name="touch", scan_period=1.0)
        pages.send(socket, "begin")
        pages.messages(socket, "world")
        for _ in range(5):  # another device than that of the drive
            pages.send(socket, "stick", forward=1.0, left=0.0, by="keyboard")
        for name in ("keyboard", "switch", "touch"):
            pages.send(socket, "device", name=name, scan_period=1.0)
            assert (
                "expected touch until this drive has ended"
                in pages.messages(socket, "error")["text"]
            )
        assert pages.messages(socket, "picture")["waits"]
        while pages.messages(socket, "picture")["twist"][0] < 0.1:  # however late this machine is
            pages.send(socket, "stick", forward=1.0, left=0.0, by="touch")
    with served.socket("study") as socket:
        assert joined(socket, 9)["task"] == "hall"
    (attempt,) = of(served, 9).attempts
    assert (attempt["outcome"], attempt["counts"]) == (CUT_OFF, False)
    assert attempt["figures"]["length"] > 0.0
    assert attempt["at"] <= attempt["end"]


def test_nothing_that_a_page_gets_names_the_condition_or_what_it_does(opened):
    served, _ = opened
    with agreed(served, 21) as (socket, step):
        pages.send(socket, "device", name="touch", scan_period=1.0)
        pages.send(socket, "begin")
        world = pages.messages(socket, "world")
        while (picture := pages.messages(socket, "picture"))["t"] < 3.0:  # towards a wall
            pages.send(socket, "stick", forward=-1.0, left=0.2, by="touch")
            assert (picture["given"], picture["reason"]) == ([0.0, 0.0], "")
    assert (world["shielded"], world["order"]) == (False, {})
    said = json.dumps([step, world])
    assert not any(word in said for word in ("help 0", "slide", "Slide", "condition"))


def test_a_second_tab_and_a_mistyped_number_are_told(opened):
    served, _ = opened
    with agreed(served, 22) as (first, step), served.socket("study") as second:
        assert step["task"] == "hall"
        pages.send(second, "participant", number=22, resume=False)
        known = pages.messages(second, "known")
        assert (known["done"], known["steps"]) == (1, 9)
        pages.send(second, "participant", number=22, resume=True)
        error = pages.messages(second, "error")
        assert "participant 22 is open in another tab" in error["text"]
        assert (error["key"], error["values"]) == ("open_elsewhere", {"number": "22"})
        pages.send(first, "consent", step=1)  # sent twice: it is known, and nothing is stored again
        assert pages.messages(first, "step")["number"] == 2
    path = served.studio.folder / "participant_0022" / "steps.jsonl"
    assert [record["kind"] for record in read_chain(path)[0]] == ["opened", "consent"]


def test_the_server_gives_participants_the_study_alone(opened, capsys):
    served, page = opened
    token = served.studio.access.token
    (served.studio.folder / "drive.mcap").write_bytes(b"of another")
    assert get(served, f"/pages?token={token}")[2] == b'["study"]'
    for path in ("/files/drive.mcap", "/participant_0003/steps.jsonl", "/maps/room.yaml"):
        assert get(served, f"{path}?token={token}")[0] in (404, 405)
    assert get(served, f"/experimenter?token={token}")[0] == 403
    for kind in ("drive", "plan", "compare"):
        with pytest.raises(InvalidStatus), served.socket(kind):
            pass
    page.evaluate("location.hash = '#drive'")
    assert not page.is_visible("nav")
    assert page.evaluate("studio.constructor.name") == "StudyPage"
    assert "--participant needs --study" in refusal(["studio", "--participant"], capsys)


def test_the_experimenter_sees_everybody_remarks_and_aborts(opened):
    served, _ = opened
    token = served.studio.experimenter.token
    assert get(served, f"/?token={token}")[0] == 403
    status, headers, _ = get(served, f"/experimenter?token={token}")
    assert (status, headers["location"]) == (303, "/experimenter")
    cookie = {"Cookie": headers["set-cookie"].split(";")[0], "Origin": f"http://{served.host}"}
    links = re.findall(r'href="(\S+css)"', get(served, "/experimenter", **cookie)[2].decode())
    style = "".join(get(served, link, **cookie)[2].decode() for link in links)
    known = {"--top", *re.findall(r"(--[\w-]+):", style)}
    assert set(re.findall(r"var\((--[\w-]+)", style)) <= known

    def post(**form):
        return get(served, "/experimenter", "POST", urlencode(form).encode(), **cookie)

    with served.socket("study") as socket:
        pages.send(socket, "participant", number=23, resume=False)
        pages.messages(socket, "step")
        assert post(number=23, action="note", text="too early")[0] == 303
        pages.send(socket, "consent", step=1)
        pages.messages(socket, "step")
        pages.send(socket, "device", name="touch", scan_period=1.0)
        pages.send(socket, "begin")
        while pages.messages(socket, "picture")["t"] < 0.3:
            pages.send(socket, "stick", forward=0.3, left=0.0, by="touch")
        assert post(number=23, action="abort", text="")[0] == 303
        again = pages.messages(socket, "step")
        assert (again["outcome"], again["task"]) == ("aborted", "hall")
        assert post(number=23, action="adverse_event", text="<dizzy>")[0] == 303
        body = get(served, "/experimenter", **cookie)[2].decode()
        assert "1 of 9" in body
        assert "&lt;dizzy&gt;" in body
    assert wait_until(lambda: 23 not in served.studio.desk.open)
    assert post(number=23, action="note", text="came back")[0] == 303
    for form in ({"action": "note"}, {"action": "fly", "text": "x"}, {"action": "abort"}):
        for number in (23, 5000 * "9"):
            assert post(**{"number": number, **form})[0] == 400
    assert b"has not begun" in post(number=999, action="note", text="x")[2]
    one = of(served, 23)
    assert [(of["kind"], of["text"]) for of in one.remarks] == [
        ("note", "too early"), ("adverse_event", "<dizzy>"), ("note", "came back"),
    ]  # fmt: skip
    assert [attempt["outcome"] for attempt in one.attempts] == [ABORTED]


def test_a_remark_at_the_moment_at_which_a_page_closes_is_stored(tmp_path):
    desk = Desk(tmp_path, protocol(1, 1))
    page = Scripted(desk, 1)
    leaves = threading.Thread(target=page._leave)

    class Closing(dict):
        def get(self, number):
            found = super().get(number)
            leaves.start()
            leaves.join(0.2)
            return found

    desk.open = Closing(desk.open)
    page.tell("consent", step=1)
    desk.act(1, "note", "dizzy")
    leaves.join()
    assert [remark["text"] for remark in read_folder(tmp_path)[1][0].remarks] == ["dizzy"]
    assert desk.open == {}
    with closing(Session(tmp_path, protocol(1, 1), 2)) as other:
        other.mark("note", text="begun")
    steps = tmp_path / "participant_0002" / "steps.jsonl"
    steps.write_bytes(steps.read_bytes().replace(b"begun", b"ended"))
    # The others' records stay in sight.
    assert re.search("line 2 is damaged.*dizzy", desk.page(), re.DOTALL)


@contextmanager
def started(tmp_path):
    """The program itself with an experiment, until it is killed; its page's socket."""
    words = "--study", tmp_path / "rooms.json", "--out", tmp_path, "--participant", "--port", "0"
    program = Program("studio", *map(str, words))
    try:
        assert wait_until(lambda: program.said), program.errors
        port, token = re.search(r":(\d+)/\?token=(\S+)#study", program.said[0]).groups()
        served = pages.Served(SimpleNamespace(access=SimpleNamespace(token=token)), port)
        with served.socket("study") as socket:
            yield socket
            program.process.kill()
    finally:
        program.process.kill()
        program.close()


def test_a_program_that_is_killed_in_a_drive_loses_nothing(tmp_path):
    task = Task("room", pages.room_map(tmp_path, goal=2.3))
    plan = dataclasses.replace(protocol(1, nasa_tlx=False), tasks=(task,))
    write_json(tmp_path / "rooms.json", dump(plan))
    outcomes, due = [], None
    for resume in (False, True):
        with started(tmp_path) as socket:
            pages.send(socket, "participant", number=4, resume=resume)
            due = pages.messages(socket, "step")
            if not resume:
                pages.send(socket, "consent", step=1)
                due = pages.messages(socket, "step")
            assert (due["task"], due["number"]) == ("room", 2)
            pages.send(socket, "device", name="touch", scan_period=1.0)
            pages.send(socket, "begin")
            while (now := pages.messages(socket, "picture", "done"))["type"] == "picture":
                if now["t"] > 0.5 and not resume:
                    break
                pages.send(socket, "stick", forward=0.6, left=0.0, by="touch")
        (one,) = read_folder(tmp_path / "rooms")[1]  # reads each checksum
        outcomes.append([attempt["outcome"] for attempt in one.attempts])
        assert list(one.done) == ["consent", "help 0/room"][: 1 + resume]
    assert outcomes == [[""], [CUT_OFF, "success"]]
    assert one.state == State.FINISHED
    first, second = one.attempts
    assert first["world"] != second["world"]
    for attempt in one.attempts:
        assert (tmp_path / "rooms" / "participant_0004" / attempt["recording"]).stat().st_size


DRIVERS = "novice", "essential_tremor", "keyboard", "weak_left", "ataxia", "expert"


class Scripted(StudySession):
    """A page without a server: a driver model reads what it gets and sends what pages send."""

    def __init__(self, desk, number, driver="expert", known=None):
        self.driver, self.known, self.got = make_driver(driver), known, []
        self.show = lambda *picture: self.got.append(("picture", picture))
        self.send = lambda kind, /, **content: self.got.append((kind, content))
        self.refuse = lambda error: self.got.append(("error", {"text": str(error)}))
        ready = threading.Event()
        ready.set()
        super().__init__(desk, self, ready)
        self._thread.join()
        self.tell("participant", number=number, resume=False)

    def _run(self):
        """Nothing: `tell` handles a message at once."""

    def tell(self, kind, **content):
        self.receive(read_message(json.dumps({"type": kind, **content}), self.fields))
        if kind != "stick":
            self._handle(0.0)

    def take_part(self, patience=10**6):
        """Do this number of steps, at most; the last messages tell what is due."""
        while self.got[-1][0] == "step" and patience:
            patience -= 1
            step = self.got[-1][1]
            if step["kind"] == "consent":
                self.tell("consent", step=step["number"])
            elif step["kind"] == "answers":
                values = [values[len(values) // 2] for *_, values in step["items"]]
                self.tell("answer", values=values, step=step["number"])
            else:
                self.tell("device", name="touch", scan_period=1.0)
                self.tell("begin")
                self._be_driven(step["number"])

    def _be_driven(self, key):
        settings, period = self._drive._world.settings, self._drive._world.task.period
        person = Drivers([self.driver], settings.chair, settings.sensors, period)
        person.begin(key)
        while self._drive is not None:
            head, ranges = self.got[-1][1]
            scan = np.frombuffer(ranges, "<u2") / 1e3
            scan = np.where(scan > 0.0, scan, np.inf).astype(np.float32)
            pose, twist = np.array(head["pose"]), np.array(head["twist"])
            stick = person.step(self.known, pose, twist, scan)
            self.tell("stick", forward=stick.forward, left=stick.left, by="touch")
            self._step(self._drive)


@pytest.mark.parametrize("people", long_but([4, 12], [4]))
def test_a_complete_study_with_two_dropouts(people, tmp_path):
    """From the pages' own messages to data, dictionary and report."""
    scene = pages.room_map(tmp_path, goal=2.0)
    tasks = [Task(name, scene) for name in "abc"[: 1 if people < 12 else 3]]
    conditions = Condition("direct", "direct"), Condition("shield"), Condition("dwa", "shared_dwa")
    plan = Protocol(
        "Rooms", "Yes.", conditions, tuple(tasks), (Task("hall", scene),),
        practice_until="arrived", seed=3, language="es",
        questionnaires=(Questionnaire("=trust", ("I felt safe.",)),),
    )  # fmt: skip
    desk = Desk(tmp_path / "data", plan)
    knows = NavigationEnv(without_labels(scene), driver="expert")  # the way in the one world
    knows.reset(seed=0)
    for number in range(1, people + 1):
        page = Scripted(desk, number, DRIVERS[number % len(DRIVERS)], knows._prepared)
        page.take_part({2: 4, 3: 3}.get(number, 10**6))
        if number == 2:
            page.tell("withdraw")
        page._leave()
    people_of = read_folder(desk.folder)[1]
    assert [one.state for one in people_of] == [
        {2: State.WITHDRAWN, 3: State.UNDER_WAY}.get(k, State.FINISHED)
        for k in range(1, people + 1)
    ]  # fmt: skip
    assert len({tuple(step.key for step in one.steps) for one in people_of}) > 2
    assert all(one["outcome"] == "success" for who in people_of for one in who.attempts)
    assert main(["report", str(desk.folder), "--bom"]) == 0
    assert (
        f"{people} participants, {people - 2} did every step"
        in (desk.folder / "report.html").read_text()
    )
    found = {}
    for name in ("data", "wide", "attempts", "dictionary"):
        text = (desk.folder / f"{name}.csv").read_text("utf-8-sig")
        found[name] = list(csv.DictReader(text.splitlines()))
    assert len(found["wide"]) == people
    defined = {(row["table"], row["name"]): row for row in found["dictionary"]}
    for row in found["data"]:
        assert defined[row["source"], row["measure"]]["unit"] == row["unit"]
    assert {name for _, name in defined} >= {*found["data"][0], *found["attempts"][0]}
    assert {row["source"] for row in found["data"]} == {"drive", "nasa_tlx", "'=trust"}
    times = [float(row["value"]) for row in found["data"] if row["measure"] == "time"]
    wide = [float(v) for row in found["wide"] for k, v in row.items() if v and "time [s]" in k]
    assert sorted(times) == sorted(wide)
    assert all(row["start"] <= row["end"] for row in found["attempts"])


@pytest.mark.parametrize("cut", ["socket", "reload"])
def test_answers_stay_in_the_page_until_they_are_stored(opened, cut):
    """Over a closed socket, a reload, and a disk that is full for a while."""
    served, page = opened
    number = {"socket": 24, "reload": 25}[cut]
    session = Session(served.studio.folder, served.studio.desk.protocol, number)
    session.consent()
    for _ in range(2):
        session.drive(session.next(), lambda _: figures())
    session.close()
    enter(page, number)
    page.click("#yes")
    pages.until(page, "document.querySelectorAll('.panel fieldset').length == 6")
    for k in range(6):
        page.locator(f"input[name=q{k}]").nth(k).check()
    with full_disk():
        page.click("#go")
        pages.until(
            page, "document.getElementById('error').textContent.includes('cannot be written')"
        )
    assert page.inner_text("#error").startswith("That did not work. Tell the experimenter:")
    assert page.is_visible("#error")
    if cut == "reload":
        page.reload()
    else:
        page.evaluate("studio.link.socket.close()")
    # Sent again by itself.
    pages.until(page, "document.querySelectorAll('.panel fieldset').length == 2")
    answers = of(served, number).done["help 0/nasa_tlx"]["answers"]
    assert list(answers.values()) == [0, 5, 10, 15, 20, 25]
    kinds = [one["kind"] for one in read_chain(session.folder / "steps.jsonl")[0]]
    assert kinds[-2:] == ["opened", "answers"]
    page.click("#rest")
    page.click("#go[data-t=resume]")
    pages.until(page, "document.querySelectorAll('.panel fieldset').length == 2")
    page.click("#withdraw")
    page.click("#no")
    pages.until(page, "document.querySelectorAll('.panel fieldset').length == 2")
    page.click("#withdraw")
    pages.axe(page)
    page.click("#yes")
    pages.until(page, "document.querySelector('[data-t=study_ended]')")
    assert of(served, number).state == State.WITHDRAWN


def test_a_drive_that_is_ready_while_one_rests_waits_until_it_is_seen(opened, monkeypatch):
    served, page = opened
    ready, make = threading.Event(), StudySession._make
    monkeypatch.setattr(StudySession, "_make", lambda *of: ready.wait(pages.PATIENCE) and make(*of))
    enter(page, 26)
    page.check("#agreed")
    page.click("#go")
    page.click("#go[data-t=begin_drive]")
    pages.until(page, "studio.waiting")
    page.click("#rest")
    page.keyboard.down("ArrowLeft")
    ready.set()
    pages.until(page, "studio.paused && studio.now")
    page.wait_for_timeout(300)
    assert page.evaluate("studio.now.waits")
    assert not page.is_visible("#map")
    page.click("#go[data-t=resume]")
    pages.until(page, "studio.now.twist[1] > 0.1")
    assert page.is_visible("#map")
    page.click("#rest")
    pages.until(page, "studio.paused")
    page.click("#withdraw")
    page.click("#no")
    page.keyboard.up("ArrowLeft")
    page.wait_for_timeout(300)
    assert page.evaluate("studio.paused")  # as before the question
    assert page.inner_text("#rest") == "Go on"
    page.keyboard.press("Escape")
    pages.until(page, "!studio.running && document.querySelector('#go')")  # the next step is shown
    page.click("#withdraw")
    page.click("#yes")
    pages.until(page, "document.querySelector('[data-t=study_ended]')")
    (attempt,) = of(served, 26).attempts
    assert (attempt["outcome"], attempt["figures"]["length"] < 0.1) == (GIVEN_UP, True)


def test_a_tab_whose_participant_was_deleted_asks_for_another(opened):
    served, page = opened
    with closing(Session(served.studio.folder, served.studio.desk.protocol, 27)) as session:
        session.consent()
    delete(served.studio.folder, 27)
    page.evaluate("sessionStorage.setItem('participant', 27)")
    page.reload()
    pages.until(page, "document.querySelector('#number')")
    assert "27" in page.inner_text("#error")
    page.wait_for_timeout(1500)
    assert page.evaluate("!studio.joining && !sessionStorage.length")


def test_the_environment_of_a_task_is_set_in_its_scene(tmp_path):
    """As in a suite of `wheelchair compare`; the rest is the same for all."""
    scene = {"name": "empty", "env": {"pose_source": "truth", "beams": 64}}
    plan, ordered = Protocol("Rooms", "Yes.", (Condition("help"),), (Task("room", scene),)), []
    page = Scripted(Desk(tmp_path, plan), 1)
    page._begin_when_ready = ordered.append
    page.tell("consent", step=1)
    page.tell("device", name="keyboard", scan_period=1.0)
    page.tell("begin")
    page._leave()
    (order,) = ordered
    assert order.place.scene == {"name": "empty"}
    assert order.place.env == {"pose_source": "truth", "beams": 64, "config": PATIENCE}
