"""Pages in a real browser: no error, no missing picture, readable on a phone, tables that sort."""

import re

import pytest

from agents.cli import main
from tests.agents.studio.served import browsing

pytestmark = pytest.mark.long
PROBE = """async () => {
  for (const image of document.images) image.loading = "eager";
  await Promise.all([...document.images].map(image => image.decode().catch(() => null)));
  const sizes = [], cut = [];
  for (const of of document.querySelectorAll("h1, p, td, th, figcaption, li, dt, dd, pre")) {
    sizes.push(parseFloat(getComputedStyle(of).fontSize));
    if (!of.closest(".wide, svg") && of.getBoundingClientRect().right > innerWidth + 1)
      cut.push(of.textContent.slice(0, 40));
  }
  const table = document.querySelector("table"), rows = () =>
    [...table.querySelectorAll("tbody tr")].map(row => row.textContent);
  const before = rows(), button = table.querySelectorAll("thead button")[1];
  if (button) { button.click(); button.click(); }
  return {
    width: innerWidth, page: document.documentElement.scrollWidth,
    broken: [...document.images].filter(i => !i.complete || !i.naturalWidth).length,
    images: document.images.length, least: Math.min(...sizes), cut,
    sorted: button ? button.closest("th").getAttribute("aria-sort") : null,
    same: JSON.stringify(before.sort()) === JSON.stringify(rows().sort()),
  };
}"""


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """A comparison's page with failures among its pictures, and a study's."""
    folder = tmp_path_factory.mktemp("pages")
    compared = ["compare", "--suite", "demo", "--policies", "random,straight", "--episodes", "2"]
    compared += ["--scenes", "clutter,floor_plan", "--jobs", "1", "--quiet"]
    assert main([*compared, "--out", str(folder / "compare")]) == 0
    studied = ["study", "t2", "--runs", "2", "--jobs", "1", "--quiet"]
    assert main([*studied, "--out", str(folder / "study")]) == 0
    return folder


@pytest.fixture(scope="module")
def browser():
    with browsing() as one:
        yield one


def seen(browser, page, width):
    """Return a page's measures of itself in a window `width` wide, and the console's messages."""
    tab, console = browser.new_page(viewport={"width": width, "height": 1800}), []
    for told in ("console", "pageerror"):
        tab.on(told, lambda message: console.append(f"{message}"))
    tab.goto(page.as_uri())
    return tab.evaluate(PROBE), console


@pytest.mark.parametrize("name", ["compare", "study"])
@pytest.mark.parametrize("width", [360, 1280])
def test_a_page_is_whole_and_readable(browser, pages, name, width):
    told, console = seen(browser, pages / name / "report.html", width)
    assert console == []
    assert told["broken"] == 0
    assert told["images"] > 0
    assert told["width"] == told["page"] == width  # nothing but tables scrolls sideways
    assert told["cut"] == []
    assert told["least"] >= 11.0  # px
    assert told["sorted"] in ("ascending", "descending")
    assert told["same"]


def test_a_broken_page_is_told(browser, pages):
    page = pages / "broken" / "report.html"
    page.parent.mkdir()
    text = (pages / "study" / "report.html").read_text(encoding="utf-8")
    page.write_text(
        text + "<script>console.error('broken')</script><img src='none.png'>"
        "<p style='font-size:5px;width:900px'>long</p>", encoding="utf-8",
    )  # fmt: skip
    told, console = seen(browser, page, 360)
    assert len(console) >= 1
    assert told["broken"] == 1
    assert told["least"] == 5.0
    assert told["page"] > told["width"]
    assert told["cut"] == ["long"]


@pytest.mark.parametrize("name", ["compare", "study"])
def test_a_page_prints_on_landscape_sheets(browser, pages, name):
    tab = browser.new_page()
    tab.goto((pages / name / "report.html").as_uri())
    content = tab.pdf(prefer_css_page_size=True)
    assert content.startswith(b"%PDF")
    boxes = set(re.findall(rb"/MediaBox ?\[([\d. ]+)\]", content))
    assert boxes
    for box in boxes:
        x0, y0, x1, y1 = map(float, box.split())
        assert x1 - x0 > y1 - y0
