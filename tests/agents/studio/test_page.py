"""The page in a browser: people drive by keys, touch, gamepad and switch, and can read it."""

import re
from pathlib import Path

import numpy as np
import pytest

from agents.people import ASSISTANTS
from agents.studio import PAGE, page_texts
from agents.studio.catalogue import NO_HAND, NO_SIGHT, places
from agents.studio.session import NOBODY, POLICIES
from planners.registries import PLANNERS
from tests.agents.studio.served import SCREENS, axe, browsing, cut_off, looked_at, serving, until
from tests.conftest import PATIENCE, output_of
from tests.hardware.conftest import build_twin
from wheelchair_gym.base.files import read_json
from wheelchair_gym.people.drivers import DRIVERS
from wheelchair_gym.people.drivers.live_person import SIGHTS
from wheelchair_gym.rendering import palette

GAMEPAD = """navigator.getGamepads = () => [
  { axes: [0, window.pushed ?? 0], buttons: [{ pressed: window.clicked ?? false }] }]"""
THEME = read_json(Path(palette.__file__).with_name("theme.json"))
WAITS = "studio.running && studio.now?.waits"


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    with (
        serving(tmp_path_factory.mktemp("page"), goal=2.5) as served,
        browsing() as browser,
        looked_at(browser, served.url, GAMEPAD) as page,
    ):
        axe(page)  # the first visit
        page.click("a[href='#drive']")
        until(page, "window.studio?.running")
        assert "token" not in page.url
        assert page.input_value("#place") == "map"
        assert page.input_value("#assist") == "shared_dwa"
        page.select_option("#assist", "direct")
        yield served, page


def begin(page):
    """A fresh drive, before its first move."""
    until(page, "!document.getElementById('start').disabled")
    page.evaluate("studio.now = studio.world = null; studio.running = false")
    page.click("#start")
    until(page, WAITS)


@pytest.fixture
def page(opened):
    return opened[1]


@pytest.fixture
def begun(page):
    begin(page)


@pytest.mark.parametrize("place", ["map", "twin:map"])
def test_keys_drive_to_the_goal_and_the_drive_is_judged_the_same(opened, capsys, place):
    served, page = opened
    if place.startswith("twin"):
        pytest.importorskip("serial", reason="pip install 'wheelchair_gym[hardware]'")
        build_twin()
    page.select_option("#place", place)
    begin(page)
    page.keyboard.down("ArrowUp")
    until(page, "!studio.running")
    page.keyboard.up("ArrowUp")
    result = page.evaluate("studio.result")
    assert result["outcome"] == "success"
    assert page.evaluate("studio.world.order.place") == place
    assert page.inner_text("#outcome") == page.inner_text("#banner")
    page.select_option("#place", "map")
    recording = served.studio.folder / result["file"]
    assert "the same rewards" in output_of(["replay", recording], capsys)


@pytest.mark.long
def test_a_drive_is_filmed(page, begun):
    page.keyboard.down("ArrowLeft")
    page.wait_for_timeout(500)
    page.keyboard.up("ArrowLeft")
    page.keyboard.press("Escape")
    until(page, "!studio.running")
    page.click("#film")
    until(page, "!document.getElementById('filmed').hidden")
    with page.expect_download() as loading:
        page.click("#filmed")
    assert loading.value.path().stat().st_size > 1000


def test_what_compiles_while_one_waits_is_told(page, begun):
    state = "{ready: true, kernel: 'scan_laser', kernels: 7}"
    page.evaluate(f"studio.prepared({state})")
    assert "scan_laser" not in page.inner_text("#banner")
    page.evaluate(f"studio.running = false; studio.waiting = true; studio.prepared({state})")
    assert "part 7 scan_laser" in page.inner_text("#banner")
    begin(page)
    assert "scan_laser" not in page.inner_text("#banner")


def test_a_drive_can_be_ended_before_it_begins(page, begun):
    page.click("#stop")
    until(page, "!studio.running")
    assert page.is_disabled("#stop")
    begin(page)


def test_touch_drives_and_stops(page, begun):
    page.click("#device", trial=True)  # in view
    box = page.locator("#stick").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y - box["height"] / 2)
    until(page, "studio.now.twist[0] > 0.1")
    page.mouse.up()
    until(page, "Math.abs(studio.now.twist[0]) < 0.02")


def test_a_gamepad_drives(page, begun):
    page.evaluate("window.pushed = 0.05")  # a stick that rests off its centre
    page.wait_for_timeout(200)
    assert page.evaluate(WAITS)
    page.evaluate("window.pushed = -0.9")
    until(page, "studio.now.twist[0] > 0.1")
    page.evaluate("window.pushed = 0")
    page.keyboard.press("Escape")
    until(page, "!studio.running")


def test_a_single_switch_drives_and_stops(page, begun, monkeypatch):
    monkeypatch.setattr("agents.studio.session.DEAD_MAN", PATIENCE)
    page.select_option("#device", "switch")
    page.fill("#period", "0.5")
    page.focus("#map")
    until(page, "studio.now.lit === 'back'")
    until(page, "studio.now.lit === 'forward'")
    driven = "studio.now.lit === ''"  # as it was lit when it was pressed
    for focus, key in (("#map", "Space"), ("#stop", "Enter"), ("#place", "Space"), ("#seed", "")):
        page.focus(focus)
        for expected in (driven, "studio.now.lit !== ''"):
            until(page, "studio.now.lit !== 'forward'")  # slow presses would end at the goal
            page.keyboard.press(key) if key else page.evaluate("window.clicked = true")
            until(page, expected)
            page.evaluate("window.clicked = false")
            until(page, "!studio.inputs.down")  # the gamepad was looked at
    page.click("#switch")
    until(page, driven)
    assert page.evaluate("studio.running")
    monkeypatch.undo()
    page.evaluate("Object.defineProperty(document, 'hidden', {value: true, configurable: true})")
    until(page, "studio.now.lit !== ''")  # a page that is not seen does not drive
    page.evaluate("delete document.hidden")
    page.select_option("#device", "stick")
    page.keyboard.press("Escape")


# The colours of the picture at points [m] of the map.
AT = """points => {
  const {view} = studio, [mx, my] = view.middle(), copy = document.createElement("canvas");
  Object.assign(copy, {width: view.canvas.width, height: view.canvas.height});
  const context = copy.getContext("2d", {willReadFrequently: true});
  context.drawImage(view.canvas, 0, 0);
  return points.map(([x, y]) => {
    const left = copy.width / 2 + (x - mx) * view.scale;
    const top = copy.height / 2 - (y - my) * view.scale;
    const [r, g, b] = context.getImageData(left, top, 1, 1).data;
    return "#" + [r, g, b].map(one => one.toString(16).padStart(2, "0")).join("");
  });
}"""
AROUND = """[-2.6, -1.5, -0.3, 0.3, 1.5, 2.6].map(side => {  // at 0.8 m around the chair
  const [x, y, yaw] = studio.now.pose;
  return [x + 0.8 * Math.cos(yaw + side), y + 0.8 * Math.sin(yaw + side)];
})"""


def test_what_a_simulated_person_does_not_see_is_covered(page, begun):
    covered = lambda: [one == veil for one in page.evaluate(f"({AT})({AROUND})")]  # noqa: E731
    veil = page.evaluate("studio.view.colour.veil")
    assert not any(covered())
    page.select_option("#sight", "hemianopia")
    until(page, "studio.now.sight?.[0] === 0")
    assert covered() == [False, False, False, True, True, True]
    assert "left" in page.inner_text("#unseen")
    page.select_option("#sight", "hemineglect")
    until(page, "studio.now.sight?.[2] < 0.2")
    assert covered()[:3] == [False] * 3
    assert covered()[5]  # where the scanner does not look
    page.keyboard.down("ArrowLeft")  # the chair turns, and what it covers turns with it
    until(page, "studio.now.t > 2")
    page.keyboard.up("ArrowLeft")
    page.select_option("#sight", "hemianopia")
    until(page, "studio.now.sight?.[0] === 0")
    assert covered() == [False, False, False, True, True, True]
    page.select_option("#sight", "none")
    until(page, "studio.now.sight === null")
    assert not any(covered())
    page.keyboard.press("Escape")


@pytest.mark.parametrize("mode", ["light", "dark", "contrast"])
def test_walls_are_filled_and_the_floor_is_free_in_the_colours_of_the_theme(page, mode):
    page.emulate_media(color_scheme="light" if mode == "light" else "dark")
    page.evaluate("document.getElementById('looks').open = true")
    page.set_checked("#contrast", mode == "contrast")
    begin(page)
    points = [[0.05, 1.0], [0.4, 2.1], [-0.2, 1.0]]  # in a wall, behind the chair, outside
    names = ("wall", "floor", "unknown")
    assert page.evaluate(AT, points) == [THEME[mode][name] for name in names]
    page.set_checked("#contrast", False)
    page.emulate_media(color_scheme="light")


def swipe(page, *ways):
    """Draw fingers along ways from (x, y) by (dx, dy), and let them rest."""
    touch = page.context.new_cdp_session(page)
    for k in range(11):
        points = [{"x": x + k * dx / 10, "y": y + k * dy / 10} for x, y, dx, dy in ways]
        points = [{**point, "id": number} for number, point in enumerate(points)]
        kind = "touchMove" if k else "touchStart"
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    page.wait_for_timeout(300)  # so that nothing goes on to scroll
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def test_the_map_is_dragged_zoomed_and_turned_and_one_finger_scrolls(page, begun):
    view = lambda: page.evaluate("[studio.view.zoom, ...studio.view.shift]")  # noqa: E731
    at = lambda x, y: page.evaluate(f"studio.view.place({{clientX: {x}, clientY: {y}}})")  # noqa: E731
    box = page.locator("#map").bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    page.mouse.move(x, y)
    under = pytest.approx(at(x, y), abs=0.02)
    page.mouse.wheel(0, -400)
    until(page, "studio.view.zoom > 2")
    assert at(x, y) == under
    page.mouse.down()
    page.mouse.move(x + 60, y - 40, steps=2)
    page.mouse.up()
    assert at(x + 60, y - 40) == under
    page.click("#heading")
    assert page.evaluate("studio.view.angle") == pytest.approx(np.pi / 2, abs=0.05)
    page.click("#heading")
    page.click("#fit")
    page.evaluate("document.getElementById('main').style.minHeight = '200vh'; scrollTo(0, 0)")
    swipe(page, (x, y, 0, -200))
    until(page, "scrollY > 50")
    page.evaluate("scrollTo(0, 0)")
    page.mouse.move(x, y)
    page.mouse.wheel(0, 100)  # all is seen: this means the page
    until(page, "scrollY > 50")
    page.evaluate("scrollTo(0, 0)")
    assert view() == [1, 0, 0]
    swipe(page, (x - 30, y, -50, 0), (x + 30, y, 50, 0))
    assert view()[0] == pytest.approx(80 / 30, abs=0.1)
    assert page.evaluate("scrollY") == 0
    page.evaluate("document.getElementById('main').style.minHeight = ''")
    page.click("#fit")


@pytest.mark.parametrize("name", ["drive", "plan", "compare"])
@pytest.mark.parametrize("language", ["en", "es"])
@pytest.mark.parametrize("contrast", [False, True])
def test_a_page_is_accessible(page, language, contrast, name):
    tab(page, name)
    page.evaluate("document.getElementById('looks').open = true")
    page.select_option("#language", language)
    page.set_checked("#contrast", contrast)
    axe(page)
    assert page.evaluate("document.documentElement.lang") == language
    page.select_option("#language", "en")
    tab(page, "drive")


# Controls that lie over one another, and those that are too small for a finger.
CRAMPED = """() => {
  const shown = [...document.querySelectorAll("button, select, input, summary, .mark")]
    .filter(one => one.checkVisibility() && !one.closest(".list, .mark > *"));
  const box = one => (one.closest("label.check, .mark") ?? one).getBoundingClientRect();
  const covers = (one, other) => {
    const a = box(one), b = box(other);
    return !one.contains(other) && !other.contains(one)
      && Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1
      && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1;
  };
  const small = shown.filter(one => Math.min(box(one).width, box(one).height) < 24);
  const over = shown.filter((one, k) => shown.slice(k + 1).some(other => covers(one, other)));
  const broken = [...document.querySelectorAll("dt")].filter(one => box(one).height > 60);
  return [...small, ...over, ...broken].map(one => one.outerHTML);
}"""


@pytest.mark.parametrize("width", [390, 820, 1280])
@pytest.mark.parametrize("name", ["drive", "plan", "compare"])
def test_no_control_is_covered_too_small_or_cut_off_on_any_screen(page, width, name):
    tab(page, name)
    page.set_viewport_size({"width": width, "height": 900})
    page.evaluate("document.getElementById('looks').open = false")
    assert page.evaluate(CRAMPED) == []
    page.evaluate("document.getElementById('looks').open = true")
    for size in ("100", "200"):
        page.select_option("#size", size)
        assert page.evaluate("document.documentElement.scrollWidth") <= width, size
    page.select_option("#size", "100")
    page.set_viewport_size({"width": 1280, "height": 900})
    tab(page, "drive")


def test_stick_map_and_message_are_on_one_screen_and_errors_wherever_one_has_scrolled(page):
    for width, height in SCREENS:
        page.set_viewport_size({"width": width, "height": height})
        begin(page)
        until(page, "studio.now?.waits")
        assert cut_off(page) == [], (width, height)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.set_viewport_size({"width": 390, "height": 844})
    for name in ("error", "lost"):
        page.evaluate(f"""scrollTo(0, 1e5);
            Object.assign(document.getElementById({name!r}), {{ hidden: false }})""")
        box = page.locator(f"#{name}").bounding_box()
        assert 0 <= box["y"] < 844 - box["height"]
        page.evaluate(f"document.getElementById({name!r}).hidden = true")
    page.set_viewport_size({"width": 1280, "height": 900})


def test_a_chair_that_may_not_back_says_so(page):
    page.select_option("#assist", "shared_dwa")
    begin(page)
    page.keyboard.down("ArrowDown")
    until(page, "document.getElementById('banner').textContent.startsWith('No sensor looks back')")
    page.keyboard.up("ArrowDown")
    until(page, "studio.now.stick[0] === 0 && !studio.backs")
    page.keyboard.press("Escape")
    page.select_option("#assist", "direct")


def test_keys_alone_reach_everything(page):
    page.focus("body")
    page.evaluate("document.activeElement.blur()")
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id"))
    shown = page.evaluate(
        "[...document.querySelectorAll('main button, main select, main input, main a[href]')]"
        ".filter(one => one.offsetParent && !one.disabled).map(one => one.id)"
    )
    assert set(shown) <= reached
    assert "map" in reached


def test_a_lost_connection_is_told(page):
    page.evaluate("studio.link.socket.close()")
    until(page, "!document.getElementById('lost').hidden")
    page.click("#again")
    until(page, WAITS)


def tab(page, name):
    ready = {"plan": "studio.kinds.length && studio.world", "compare": "studio.sources"}
    page.click(f"[data-page={name}]")
    until(page, f"document.querySelector('[data-page={name}][aria-current]')")
    until(page, ready.get(name, WAITS))


def on_map(page, x, y):
    """Return the screen position of a point [m] of the map."""
    box = page.locator("#map").bounding_box()
    x0, y0, x1, y1 = page.evaluate("studio.view.bounds")
    scale = page.evaluate("1 / studio.view.pixel")
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    return middle[0] + (x - (x0 + x1) / 2) * scale, middle[1] - (y - (y0 + y1) / 2) * scale


def planned(page):
    page.click("#plan")
    until(page, "studio.answers.length && !document.getElementById('plan').disabled")
    return {row["planner"]: row for row in page.evaluate("studio.answers")}


def test_people_draw_plan_watch_and_save(opened):
    served, page = opened
    tab(page, "plan")
    for box in page.query_selector_all("#planners input"):
        box.set_checked(box.get_attribute("value") in ("visibility", "rrt_star", "swarm"))
    assert "A*" in page.inner_text("#planners")
    page.check("#tool-start")
    page.mouse.click(*on_map(page, 2.0, 4.0))
    page.check("#tool-goal")
    page.mouse.click(*on_map(page, 8.0, 4.0))
    assert planned(page)["visibility"]["length"] == pytest.approx(6.0, abs=0.2)
    page.check("#tool-wall")
    page.mouse.move(*on_map(page, 5.0, 0.5))
    page.mouse.down()
    page.mouse.move(*on_map(page, 5.0, 6.0), steps=3)
    page.mouse.up()
    until(page, "studio.shapes.length === 1 && !studio.answers.length")
    found = planned(page)
    assert found["visibility"]["length"] == min(row["length"] for row in found.values()) > 6.5
    assert "Visibility graph" in page.inner_text("#banner")
    page.check("#tool-furniture")  # by keys: two corners
    page.focus("#map")
    for key in ("Enter", "Shift+ArrowUp", "Shift+ArrowRight", "Enter"):
        page.keyboard.press(key)
    until(page, "studio.shapes.length === 2")
    page.click("#clear")
    for left in (2, 1):  # what was removed comes back
        page.click("#undo")
        until(page, f"studio.shapes.length === {left}")
    planned(page)
    for name, words in (("rrt_star", "RRT*"), ("swarm", "Swarm")):
        page.click(f"[aria-label='Watch: {words}']")
        until(page, f"studio.frames && studio.grower === '{name}'")
        page.evaluate("clearInterval(studio.playing)")
        page.fill("#frame", "3")
        assert words in page.inner_text("#grown")
        assert page.evaluate("studio.frames.every(one => one.tree.length + one.swarm.length >= 0)")
    page.fill("#name", "drawn")
    page.click("#save-problem")
    page.wait_for_selector("#saved a[href='files/drawn.json']")
    page.click("#save-map")
    page.wait_for_selector("#saved a[href='files/drawn.yaml']")
    for name in ("drawn.json", "drawn.yaml", "drawn.png"):
        assert (served.studio.folder / name).is_file()
    page.set_input_files(
        "#files", [served.studio.folder / "drawn.yaml", served.studio.folder / "drawn.png"]
    )
    until(page, "studio.world.name === 'drawn'")
    page.set_input_files("#files", served.studio.folder / "drawn.png")
    until(page, "!studio.shapes.length")
    page.check("#tool-scale")
    x0, y0, x1, y1 = page.evaluate("studio.world.bounds")
    for x, y in ((x0 + 1.0, y0 + 1.0), (x0 + 3.0, y0 + 1.0)):
        page.mouse.click(*on_map(page, x, y))
    page.fill("#true", "4")
    page.click("#rescale")
    until(page, f"studio.world.bounds[2] > {x1} + 1")
    bounds = page.evaluate("studio.world.bounds")
    assert bounds == pytest.approx([2 * one for one in (x0, y0, x1, y1)], rel=0.05)
    page.check("#tool-start")
    assert page.inner_text("#error") == ""


def test_two_drives_are_compared(page):
    tab(page, "compare")
    until(page, "studio.sources && !document.getElementById('go').disabled")
    page.select_option("#place", "scene:doorway")
    page.select_option("#driver", "novice")
    page.click("#go")
    until(page, "studio.tracks.right && !document.getElementById('go').disabled")
    page.click("#event")
    assert page.inner_text("#name-left") == page.inner_text("#head-left") == "No help"
    time = page.evaluate("Number(document.getElementById('time').value)")
    assert time in page.evaluate("studio.tracks.right.events.map(([t]) => Math.round(10 * t) / 10)")
    page.fill("#time", "1")
    assert "1.0 s" in page.inner_text("#clock")
    page.click("#play")
    until(page, "Number(document.getElementById('time').value) > 1.5")
    for width in (390, 820, 1280):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    axe(page)
    tab(page, "drive")


def test_pictures_and_pages_share_one_legend_and_walls_stand_out():
    english = read_json(PAGE / "texts" / "en.json")
    legend = {key[2:]: words for key, words in english.items() if key.startswith("k_")}
    assert legend == {key: THEME["words"][key] for key in legend}

    for theme in (THEME[mode] for mode in ("light", "dark", "contrast")):
        assert set(theme) == set(THEME["light"])
        rgb = np.array([[*bytes.fromhex(theme[name][1:])] for name in ("floor", "wall")]) / 255
        dark, light = sorted(rgb**2.2 @ [0.2126, 0.7152, 0.0722])
        assert (light + 0.05) / (dark + 0.05) > 3.0  # WCAG 2.2, 1.4.11


def test_every_text_is_there_in_every_language():
    languages = page_texts()
    english = languages["en"]
    assert {"en", "es"} <= set(languages)
    for texts in languages.values():
        assert list(texts) == list(english)
        for key, one in texts.items():
            assert one
            named = [set(re.findall(r"\{\w+\}", each)) for each in (one, english[key])]
            assert named[0] == named[1], key
    used = set()
    for file in PAGE.iterdir():
        if file.suffix in (".js", ".html"):
            source = file.read_text(encoding="utf-8")
            used |= set(re.findall(r'data-(?:t|label)="(\w+)"|\btext\("(\w+)"', source))
    used = {one or other for one, other in used}
    used |= {f"{kind}_{name}" for name in ASSISTANTS.built_in for kind in "an"}
    scenes = {key[6:]: one.label for key, one in places().items() if one.group == "scene"}
    used |= {f"p_{label}" for label in scenes.values()} | {f"q_{name}" for name in scenes}
    outcomes = ("success", "collision", "timeout", "missed", "left_map", "stopped")
    used |= {f"{kind}_{name}" for name in outcomes for kind in ("o", "end")}
    used |= {f"h_{name}" for name in (NO_HAND, NOBODY, *DRIVERS.built_in)}
    used |= {f"l_{name}" for name in PLANNERS.built_in} | {f"y_{name}" for name in POLICIES}
    used |= {f"s_{name}" for name in (NO_SIGHT, *SIGHTS)} | {f"u_{name}" for name in SIGHTS}
    assert used <= set(english)
