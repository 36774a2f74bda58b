"""A host at the twin's wires: commands every 20 ms, odometry and ranges heard."""

import numpy as np

from tests.sim.worlds import box
from wheelchair_gym.hardware.boards import protocol
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.hardware.twin.plant import Plant
from wheelchair_gym.sensors.settings import SensorSettings
from wheelchair_gym.sim.settings import ChairSettings

PERIOD = 0.02  # s


class Pilot:
    """Drives a twin in a large room; what was heard last stands in `heard`, by kind."""

    def __init__(self, chair: ChairSettings | None = None):
        self.twin = Twin(Plant(chair, SensorSettings(noise=False)))
        self.twin.reset(box(50.0), 0)
        self.target = None
        self.heard, self.odometry = {}, []
        self.bad = 0
        self._receivers = protocol.Receiver(), protocol.Receiver()
        self._sequence = 0

    def send(self, message, board="drive"):
        self._sequence += 1
        getattr(self.twin, board).write(b"\0" + protocol.encode(message, self._sequence))

    def run(self, seconds):
        for _ in range(round(seconds / PERIOD)):
            if self.target is not None:
                self.send(protocol.Command(*self.target))
            self.twin.run(PERIOD)
            self.listen()
        return self

    def follow(self, target, seconds):
        self.target = target
        return self.run(seconds)

    def listen(self):
        boards = self.twin.drive, self.twin.range
        for board, receiver in zip(boards, self._receivers, strict=True):
            for frame in receiver.feed(board.read()):
                self.heard[type(frame.message)] = frame.message
                if isinstance(frame.message, protocol.Odometry):
                    self.odometry.append(frame.message)
        self.bad = sum(receiver.bad for receiver in self._receivers)

    def ask(self, message, kind=protocol.Parameter, board="drive"):
        self.heard.pop(kind, None)
        self.send(message, board)
        self.twin.run(0.01)
        self.listen()
        return self.heard[kind]

    def start(self, v=0.0, w=0.0, seconds=3.0):
        self.follow((0.0, 0.0), 0.1)
        answer = self.ask(protocol.Rearm(0xFFFF), protocol.Answer)
        assert answer.status == 0, answer
        self.follow((v, w), seconds)
        assert self.now.mode == protocol.Mode.HOST, self.now
        return self

    def until_rest(self, maximum=3.0):
        """Seconds until the chair stands, by truth, in steps of the world."""
        steps = self.twin.steps
        while abs(self.twin.motion.speed) > 1e-3 or abs(self.twin.motion.turn) > 1e-3:
            self.twin.run(0.001)
            assert self.twin.steps - steps < maximum * 1000, self.twin.motion
        return (self.twin.steps - steps) * 0.001

    @property
    def now(self) -> protocol.Odometry:
        return self.heard[protocol.Odometry]

    @property
    def ranges(self) -> protocol.Ranges:
        return self.heard[protocol.Ranges]

    @property
    def pose(self):
        return np.array(self.twin.plant.pose)
