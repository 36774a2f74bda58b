"""Learned policies as ONNX: the graph maps sensor readings to a twist."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.evaluation.provenance import write_json
from agents.evaluation.tables import templates
from agents.learning import weights as learned
from agents.learning.weights import Weights, check_card
from wheelchair_gym.base.arrays import Floats
from wheelchair_gym.base.errors import imports, shorten
from wheelchair_gym.base.files import atomic_write, read_bytes, read_json
from wheelchair_gym.base.settings import InputError, load
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.task.observations import PRIVILEGED

NAMES = {"action": "last_action"}  # names of inputs that differ from keys
OPSET = 17  # of 2022, so that every current runtime reads it


def groups_of(env: EnvSettings) -> NDArray[np.int64]:
    """Indices (pooled, most) of the beams that each pooled beam of all lasers is the minimum of."""
    ends, first = [np.zeros(1, np.int64)], 0
    lasers, observed = env.sensors.lasers, env.task.observed_beams(env.sensors)
    for laser, pooled in zip(lasers, observed, strict=True):
        ends.append(first + np.arange(1, pooled + 1) * laser.beams // pooled)
        first += laser.beams
    edges = np.concatenate(ends)
    maximum = int(np.diff(edges).max())
    groups: NDArray[np.int64] = np.minimum(
        edges[:-1, None] + np.arange(maximum), edges[1:, None] - 1
    )
    return groups


def export_onnx(weights: Weights, path: str | Path) -> dict[str, Any]:
    """Write weights as an ONNX graph, and a sidecar PATH.json; the sidecar.

    Inputs are the fields of a reading: `laser` (n, beams of all lasers) and `ultrasonic` (n, those
    mounted) [m], which may hold +inf, -inf and NaN; and keys of the observation (`twist`, `goal`,
    `last_action`, `shield`, `path`; of an assistant `stick` in place of `goal`). Outputs are
    `action` (n, 2) in [-1, 1] and, of a policy, its twist, `twist_asked` (n, 2) [m/s, rad/s]. The
    action of an assistant is a residual, which the compiled assistant in the card's settings adds
    within its freedom.

    Raises:
        InputError: onnx is not installed, a file cannot be written, or the weights are of a chair
            without lasers or ultrasonics.
    """
    with imports("export needs", "learn"):
        import onnx
    layout, arrays = weights.layout, weights.arrays
    env = load(EnvSettings, weights.card["env"], "weights: env")
    sizes = {key: n for key, n in layout.sizes if key not in PRIVILEGED}
    lasers, beams, limits = env.sensors.lasers, env.sensors.beams, env.chair.limits
    if not lasers or not env.sensors.ultrasonic.mounted:
        raise InputError("export: expected lasers and ultrasonics; the weights' chair has not both")
    inputs = {NAMES.get(key, key): n for key, n in {**sizes, "laser": beams}.items()}
    outputs = {"action": 2} | ({} if layout.is_assistant else {"twist_asked": 2})
    text = templates().get_template("policy.onnx.txt").render(
        opset=OPSET, inputs=inputs, outputs=outputs,
        others=[NAMES.get(key, key) for key in learned.SCALED[2:] if key in sizes],
        layers=weights.dense_layers, head=weights.card["head"], is_assistant=layout.is_assistant,
    )  # fmt: skip
    model = onnx.parser.parse_model(text)
    constants: dict[str, Any] = {
        "zero": 0.0, "one": 1.0, "minus_one": -1.0,
        "laser_reach": np.concatenate([np.full(laser.beams, laser.reach) for laser in lasers]),
        "ultrasonic_reach": [model.reach for model in env.sensors.ultrasonic.models],
        "groups": groups_of(env),
        "range_shift": learned.RANGE_SHIFT, "range_scale": learned.RANGE_SCALE,
        "goal_range_index": np.array([0]), "bearing_indices": np.arange(1, sizes.get("goal", 1)),
        "goal_range": learned.GOAL_RANGE, "goal_proximity_weight": learned.GOAL_PROXIMITY_WEIGHT,
        "scales": layout.scales,
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
        with imports("ONNX policies need", "learn"):
            import onnxruntime
        path = Path(path)
        content = read_bytes(path, "weights")
        self.card = read_json(f"{path}.json")
        digest = hashlib.sha256(content).hexdigest()
        if not isinstance(self.card, dict) or digest != self.card.get("sha256"):
            raise InputError(f"{path}: differs from what {path.name}.json says; export it again")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.log_severity_level = 4  # errors are reported below
        try:
            check_card(self.card)
            places = ["CPUExecutionProvider"]
            self._session = onnxruntime.InferenceSession(content, options, providers=places)
            inputs = {value.name: value.shape[-1] for value in self._session.get_inputs()}
            if self.card.get("inputs") != inputs:
                raise ValueError(f"inputs are {shorten(inputs)}")
            self._layout = learned.Layout.of_card(self.card)
            self._inputs = inputs
            groups = groups_of(load(EnvSettings, self.card["env"], "weights: env"))
            widths = groups[:, -1] - groups[:, 0] + 1
            self._pooled = np.repeat(np.arange(len(groups)), widths)  # by beam
            action = self(np.ones((1, self._layout.size), np.float32))  # some graphs fail only here
            if action.shape != (1, 2) or action.dtype != np.float32:
                raise ValueError(f"its action has shape {action.shape}; expected (1, 2)")
        except Exception as error:  # onnxruntime documents no errors of its reader
            why = " ".join(str(error).split()[:20]) or type(error).__name__
            raise InputError(f"{path}: expected an exported policy ({why})") from None

    def __call__(self, flat: Floats) -> Floats:
        """Actions (n, 2) for flat observations (n, size), whose scan is already pooled."""
        feed = {
            NAMES.get(key, key): flat[:, self._layout.slice_of(key)]
            for key, _ in self._layout.sizes
            if NAMES.get(key, key) in self._inputs
        }
        feed["laser"] = feed["laser"][:, self._pooled]
        feed = {key: np.ascontiguousarray(value) for key, value in feed.items()}
        action: Floats = self._session.run(["action"], feed)[0]
        return action
