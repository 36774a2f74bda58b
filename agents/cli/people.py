"""`wheelchair studio`, `participants` and `report`: people drive in the browser, and their data."""

import argparse
from importlib.util import find_spec
from pathlib import Path

from agents.cli.arguments import map_scenes, refuse
from agents.cli.arguments import report as report_result
from agents.evaluation.tables import columns_of, count, make_table
from wheelchair_gym.base import settings
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs.settings import env_settings


def studio(given: argparse.Namespace) -> int:
    """Serve the page in the browser until Ctrl-C."""
    if missing := [name for name in ("starlette", "uvicorn", "websockets") if not find_spec(name)]:
        needs = ", ".join(missing)
        raise InputError(f"wheelchair studio needs {needs}: pip install 'wheelchair_gym[studio]'")
    from agents.studio.warm_up import WarmUp

    own_map = next(iter(map_scenes(given)), None)
    if own_map is not None:
        from wheelchair_gym.maps import read_any_map

        solid = own_map.get("unknown_is_solid", True)
        read_any_map(own_map["path"], solid, own_map.get("resolution"))  # refuses what is wrong
    env_settings(None, model=given.model)  # refuses what is wrong
    folder, study = Path(given.out), None
    if given.study is not None:
        from agents.people.protocol import Protocol

        refuse(given, ("model",), "expected without --study: its scenes say which chair is driven")
        if given.participant:
            refuse(given, ("map", "runs"), "expected without --participant, which locks its page")
        study = settings.read(Protocol, given.study)
        folder /= Path(given.study).stem
    elif given.participant:
        raise InputError("--participant needs --study FILE")
    warm_up = WarmUp()
    warm_up.start()  # while the server is loaded
    try:
        from agents.studio.server import Access, Studio, serve

        access = Access(lan=given.lan)
        runs = Path(given.runs)
        made = Studio(folder, own_map, access, study, runs, warm_up, given.model, given.participant)
        serve(made, given.port)
    finally:
        warm_up.close()
    return 0


def read(given: argparse.Namespace) -> int:
    """Read every record of an experiment with its checksum, and list the participants."""
    from agents.people.session import read_folder

    people = read_folder(given.folder)[1]
    rows, records = [one.row() for one in people], sum(one.records for one in people)
    table = make_table("", columns_of("progress"), [rows]).text()
    report_result(given, rows, f"{table}\n{count(records, 'record')}: every checksum is right")
    return 0


def remove(given: argparse.Namespace) -> int:
    """Delete everything of a participant, after a confirmation."""
    from agents.people.folder import delete

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


def report(given: argparse.Namespace) -> int:
    """Compare the conditions of an experiment with participants."""
    from agents.people.report import write_report

    tables, page = write_report(given.folder, given.bom)
    rows = {table.caption: [[cell.text for cell in row] for group in table.groups for row in group]
            for table in tables}  # fmt: skip
    text = "\n\n".join(f"{one.caption}\n{one.text()}\n{one.note}".rstrip() for one in tables)
    report_result(given, rows, f"{text}\n\n{page}")
    return 0
