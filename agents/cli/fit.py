"""`wheelchair fit`: the settings of a chair from logs of its drives."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from agents.cli.arguments import report
from agents.evaluation.provenance import write_json
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.envs.settings import env_settings
from wheelchair_gym.identification.fit import AGREES, Finding, fit, settings_of
from wheelchair_gym.identification.logs import Drive, read_drives


def run(given: argparse.Namespace) -> int:
    """Fit, write the settings that were found, and print the findings."""
    settings = env_settings(given.config)
    drives: list[Drive] = []
    for file in given.logs:
        drives += read_drives(file, settings.chair, settings.sensors)
    first = drives[0]
    for drive in drives[1:]:
        if (drive.chair.drive, drive.sensors.laser) != (first.chair.drive, first.sensors.laser):
            raise InputError(f"{drive.name}: recorded with other settings than {first.name}")
    logs = [(drive.name, drive.log) for drive in drives]
    found = fit(logs, first.chair, first.sensors, given.mass, given.seed)
    files: dict[str, Any] = settings_of(found)
    lines = [line_of(one) for one in found.findings] + list(found.notes)
    if given.out is not None:
        for name, content in files.items():
            write_json(Path(given.out) / name, content)
        lines.append(f"written to {given.out}: {', '.join(files)}")
    report(given, files["fit.json"], "\n".join(lines))
    return 0


def judged(one: Finding) -> str:
    """Return ok, OFF where the config differs by more than its limit, or nothing without one."""
    limit = AGREES.get(one.name)
    if limit is None or one.value is None or one.before is None:
        return ""
    return "ok" if abs(one.value - one.before) <= limit else "OFF"


def line_of(one: Finding) -> str:
    """Return a line about a finding: value, interval, status, and the value of the config."""
    before = "" if one.before is None else f"config {one.before:.5g}"
    if one.value is None or one.low is None or one.high is None:
        return f"{one.name:16} {'':34} {one.status:16}  {before}"
    value = f"{one.value:.5g} ({one.low:.5g} to {one.high:.5g}) {one.unit}"
    return f"{one.name:16} {value:34} {one.status:16}  {before}".rstrip()
