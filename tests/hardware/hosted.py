"""A hardware chair over the twin in simulated time, with a person beside it."""

import numpy as np

from tests.hardware.conftest import build_twin
from tests.sim.worlds import box, drive_for
from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.hardware.twin.inprocess import TwinChair
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.hardware.twin.plant import Plant
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings

AHEAD = np.array([0.4, 0.0])


class Hosted(TwinChair):
    """A person stands by: re-arms when reset waits for it, as long as `minds`.

    The host believes that chair and sensors are the plant's, where it is not said otherwise.
    """

    def __init__(
        self, episode=None, chair=None, sensors=None, period=0.1, plant=None, believed=None,
        **settings,
    ):  # fmt: skip
        build_twin()
        plant = plant or Plant(chair or ChairSettings(), sensors or SensorSettings(noise=False))
        twin = Twin(plant, believed=believed and believed[0])
        twin.reset(episode or box(3.0), 0)
        super().__init__(twin, period, HardwareSettings(**settings), believed)
        self.minds = True
        self.clock.call_every(self._mind, 0.05, "person")

    def _mind(self):
        if self.minds and self.chair.waiting_for:
            self.chair.rearm()

    def drive_for(self, periods, twist=AHEAD):
        return drive_for(self.chair, twist, periods)

    def close(self):
        super().close()
        self.twin.close()
