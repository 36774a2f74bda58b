"""A hardware chair over the twin in simulated time, with a person beside it."""

from tests.hardware.conftest import build_twin
from tests.sim.worlds import box
from wheelchair_gym.hardware.settings import HardwareSettings
from wheelchair_gym.hardware.twin.inprocess import TwinChair
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.hardware.twin.plant import Plant
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings


class Hosted(TwinChair):
    """A person stands by: re-arms when reset waits for it, as long as `minds`."""

    def __init__(self, episode=None, chair=None, sensors=None, period=0.1, **settings):
        build_twin()
        sensors = sensors or SensorSettings(noise=False)
        twin = Twin(Plant(chair or ChairSettings(), sensors))
        twin.reset(episode or box(3.0), 0)
        super().__init__(twin, period, HardwareSettings(**settings))
        self.minds = True
        self.clock.call_every(self._mind, 0.05, "person")

    def _mind(self):
        if self.minds and self.chair.waiting_for:
            self.chair.rearm()

    def close(self):
        super().close()
        self.twin.close()
