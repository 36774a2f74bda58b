"""The server refuses whom it does not know, and a chair that is let go stops."""

import contextlib
import http.client
import json
import socket
import time
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from agents.studio import session
from agents.studio.catalogue import Place
from agents.studio.drive import film
from agents.studio.messages import read_message
from agents.studio.plan_session import PlanSession
from agents.studio.server import listening_socket, make_session
from agents.studio.session import CompareSession, DriveSession
from agents.studio.warm_up import WarmUp
from tests.agents.studio.served import START, messages, send
from tests.conftest import PATIENCE, output_of, until
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.recording.replay import read_recording


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """A stick is held until it is let go, however slow the machine is."""
    monkeypatch.setattr(session, "DEAD_MAN", PATIENCE)


def get(served, path, method="GET", content=b"", **headers):
    line = http.client.HTTPConnection("127.0.0.1", served.port, timeout=PATIENCE)
    headers = {name.replace("_", "-"): value for name, value in headers.items()}
    line.putrequest(method, path, skip_host="Host" in headers)
    for name, value in headers.items():
        line.putheader(name, value)
    if content:
        line.putheader("Content-Length", str(len(content)))
    line.endheaders(content)
    answer = line.getresponse()
    body = answer.read()
    line.close()
    return answer.status, dict(answer.getheaders()), body


def is_alive(served):
    status, _, body = get(served, f"/app.js?token={served.studio.access.token}")
    return status == 200 and b"import" in body


def test_the_address_gives_a_cookie_that_opens_the_page(served):
    status, headers, _ = get(served, f"/?token={served.studio.access.token}")
    assert status == 303
    assert headers["location"] == "/"
    cookie = headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    status, headers, body = get(served, "/", Cookie=cookie.split(";")[0])
    assert status == 200
    assert b"<main" in body
    assert "default-src 'self'" in headers["content-security-policy"]


@pytest.mark.parametrize("path", ["/", "/app.js", "/files/x.mcap", "/session/drive"])
def test_without_the_token_nothing_is_served(served, path):
    for query in ("", "?token=", "?token=wrong", "?token=%00%ff"):
        status, headers, body = get(served, path + query)
        assert status == 403
        assert b"token" in body
        assert headers["connection"] == "close"  # which keeps no place
    assert get(served, path, Cookie=f"studio-{served.port}=wrong; x")[0] == 403
    assert is_alive(served)


@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"])
def test_strangers_that_make_no_request_keep_nobody_out(served, said, monkeypatch):
    """The oldest of too many are cut off, and each one in time."""
    with contextlib.ExitStack() as lines:

        def line():
            made = socket.create_connection(("127.0.0.1", served.port), PATIENCE)
            lines.enter_context(made).sendall(said)
            return made

        first, *_ = [line() for _ in range(100)]
        assert is_alive(served)
        assert is_closed(first)
        monkeypatch.setattr("agents.studio.server._HEAD_PATIENCE", 0.01)
        assert is_closed(line())


def is_closed(line):
    with contextlib.suppress(ConnectionResetError):
        return line.recv(1) == b""
    return True


def test_another_page_and_another_name_of_the_machine_are_refused(served):
    own = f"/app.js?token={served.studio.access.token}"
    assert get(served, own, Origin=f"http://{served.host}")[0] == 200
    for origin in ("http://evil.example", "null", f"https://{served.host}", "http://127.0.0.1:1"):
        assert get(served, own, Origin=origin)[0] == 403
    for host in ("evil.example", f"evil.example:{served.port}", "127.0.0.1.evil.example", "[", ""):
        assert get(served, own, Host=host)[0] == 403  # a name that others let point here
    assert get(served, own, Host="192.0.2.7")[0] == 403  # without --lan
    assert get(served, own, "POST")[0] == 403
    assert get(served, own, Host=f"localhost:{served.port}")[0] == 200


def test_sockets_of_other_pages_are_refused(served):
    for change in ({"origin": "http://evil.example"}, {"origin": None}, {"token": "wrong"}):
        with pytest.raises(InvalidStatus) as error, served.socket(**change):
            pass
        assert error.value.response.status_code == 403
    with pytest.raises(InvalidStatus), served.socket("nothing"):
        pass
    assert is_alive(served)


@pytest.mark.parametrize(
    "name",
    ["..%2f..%2fetc%2fpasswd", "../secret.mcap", "%2e%2e/secret.mcap", "..\\secret.mcap",
     "secret", ".hidden.mcap", "link.mcap", "a%00.mcap", "no.mcap", "x/../../secret.mcap"],
)  # fmt: skip
def test_only_files_of_the_folder_are_given(served, name):
    folder = served.studio.folder
    folder.mkdir(exist_ok=True)
    (folder.parent / "secret.mcap").write_text("secret")
    (folder / ".hidden.mcap").write_text("secret")
    (folder / "fine.mcap").write_text("mine")
    if not (folder / "link.mcap").is_symlink():
        (folder / "link.mcap").symlink_to(folder.parent / "secret.mcap")
    token = served.studio.access.token
    status, _, body = get(served, f"/files/{name}?token={token}")
    assert status in (400, 404)
    assert b"secret" not in body
    assert get(served, f"/{name}?token={token}")[0] in (400, 404)
    assert get(served, f"/files/fine.mcap?token={token}")[2] == b"mine"


def cut_off(socket):
    with pytest.raises(ConnectionClosed):
        until(lambda: socket.recv(timeout=PATIENCE) is None)


def test_broken_messages_are_answered_and_then_cut_off(served):
    broken = ["", "{", "[]", "1", '{"type": 3}', '{"type": "fly"}', '{"type": "stick"}',
              json.dumps({"type": "stick", "forward": 2, "left": 0, "by": "touch"}),
              '{"type": "stick", "forward": NaN, "left": 0, "by": "touch"}',
              "x" * 5000]  # fmt: skip
    with served.socket() as socket:
        for text in broken:
            socket.send(text)
            assert messages(socket, "error")["text"]
        socket.send(b"\x00\xff")
        cut_off(socket)
    with served.socket() as socket:
        with contextlib.suppress(ConnectionClosed):
            socket.send("x" * (2 << 20))  # larger than any message may be
        cut_off(socket)
    assert is_alive(served)


@pytest.fixture
def standing(monkeypatch):
    """Time that passes for limits of rates only when a test says so: [seconds]."""
    now = [time.monotonic()]
    clock = SimpleNamespace(monotonic=lambda: now[0])
    monkeypatch.setattr("agents.studio.server.time", clock)
    return now


def test_a_flood_is_cut_off_and_others_are_served(served, standing):
    with served.socket() as flooding, served.socket() as other:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(3000):
                send(flooding, "stick", forward=0.0, left=0.0, by="touch")
        cut_off(flooding)
        send(other, "start", **{**START, "place": "nowhere"})
        assert "nowhere" in messages(other, "error")["text"]
    assert is_alive(served)


def test_too_many_requests_are_refused_for_a_moment(served, standing):
    path = f"/files/none.mcap?token={served.studio.access.token}"
    assert get(served, path)[0] == 404
    assert any(get(served, path)[0] == 429 for _ in range(1000))
    standing[0] += 1.0
    assert is_alive(served)


GOOD = {
    "place": "map", "seed": 1, "assist": "slide", "hand": "none", "sight": "none", "rate": 20,
    "on": True, "forward": 0.5, "left": -1, "by": "keyboard", "name": "stick", "scan_period": 1.0,
    "width": 3.0, "height": 3.0, "resolution": 0.05, "factor": 2.0, "shapes": [[0, 1, 1, 2, 2]],
    "planners": ["a_star"], "start": [1, 2], "goal": [2, 1], "clearance": 0.3, "deadline": 1.0,
    "planner": "rrt", "what": "map", "driver": "nobody", "right": "b", "run": "r", "side": "left",
    "episode": 0, "scene": "s",
}  # fmt: skip
KINDS = {
    (page.__name__, kind): page.fields
    for page in (DriveSession, PlanSession, CompareSession)
    for kind in page.fields
}


@pytest.mark.parametrize(("page", "kind"), KINDS)
def test_a_message_has_exactly_its_fields(page, kind):
    fields, good = KINDS[page, kind], GOOD | ({"left": "a"} if page == "CompareSession" else {})
    good |= {"name": {"assist": "slide", "hand": "none", "sight": "none"}.get(kind, good["name"])}
    message = {"type": kind, **{name: good[name] for name in fields[kind]}}
    assert read_message(json.dumps(message), fields) == message
    for wrong in ({**message, "more": 1}, {**message, "type": kind + "x"}):
        with pytest.raises(InputError):
            read_message(json.dumps(wrong), fields)
    lists = [], [[1]], [["a", 1]], [[1e9] * 5], ["no"]
    for name in fields[kind]:
        wrong = None, {}, "x" * 999, 1e19, -5.0, True if name != "on" else 1
        for value in (*wrong, *lists[isinstance(good[name], list) :]):
            with pytest.raises(InputError, match=rf"{kind}\.{name}"):
                read_message(json.dumps({**message, name: value}), fields)


@pytest.mark.parametrize("page", ["drive", "compare"])
def test_a_page_opens_while_another_one_adds_a_map(page, tmp_path):
    class Adds(Place):
        group = twin = property(lambda self: places.setdefault(str(len(places)), ()) and None)

    places = {"scene:empty": Adds(*4 * ("",))}
    studio = SimpleNamespace(places=places, folder=tmp_path, runs=tmp_path, warm_up=WarmUp())
    make_session(page, studio, SimpleNamespace(send=Mock())).close()
    assert len(places) > 1


def test_a_taken_port_is_named(served):
    with pytest.raises(InputError, match=rf"port {served.port} .*--port"):
        listening_socket("127.0.0.1", served.port)


def drive_for(socket, seconds, forward=1.0, left=0.0):
    """Hold a stick for so long, in simulated time; the head of the last picture."""
    first = picture = messages(socket, "picture")
    while picture["t"] < first["t"] + seconds - 1e-6:
        send(socket, "stick", forward=forward, left=left, by="touch")
        picture = messages(socket, "picture")
    return picture


def recordings(served):
    """The recordings of all drives, once every page is closed."""
    assert until(lambda: not served.studio._pages)
    return sorted(served.studio.folder.glob("2*.mcap"))


def test_a_closed_page_stops_the_chair_and_its_drive_is_judged_the_same(served, tmp_path, capsys):
    before = recordings(served)
    with served.socket() as socket:
        send(socket, "start", **START)
        world = messages(socket, "world")
        assert world["recorded"]
        assert messages(socket, "picture")["waits"]
        picture = drive_for(socket, 1.0, 1.0)
        assert picture["twist"][0] > 0.2  # closed in mid-drive
        assert len(picture["ranges"]) == 2 * world["laser"][4]
    (file,) = set(recordings(served)) - set(before)
    (recorded,) = read_recording(file)
    speeds = np.array([state.truth.twist[0] for state in recorded.states])
    assert speeds.max() > 0.2
    assert np.abs(recorded.states[-1].truth.twist).max() < 0.02
    assert "the same rewards" in output_of(["replay", file], capsys)
    target = film(file)
    assert target.stat().st_size > 1000


@pytest.mark.parametrize("device", ["stick", "switch"])
def test_a_silent_device_counts_as_released(served, monkeypatch, device):
    with served.socket() as socket:
        send(socket, "device", name=device, scan_period=5.0)  # time enough to press, if slowly
        send(socket, "start", **{**START, "rate": 40})
        messages(socket, "world")
        if device == "switch":
            send(socket, "stick", forward=0.0, left=0.0, by="switch")
            while messages(socket, "picture")["lit"] != "forward":
                pass
            send(socket, "press")
            while messages(socket, "picture")["twist"][0] < 0.1:
                pass
        else:
            assert drive_for(socket, 0.6, 0.8)["twist"][0] > 0.1
        monkeypatch.undo()
        picture = first = messages(socket, "picture")
        while picture["twist"][0] > 0.02:
            picture = messages(socket, "picture")
            assert picture["t"] - first["t"] < 4.0
        assert messages(socket, "picture")["asked"] == [0.0, 0.0]


def test_help_and_hands_change_while_driving(served):
    with served.socket() as socket:
        send(socket, "start", **{**START, "assist": "slide"})
        world = messages(socket, "world")
        assert world["shielded"]
        drive_for(socket, 0.3, 0.6)
        send(socket, "assist", name="shield")
        assert messages(socket, "assist")["anew"] is False
        send(socket, "hand", name="essential_tremor")
        shaken = [tuple(drive_for(socket, 0.05, 0.5)["stick"]) for _ in range(20)]
        assert len(set(shaken[5:])) > 3
        send(socket, "assist", name="direct")  # without a shield: the drive begins anew
        assert messages(socket, "ended")["outcome"] == "stopped"
        assert not messages(socket, "world")["shielded"]
        assert messages(socket, "assist")["anew"] is True
        send(socket, "pause", on=True)
        assert messages(socket, "paused")["on"]
        send(socket, "assist", name="nobody")
        assert "nobody" in messages(socket, "error")["text"]
