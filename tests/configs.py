"""What each shipped config file must equal; run as a program, it writes them."""

from __future__ import annotations

import json
from typing import Any, Final

from tests.conftest import ROOT
from wheelchair_gym.envs import EnvSettings
from wheelchair_gym.sensing import SensorSettings
from wheelchair_gym.simulation import ChairSettings
from wheelchair_gym.task import TaskSettings

DEFAULTS: Final[dict[str, Any]] = {
    "chair": ChairSettings(),
    "env": EnvSettings(),
    "sensors": SensorSettings(),
    "task": TaskSettings(),
}

if __name__ == "__main__":
    from wheelchair_gym.config import dump

    for name, default in DEFAULTS.items():
        path = ROOT / "configs" / f"{name}.json"
        path.write_text(json.dumps(dump(default), indent=2) + "\n")
