"""The drive board's mind on a bench: two wheels that follow their volts, and faults on command."""

import math

from tests.hardware.native import NativeDrive
from wheelchair_gym.hardware.boards.protocol import Answer, Command, Mode, Rearm, Status
from wheelchair_gym.hardware.twin.lockstep import JoystickState
from wheelchair_gym.hardware.twin.lockstep import ibus_frame as frame
from wheelchair_gym.sim.settings import ChairSettings

CHAIR = ChairSettings()
FEED = CHAIR.motor.torque_constant / CHAIR.drive.wheel_radius  # V s/m
LAG = 0.13  # s: of 135 kg behind two motors
BRAKE = 2.0  # m/s2: of the spring brakes
EVERYTHING = 0xFFFF


class Bench(NativeDrive):
    """One wheel law for both: speed follows volts with a lag; brakes and friction end it."""

    def __init__(self, native):
        super().__init__(native)
        self.speeds, self.ways = [0.0, 0.0], [0.0, 0.0]
        self.seen = [True, True]  # a wheel whose encoder is seen
        self.stuck = [None, None]  # the duty at which a driver is stuck while it is enabled
        self.pull = 0.0  # m/s2: of a slope, forward
        self.grip = 1.0  # share of the brakes that is left
        self.target = None  # command sent every 20 ms
        self.runs = 0
        self.periods = lambda: 5  # ms of each run of the control

    def run(self, seconds: float) -> None:
        end = self.now + round(1e3 * seconds)
        while self.now < end:
            period = self.periods()
            dt = 1e-3 * period
            if self.target is not None and self.runs % 4 == 0:
                assert self.send(Command(*self.target)) == []
            self.runs += 1
            for i in range(2):
                self.speeds[i] += self.pull * dt
                if self.enable:
                    duty = self.duty[i] if self.stuck[i] is None else self.stuck[i]
                    aim = duty * self.battery / FEED
                    self.speeds[i] += (aim - self.speeds[i]) * (1 - math.exp(-dt / LAG))
                if not self.release:
                    slower = max(0.0, abs(self.speeds[i]) - self.grip * BRAKE * dt)
                    self.speeds[i] = math.copysign(slower, self.speeds[i])
                self.ways[i] += self.speeds[i] * dt
                if self.seen[i]:
                    self.counts[i] = math.floor(self.ways[i] * CHAIR.drive.counts_per_metre)
            self.step(period)

    def by_hand(self, seconds: float, **stick) -> None:
        """Run for some seconds with a hand at the stick, a frame every 10 ms."""
        for _ in range(round(seconds / 0.01)):
            self.stick(ibus(**stick))
            self.run(0.01)

    def rearm(self) -> Status:
        (answer,) = self.send(Rearm(EVERYTHING))
        assert isinstance(answer, Answer)
        return Status(answer.status)

    def follow(self, target, seconds: float) -> None:
        """Run for some seconds with this target; None: no commands come."""
        self.target = target
        self.run(seconds)

    def start(self, v=0.0, w=0.0, seconds=3.0):
        self.follow((0.0, 0.0), 0.1)
        assert self.rearm() == Status.DONE
        self.follow((v, w), seconds)
        assert self.odometry().mode == Mode.HOST
        return self


def ibus(ahead=0.0, aside=0.0, manual=False, held=False) -> bytes:
    """A frame of a FlySky receiver: sticks in [-1, 1], left positive."""
    return frame(JoystickState(ahead, aside, manual, held))
