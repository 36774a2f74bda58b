"""`wheelchair participants`: list, check and delete the data of participants."""

from __future__ import annotations

import argparse
from pathlib import Path

from agents.cli.arguments import report
from agents.evaluation.tables import columns_of, count, make_table
from agents.people.folder import delete
from agents.people.session import read_folder
from wheelchair_gym.base.settings import InputError


def read(given: argparse.Namespace) -> int:
    """Read every record of an experiment with its checksum, and list the participants."""
    people = read_folder(given.folder)[1]
    rows, records = [one.row() for one in people], sum(one.records for one in people)
    table = make_table("", columns_of("progress"), [rows]).text()
    report(given, rows, f"{table}\n{count(records, 'record')}: every checksum is right")
    return 0


def remove(given: argparse.Namespace) -> int:
    """Delete everything of a participant, after a confirmation."""
    question = f"delete all data of participant {given.number} in {given.folder}? [y/N] "
    try:
        sure = given.yes or input(question).strip().lower() in ("y", "yes")
    except EOFError:  # nobody is there to answer
        sure = False
    if not sure:
        raise InputError("nothing was deleted; expected y, or --yes")
    files = delete(Path(given.folder), given.number)
    print(f"deleted {count(files, 'file')}; the number {given.number} is not used again")
    return 0
