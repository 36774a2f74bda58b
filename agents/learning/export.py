"""Learned policies as ONNX: the graph maps sensor readings to a twist."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.evaluation.provenance import write_json
from agents.learning.features import (
    GOAL_PROXIMITY_WEIGHT,
    GOAL_RANGE,
    RANGE_SCALE,
    RANGE_SHIFT,
    SCALED,
    Layout,
)
from agents.learning.weights import Weights, check_card
from wheelchair_gym.config import InputError, load
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.errors import shorten
from wheelchair_gym.files import atomic_write, read_bytes, read_json
from wheelchair_gym.task.observations import PRIVILEGED

Floats = NDArray[np.float32]
NAMES = {"action": "last_action"}  # names of inputs that differ from keys
OPSET = 17  # of 2022, so that every current runtime reads it


class _Graph:
    """Nodes and constants of a graph."""

    def __init__(self, onnx: Any) -> None:
        self._onnx = onnx
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: Any, kind: Any = np.float32) -> str:
        name = f"c{len(self.constants)}"
        array = np.asarray(value, kind)
        self.constants.append(self._onnx.numpy_helper.from_array(array, name))
        return name

    def add(self, op: str, *inputs: str, out: str | None = None, **attributes: Any) -> str:
        name = out or f"n{len(self.nodes)}"
        self.nodes.append(self._onnx.helper.make_node(op, inputs, [name], **attributes))
        return name


def _onnx() -> Any:
    try:
        import onnx
    except ImportError:
        raise InputError("export needs: pip install 'wheelchair_gym[learn]'") from None
    return onnx


def groups_of(beams: int, pooled: int) -> NDArray[np.int64]:
    """Indices (pooled, most) of the beams that each pooled beam is the minimum of."""
    ends = np.arange(pooled + 1) * beams // pooled
    most = int(np.diff(ends).max())
    groups: NDArray[np.int64] = np.minimum(ends[:-1, None] + np.arange(most), ends[1:, None] - 1)
    return groups


def export_onnx(weights: Weights, path: str | Path) -> dict[str, Any]:
    """Write weights as an ONNX graph, and a sidecar PATH.json; the sidecar.

    Inputs are the fields of a reading: `laser` (n, beams of the laser) and `ultrasonic` (n, 8) [m],
    which may hold +inf, -inf and NaN; and keys of the observation (`twist`, `goal`, `last_action`,
    `shield`, `path`). Outputs are `action` (n, 2) in [-1, 1] and its twist, `twist_asked` (n, 2)
    [m/s, rad/s]. A recurrent policy has inputs `h`, `c` and outputs `h_next`, `c_next`
    (n, units).

    Raises:
        InputError: onnx is not installed, a file cannot be written, or the weights are not of a
            chair with one laser and with ultrasonics.
    """
    onnx = _onnx()
    helper, kinds = onnx.helper, onnx.TensorProto
    graph, layout = _Graph(onnx), weights.layout
    env = load(EnvSettings, weights.card["env"], "weights: env")
    sizes = {key: n for key, n in layout.sizes if key not in PRIVILEGED}
    lasers, beams = env.sensors.lasers, env.sensors.beams
    if len(lasers) != 1 or not env.sensors.ultrasonic.mounted:
        raise InputError("export: expected one laser, and ultrasonics; the weights have others")
    reaches = [model.reach for model in env.sensors.ultrasonic.models]
    laser = _ranges(graph, "laser", [lasers[0].reach])
    groups = graph.constant(groups_of(beams, sizes["laser"]), np.int64)
    pooled = graph.add("Gather", laser, groups, axis=1)
    pooled = graph.add("ReduceMin", pooled, axes=[2], keepdims=0)
    x = _features(graph, layout, sizes, pooled, _ranges(graph, "ultrasonic", reaches))
    if weights.lstm_size:
        x = _lstm(graph, weights, x)
    for k in range(weights.dense_layers):
        matrix = graph.constant(weights.arrays[f"dense{k}.w"])
        x = graph.add("Gemm", x, matrix, graph.constant(weights.arrays[f"dense{k}.b"]), transB=1)
        if k < weights.dense_layers - 1:
            x = graph.add("Relu", x)
    if weights.card["head"] == "tanh":
        graph.add("Tanh", x, out="action")
    else:
        graph.add("Clip", x, graph.constant(-1.0), graph.constant(1.0), out="action")
    limits = env.chair.limits
    ahead = graph.constant([limits.forward, limits.turn])
    back = graph.constant([limits.backward, limits.turn])
    positive = graph.add("Greater", "action", graph.constant(0.0))
    scale = graph.add("Where", positive, ahead, back)
    graph.add("Mul", "action", scale, out="twist_asked")

    def value(name: str, width: int) -> Any:
        return helper.make_tensor_value_info(name, kinds.FLOAT, ["n", width])

    shapes = {NAMES.get(key, key): n for key, n in {**sizes, "laser": beams}.items()}
    outputs = {"action": 2, "twist_asked": 2}
    if weights.lstm_size:
        shapes |= {"h": weights.lstm_size, "c": weights.lstm_size}
        outputs |= {"h_next": weights.lstm_size, "c_next": weights.lstm_size}
    made = helper.make_graph(
        graph.nodes, "policy", [value(*item) for item in shapes.items()],
        [value(*item) for item in outputs.items()], graph.constants,
    )  # fmt: skip
    model = helper.make_model(
        made, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="wheelchair_gym"
    )
    model.ir_version = 8  # as old as the opset
    onnx.checker.check_model(model)
    content = model.SerializeToString()
    sidecar = {
        **weights.card,
        "inputs": shapes,
        "outputs": outputs,
        "sha256": hashlib.sha256(content).hexdigest(),
    }
    with atomic_write(path) as part:
        part.write_bytes(content)
    write_json(f"{path}.json", sidecar)
    return sidecar


def _ranges(graph: _Graph, name: str, reach: list[float]) -> str:
    """Ranges as in an observation: no echo is the reach; too near and invalid are 0."""
    zero = graph.constant(0.0)
    positive = graph.add("Greater", name, zero)  # false for NaN
    return graph.add("Min", graph.add("Where", positive, name, zero), graph.constant(reach))


def _features(
    graph: _Graph, layout: Layout, sizes: dict[str, int], laser: str, ultrasonic: str
) -> str:
    """The graph of `features.features`."""
    ranges = graph.add("Concat", laser, ultrasonic, axis=1)
    shifted = graph.add("Add", ranges, graph.constant(RANGE_SHIFT))
    scaled_ranges = graph.add("Mul", graph.add("Log", shifted), graph.constant(RANGE_SCALE))
    far, bearing = (
        graph.add("Gather", "goal", graph.constant(which, np.int64), axis=1)
        for which in ([0], list(range(1, sizes["goal"])))
    )
    rest = [
        "twist",
        bearing,
        *(NAMES.get(k, k) for k in SCALED[2:] if k in sizes),
    ]
    scaled = graph.add("Mul", graph.add("Concat", *rest, axis=1), graph.constant(layout.scales))
    least = graph.add("Min", far, graph.constant(GOAL_RANGE))
    distance = graph.add("Div", least, graph.constant(GOAL_RANGE))
    near = graph.add("Exp", graph.add("Neg", far))
    near = graph.add("Mul", near, graph.constant(GOAL_PROXIMITY_WEIGHT))
    return graph.add("Concat", scaled_ranges, scaled, distance, near, axis=1)


def _lstm(graph: _Graph, weights: Weights, x: str) -> str:
    """The graph of the recurrent layer of `weights.Network`."""
    fed = graph.add("Gemm", x, graph.constant(weights.arrays["lstm.x"]), transB=1)
    recalled = graph.add(
        "Gemm", "h", graph.constant(weights.arrays["lstm.h"]),
        graph.constant(weights.arrays["lstm.b"]), transB=1,
    )  # fmt: skip
    gates = graph.add("Add", fed, recalled)
    names = [f"gate_{k}" for k in range(4)]
    parts = graph.constant([weights.lstm_size] * 4, np.int64)
    graph.nodes.append(graph._onnx.helper.make_node("Split", [gates, parts], names, axis=1))
    i, f, o = (graph.add("Sigmoid", names[k]) for k in (0, 1, 3))
    kept = graph.add("Mul", f, "c")
    new = graph.add("Mul", i, graph.add("Tanh", names[2]))
    graph.add("Add", kept, new, out="c_next")
    return graph.add("Mul", o, graph.add("Tanh", "c_next"), out="h_next")


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
