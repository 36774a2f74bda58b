"""Learned weights in a file: arrays and a card, whole or refused; nothing in it is executed."""

from __future__ import annotations

import hashlib
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.learning.features import Layout, features
from wheelchair_gym.config import InputError
from wheelchair_gym.files import whole

Floats = NDArray[np.float32]
FORMAT = 1
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
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        card = arrays.pop("card").tobytes().decode()
        digest = arrays.pop("digest").tobytes().decode()
        if digest != _digest(arrays, card):
            raise ValueError("its digest differs")
        weights = Weights(arrays, json.loads(card))
        known = weights.card["format"] == FORMAT
    except Exception as error:  # whatever readers make of damaged bytes
        why = str(error) or type(error).__name__
        raise InputError(f"{path}: expected whole weights of a policy ({why})") from None
    if not known:
        raise InputError(f"{path}: weights of format {weights.card['format']}; expected {FORMAT}")
    return weights


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
