"""`wheelchair study`: the source documents' experiments again."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from agents.cli.arguments import add_json, add_workers, count, report


def add(parts: Any) -> None:
    """Add the subcommand's parser."""
    parser: argparse.ArgumentParser = parts.add_parser(
        "study",
        help="measure the source documents' experiments again",
        description="Run what a table or figure of the sources ran, set our figures beside the "
        "published ones, and judge its claims. Finished runs are stored: the same command after "
        "Ctrl-C, or with more runs, computes only what is missing.",
        epilog="example: wheelchair study t1-3.5 --runs 100 --jobs 2",
    )
    parser.add_argument(
        "name", metavar="NAME",
        help="t1-3.1 to t1-3.13, t1-1.1, p1, p2, r1, t2, control, or all",
    )  # fmt: skip
    many = parser.add_mutually_exclusive_group()
    many.add_argument("--quick", action="store_true", help="few runs, for a first look")
    many.add_argument(
        "--runs", type=count, metavar="N", help="per row and map or goal (100 or 400, by study)"
    )
    add_workers(parser)
    parser.add_argument("--out", metavar="DIR", default="runs/study", help="default runs/study")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    add_json(parser)
    parser.set_defaults(run=run)


def run(given: argparse.Namespace) -> int:
    """Conduct a study and write everything to the folder."""
    from pathlib import Path

    from agents.evaluation.provenance import command_line, cores
    from agents.evaluation.runs import StoppedError
    from agents.studies.catalog import chosen
    from agents.studies.chapter import told
    from agents.studies.conduct import conduct

    studies = chosen(given.name)
    try:
        chapters = conduct(
            studies, given.out, runs=given.runs, quick=given.quick, jobs=given.jobs or cores(),
            engine=given.engine, progress=not given.quiet,
            title=studies[0].title if len(studies) == 1 else None,
        )  # fmt: skip
    except StoppedError as stopped:
        print(f"wheelchair: stopped; {stopped}; resume with: {command_line()}", file=sys.stderr)
        return 130
    page = Path(given.out) / "report.html"
    report(given, chapters, f"{told(list(chapters.values()))}\n{page}")
    return 0
