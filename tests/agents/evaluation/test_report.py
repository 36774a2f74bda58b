"""A report stands alone, shows every failure, and repeats the numbers it was given."""

import base64
import csv
import html
import io
import math
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from agents.evaluation import plots as figures
from agents.evaluation.compare import COLUMNS, PARTS, SUITES, markdown, webp, write_report
from agents.evaluation.tables import csv_table
from agents.learning.weights import shipped
from wheelchair_gym.rendering import write_png
from wheelchair_gym.scenes.arena import FOOTPRINT, _turns

VOID = {"meta", "link", "img", "br", "wbr", "hr", "input"}
POLICIES, SCENES = ["dwa", "a|b <i>&"], ["clutter", "office"]
VIDEO = {"file": "episode.mp4", "policy": "dwa", "scene": "office", "seed": 7}


def evaluation():
    """Two policies on two scenes, three episodes each: one good, one hit, one late."""
    outcomes = ["success", "collision", "timeout"]
    records = [
        {
            "policy": policy, "scene": scene, "seed": seed, "outcome": outcome,
            "success": outcome == "success", "arrived": outcome == "success",
            "contact": outcome == "collision", "time": 10.5 + seed, "length": 6.0 + seed,
            "geodesic": 5.8, "shortest": 5.5, "spl": 0.9, "clearance_min": 0.1 * seed,
            "clearance_mean": 0.5, "jerk_rms": 0.4, "rough_share": 0.01, "energy_per_m": None,
            "plan_ms": None, "act_ms_p50": 0.3, "act_ms_p95": 0.6,
            "picture": None if outcome == "success" else f"pictures/{p}{s}{seed}.png",
        }
        for p, policy in enumerate(POLICIES)
        for s, scene in enumerate(SCENES)
        for seed, outcome in enumerate(outcomes)
    ]  # fmt: skip
    summary = [
        {
            "policy": policy, "scene": scene, "episodes": 6 if scene == "all" else 3,
            "success": 1 / 3 + 0.1 * p, "success_low": 0.097, "success_high": 0.7,
            "collision": 1 / 3, "collision_low": 0.0968, "collision_high": 0.7,
            "timeout": 1 / 3, "timeout_low": 0.0968, "timeout_high": 0.7, "arrived": 1 / 3,
            "at_fault": 1 / 6, "wide": 0.5, "wide_low": 0.15, "wide_high": 0.85, "margin": 0.07,
            "barn": 0.21, "barn_own": 0.34, "halts": 1.5, "replans": 2.25, "accel_rms": 0.2,
            "spl": 0.31 + p, "spl_grid": 0.32 + p, "time": 11.5, "length": 7.03,
            "clearance_min": 0.123, "clearance_mean": 0.5, "jerk_rms": 0.456, "rough_share": 0.017,
            "energy_per_m": None, "plan_ms_p50": None, "plan_ms_p95": None, "act_ms_p50": 0.321,
            "act_ms_p95": 0.654,
        }
        for p, policy in enumerate(POLICIES)
        for scene in ["all", *SCENES]
    ]  # fmt: skip
    return {
        "title": "Two < three & more", "command": "wheelchair compare --out 'runs/a b'",
        "provenance": {"commit": "0123abc", "seeds": [0, 1, 2, 3], "machine": {"cores": 2}},
        "policies": POLICIES, "scenes": SCENES, "records": records, "summary": summary,
        "video": None,
    }  # fmt: skip


class Page(HTMLParser):
    """Checks that tags close in order, and collects what they carry."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.rows, self.cell = [], [], [], False
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        assert len({name for name, _ in attrs}) == len(attrs)
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if {"td", "th"} & set(self.open):
            self.rows[-1][-1] += " " + data

    def of(self, tag):
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    what = evaluation()
    rng = np.random.default_rng(0)
    for record in what["records"]:
        if record["picture"]:
            image = rng.integers(0, 256, (8, 8, 3)).astype(np.uint8)
            write_png(folder / record["picture"], image)
    text = write_report(what, folder).read_text(encoding="utf-8")
    return what, folder, text, Page(text)


def test_nothing_outside_is_needed(made):
    _, folder, text, page = made
    for _, attributes in page.tags:
        assert attributes.get("src", "data:").startswith("data:")
    links = [link["href"] for link in page.of("a") if not (folder / link["href"]).is_file()]
    assert links == []
    assert not re.search(r"https?:|//[a-z]|@import|url\(", re.sub(r"data:[^'\"]*", "", text))


def test_every_failure_is_shown_with_its_own_picture_and_words(made):
    what, folder, _, page = made
    shown = {image["src"]: image["alt"] for image in page.of("img")}
    failed = [record for record in what["records"] if not record["success"]]
    assert len(failed) == 8
    for record in failed:
        data = base64.b64encode(webp(folder / record["picture"])).decode()
        said = shown[f"data:image/webp;base64,{data}"]
        assert f"{record['policy']}, {record['scene']}, seed {record['seed']}" in said
        assert ("hit something" if record["contact"] else "out of time") in said
        assert f"{record['time']:.1f} s" in said


def test_a_failure_without_its_picture_is_still_told(tmp_path):
    text = write_report(evaluation(), tmp_path).read_text(encoding="utf-8")
    assert text.count("no picture") == 8
    assert text.count("seed 1</strong>") == 4


def test_tables_repeat_the_summary(made):
    what, _, _, page = made
    rows = {}
    for row in page.rows:
        cells = [" ".join(cell.split()) for cell in row]
        if len(cells) in [len(part) + 1 for _, part in PARTS]:
            cells.insert(1, "all")
        rows.setdefault((cells[0].replace(" ", ""), cells[1]), []).extend(cells[2:])
    for given in what["summary"]:
        cells = rows[given["policy"].replace(" ", ""), given["scene"]]
        assert len(cells) == len(COLUMNS)
        for cell, column in zip(cells, COLUMNS, strict=True):
            value = given[column.key]
            figure, *interval = cell.split()
            if value is None:
                assert cell == "-"
                continue
            unit = 0.5 * 10.0**-column.digits + 1e-9
            assert float(figure) == pytest.approx(column.factor * value, abs=unit)
            if column.interval:
                low, high = map(float, interval[0].split("-"))
                assert low == pytest.approx(100 * given[f"{column.key}_low"], abs=unit)
                assert high == pytest.approx(100 * given[f"{column.key}_high"], abs=unit)


def test_markdown_has_a_row_for_each_row_and_as_many_cells_as_headings():
    what = evaluation()
    lines = [line for line in markdown(what).splitlines() if line.startswith("|")]
    cells = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines]
    assert len(lines) == 2 + len(what["summary"])
    assert {len(row) for row in cells} == {len(COLUMNS) + 2}
    assert "33.3 (9.7-70.0)" in lines[-1] or "43.3 (9.7-70.0)" in lines[-1]


def test_every_scene_lists_its_best_first_and_failures_of_the_best_come_first(made):
    page = made[3]
    names = [[" ".join(cell.split()) for cell in row[:2]] for row in page.rows]
    names = [name for name in names if name[1] in SCENES]
    assert names == 2 * [[p, s] for s in SCENES for p in ("a|b <i>&", "dwa")]
    shown = [
        image["alt"].partition(", ")[0] for image in page.of("img") if ", seed" in image["alt"]
    ]
    assert shown == ["a|b <i>&"] * 4 + ["dwa"] * 4


def test_no_cell_of_csv_is_a_formula_and_numbers_are_numbers():
    """Only a number begins with a sign, for any first character of a text."""
    texts = [f"{first}1+cmd" for first in "=+-@\t\ra1'"]
    numbers = [-1, -2.5, 3, "-0.5", "+1e-3", -math.inf]
    rows = [{"=key": value} for value in (*texts, *numbers)]
    header, *cells = [row[0] for row in csv.reader(io.StringIO(csv_table(rows), newline=""))]
    assert header == "'=key"
    assert cells[: len(texts)] == [text if text[0] in "a1'" else f"'{text}" for text in texts]
    assert [float(cell) for cell in cells[len(texts) :]] == [float(one) for one in numbers]


def test_pictures_beyond_the_budget_are_linked(made, tmp_path, monkeypatch):
    what, folder, text, page = made
    first = next(image["src"] for image in page.of("img") if "webp" in image["src"])
    monkeypatch.setattr("agents.evaluation.compare._MAX_PICTURES", len(first) + 1)
    heavy = Page(write_report(what, folder).read_text(encoding="utf-8"))
    shown = [image["src"] for image in heavy.of("img") if ", seed" in image["alt"]]
    assert [source.startswith("data:") for source in shown] == [True, True] + 6 * [False]
    assert all((folder / source).is_file() for source in shown[2:])
    (folder / "report.html").write_text(text, encoding="utf-8")


def test_images_columns_and_provenance_are_told_in_words(made):
    _, _, text, page = made
    images = page.of("img")
    assert len(images) > 3
    assert all(image["alt"].strip() for image in images)
    told = text[text.index("What the columns mean") : text.index("<h2>Figures")]
    assert told.count("<dt>") == len(COLUMNS)
    assert len(re.findall(r"<dd>[^<]{10,}</dd>", told)) == len(COLUMNS)
    for word in ("0123abc", "machine.cores", "0 to 3", "--out &#39;runs/a b&#39;"):
        assert word in text


def test_same_evaluation_same_bytes(made, tmp_path):
    what, folder, text, _ = made
    assert write_report(what, folder).read_text(encoding="utf-8") == text


def test_a_video_is_embedded_and_a_long_one_plays_from_beside_the_page(tmp_path, monkeypatch):
    (tmp_path / "episode.mp4").write_bytes(b"\0\1film")
    embedded = "data:video/mp4;base64," + base64.b64encode(b"\0\1film").decode()
    for source in (embedded, "episode.mp4"):
        text = write_report(evaluation() | {"video": VIDEO}, tmp_path).read_text("utf-8")
        assert Page(text).of("video")[0]["src"] == source
        monkeypatch.setattr("agents.evaluation.compare._LARGEST_VIDEO", 3)
    assert "dwa, office, seed 7" in text


def test_a_ladder_of_doors_is_drawn_with_its_physical_limit(monkeypatch):
    rungs = [
        {"name": "doorway", "door_width": door, "corridor_width": 1.05} for door in (0.95, 0.85)
    ]
    provenance = {**evaluation()["provenance"], "config": {"scenes": rungs}}
    drawn = []
    monkeypatch.setattr(figures, "as_svg", lambda figure: drawn.append(figure) or b"")
    assert "doors" not in figures.figures(evaluation())
    assert "doors" in figures.figures(evaluation() | {"provenance": provenance})
    twice = {**provenance, "config": {"scenes": [rungs[0], rungs[0]]}}
    assert "doors" not in figures.figures(evaluation() | {"provenance": twice})
    bare = {**provenance, "config": {"scenes": [{"name": "doorway"}, rungs[0]]}}
    assert "doors" in figures.figures(evaluation() | {"provenance": bare})
    figures.figures(evaluation() | {"provenance": provenance})
    for axes, share in zip(drawn[-1].axes, ("33", "43"), strict=True):
        assert [text.get_text() for text in axes.texts] == [share, share]
        limit, spare = (line.get_data() for line in axes.lines)
        assert (limit[1] < spare[1]).all()
        for corridor, door in np.transpose(spare)[::10]:
            assert _turns(door, corridor, 0.0499, FOOTPRINT)
            assert not _turns(door, corridor, 0.0501, FOOTPRINT)


def test_no_mark_of_a_figure_is_cut_off_and_no_curve_is_left_out(monkeypatch):
    what = evaluation()
    for record in what["records"]:
        record["clearance_min"] = 0.0 if record["policy"] == "dwa" else 0.3
    drawn = []
    monkeypatch.setattr(figures, "as_svg", lambda figure: drawn.append(figure) or b"")
    figures.figures(what)
    _, times, clearances = (figure.axes[0] for figure in drawn)
    for marks in times.collections:
        points = marks.get_offsets()
        assert (points > (times.get_xlim()[0], times.get_ylim()[0])).all()
        assert (1.03 * points < (times.get_xlim()[1], times.get_ylim()[1])).all()
    assert len(clearances.lines) == 2
    for line in clearances.lines:
        x, y = line.get_data()
        assert clearances.get_xlim()[0] < x.min()
        assert x.max() <= clearances.get_xlim()[1]
        assert y.max() == 100.0


def lead(path):
    page = path.read_text(encoding="utf-8")
    first = page[page.index("class='answer'>") :].partition(">")[2]
    assert first.startswith("<p class='lead'>")
    return html.unescape(re.sub(r"<(?!i>)[^>]+>", "", first.partition("</p>")[0]))


def test_the_first_sentence_says_who_wins_where(tmp_path):
    what = evaluation()
    what["records"][7]["success"] = True  # of the second policy, on the first scene
    what["kinds"] = {POLICIES[0]: "learned", POLICIES[1]: "planned"}
    said = (
        "Best policy by contacts, then by success: none on clutter or office, where 95 % intervals "
        "overlap, all planned policies 3 of 6, all learned policies 2 of 6."
    )
    assert lead(write_report(what, tmp_path)) == said
    assert markdown(what).splitlines()[6] == said
    for row in what["summary"]:
        row |= {"authority": 0.1} | ({"collision_low": 0.8} if row["policy"] == "dwa" else {})
        row |= {"collision": 0.9} if row["policy"] == "dwa" else {}
    assert lead(write_report(what, tmp_path)).startswith(
        "Best assistant by contacts, then by success: a|b <i>& on clutter (33.3 % contacts, 43.3 % "
    )


def test_suites_have_all_learned_policies_and_all_chains_of_rrt_star_woa():
    assert set(shipped()) <= {"ppo_rear", *SUITES["league"].policies}  # which drives another chair
    chains = [f"rrt_star_woa_{a}+{b}" for a in ("local", "global") for b in ("thesis", "controls")]
    assert all(one in SUITES[name].policies for one in chains for name in ("whales", "league"))
