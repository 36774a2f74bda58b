"""`wheelchair participants`: list, check and delete the data of participants."""

from __future__ import annotations

import argparse
from pathlib import Path

from agents.cli.arguments import report
from agents.evaluation.tables import columns_of, count, make_table
from agents.people.folder import delete, digest_of, read_folder
from wheelchair_gym.base.settings import InputError


def list_(given: argparse.Namespace) -> int:
    """List the participants of an experiment with their progress."""
    _, people = read_folder(given.folder)
    rows = [one.row() for one in people]
    report(given, rows, make_table("", columns_of("progress"), [rows]).text())
    return 0


def check(given: argparse.Namespace) -> int:
    """Check every record of an experiment against its checksum."""
    protocol, people = read_folder(given.folder)
    records = sum(one.records for one in people)
    found = {"participants": len(people), "records": records, "protocol": digest_of(protocol)}
    who = count(len(people), "participant")
    report(given, found, f"{who}, {count(records, 'record')}: every checksum is right")
    return 0


def delete_(given: argparse.Namespace) -> int:
    """Delete everything of a participant, after a confirmation."""
    question = f"delete all data of participant {given.number} in {given.folder}? [y/N] "
    if not given.yes and input(question).strip().lower() not in ("y", "yes"):
        raise InputError("nothing was deleted; expected y, or --yes")
    files = delete(Path(given.folder), given.number)
    print(f"deleted {count(files, 'file')}; the number {given.number} is not used again")
    return 0
