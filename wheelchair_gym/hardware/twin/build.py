"""Building the firmware and the emulator from source, once for each state of the sources."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from wheelchair_gym.config import InputError

FIRMWARE = Path(__file__).resolve().parents[1] / "firmware"
_SIMAVR = Path("/usr/include/simavr/sim_avr.h")
# What each target needs, and where it shows.
_NEEDS = {
    "drive.elf": ("make", "avr-gcc"),
    "range.elf": ("make", "avr-gcc"),
    "libemulator.so": ("make", "cc", "simavr"),
    "libfirmware.so": ("make", "cc"),
    "fuzz": ("make", "cc"),
}


def _sources() -> list[Path]:
    twin = Path(__file__).resolve().parent
    files = [path for folder in (FIRMWARE, twin) for path in folder.glob("*.[ch]")]
    return [*sorted(files), FIRMWARE / "Makefile"]


@cache
def _folder() -> Path:
    """Where this state of the sources is built: compiled code never lies beside other sources."""
    digest = hashlib.sha256(b"\0".join(path.read_bytes() for path in _sources())).hexdigest()[:16]
    cache_home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache_home / "wheelchair_gym" / f"firmware-{digest}"


def missing_tools(target: str) -> list[str]:
    """What a target needs to be built, and is not here; nothing where it is built already."""
    if (_folder() / target).exists():
        return []
    return [
        need
        for need in _NEEDS[target]
        if not (_SIMAVR.exists() if need == "simavr" else shutil.which(need))
    ]


@cache
def build_target(target: str) -> Path:
    """The path of a target of the firmware's Makefile, built if it is not there yet.

    Raises:
        InputError: a compiler or the emulator's library is missing, or the build failed.
    """
    path = _folder() / target
    if path.exists():
        return path
    if lacks := missing_tools(target):
        raise InputError(f"{target} needs {' and '.join(lacks)}: run `make emulator`")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{path.parent}: cannot be made ({error.strerror}); XDG_CACHE_HOME names another place"
        ) from None
    # Others may be building the same: each builds aside, and the last to move it in place wins.
    with tempfile.TemporaryDirectory(dir=path.parent) as aside:
        made = subprocess.run(
            ["make", "-s", "-C", str(FIRMWARE), f"BUILD={aside}", f"{aside}/{target}"],
            capture_output=True,
            text=True,
            check=False,
        )
        if made.returncode:
            lines = made.stderr.strip().splitlines()
            raise InputError(f"{target} was not built: {lines[0] if lines else made.returncode}")
        os.replace(Path(aside) / target, path)
    return path
