"""How quick the studio is on this machine: first picture, key to picture, rate, memory.

    python -m tests.benchmarks.studio
    python -m tests.benchmarks.studio --cold --minutes 10

It starts `wheelchair studio` and opens its page in Chromium. With --cold nothing is compiled
before. With --minutes a person drives in circles for so long, and the memory of
the server is printed each minute.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.agents.studio.served import browsing, until
from tests.conftest import ROOT

KEYS = 60  # that are pressed to measure latencies
WATCHED = 10.0  # s for which pictures are counted


def resident(pid: int) -> float:
    """Memory of a process that is in use [MiB]."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def start_drive(page, place, assist, rate):
    """Begin a drive; seconds until its first picture."""
    begun = time.perf_counter()
    page.select_option("#place", place)
    page.select_option("#assist", assist)
    page.select_option("#rate", str(rate))
    page.evaluate("studio.now = studio.world = null; studio.running = false")
    page.click("#start")
    until(page, "studio.running && studio.now", 300.0)
    page.focus("#map")
    return time.perf_counter() - begun


def latencies(page, rate):
    """Milliseconds from a key to the picture that shows it, of each key."""
    page.evaluate("studio.latencies = []")
    for k in range(KEYS):
        key = ("ArrowLeft", "ArrowRight")[k % 2]
        page.keyboard.down(key)
        page.wait_for_timeout(60 + 7 * (k % 11))  # at any moment of a period
        page.keyboard.up(key)
        page.wait_for_timeout(60 + 5 * (k % 13))
    found = sorted(page.evaluate("studio.latencies"))
    p95 = found[int(0.95 * len(found))]
    print(
        f"key to picture at {rate} Hz: p50 {statistics.median(found):.0f} ms  p95 {p95:.0f} ms  "
        f"({len(found)} changes)"
    )


def watched_rate(page, rate):
    """Pictures a second, and simulated seconds a second, while a person drives among people."""
    page.keyboard.down("ArrowLeft")
    page.wait_for_timeout(500)
    begun, first, t0 = time.perf_counter(), *page.evaluate("[studio.pictures, studio.now.t]")
    page.wait_for_timeout(1e3 * WATCHED)
    last, t1 = page.evaluate("[studio.pictures, studio.now.t]")
    spent = time.perf_counter() - begun
    page.keyboard.up("ArrowLeft")
    beams = page.evaluate("studio.world.laser[4]")
    people = page.evaluate("studio.world.actors.length")
    print(
        f"among {people} people, {beams} beams, asked for {rate} Hz: {(last - first) / spent:.1f} "
        f"pictures/s, {(t1 - t0) / spent:.3f} simulated s/s"
    )


def soak(page, pid, minutes):
    """Drive in circles, and print the memory each minute; a drive that has ended begins anew."""
    for minute in range(minutes):
        end = time.perf_counter() + 60.0
        while time.perf_counter() < end:
            if not page.evaluate("studio.running"):
                start_drive(page, "scene:empty", "slide", 40)
            for key in ("ArrowLeft", "ArrowUp"):  # in a circle
                page.keyboard.down(key)
            page.wait_for_timeout(5000)
            for key in ("ArrowLeft", "ArrowUp"):
                page.keyboard.up(key)
            page.wait_for_timeout(300)
        t = page.evaluate("studio.now.t")
        print(f"minute {minute + 1:2d}: {resident(pid):.1f} MiB  (drive at {t:.0f} s)", flush=True)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cold", action="store_true", help="nothing is compiled before")
    parser.add_argument("--minutes", type=int, default=0, help="of driving, to watch the memory")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, browsing() as browser:
        environ = {**os.environ, "PYTHONPATH": str(ROOT)}
        if given.cold:
            environ["NUMBA_CACHE_DIR"] = f"{folder}/cache"
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        begun = time.perf_counter()
        command = [sys.executable, "-m", "wheelchair_gym", "studio", "--port", "0", "--out", folder]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environ) as server:
            assert server.stdout is not None
            url = server.stdout.readline().strip()
            listens = time.perf_counter() - begun
            page.goto(url)
            shown = time.perf_counter() - begun
            until(page, "window.studio?.running && studio.now", 300.0)
            print(
                f"{'cold' if given.cold else 'warm'}: address after {listens:.1f} s, page after "
                f"{shown:.1f} s, first picture after {time.perf_counter() - begun:.1f} s"
            )
            if not given.cold:
                latencies(page, 20)
                print(
                    f"another drive begins in {start_drive(page, 'scene:empty', 'slide', 40):.2f} s"
                )
                latencies(page, 40)
                start_drive(page, "scene:people", "slide", 40)
                watched_rate(page, 40)
            if given.minutes:
                start_drive(page, "scene:empty", "slide", 40)
                soak(page, server.pid, given.minutes)
            server.terminate()


if __name__ == "__main__":
    main()
