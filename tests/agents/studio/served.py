"""The studio, served in this process, and a browser: one of each for a module of tests."""

import json
import threading
import time
from contextlib import contextmanager

import numpy as np

from agents.studio.server import Access, Studio, listening_socket, make_server
from tests.browser import BROWSER, need_browser
from tests.conftest import PATIENCE
from wheelchair_gym.maps import OccupancyGrid, write_map

START = {"place": "map", "seed": 0, "assist": "direct", "hand": "none", "sight": "none",
         "rate": 20}  # fmt: skip


def room_map(folder, goal=3.3):
    """A room of 6 m x 4 m as a scene, with a goal straight ahead of the start at x = 1.5 m."""
    cells = np.zeros((84, 124), np.int8)
    cells[:2] = cells[-2:] = 100
    cells[:, :2] = cells[:, -2:] = 100
    path = folder / "room.yaml"
    write_map(OccupancyGrid(cells, 0.05, (0.0, 0.0, 0.0)), path)
    ends = {"start": [1.5, 2.1, 0.0], "goal": [goal, 2.1, 0.0]}
    return {"name": "map_file", "path": str(path), **ends, "label": "room"}


class Served:
    def __init__(self, studio, port):
        self.studio, self.port = studio, port
        self.host = f"127.0.0.1:{port}"
        self.url = f"http://{self.host}/?token={studio.access.token}"

    def socket(self, page="drive", **headers):
        from websockets.sync.client import connect

        origin = headers.pop("origin", f"http://{self.host}")
        token = headers.pop("token", self.studio.access.token)
        return connect(
            f"ws://{self.host}/session/{page}?token={token}", origin=origin, open_timeout=PATIENCE,
            additional_headers=headers, max_size=None,
        )  # fmt: skip


@contextmanager
def serving(folder, study=None, goal=3.3, locked=False):
    studio = Studio(folder / "out", room_map(folder, goal), Access(), study, locked=locked)
    bound = listening_socket("127.0.0.1", 0)
    server = make_server(studio)
    studio.warm_up.start()
    thread = threading.Thread(target=lambda: server.run(sockets=[bound]), daemon=True)
    thread.start()
    try:
        yield Served(studio, bound.getsockname()[1])
    finally:
        server.should_exit = True
        thread.join(PATIENCE)
        studio.warm_up.close()
        bound.close()
        assert not thread.is_alive()


@contextmanager
def browsing():
    """A browser; a skip, or a failure where it is required."""
    need_browser()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        patient = {"args": ["--no-sandbox"], "timeout": 1e3 * PATIENCE}
        browser = playwright.chromium.launch(executable_path=BROWSER, **patient)
        yield browser
        browser.close()


# Messages and turns of pages are late, as on a loaded machine: a test that does not wait fails.
LATE = """window.WebSocket = class extends WebSocket {
  set onmessage(take) { super.onmessage = event => setTimeout(take, 20, event); }
};
const listen = addEventListener;
window.addEventListener = (kind, take, how) =>
  listen(kind, kind === "hashchange" ? event => setTimeout(take, 200, event) : take, how);"""


@contextmanager
def looked_at(browser, url, script=""):
    """A page of a browser; at the end, nothing was wrong on its console."""
    page, wrong = browser.new_page(viewport={"width": 1280, "height": 900}), []
    page.on("console", lambda m: m.type in ("error", "warning") and wrong.append(m.text))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.set_default_timeout(300_000.0)
    page.add_init_script(LATE + script)
    page.goto(url)
    yield page
    assert wrong == []


def axe(page):
    """A page has no fault that axe, which knows rules of accessibility, finds."""
    from axe_playwright_python.sync_playwright import Axe

    until(page, "document.querySelector('[data-t=title]')?.textContent !== ''")  # by a script
    found = Axe().run(page).response["violations"]
    assert [(one["id"], one["nodes"][0]["html"]) for one in found] == []


SCREENS = [(390, 844), (820, 1180), (1024, 768), (1180, 820), (1280, 800)]
SCREENS += [(width // 2, height // 2) for width, height in SCREENS]  # at 200 %


def cut_off(page):
    """Names of stick, map and message, where one is not whole within the screen."""
    return page.evaluate("""["stick", "map", "banner"].filter(id => {
      const box = document.getElementById(id).getBoundingClientRect();
      return !box.height || Math.min(box.left, box.top, innerWidth - box.right,
        innerHeight - box.bottom) < 0;
    })""")


def until(page, expression, patience=PATIENCE):
    """Wait until an expression of JavaScript holds on a page, whose policy forbids `eval`."""
    end = time.monotonic() + patience
    while not page.evaluate(expression):
        assert time.monotonic() < end, (expression, page.inner_text("body")[:2000])
        page.wait_for_timeout(30)


def messages(socket, *kinds, patience=PATIENCE):
    """The next message of one of these types, or the head of the next `picture`."""
    end = time.monotonic() + patience
    while True:
        raw = socket.recv(timeout=max(0.1, end - time.monotonic()))
        message = {"type": ""}
        if isinstance(raw, bytes):
            length = int.from_bytes(raw[:4], "little")
            if "picture" in kinds:
                return {"type": "picture", "ranges": raw[4 + length :]} | json.loads(
                    raw[4 : 4 + length]
                )
        elif (message := json.loads(raw))["type"] in kinds:
            return message
        assert message["type"] != "error", message


def send(socket, kind, **content):
    socket.send(json.dumps({"type": kind, **content}))
