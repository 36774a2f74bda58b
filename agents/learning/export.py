"""Learned policies as ONNX: the graph maps sensor readings to a twist."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.evaluation.provenance import write_json
from agents.evaluation.tables import templates
from agents.learning.features import (
    GOAL_PROXIMITY_WEIGHT,
    GOAL_RANGE,
    RANGE_SCALE,
    RANGE_SHIFT,
    SCALED,
    Layout,
)
from agents.learning.weights import Weights, check_card
from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.files import atomic_write, read_bytes, read_json
from wheelchair_gym.base.settings import InputError, load
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.task.observations import PRIVILEGED

NAMES = {"action": "last_action"}  # names of inputs that differ from keys
OPSET = 17  # of 2022, so that every current runtime reads it


def groups_of(beams: int, pooled: int) -> NDArray[np.int64]:
    """Indices (pooled, most) of the beams that each pooled beam is the minimum of."""
    ends = np.arange(pooled + 1) * beams // pooled
    maximum = int(np.diff(ends).max())
    groups: NDArray[np.int64] = np.minimum(ends[:-1, None] + np.arange(maximum), ends[1:, None] - 1)
    return groups


def export_onnx(weights: Weights, path: str | Path) -> dict[str, Any]:
    """Write weights as an ONNX graph, and a sidecar PATH.json; the sidecar.

    Inputs are the fields of a reading: `laser` (n, beams of the laser) and `ultrasonic` (n, 8) [m],
    which may hold +inf, -inf and NaN; and keys of the observation (`twist`, `goal`, `last_action`,
    `shield`, `path`). Outputs are `action` (n, 2) in [-1, 1] and its twist, `twist_asked` (n, 2)
    [m/s, rad/s]. A recurrent policy has inputs `h`, `c` and outputs `h_next`, `c_next`
    (n, units).

    Raises:
        InputError: onnx is not installed, a file cannot be written, or the weights are an
            assistant's, or of a chair that has not one laser and ultrasonics.
    """
    try:
        import onnx
    except ImportError:
        raise InputError("export needs: pip install 'wheelchair_gym[learn]'") from None
    layout, arrays = weights.layout, weights.arrays
    env = load(EnvSettings, weights.card["env"], "weights: env")
    sizes = {key: n for key, n in layout.sizes if key not in PRIVILEGED}
    if layout.is_assistant:
        raise InputError("export: expected a policy's weights; these are an assistant's")
    lasers, beams, limits = env.sensors.lasers, env.sensors.beams, env.chair.limits
    if len(lasers) != 1 or not env.sensors.ultrasonic.mounted:
        raise InputError("export: expected one laser, and ultrasonics; the weights have others")
    state = dict.fromkeys("hc" if weights.lstm_size else "", weights.lstm_size)
    inputs = {NAMES.get(key, key): n for key, n in {**sizes, "laser": beams}.items()} | state
    outputs = {"action": 2, "twist_asked": 2, **{f"{key}_next": n for key, n in state.items()}}
    text = templates().get_template("policy.onnx.txt").render(
        opset=OPSET, inputs=inputs, outputs=outputs, lstm=weights.lstm_size,
        others=[NAMES.get(key, key) for key in SCALED[2:] if key in sizes],
        layers=weights.dense_layers, head=weights.card["head"],
    )  # fmt: skip
    model = onnx.parser.parse_model(text)
    constants: dict[str, Any] = {
        "zero": 0.0, "one": 1.0, "minus_one": -1.0,
        "laser_reach": [lasers[0].reach],
        "ultrasonic_reach": [model.reach for model in env.sensors.ultrasonic.models],
        "groups": groups_of(beams, sizes["laser"]),
        "range_shift": RANGE_SHIFT, "range_scale": RANGE_SCALE,
        "goal_range_index": np.array([0]), "bearing_indices": np.arange(1, sizes["goal"]),
        "goal_range": GOAL_RANGE, "goal_proximity_weight": GOAL_PROXIMITY_WEIGHT,
        "scales": layout.scales,
        "gate_sizes": np.full(4, weights.lstm_size),
        "limits_ahead": [limits.forward, limits.turn],
        "limits_back": [limits.backward, limits.turn],
        **{name.replace(".", "_"): array for name, array in arrays.items()},
    }  # fmt: skip
    used = {name for node in model.graph.node for name in node.input}
    for name in sorted(used & set(constants)):
        array = np.asarray(constants[name])
        kind = np.int64 if array.dtype.kind == "i" else np.float32
        model.graph.initializer.append(onnx.numpy_helper.from_array(array.astype(kind), name))
    onnx.checker.check_model(model)
    content = model.SerializeToString()
    sidecar = {
        **weights.card,
        "inputs": inputs,
        "outputs": outputs,
        "sha256": hashlib.sha256(content).hexdigest(),
    }
    with atomic_write(path) as part:
        part.write_bytes(content)
    write_json(f"{path}.json", sidecar)
    return sidecar


class OnnxNetwork:
    """An exported policy in onnxruntime, with the interface of `weights.Network`.

    Raises:
        InputError: onnxruntime is not installed, or the file or its sidecar is damaged.
    """

    def __init__(self, path: str | Path) -> None:
        try:
            import onnxruntime
        except ImportError:
            raise InputError("ONNX policies need: pip install 'wheelchair_gym[learn]'") from None
        path = Path(path)
        content = read_bytes(path, "weights")
        self.card = read_json(f"{path}.json")
        if not isinstance(self.card, dict) or hashlib.sha256(content).hexdigest() != self.card.get(
            "sha256"
        ):
            raise InputError(f"{path}: differs from what {path.name}.json says; export it again")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.log_severity_level = 4  # errors are reported below
        try:
            check_card(self.card)
            self._session = onnxruntime.InferenceSession(
                content, options, providers=["CPUExecutionProvider"]
            )
            inputs = {value.name: value.shape[-1] for value in self._session.get_inputs()}
            if self.card.get("inputs") != inputs:
                raise ValueError(f"inputs are {shorten(inputs)}")
            self._layout = Layout.of_card(self.card)
            self._inputs = inputs
            self.reset(1)
            action = self(np.ones((1, self._layout.size), np.float32))  # some graphs fail only here
            if action.shape != (1, 2) or action.dtype != np.float32:
                raise ValueError(f"its action has shape {action.shape}; expected (1, 2)")
        except Exception as error:  # onnxruntime documents no errors of its reader
            why = " ".join(str(error).split()[:20]) or type(error).__name__
            raise InputError(f"{path}: expected an exported policy ({why})") from None
        self.reset(1)

    def reset(self, rows: int) -> None:
        """Set the recurrent state to zero, for this many rows."""
        units = self._inputs.get("h", 0)
        self._state = {key: np.zeros((rows, units), np.float32) for key in "hc" if units}

    def run(self, feed: dict[str, Floats]) -> dict[str, Floats]:
        """The graph's outputs by name; the recurrent state is kept."""
        names = [output.name for output in self._session.get_outputs()]
        found = dict(zip(names, self._session.run(names, {**feed, **self._state}), strict=True))
        self._state = {key: found[f"{key}_next"] for key in self._state}
        return found

    def __call__(self, flat: Floats) -> Floats:
        """Actions (n, 2) for flat observations (n, size), whose scan is already pooled."""
        feed = {
            NAMES.get(key, key): flat[:, self._layout.slice_of(key)]
            for key, _ in self._layout.sizes
            if NAMES.get(key, key) in self._inputs
        }
        beams = self._inputs["laser"]
        pooled = feed["laser"].shape[1]
        where = np.searchsorted(
            np.arange(1, pooled + 1) * beams // pooled, np.arange(beams), "right"
        )
        feed["laser"] = np.ascontiguousarray(feed["laser"][:, where])
        return self.run({key: np.ascontiguousarray(value) for key, value in feed.items()})["action"]
