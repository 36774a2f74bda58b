"""Training runs that take a second, and weights that were never trained."""

import numpy as np

from agents.learning.settings import read_training
from agents.learning.weights import FORMAT, Layout, Weights
from wheelchair_gym.base.settings import load
from wheelchair_gym.envs import EnvSettings

ENV = {
    "scene": "clutter",
    "rate": 5.0,
    "guidance": "poses",
    "bank": {"size": 2, "turnover": 0.0},
    "chair": {"randomize": True},
    "sensors": {"laser": {"beams": 48}, "pose_source": "modelled"},
    "task": {
        "beams": 32,
        "aim": "time",
        "last_action": True,
        "shield_state": True,
        "side_clearance": True,
        "trail": [0.5, 2.0],
        "time_base": 4.0,
        "time_factor": 0.0,
    },
}
PRIVY = {**ENV, "task": {**ENV["task"], "privileged": True}}
ON = {"n_steps": 8, "batch_size": 32, "n_epochs": 1}
OFF = {"buffer_size": 400, "batch_size": 16, "learning_starts": 32, "gradient_steps": 1}


def tiny(algorithm, **changes):
    """A run of three checkpoints that takes a second."""
    on_policy = algorithm == "ppo"
    content = {
        "env": PRIVY if algorithm == "ppo" else ENV,
        "n_envs": 4,
        "frames": 192 if on_policy else 96,
        "checkpoint_frequency": 2 if on_policy else 8,
        "net_arch": [16, 16],
        "threads": 1,
        "on_policy": ON,
        "off_policy": OFF,
        "evaluation": {"episodes": 3, "frequency": 3},
        "curriculum": {"initial_time": 3.0, "episodes": 4, "success_threshold": 0.0},
        **changes,
    }
    return read_training(content, "tiny.json", algorithm)


def random_weights(posed=True, head="clip", rear=0):
    """Weights of a chair whose second laser, if any, has this many beams."""
    lasers = {"laser": {"beams": 1081}, "more_lasers": [{"beams": rear}] if rear else []}
    env = {"sensors": lasers, "task": {"beams": 64}}
    made = load(EnvSettings, env, "env")
    sizes = [
        ["laser", sum(made.task.observed_beams(made.sensors))], ["ultrasonic", 8], ["twist", 2],
        ["goal", 3], ["action", 2], ["shield", 3], ["path", 20],
    ]  # fmt: skip
    layout = Layout(tuple(map(tuple, sizes)), posed)
    rng = np.random.default_rng(5)

    def draw(*shape):
        return (rng.normal(size=shape) / np.sqrt(shape[-1])).astype(np.float32)

    told, arrays = layout.actor_size, {}
    for k, (before, after) in enumerate(((told, 32), (32, 32), (32, 2))):
        arrays[f"dense{k}.w"], arrays[f"dense{k}.b"] = draw(after, before), draw(after)
    card = {"format": FORMAT, "head": head, "env": env}
    return Weights(arrays, {**card, "layout": {"sizes": sizes, "path_has_heading": posed}})
