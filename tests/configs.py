"""Expected content of each shipped config file; run as a program, it writes them."""

import json
from typing import Any, Final

from agents.learning.settings import RECIPES
from planners import PLANNERS
from tests.conftest import ROOT
from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.hardware.registry import CHAIRS
from wheelchair_gym.people.drivers import DRIVERS
from wheelchair_gym.perception.slam import SlamSettings
from wheelchair_gym.safety import ShieldSettings
from wheelchair_gym.scenes import SCENES
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings, MotorSettings, PhysicsSettings
from wheelchair_gym.task import TaskSettings

DEFAULTS: Final[dict[str, Any]] = {
    "chair": ChairSettings(),
    "chairs": {name: chair() for name, chair in sorted(CHAIRS.items())},
    "drivers": {name: DRIVERS[name]() for name in sorted(DRIVERS.built_in)},
    "env": EnvSettings(),
    "hardware": EnvSettings(
        sensors=SensorSettings(pose_source="mcl"),
        # The drive board controls at 200 Hz: a simulation of this chair does so, too.
        chair=ChairSettings(motor=MotorSettings(control_rate=200.0)),
        physics=PhysicsSettings(step=0.005),
        slam=SlamSettings(reserve=20.0),
    ),
    "planners": {name: planner() for name, planner in sorted(PLANNERS.items())},
    "scenes": {name: scene() for name, scene in sorted(SCENES.items())},
    "sensors": SensorSettings(),
    "shield": ShieldSettings(),
    "task": TaskSettings(),
    **RECIPES,
}
# Each object of settings by a name, those of files with many, too.
SINGLE: Final[dict[str, Any]] = {
    name: value
    for file, default in DEFAULTS.items()
    for name, value in (
        {f"{file}:{key}": item for key, item in default.items()}
        if isinstance(default, dict)
        else {file: default}
    ).items()
}

if __name__ == "__main__":
    from wheelchair_gym.base.settings import dump

    for name, default in DEFAULTS.items():
        path = ROOT / "configs" / f"{name}.json"
        path.write_text(json.dumps(dump(default), indent=2) + "\n")
