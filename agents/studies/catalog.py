"""All studies by name, and how many claims are judged together."""

from __future__ import annotations

from typing import Final

from agents.studies import control_figure, disc_swarms, lab_methods, smoothing_paper, thesis_tables
from agents.studies.model import Study
from wheelchair_gym.config import InputError

_MODULES = (thesis_tables, smoothing_paper, disc_swarms, lab_methods, control_figure)
STUDIES: Final[dict[str, Study]] = {
    study.name: study for module in _MODULES for study in module.STUDIES
}
# Verdicts are corrected for all claims, whichever studies were asked for: they do not change
# with the company that they are in.
CLAIMS: Final = sum(len(study.claims) for study in STUDIES.values())


def chosen(name: str) -> list[Study]:
    """One study by name, or `all`.

    Raises:
        InputError: there is none of that name.
    """
    if name == "all":
        return list(STUDIES.values())
    if name not in STUDIES:
        raise InputError(f"study {name!r} is unknown; known: all, {', '.join(STUDIES)}")
    return [STUDIES[name]]
