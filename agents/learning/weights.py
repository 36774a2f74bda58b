"""Learned weights in a file: arrays and a card, whole or refused; nothing in it is executed."""

from __future__ import annotations

import hashlib
import io
import json
import math
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.learning.features import Layout, features
from wheelchair_gym.envs.guidance import is_built_in
from wheelchair_gym.errors import InputError, shown
from wheelchair_gym.files import LIMITS, parse_json, read_bytes, whole
from wheelchair_gym.task.observation_layout import KEYS

Floats = NDArray[np.float32]
FORMAT = 1
MOST_ARRAYS = 64  # in a file
MOST_SIZE = 100_000  # numbers of one key of an observation
_KINDS = (np.dtype(np.float32), np.dtype(np.uint8))  # of numbers, and of card and digest
SHIPPED = Path(__file__).resolve().parents[1] / "data" / "weights"


@dataclass(frozen=True, eq=False)
class Weights:
    """An actor: its arrays, what they are for, and where they come from.

    `card` holds `format`, `head` ('clip' or 'tanh'), `layout`, `env` (settings that it was trained
    in), and whatever tells of the training: command, seeds, results, limits, versions.
    """

    arrays: dict[str, Floats]
    card: dict[str, Any]

    @property
    def layout(self) -> Layout:
        """Of the observation."""
        return Layout.of(self.card["layout"]["sizes"], self.card["layout"]["posed"])

    @property
    def memory(self) -> int:
        """Units of the recurrent layer; 0: none."""
        return int(self.arrays["lstm.h"].shape[1]) if "lstm.h" in self.arrays else 0

    @property
    def digest(self) -> str:
        """SHA-256 of its arrays, whatever the card says."""
        return _digest(self.arrays, "")

    @property
    def dense(self) -> int:
        """How many layers there are, the last one gives actions."""
        return sum(name.startswith("dense") and name.endswith(".w") for name in self.arrays)


class Network:
    """The forward pass of an actor in plain numpy; remembers where it is recurrent."""

    def __init__(self, weights: Weights) -> None:
        self._w = weights.arrays
        self._tanh = weights.card["head"] == "tanh"
        self._layout, self._dense = weights.layout, weights.dense
        self._scaled, self._scales = self._layout.scaled, self._layout.scales
        self._memory = weights.memory
        self.reset(1)

    def reset(self, rows: int) -> None:
        """Forget what was seen; so many observations come at a time."""
        self._h = np.zeros((rows, self._memory), np.float32)
        self._c = np.zeros_like(self._h)

    def forget(self, rows: NDArray[np.bool_]) -> None:
        """Forget what some rows have seen."""
        self._h[rows], self._c[rows] = 0.0, 0.0

    def __call__(self, flat: Floats) -> Floats:
        """Actions (n, 2) in [-1, 1] from flat observations (n, room)."""
        room = self._layout.room - self._layout.private
        x = features(np, flat[:, :room], self._layout, self._scaled, self._scales)
        if self._memory:
            x = self._recall(x)
        for k in range(self._dense):
            x = x @ self._w[f"dense{k}.w"].T + self._w[f"dense{k}.b"]
            if k < self._dense - 1:
                x = np.maximum(x, 0.0)
        action: Floats = np.tanh(x) if self._tanh else np.clip(x, -1.0, 1.0)
        return action

    def _recall(self, x: Floats) -> Floats:
        """A long short-term memory layer (Hochreiter and Schmidhuber 1997), gates as in torch."""
        gates = x @ self._w["lstm.x"].T + self._h @ self._w["lstm.h"].T + self._w["lstm.b"]
        i, f, g, o = np.split(gates, 4, axis=1)
        self._c = _sigmoid(f) * self._c + _sigmoid(i) * np.tanh(g)
        self._h = _sigmoid(o) * np.tanh(self._c)
        return self._h


def _sigmoid(x: Floats) -> Floats:
    out: Floats = (1.0 / (1.0 + np.exp(-x))).astype(np.float32)
    return out


def _digest(arrays: dict[str, Floats], card: str) -> str:
    digest = hashlib.sha256(card.encode())
    for name in sorted(arrays):
        digest.update(f"{name}{arrays[name].shape}".encode())
        digest.update(arrays[name].tobytes())
    return digest.hexdigest()


def save_weights(path: str | Path, weights: Weights) -> None:
    """Write weights whole or not at all, as npz.

    Raises:
        InputError: it cannot be written.
    """
    card = json.dumps(weights.card, sort_keys=True, allow_nan=False)
    arrays = {k: np.ascontiguousarray(v, np.float32) for k, v in weights.arrays.items()}
    extra = {"card": card, "digest": _digest(arrays, card)}
    told = {name: np.frombuffer(text.encode(), np.uint8) for name, text in extra.items()}
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **arrays, **told)
    with whole(path) as part:
        part.write_bytes(content.getvalue())


def load_weights(path: str | Path) -> Weights:
    """Read weights; no code in the file is executed.

    Raises:
        InputError: the file cannot be read, or is not whole.
    """
    path = Path(path)
    content = read_bytes(path, "weights")
    try:
        arrays = _unpacked(content)
        card = arrays.pop("card").tobytes().decode()
        digest = arrays.pop("digest").tobytes().decode()
        if digest != _digest(arrays, card):
            raise ValueError("its digest differs")
        weights = Weights(arrays, parse_json(card, "card"))
        if not isinstance(weights.card, dict):
            raise ValueError("its card is no object")
        known = weights.card.get("format") == FORMAT
        if known:
            check_card(weights.card)
            _check_arrays(weights)
    except Exception as error:  # whatever readers make of damaged bytes
        why = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: expected whole weights of a policy ({why})") from None
    if not known:
        form = shown(weights.card.get("format"))
        raise InputError(f"{path}: weights of format {form}; expected {FORMAT}")
    return weights


def _unpacked(content: bytes) -> dict[str, Any]:
    """The arrays of an npz file, whose directory and headers are read before memory is asked for.

    Raises:
        ValueError: it is not whole, or beyond a limit.
    """
    arrays, most = {}, LIMITS["weights"].most
    with zipfile.ZipFile(io.BytesIO(content)) as packed:
        members = packed.infolist()
        if len(members) > MOST_ARRAYS or sum(member.file_size for member in members) > most:
            raise ValueError(f"more than {MOST_ARRAYS} arrays or {most:,} bytes unpacked")
        for member in members:
            data = packed.read(member)  # no more than the directory says
            stream = io.BytesIO(data)
            version = np.lib.format.read_magic(stream)
            if version != (1, 0):
                raise ValueError(f"{shown(member.filename)} is no array of numpy's format 1.0")
            shape, by_column, kind = np.lib.format.read_array_header_1_0(stream)
            size = math.prod(shape) * kind.itemsize
            if kind not in _KINDS or by_column or min(shape, default=0) < 0:
                raise ValueError(f"{shown(member.filename)} holds no float32 by rows, nor bytes")
            if size != len(data) - stream.tell():
                raise ValueError(f"{shown(member.filename)} has not the size that its shape says")
            values = np.frombuffer(data, kind, offset=stream.tell()).reshape(shape)
            arrays[member.filename.removesuffix(".npy")] = values.copy()
    return arrays


def check_card(card: dict[str, Any]) -> None:
    """Refuse a card that a policy cannot be made of.

    Raises:
        ValueError: a key is missing or wrong.
    """
    layout = card.get("layout")
    if not isinstance(layout, dict):
        raise ValueError("layout is no object")
    sizes = layout.get("sizes")
    if not isinstance(sizes, list) or not all(
        isinstance(pair, list) and len(pair) == 2 and pair[0] in KEYS
        and type(pair[1]) is int and 0 <= pair[1] <= MOST_SIZE
        for pair in sizes
    ):  # fmt: skip
        raise ValueError("layout.sizes is no list of observation keys and their sizes")
    keys = [key for key, _ in sizes]
    if len(set(keys)) < len(keys) or keys[:4] != list(KEYS[:4]):
        expected = ", ".join(KEYS[:4])
        raise ValueError(f"layout.sizes names a key twice, or does not begin with {expected}")
    if not isinstance(layout.get("posed"), bool):
        raise ValueError("layout.posed is neither true nor false")
    if card.get("head") not in ("clip", "tanh"):
        raise ValueError("head is neither 'clip' nor 'tanh'")
    if not isinstance(card.get("env"), dict):
        raise ValueError("env holds no settings")
    if not is_built_in(card["env"].get("guidance")):
        raise ValueError("env.guidance names code; weights bring none: expected geodesic or poses")


def _check_arrays(weights: Weights) -> None:
    """Refuse arrays that do not fit one another, the layout, and an action of two numbers.

    Raises:
        ValueError: a shape differs from what it must be, or a value is not finite.
    """
    arrays, layout = weights.arrays, weights.layout
    width = layout.room - layout.private
    width = features(np, np.zeros((1, width), np.float32), layout, layout.scaled, layout.scales)
    width = width.shape[1]
    expected: dict[str, tuple[int, ...]] = {}
    if "lstm.h" in arrays:
        memory = arrays["lstm.h"].shape[-1] if arrays["lstm.h"].ndim else 0
        expected |= {"lstm.x": (4 * memory, width), "lstm.h": (4 * memory, memory)}
        expected["lstm.b"], width = (4 * memory,), memory
    for k in range(max(1, weights.dense)):
        bias = arrays.get(f"dense{k}.b", np.empty(()))
        after = 2 if k == weights.dense - 1 else bias.shape[0] if bias.ndim else 0
        expected |= {f"dense{k}.w": (after, width), f"dense{k}.b": (after,)}
        width = after
    for name, shape in expected.items():
        found = arrays[name].shape if name in arrays else None
        if found != shape or arrays[name].dtype != np.float32:
            raise ValueError(f"{name} has shape {found}; expected float32 {shape}")
        if not np.isfinite(arrays[name]).all():
            raise ValueError(f"{name} holds a value that is not finite")
    unknown = sorted(set(arrays) - set(expected))
    if unknown:
        raise ValueError(f"an array {shown(unknown[0])} has no place in the network")


def shipped() -> dict[str, Path]:
    """Weights that come with the package, by name."""
    return {path.stem: path for path in sorted(SHIPPED.glob("*.npz"))}


def find_weights(name: str) -> Path:
    """The file of weights by their name or their path.

    Raises:
        InputError: there are none of that name.
    """
    if name in shipped():
        return shipped()[name]
    if name.endswith((".npz", ".onnx")):
        return Path(name)
    known = ", ".join(shipped()) or "none"
    raise InputError(f"weights {name!r} are unknown; shipped: {known}; or a file .npz or .onnx")
