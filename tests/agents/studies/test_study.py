"""Studies: every published figure has its row; runs are the same for all workers, or resumed."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from agents.studies import runner as module
from agents.studies.claims import Evidence
from agents.studies.model import Results, published
from agents.studies.runner import CLAIMS, STORE, STUDIES, run_studies
from tests.conftest import ROOT, output_of

TABLES = [f"t1-3.{k}" for k in range(1, 14)]


def small(name, rows=2, strata=2):
    whole = STUDIES[name]
    few = tuple(
        replace(row, jobs=dict(list(row.jobs.items())[:strata])) for row in whole.rows[:rows]
    )
    return replace(whole, rows=few, claims=(), figures=lambda r: {})


def test_every_published_figure_stands_in_a_row():
    assert set(TABLES) | {"p2", "r1", "t2"} <= set(STUDIES)
    for name, study in STUDIES.items():
        given = {row.label: dict(row.published) for row in study.rows if row.published}
        assert given == published(name), name
        labels = [row.label for row in study.rows]
        assert len(set(labels)) == len(labels)
        shown = {metric.key for metric in study.metrics}
        assert all(set(of) <= shown for of in given.values()), name
        assert study.claims, name


def test_claims_name_rows_and_metrics_of_their_study():
    for study in STUDIES.values():
        names = {name for row in study.rows for name in (row.label, row.group, row.series)}
        for claim in study.claims:
            named = [*claim.rows, *(name for pair in claim.pairs for name in pair)]
            assert {name for name in named if isinstance(name, str)} <= names - {""}, claim.text
            assert claim.test.startswith("share") or claim.metric in study.margins, claim.text
        assert set(study.margins) <= {metric.key for metric in study.metrics}


def test_an_effect_as_large_as_the_printed_one_never_refutes_a_claim():
    """Law of all margins: none hides a difference that the source itself prints."""
    capped = 0
    for study in STUDIES.values():
        for claim in study.claims:
            printed, margin = claim.printed_effect(study), claim.margin(study)
            if margin is None and claim.test == "between" and "Misprint" not in claim.text:
                assert claim.low <= printed <= claim.high or np.isnan(printed), claim.text
            elif margin is not None and np.isfinite(printed):
                assert margin > 0.0
                equal = claim.test in ("level", "between")
                assert (margin >= abs(printed)) if equal else (margin <= abs(printed)), claim.text
                capped += margin != study.margins[claim.metric]
    assert capped  # P2's 0.025 % is less than half a per cent


@pytest.mark.parametrize(
    ("effect", "spread", "verdict"),
    [
        (-0.0004, 1e-4, "holds"),
        (-0.0004, 4e-3, "cannot be decided"),  # although it is surely less than half a per cent
        (0.0, 1e-4, "does not hold"),
    ],
)
def test_a_difference_as_small_as_the_printed_one_is_not_taken_for_none(effect, spread, verdict):
    """P2 prints -0.025 %: so small an effect may hold, and none at all does not."""
    study = STUDIES["p2"]
    noise = spread * np.random.default_rng(0).normal(size=(2, 400))
    of = {"pso": 11.4 * (1.0 + noise[0]), "pso_chaotic": 11.4 * (1.0 + effect + noise[1])}
    runs = [
        (row, "eight discs", seed, {"solved": True, "length_m": length})
        for row, lengths in of.items()
        for seed, length in enumerate(lengths)
    ]
    assert study.claims[0].judge(Results(study, runs)).verdict(CLAIMS) == verdict


def test_the_published_verdicts_are_those_of_all_claims():
    found = json.loads((ROOT / "docs/results/data/verdicts.json").read_text("utf-8"))["rows"]
    claims = [(s.name, c.text, c.source) for s in STUDIES.values() for c in s.claims]
    assert [(row["study"], row["claim"], row["source"]) for row in found] == claims
    for row in found:
        figures = [np.nan if row[k] is None else row[k] for k in ("low", "effect", "high")]
        assert figures == sorted(figures) or np.isnan(figures).any(), row["claim"]
        p = row["p_for"], row["p_against"]
        assert Evidence(*p, *figures, "", "").verdict(CLAIMS) == row["verdict"]


def test_published_figures_are_those_of_the_sources(shared):
    """Each number of the reading's tables, and each line of the thesis's own tables."""
    page = (shared / "SEEDS.md").read_text()
    tables = {
        "t1-3.1": page[page.index("| T1 table 3.1") : page.index("Trends its tables")],
        "r1": page[page.index("| goal | PSO fixed") : page.index("| (10, 2.5)")],
        "t2": page[page.index("| lab 1 |") : page.index("Claims to check")],
    }
    for name, text in tables.items():
        ours = {value for of in published(name).values() for value in of.values()}
        lines = [
            line for line in text.splitlines() if re.match(r"\| (RRT|local|global|lab|\()", line)
        ]
        for line in lines:
            cells = re.sub(r"\(\d.*?\)", "", line.split("|", 2)[2]).split("|")[:4]
            found = {float(v) for cell in cells for v in re.findall(r"\d+\.\d+", cell)}
            assert found, line
            assert found <= ours, line
    thesis = next((shared / "seeds").glob("000_*.txt")).read_text()
    for name in TABLES:
        for row, of in published(name).items():
            line = "\t".join(rf"{of[key]!r}0*" for key in ("time_s", "length_m", "nodes"))
            assert re.search(line.replace(".", r"\."), thesis), (name, row)


def test_rows_are_independent_draws_unless_they_are_paired():
    for study in STUDIES.values():
        seeds = [study.seeds(row, 100) for row in study.rows]
        if study.paired:
            assert len(set(seeds)) == 1
        else:
            assert len({s for of in seeds for s in of}) == 100 * len(study.rows)


def test_more_runs_add_to_those_that_are_stored(tmp_path, monkeypatch):
    """Resuming of stopped runs is a law of all stores: tests/agents/evaluation."""
    real, made = module.measure, []
    monkeypatch.setattr(module, "_compile_all", lambda jobs: None)
    monkeypatch.setattr(module, "measure", lambda job: made.append(job) or real(job))
    for runs, count in ((3, 12), (3, 12), (4, 16)):
        run_studies([small("t1-3.5")], tmp_path, runs=runs, progress=False)
        assert len(made) == count
    assert len((tmp_path / STORE).read_text().splitlines()) == 16


@pytest.mark.parametrize("name", ["t1-3.1", "p1", "p2", "r1", "t2", "t1-1.1", "control"])
def test_each_kind_of_run_repeats_itself(name):
    study = STUDIES[name]
    row = study.rows[0]
    job = {**next(iter(row.jobs.values())), "seed": 3}
    a, b = (module.measure(job) for _ in range(2))
    assert {k: v for k, v in a.items() if not k.endswith("_s")} == {
        k: v for k, v in b.items() if not k.endswith("_s")
    }
    assert {"solved", "status", "time_s"} <= set(a)
    json.dumps(a, allow_nan=False)


def test_a_page_says_its_verdicts_first_and_needs_no_other_file(tmp_path, capsys):
    words = ["study", "t2", "--runs", "2", "--jobs", "1", "--quiet", "--out", tmp_path]
    said = output_of(words, capsys)
    page = (tmp_path / "report.html").read_text()
    assert "claims" in said
    assert page.index("claims") < page.index("<table")
    assert not re.search(r"(src|href)='(?!data:|#)", page)
    result = json.loads((tmp_path / "t2.json").read_text())
    assert len(result["rows"]) == len(STUDIES["t2"].rows)
    assert result["provenance"]["versions"]["python"]
    for row in result["rows"][:9]:
        assert row["figures"]["length_m"]["published"] > 0
    assert f"{CLAIMS} claims" in result["provenance"]["judged together"]
    assert len(list((tmp_path / "figures").glob("t2-*.png"))) == 3
