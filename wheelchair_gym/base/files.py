"""Files: read within stated limits from regular files only; written completely or not at all.

Every reader of the project opens its file here. A limit is checked before memory is asked for.
"""

import hashlib
import json
import os
import re
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

from wheelchair_gym.base.errors import InputError, shorten


class Limit(NamedTuple):
    """The largest amount that a file may hold of something."""

    maximum: int
    unit: str
    what: str


_MIB: Final = 2**20
# docs/how_to/files.md shows this table; a test compares the two.
LIMITS: Final[dict[str, Limit]] = {
    "json": Limit(16 * _MIB, "bytes", "a JSON file: settings, problems, worlds, floor plans"),
    "depth": Limit(64, "levels", "lists and objects inside one another, in JSON and YAML"),
    "integer": Limit(64, "bits", "a whole number in JSON and YAML"),
    "yaml": Limit(64 * 1024, "bytes", "the YAML file of a map; aliases are refused"),
    "values": Limit(1000, "values", "the YAML file of a map"),
    "image": Limit(256 * _MIB, "bytes", "the image of a map: PGM, PNG, BMP, JPEG or TIFF"),
    "cells": Limit(100_000_000, "cells or pixels", "a map, from a file or generated"),
    "decoded": Limit(512 * _MIB, "bytes", "the pixels of a map's image, decoded"),
    "walls": Limit(100_000, "walls", "a map to drive or plan on: edges of its occupied cells"),
    "coordinate": Limit(10_000_000, "m", "a coordinate or a size in maps, worlds and problems"),
    "outline": Limit(5_000, "corners or shapes", "the outline of a house, a world, a problem"),
    "text": Limit(128 * _MIB, "bytes", "a MovingAI map, a curve in CSV"),
    "log": Limit(512 * _MIB, "bytes", "a log in BreezySLAM's format"),
    "recording": Limit(2048 * _MIB, "bytes", "a recording"),
    "chunk": Limit(64 * _MIB, "bytes", "a chunk of a recording, decompressed"),
    "unpacked": Limit(4096 * _MIB, "bytes", "all chunks of a recording, decompressed"),
    "weights": Limit(256 * _MIB, "bytes", "weights of a policy: the file, and its arrays unpacked"),
    "checkpoint": Limit(16_384 * _MIB, "bytes", "a training checkpoint: the file, and unpacked"),
    "line": Limit(64 * _MIB, "bytes", "a line of a store of records"),
}


@contextmanager
def opened(path: str | Path, limit: str | None = None) -> Iterator[IO[bytes]]:
    """A regular file, open for reading.

    Args:
        path: of the file.
        limit: which of `LIMITS` its size must keep; None: it is read piece by piece.

    Raises:
        InputError: it is missing, unreadable, no regular file or too large.
    """
    path = _shipped(path)
    try:
        # Not opened before it is known to be regular: opening a pipe waits, a port resets a board.
        kind = os.stat(path)
        if not stat.S_ISREG(kind.st_mode):
            raise InputError(f"{path}: cannot be read (not a regular file)")
        with open(path, "rb") as file:
            if limit is not None:
                _check_size(path, os.fstat(file.fileno()).st_size, limit)
            yield file
    except OSError as error:
        named = path if len(str(path)) < 1000 else shorten(str(path))  # which may come from a file
        raise InputError(f"{named}: cannot be read ({error.strerror or error})") from None
    except ValueError as error:
        if isinstance(error, InputError) or "null" not in str(error):
            raise
        raise InputError(f"{str(path)!r}: cannot be read (a NUL character in its name)") from None


def exists(path: str | Path) -> bool:
    """Return True if `opened` finds something under a path."""
    return os.path.exists(_shipped(path))  # false for a name that no file can have


def _shipped(path: str | Path) -> str | Path:
    """The installed copy of `configs/NAME`, or of a map of the package, where there is no file."""
    parts, package = Path(path).parts, Path(__file__).parents[1]
    shipped = parts[:2] == ("wheelchair_gym", "maps") or parts[:1] == ("configs",)
    if not shipped or os.path.lexists(path) or ".." in parts:
        return path
    # A wheel holds `configs` in the package, a checkout beside it.
    copies = package.joinpath(*parts), package.parent.joinpath(*parts)
    return next((copy for copy in copies if copy.exists()), path)


def _check_size(path: str | Path, size: int, limit: str) -> None:
    bound = LIMITS[limit]
    if size > bound.maximum:
        more = f"more than {bound.maximum:,} {bound.unit}"
        raise InputError(f"{path}: {more}, the limit of {bound.what}")


def read_bytes(path: str | Path, limit: str) -> bytes:
    """The content of a regular file within one of `LIMITS`.

    Raises:
        InputError: it is missing, unreadable, no regular file or too large.
    """
    with opened(path, limit) as file:
        content = file.read(os.fstat(file.fileno()).st_size + 1)
        while more := file.read(_MIB):  # some files hold more than their size says
            content += more
            _check_size(path, len(content), limit)
    _check_size(path, len(content), limit)
    return content


def modified(path: str | Path) -> int:
    """When a file was last changed [ns]; 0 where there is none."""
    try:
        return os.stat(path).st_mtime_ns
    except (OSError, ValueError):
        return 0


@cache
def _digest(path: str | Path, stamp: int, limit: str) -> str:
    return hashlib.sha256(read_bytes(path, limit)).hexdigest()


def file_digest(path: str | Path, limit: str = "weights") -> str:
    """SHA-256 of a file within one of `LIMITS`.

    Raises:
        InputError: it cannot be read.
    """
    return _digest(path, modified(path), limit)


_SOURCES: Final = {".py", ".yaml", ".toml", ".json", ".c", ".h"}


def sources(package: Path) -> list[Path]:
    """Return the files of code and of settings of a package, in order; those decide its results."""
    return sorted(path for path in package.rglob("*") if path.suffix in _SOURCES)


def read_text(path: str | Path, limit: str = "text", errors: str = "strict") -> str:
    """Read a text file within one of `LIMITS`; `errors` is that of `bytes.decode`.

    Raises:
        InputError: the file is missing, unreadable, too large or not text.
    """
    try:
        text = read_bytes(path, limit).decode("utf-8", errors)
        return text.replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file; expected UTF-8") from None


def read_json(path: str | Path) -> Any:
    """The content of a JSON file.

    Raises:
        InputError: the file is missing, unreadable, beyond a limit or not JSON.
    """
    return parse_json(read_text(path, "json"), path)


def parse_json(text: str | bytes, path: str | Path) -> Any:
    """The content of a JSON text; errors name the path.

    Raises:
        InputError: it is not JSON, or beyond a limit.
    """
    try:
        content = json.loads(text, parse_int=_parse_int, object_pairs_hook=_unique)
    except json.JSONDecodeError as error:
        message = f"{path}: line {error.lineno}, column {error.colno}: not JSON: {error.msg}"
        raise InputError(message) from None
    except RecursionError:
        raise InputError(f"{path}: {_TOO_DEEP}") from None
    except ValueError as error:  # an integer beyond its limit, bytes that are no text
        raise InputError(f"{path}: not JSON that can be read: {error}") from None
    _check_values(content, path)
    return content


_TOO_DEEP: Final = f"nested too deep; expected at most {LIMITS['depth'].maximum} levels"


def _parse_int(digits: str) -> int:
    # Digits are counted first: Python itself takes quadratic time, and refuses 4,301 of them.
    if len(digits) > 20 or not -(2**63) <= int(digits) < 2**64:
        raise ValueError(f"{shorten(digits)} needs more than {LIMITS['integer'].maximum} bits")
    return int(digits)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the pairs of an object; refuse a key that is given twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key {shorten(twice)} is given twice")
    return found


def _check_values(content: Any, path: str | Path) -> None:
    """Refuse deep nesting, and text that cannot be printed."""
    level = [content]
    for _ in range(LIMITS["depth"].maximum + 1):
        following = []
        for value in level:
            if isinstance(value, dict):
                following += [*value, *value.values()]
            elif isinstance(value, list):
                following += value
            elif isinstance(value, str) and not value.isascii():
                try:
                    value.encode()
                except UnicodeEncodeError:
                    raise InputError(f"{path}: half a surrogate pair in {value!a:.80}") from None
        level = following
        if not level:
            return
    raise InputError(f"{path}: {_TOO_DEEP}")


def parse_yaml(text: str, path: str | Path) -> Any:
    """Parse a YAML text without aliases; errors name the path.

    Numbers are those of YAML 1.2, which yaml-cpp and ROS read: 1e-1 is one, 1:30 and 1_000 are not.

    Raises:
        InputError: it is not YAML, beyond a limit, or holds an alias or a key twice.
    """
    import yaml  # only here: settings are JSON

    class Loader(yaml.SafeLoader):
        """Counts what it composes."""

        values = depth = 0

        def scan_to_next_token(self) -> None:
            """Skip blanks, tabs (which PyYAML refuses), comments and ends of lines."""
            super().scan_to_next_token()
            while self.peek() == "\t":
                self.forward()
                super().scan_to_next_token()

        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.AliasEvent):
                raise yaml.YAMLError("aliases are not allowed")
            self.values, self.depth = self.values + 1, self.depth + 1
            if self.values > LIMITS["values"].maximum:
                raise yaml.YAMLError(f"more than {LIMITS['values'].maximum} values")
            if self.depth > LIMITS["depth"].maximum:
                raise yaml.YAMLError(_TOO_DEEP)
            node = super().compose_node(parent, index)
            self.depth -= 1
            keys = [key for key, _ in node.value] if isinstance(node, yaml.MappingNode) else []
            for k, key in enumerate(keys):
                if key.value in [other.value for other in keys[:k]]:
                    problem = f"the key {shorten(key.value)} is given twice"
                    raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            return node

        def construct_yaml_int(self, node: Any) -> int:
            return _parse_int(str(node.value))

    Loader.yaml_implicit_resolvers = {
        first: [pair for pair in pairs if not pair[0].endswith((":int", ":float"))]
        for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }
    for kind, form, first in (
        ("int", r"[-+]?[0-9]+", "-+0123456789"),
        ("float", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", "-+.0123456789"),
        ("float", r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", "-+."),
    ):
        Loader.add_implicit_resolver(f"tag:yaml.org,2002:{kind}", re.compile(f"({form})$"), first)
    Loader.add_constructor("tag:yaml.org,2002:int", Loader.construct_yaml_int)
    try:
        return yaml.load(text, Loader)
    except (yaml.YAMLError, ValueError, OverflowError, TypeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f"line {mark.line + 1}: " if mark else ""
        problem = getattr(error, "problem", None) or " ".join(str(error).split()) or "broken"
        raise InputError(f"{path}: {place}not YAML: {problem}") from None


def check_cells(rows: float, columns: float, where: str) -> None:
    """Refuse a map of too many cells before memory is asked for.

    Raises:
        InputError: it has more than the limit.
    """
    maximum = LIMITS["cells"].maximum
    if not rows * columns <= maximum:
        raise InputError(f"{where}: {columns:.6g} x {rows:.6g} cells; expected at most {maximum:,}")


def is_coordinate(value: Any) -> bool:
    """Whether a value is a finite number that a coordinate [m] in a file may have."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) <= LIMITS["coordinate"].maximum  # false for NaN


def coordinates(value: Any, counts: tuple[int, ...], where: str) -> list[float]:
    """A list from a file as coordinates [m]; `counts` are the lengths that it may have.

    Raises:
        InputError: it is no list of coordinates, or has another length.
    """
    good = isinstance(value, list) and len(value) in counts
    if not good or not all(map(is_coordinate, value)):
        expected = f"expected a list of {' or '.join(map(str, counts))} coordinates [m]"
        raise InputError(f"{where} is {shorten(value)}; {expected}")
    return [float(number) for number in value]


def coordinate_lists(value: Any, count: int, where: str) -> list[list[float]]:
    """A list of lists from a file, each of `count` coordinates [m].

    Raises:
        InputError: it is no such list, or is longer than the limit.
    """
    if not isinstance(value, list):
        raise InputError(f"{where} is {shorten(value)}; expected a list")
    if len(value) > LIMITS["outline"].maximum:
        expected = f"expected at most {LIMITS['outline'].maximum:,}"
        raise InputError(f"{where} has {len(value):,} elements; {expected}")
    return [coordinates(item, (count,), f"{where}[{k}]") for k, item in enumerate(value)]


os.umask(_UMASK := os.umask(0o077))  # there is no way to read it alone


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """A name to write to; renamed to `path` at the end, removed after an error.

    The file keeps the permissions of the one that it replaces; a new one has those of `open`.

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
            part.chmod(stat.S_IMODE(path.stat().st_mode) if path.exists() else 0o666 & ~_UMASK)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise write_error(path, error) from None


def write_error(path: Path, error: OSError) -> InputError:
    """The error of a file that cannot be written."""
    taken = isinstance(error, FileExistsError | NotADirectoryError)
    why = "its folder is a file" if taken else error.strerror or str(error)
    return InputError(f"{path}: cannot be written ({why})")
