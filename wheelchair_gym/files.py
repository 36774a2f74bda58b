"""Files that appear under their names only when they are whole."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wheelchair_gym.config import InputError


@contextmanager
def whole(path: str | Path) -> Iterator[Path]:
    """A name to write to; renamed to `path` at the end, removed after an error.

    Raises:
        InputError: it cannot be written.
    """
    path = Path(path)
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            yield path  # a device or a pipe: to be written to, never to be replaced
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(suffix=path.suffix, prefix=".", dir=path.parent)
        os.close(handle)
        part = Path(name)
        try:
            yield part
            part.chmod(0o644)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise refused(path, error) from None


def refused(path: Path, error: OSError) -> InputError:
    """What a person is told of a file that cannot be written."""
    taken = isinstance(error, FileExistsError | NotADirectoryError)
    why = "its folder is a file" if taken else error.strerror or str(error)
    return InputError(f"{path}: cannot be written ({why})")
