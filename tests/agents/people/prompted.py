"""Simulated people who follow prompts: hand and interface as they drive, without intention."""

from __future__ import annotations

import numpy as np

from agents.people.recorded_stick import schedule
from wheelchair_gym.people.drivers.state import DRIVER, constants_of
from wheelchair_gym.people.drivers.step import begin_signal, give_signal
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Stick


class Prompted:
    """The stick of a driver that does what prompts ask for, one control period a call."""

    def __init__(self, driver, rate=50.0, seed=0):
        switches = driver.interface.kind == "switches"
        directions = driver.interface.directions if switches else 8
        sizes = (1.0,) * 4 if switches else (1.0, 0.5)
        self.prompts = np.array(schedule(seed, sizes, directions))
        self._records = constants_of(driver, ChairSettings(), SensorSettings(), 1.0 / rate)
        self._state = np.zeros(1, DRIVER)
        device = driver.interface
        asked = self.prompts[:, 1:] * getattr(device, "gain", 1.0)
        if device.kind == "stick":  # which signals it has follows from the prompts
            self._records["signals"][0][: len(asked)] = asked
            self._signals, late = np.arange(len(asked)), driver.perception.reaction + device.delay
        else:
            known = self._records["signals"][0][: self._records["n_signals"][0]]
            want = np.where(np.abs(asked) > 0.1, np.sign(asked), 0.0)
            self._signals = np.array(
                [np.flatnonzero((np.sign(known) == one).all(axis=1))[0] for one in want]
            )
            late = driver.perception.reaction
        self._times = self.prompts[:, 0] + late
        self.period, self._k = 1.0 / rate, 0
        begin_signal(self._state[0], np.uint64(seed + 1))

    def __call__(self):
        row = np.searchsorted(self._times, self._k * self.period + 1e-9, "right") - 1
        self._k += 1
        self._state[0]["intended"] = self._signals[row] if row >= 0 else 0
        give_signal(self._records[0], self._state[0], 0.0, False)
        forward, left = self._state[0]["stick"].tolist()
        return Stick(forward, left, bool(self._state[0]["latched"]))
