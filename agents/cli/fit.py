"""`wheelchair fit`, `replay --simulate`: settings from drives, and how well they predict drives."""

import argparse
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from agents.cli.arguments import report
from agents.evaluation.provenance import command_line, provenance, write_json
from agents.evaluation.tables import Table, columns_of, json_value, make_table, write_page
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.identification.fit import AGREES, Finding, fit, settings_of
from wheelchair_gym.identification.logs import Drive, read_drives
from wheelchair_gym.identification.predict import check_commands, predict
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings

Simulations = Mapping[str, tuple[ChairSettings, SensorSettings]]


def run(given: argparse.Namespace) -> int:
    """Fit, write the settings that were found, and print the findings."""
    drives = _read(given.logs, given.config)
    first = drives[0]
    for drive in drives[1:]:
        if (drive.chair.drive, drive.sensors.lasers) != (first.chair.drive, first.sensors.lasers):
            raise InputError(f"{drive.name}: recorded with other settings than {first.name}")
    held = _read([given.hold], given.config) if given.hold else []
    for drive in held:
        check_commands(drive)  # before minutes of fitting
    logs = [(drive.name, drive.log) for drive in drives]
    found = fit(logs, first.chair, first.sensors, given.mass, given.seed, given.wall)
    before, after = (first.chair, first.sensors), (found.chair, found.sensors)
    rows = prediction_rows(held, {"before": before, "fitted": after})
    tables = [findings_table(found.findings), _predictions_table(rows)]
    files: dict[str, Any] = settings_of(found)
    files["fit.json"] |= {"predictions": rows}
    notes = [*found.notes, found.weakest]
    lines = [table.text() for table in tables if any(table.groups)] + notes
    if given.out is not None:
        folder, of = Path(given.out), ", ".join(drive.name for drive in drives)
        for name, content in files.items():
            write_json(folder / name, content)
        write_page(
            folder / "report.html", "fit.html", title="A chair, fitted", of=of, notes=notes,
            tables=tables, source={"command": command_line(), "provenance": provenance()},
        )  # fmt: skip
        lines.append(f"written to {given.out}: {', '.join(files)}, report.html")
    report(given, files["fit.json"], "\n".join(lines))
    return 0


def replay_simulated(given: argparse.Namespace) -> int:
    """Say how far a simulated chair is from a recorded one; 1 if farther than --bar."""
    drives = _read([given.file], given.config)
    if given.episode is not None:
        if given.episode >= len(drives):
            raise InputError(f"--episode {given.episode}: {given.file} has {len(drives)}, from 0")
        drives = [drives[given.episode]]
    rows: list[dict[str, Any]] = []
    for drive in drives:
        simulated = drive.chair, drive.sensors
        if given.config is not None:
            settings = env_settings(given.config)
            simulated = settings.chair, settings.sensors
        rows += prediction_rows([drive], {given.config or "as recorded": simulated})
    bar = 0.02 if given.bar is None else given.bar  # m
    errors = [row["position_95"] for row in rows]  # None: a log too short for the window
    good = all(error is not None and error <= bar for error in errors)
    told = f"the simulation {'predicts' if good else 'does not predict'} the drive to {bar:g} m"
    report(given, rows, f"{_predictions_table(rows).text()}\n{told}")
    return 0 if good else 1


def _read(files: Iterable[str], config: str | None) -> list[Drive]:
    """The drives of logs; the config is that of robots whose logs have no settings."""
    settings = env_settings(config)
    return [
        drive for file in files for drive in read_drives(file, settings.chair, settings.sensors)
    ]


def prediction_rows(drives: Iterable[Drive], simulations: Simulations) -> list[dict[str, Any]]:
    """Rows of the errors of simulations by their names, of each drive and horizon.

    `KEY` is the median of a figure of `Prediction`, `KEY_95` the 95th percentile.
    """
    rows = []
    for drive in drives:
        found = predict(drive, list(simulations.values()))
        for of, predictions in zip(simulations, found, strict=True):
            for one in predictions:
                row: dict[str, Any] = {"drive": drive.name, "of": of}
                for key, value in one._asdict().items():
                    if isinstance(value, tuple):
                        row[key], row[f"{key}_95"] = map(json_value, value)
                    else:
                        row[key] = value
                rows.append(row)
    return rows


def _predictions_table(rows: list[dict[str, Any]]) -> Table:
    caption = "A simulated chair that is driven as the recorded one was: medians, 95th percentiles"
    return make_table(caption, columns_of("predictions"), [rows] if rows else [])


def findings_table(findings: Iterable[Finding], check: bool = False) -> Table:
    """Values, intervals and status; with `check`, whether the config agrees, too."""
    rows = [
        one._asdict() | {"value_low": one.low, "value_high": one.high, "agrees": judged(one)}
        for one in findings
    ]
    columns = columns_of("findings")
    return make_table("Findings", columns if check else columns[1:], [rows])


def judged(one: Finding) -> str:
    """Return ok, OFF where the config differs by more than its limit, or nothing without one."""
    limit = AGREES.get(one.name.split()[0])
    if limit is None or one.value is None or one.before is None:
        return ""
    return "ok" if abs(one.value - one.before) <= limit else "OFF"
