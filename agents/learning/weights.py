"""Files of learned weights: arrays and a card, complete or refused; no code in them is executed.

The features that a network gets have one definition, for training, driving and export.
"""

import hashlib
import io
import json
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from agents.evaluation.provenance import command_line, provenance
from wheelchair_gym.base import files, registry, settings
from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.envs.guidance import is_built_in
from wheelchair_gym.task.observations import PRIVILEGED, SCALES, SIZES, places

RANGE_SCALE, RANGE_SHIFT = 0.6, 0.1  # a range r [m] becomes 0.6 ln(r + 0.1)
GOAL_RANGE = 10.0  # m: the goal's distance is clipped to this
GOAL_PROXIMITY_WEIGHT = 2.0  # weight of exp(-distance to the goal)
SCALED = (  # keys with a factor
    "twist", "goal", "stick", "action", "shield", "path", "side_clearance", "trail",
    "tracks",
)  # fmt: skip


@dataclass(frozen=True)
class Layout:
    """The place of each key in a flat observation, in the order of the task."""

    sizes: tuple[tuple[str, int], ...]  # key, count of numbers
    path_has_heading: bool  # the path holds poses, not points

    @classmethod
    def of_task(cls, task: Any) -> Self:
        """The layout of a task's observations."""
        return cls(tuple((key, box.shape[0]) for key, box in task.spaces.items()), task.has_poses)

    @classmethod
    def of_card(cls, card: Mapping[str, Any]) -> Self:
        """The layout that a card of weights holds."""
        layout = card["layout"]
        sizes = tuple((str(key), int(n)) for key, n in layout["sizes"])
        return cls(sizes, layout["path_has_heading"])

    @cached_property
    def _places(self) -> dict[str, slice]:
        return places(self.sizes)

    def slice_of(self, key: str) -> slice:
        """The place of a key; an empty slice if it is absent."""
        return self._places.get(key, slice(0, 0))

    @property
    def size(self) -> int:
        """Numbers in an observation."""
        return sum(size for _, size in self.sizes)

    @property
    def privileged_size(self) -> int:
        """Numbers that only a critic gets; they are last."""
        return sum(size for key, size in self.sizes if key in PRIVILEGED)

    @property
    def is_assistant(self) -> bool:
        """Whether a person's stick is observed, in place of a goal."""
        return "stick" in self._places

    @property
    def actor_size(self) -> int:
        """Features that an actor gets."""
        twice = int("goal" in self._places)  # the goal's distance gives two
        return self.size - self.privileged_size + twice

    @property
    def scales(self) -> Floats:
        """Factors of the keys of SCALED (n,), without the distance of the goal."""
        parts = [self._scale(key) for key in SCALED]
        del parts[SCALED.index("goal")][:1]
        return np.concatenate(parts).astype(np.float32)

    @property
    def privileged_scales(self) -> Floats:
        """Factors of the privileged numbers (privileged_size,)."""
        return np.concatenate([self._scale(key) for key in PRIVILEGED]).astype(np.float32)

    def _scale(self, key: str) -> list[float]:
        each = SCALES.get(key, [1.0])
        if key.endswith("path") and not self.path_has_heading:
            each = each[:2]
        return each * (dict(self.sizes).get(key, 0) // len(each))

    @property
    def scaled_indices(self) -> NDArray[np.int64]:
        """The places of the numbers of `scales` in a flat observation."""
        each = {key: self.slice_of(key) for key in SCALED}
        goal = each["goal"]
        each["goal"] = slice(min(goal.start + 1, goal.stop), goal.stop)
        return np.concatenate([np.arange(at.start, at.stop) for at in each.values()])


def features(xp: Any, flat: Any, layout: Layout, scaled: Any, scales: Any) -> Any:
    """Features (n, actor_size) of flat observations (n, size), by numpy or torch as `xp`.

    `scaled` and `scales` are `layout.scaled_indices` and `layout.scales`, as arrays of `xp`.
    """
    # Ranges of lasers and ultrasonics are first.
    ranges = flat[:, : sum(n for key, n in layout.sizes if key in ("laser", "ultrasonic"))]
    parts = [RANGE_SCALE * xp.log(ranges + RANGE_SHIFT), flat[:, scaled] * scales]
    goal = layout.slice_of("goal")
    if goal.stop:
        far = flat[:, goal.start : goal.start + 1]
        parts += [far.clip(None, GOAL_RANGE) / GOAL_RANGE, GOAL_PROXIMITY_WEIGHT * xp.exp(-far)]
    return xp.concatenate(parts, -1)


FORMAT = 1
MAX_ARRAYS = 64  # in a file
MAX_SIZE = 100_000  # numbers of one key of an observation
_KINDS = (np.dtype(np.float32), np.dtype(np.uint8))  # of numbers, and of card and digest
SHIPPED = Path(__file__).resolve().parents[1] / "data" / "weights"  # of policies
SHIPPED_ASSISTANTS = SHIPPED.parent / "assistants"

_KEYS = SIZES.names or ()  # that an observation may have


@dataclass(frozen=True, eq=False)
class Weights:
    """An actor: its arrays and its card.

    `card` holds `format`, `head` ('clip' or 'tanh'), `layout`, `env` (the settings of its training
    environment), and the provenance: command, seeds, results, limits, versions.
    """

    arrays: dict[str, Floats]
    card: dict[str, Any]

    @property
    def layout(self) -> Layout:
        """The layout of its observations."""
        return Layout.of_card(self.card)

    @property
    def digest(self) -> str:
        """SHA-256 of the arrays, without the card."""
        return _digest(self.arrays, "")

    @property
    def dense_layers(self) -> int:
        """Number of dense layers; the last one gives actions."""
        return sum(name.startswith("dense") and name.endswith(".w") for name in self.arrays)


class Network:
    """The forward pass of an actor in numpy."""

    def __init__(self, weights: Weights) -> None:
        self._arrays = weights.arrays
        self._tanh = weights.card["head"] == "tanh"
        self._layout = weights.layout
        self._dense = [
            (self._arrays[f"dense{k}.w"].T, self._arrays[f"dense{k}.b"])
            for k in range(weights.dense_layers)
        ]
        self._scaled, self._scales = self._layout.scaled_indices, self._layout.scales

    def __call__(self, flat: Floats) -> Floats:
        """Actions (n, 2) in [-1, 1] for flat observations (n, size)."""
        public = self._layout.size - self._layout.privileged_size
        x = features(np, flat[:, :public], self._layout, self._scaled, self._scales)
        for k, (weight, bias) in enumerate(self._dense):
            x = x @ weight + bias
            if k < len(self._dense) - 1:
                x = np.maximum(x, 0.0)
        action: Floats = np.tanh(x) if self._tanh else np.clip(x, -1.0, 1.0)
        return action


def _digest(arrays: dict[str, Floats], card: str) -> str:
    digest = hashlib.sha256(card.encode())
    for name in sorted(arrays):
        digest.update(f"{name}{arrays[name].shape}".encode())
        digest.update(arrays[name].tobytes())
    return digest.hexdigest()


def make_card(
    algorithm: str, head: str, layout: Layout, env: Any, training: Any, seed: int, limits: str
) -> dict[str, Any]:
    """The card of new weights: what they are for, and the provenance."""
    return {
        "format": FORMAT,
        "algorithm": algorithm,
        "head": head,
        "layout": settings.dump(layout),
        "env": settings.dump(env),
        "training": settings.dump(training),
        "seed": seed,
        "command": command_line(),
        **provenance(),
        "limits": limits,
    }


def save_weights(path: str | Path, weights: Weights) -> None:
    """Write weights atomically, as npz.

    Raises:
        InputError: it cannot be written.
    """
    card = json.dumps(weights.card, sort_keys=True, allow_nan=False)
    arrays = {k: np.ascontiguousarray(v, np.float32) for k, v in weights.arrays.items()}
    extra = {"card": card, "digest": _digest(arrays, card)}
    texts = {name: np.frombuffer(text.encode(), np.uint8) for name, text in extra.items()}
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **arrays, **texts)
    with files.atomic_write(path) as part:
        part.write_bytes(content.getvalue())


def load_weights(path: str | Path) -> Weights:
    """Read weights; no code in the file is executed.

    Raises:
        InputError: the file cannot be read, or is not complete.
    """
    path = Path(path)
    content = files.read_bytes(path, "weights")
    try:
        arrays = _unpacked(content)
        card = arrays.pop("card").tobytes().decode()
        digest = arrays.pop("digest").tobytes().decode()
        if digest != _digest(arrays, card):
            raise ValueError("its digest differs")
        weights = Weights(arrays, files.parse_json(card, "card"))
        if not isinstance(weights.card, dict):
            raise ValueError("its card is no object")
        readable = weights.card.get("format") == FORMAT
        if readable:
            check_card(weights.card)
            _check_arrays(weights)
    except Exception as error:  # readers document no errors for damaged bytes
        why = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: expected complete weights of a policy ({why})") from None
    if not readable:
        form = shorten(weights.card.get("format"))
        raise InputError(f"{path}: weights of format {form}; expected {FORMAT}")
    return weights


def _unpacked(content: bytes) -> dict[str, Any]:
    """The arrays of an npz file; a ValueError if it is not complete, or beyond a limit.

    Its directory and headers are checked before memory is allocated.
    """
    arrays, maximum = {}, files.LIMITS["weights"].maximum
    with zipfile.ZipFile(io.BytesIO(content)) as packed:
        members = packed.infolist()
        if len(members) > MAX_ARRAYS or sum(member.file_size for member in members) > maximum:
            raise ValueError(f"more than {MAX_ARRAYS} arrays or {maximum:,} bytes unpacked")
        for member in members:
            name = shorten(member.filename)
            data = packed.read(member)  # no more than the directory says
            stream = io.BytesIO(data)
            version = np.lib.format.read_magic(stream)
            if version != (1, 0):
                raise ValueError(f"{name} is not an array of numpy's format 1.0")
            shape, by_column, kind = np.lib.format.read_array_header_1_0(stream)
            size = math.prod(shape) * kind.itemsize
            if kind not in _KINDS or by_column or min(shape, default=0) < 0:
                raise ValueError(f"{name} holds neither float32 in C order nor bytes")
            if size != len(data) - stream.tell():
                raise ValueError(f"{name} has another size than its shape")
            values = np.frombuffer(data, kind, offset=stream.tell()).reshape(shape)
            arrays[member.filename.removesuffix(".npy")] = values.copy()
    return arrays


def check_card(card: dict[str, Any]) -> None:
    """Refuse a card from which no policy can be made.

    Raises:
        ValueError: a key is missing or wrong.
    """
    layout = card.get("layout")
    if not isinstance(layout, dict):
        raise ValueError("layout is no object")
    sizes = layout.get("sizes")
    if not isinstance(sizes, list) or not all(
        isinstance(pair, list) and len(pair) == 2 and pair[0] in _KEYS
        and type(pair[1]) is int and 0 <= pair[1] <= MAX_SIZE
        for pair in sizes
    ):  # fmt: skip
        raise ValueError("layout.sizes is no list of observation keys and their sizes")
    keys = [key for key, _ in sizes]
    # A chair may have neither laser nor ultrasonics.
    aim = "stick" if "stick" in keys else "goal"  # an assistant's weights, or a policy's
    begin = [key for key in (*_KEYS[:3], aim) if key in keys or key in ("twist", aim)]
    if len(set(keys)) < len(keys) or keys[: len(begin)] != begin or {"goal", "stick"} <= set(keys):
        expected = ", ".join(begin)
        raise ValueError(f"layout.sizes names a key twice, or does not begin with {expected}")
    if not isinstance(layout.get("path_has_heading"), bool):
        raise ValueError("layout.path_has_heading is neither true nor false")
    if card.get("head") not in ("clip", "tanh"):
        raise ValueError("head is neither 'clip' nor 'tanh'")
    if not isinstance(card.get("env"), dict):
        raise ValueError("env holds no settings")
    if not is_built_in(card["env"].get("guidance")):
        raise ValueError("env.guidance names code; expected geodesic or poses")
    if registry.places_in([card["env"].get("driver"), card["env"].get("assistant")]):
        raise ValueError("env.driver or env.assistant names code; expected names of the project")


def _check_arrays(weights: Weights) -> None:
    """Refuse arrays that are not finite, or do not fit each other, the layout or an action (2,)."""
    arrays, layout = weights.arrays, weights.layout
    width = layout.size - layout.privileged_size
    # Computed from features, which also refuses sizes that no observation has.
    flat = np.zeros((1, width), np.float32)
    width = features(np, flat, layout, layout.scaled_indices, layout.scales).shape[1]
    expected: dict[str, tuple[int, ...]] = {}
    for k in range(max(1, weights.dense_layers)):
        bias = arrays.get(f"dense{k}.b", np.empty(()))
        after = 2 if k == weights.dense_layers - 1 else bias.shape[0] if bias.ndim else 0
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
        raise ValueError(f"an array {shorten(unknown[0])} is not part of the network")


def shipped(folder: Path = SHIPPED) -> dict[str, Path]:
    """The weights that the package ships, of policies or of `SHIPPED_ASSISTANTS`, by name."""
    return {path.stem: path for path in sorted(folder.glob("*.npz"))}


def find_weights(name: str) -> Path:
    """The file of weights of a shipped name or a path.

    Raises:
        InputError: there are no weights of that name.
    """
    known = shipped() | shipped(SHIPPED_ASSISTANTS)
    if name in known:
        return known[name]
    if name.endswith((".npz", ".onnx")):
        return Path(name)
    if name.endswith(".zip"):
        raise InputError(f"{name}: a model of stable-baselines3; expected weights (.npz)")
    names = ", ".join(known) or "none"
    raise InputError(f"weights {name!r} are unknown; shipped: {names}; or a file .npz or .onnx")
