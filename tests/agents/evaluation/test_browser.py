"""Pages in a real browser: no error, no missing picture, readable on a phone, tables that sort.

Chromium is run without a window on a copy of a page that tells of itself when it has loaded.
"""

import html
import json
import re
import subprocess

import pytest

from agents.cli import main
from tests.browser import BROWSER, need_browser

pytestmark = pytest.mark.long
PROBE = """<script>
addEventListener("load", () => {
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
  const told = {
    width: innerWidth, page: document.documentElement.scrollWidth,
    broken: [...document.images].filter(i => !i.complete || !i.naturalWidth).length,
    images: document.images.length, least: Math.min(...sizes), cut,
    sorted: button ? button.closest("th").getAttribute("aria-sort") : null,
    same: JSON.stringify(before.sort()) === JSON.stringify(rows().sort()),
  };
  parent.postMessage(JSON.stringify(told), "*");
});
</script>"""
# A window is never narrower than 500 pixels; a frame in it is.
FRAME = """<!doctype html><script>addEventListener("message", event => {
  document.body.innerHTML = "<pre id=told></pre>";
  document.getElementById("told").textContent = event.data;
})</script><iframe src="probed.html" width="{width}" height="1800" style="border:0"></iframe>"""


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


def seen(page, width):
    """Return a page's measures of itself in a window `width` wide, and the console's messages."""
    need_browser()
    probed = page.with_name("probed.html")
    probed.write_text(page.read_text(encoding="utf-8") + PROBE, encoding="utf-8")
    frame = page.with_name("frame.html")
    frame.write_text(FRAME.replace("{width}", str(width)), encoding="utf-8")
    done = subprocess.run(
        [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr",
         "--hide-scrollbars", "--window-size=1400,2000", "--virtual-time-budget=8000", "--dump-dom",
         frame.as_uri()],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    (told,) = re.findall(r'<pre id="told">(.*?)</pre>', done.stdout, re.DOTALL)
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return json.loads(html.unescape(told)), console


@pytest.mark.parametrize("name", ["compare", "study"])
@pytest.mark.parametrize("width", [360, 1280])
def test_a_page_is_whole_and_readable(pages, name, width):
    told, console = seen(pages / name / "report.html", width)
    assert console == []
    assert told["broken"] == 0
    assert told["images"] > 0
    assert told["width"] == told["page"] == width  # nothing but tables scrolls sideways
    assert told["cut"] == []
    assert told["least"] >= 11.0  # px
    assert told["sorted"] in ("ascending", "descending")
    assert told["same"]


def test_a_broken_page_is_told(pages):
    """The probe sees what it is there to see."""
    page = pages / "broken" / "report.html"
    page.parent.mkdir()
    text = (pages / "study" / "report.html").read_text(encoding="utf-8")
    page.write_text(
        text + "<script>console.error('broken')</script><img src='none.png'>"
        "<p style='font-size:5px;width:900px'>long</p>", encoding="utf-8",
    )  # fmt: skip
    told, console = seen(page, 360)
    assert len(console) >= 1
    assert told["broken"] == 1
    assert told["least"] == 5.0
    assert told["page"] > told["width"]
    assert told["cut"] == ["long"]


@pytest.mark.parametrize("name", ["compare", "study"])
def test_a_page_prints_on_landscape_sheets(pages, name):
    need_browser()
    pdf = pages / f"{name}.pdf"
    subprocess.run(
        [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", f"--print-to-pdf={pdf}",
         (pages / name / "report.html").as_uri()],
        capture_output=True, timeout=120, check=True,
    )  # fmt: skip
    content = pdf.read_bytes()
    assert content.startswith(b"%PDF")
    boxes = set(re.findall(rb"/MediaBox ?\[([\d. ]+)\]", content))
    assert boxes
    for box in boxes:
        x0, y0, x1, y1 = map(float, box.split())
        assert x1 - x0 > y1 - y0
