"""Both boards and the world in lock step: a millisecond of physics, then a millisecond of firmware.

The boards' registers at the start of a step drive its physics. The results reach the boards in the
next step: encoder edges at their exact cycles, voltages and switches at its start.
"""

import functools
import math
from dataclasses import dataclass, field

from wheelchair_gym.hardware.boards.parameters import drive_parameters, range_parameters
from wheelchair_gym.hardware.boards.protocol import BAUD, Switch
from wheelchair_gym.hardware.twin.board import FREQUENCY, EmulatedBoard, stored_parameters
from wheelchair_gym.hardware.twin.laser import SCAN_PERIOD_MS, TwinLaser
from wheelchair_gym.hardware.twin.plant import TIME_STEP, Motion, Plant, Slope
from wheelchair_gym.sim.settings import ChairSettings
from wheelchair_gym.types import Episode

EVERY = 7  # ms between two frames of the joystick's receiver
_CENTRE, _TRAVEL, _OFF, _ON = 1500, 500, 1000, 2000


@dataclass(frozen=True)
class JoystickState:
    """The state of the joystick; sticks in [-1, 1], left positive."""

    forward: float = 0.0
    turn: float = 0.0
    manual: bool = False  # the switch that takes over
    dead_man: bool = False  # the dead-man button


def ibus_frame(stick: JoystickState) -> bytes:
    """A frame of the joystick's receiver (iBUS)."""
    values = [_CENTRE] * 14
    values[0] = round(_CENTRE - _TRAVEL * stick.turn)
    values[1] = round(_CENTRE + _TRAVEL * stick.forward)
    values[4], values[5] = _ON if stick.manual else _OFF, _ON if stick.dead_man else _OFF
    data = b"\x20\x40" + b"".join(v.to_bytes(2, "little") for v in values)
    return data + (0xFFFF - sum(data)).to_bytes(2, "little")


IBUS_BAUD = 115_200  # 1/s, of the joystick's receiver
CYCLES = round(TIME_STEP * FREQUENCY)
SOUND = 343.0  # m/s, at 20 C: as the range board's `sound`
BATTERY_FULL = 60.0  # V at the ADC's full scale: as the drive board's `battery_full`
ADC_FULL = 2.56  # V: the internal reference
CHANGE_OVER = 15  # steps in which the relay K2 moves between the drivers and the short circuit
STRIP_HELD = 100  # steps that a strip stays pressed after a hit

# Data memory of the ATmega2560.
_TCCR4A, _ICR4, _OCR4A, _OCR4B, _DDRL, _PORTL = 0xA0, 0xA6, 0xA8, 0xAA, 0x10A, 0x10B
_COM4A1, _COM4B1, _ENABLE, _RELEASE = 0x80, 0x20, 0x04, 0x08
_BUS_SONAR = 0xE0  # address of the first

_NONE = Switch(0)


@dataclass
class Faults:
    """Injected faults, and what a person does to the chair; pairs are (left, right)."""

    switches: Switch = _NONE  # pressed or pulled
    disconnected_encoders: list[bool] = field(default_factory=lambda: [False] * 2)
    swapped_encoders: list[bool] = field(default_factory=lambda: [False] * 2)  # A and B
    battery: float | None = None  # V: what the drive board measures
    blocked_wheels: tuple[bool, bool] = (False, False)
    silent_ultrasonics: set[int] = field(default_factory=set)
    stuck_ultrasonics: dict[int, float] = field(default_factory=dict)  # m
    joystick: JoystickState | None = None  # at the drive board's receiver; None: silent
    # Duties at which drivers are stuck, until they are disabled; None: they work.
    stuck_drivers: list[float | None] = field(default_factory=lambda: [None] * 2)
    swapped_motors: bool = False  # each driver feeds the other side's motor
    inverted_motors: list[bool] = field(default_factory=lambda: [False] * 2)  # the two wires
    brake_fraction: float = 1.0  # of the spring brakes' torque
    slope: Slope | None = None  # of the floor; None: level
    push_force: float = 0.0  # N, along the chair's heading
    push_switch: bool = False  # held: it opens the motors' short circuit and the drivers' enable


class Twin:
    """An emulated drive board and range board on a simulated chair; time passes in `run`.

    Args:
        plant: the chair.
        believed: the chair whose parameters the EEPROM holds; None: the plant's settings.

    Attributes:
        drive: the drive board, see `SerialCable`.
        range: the range board.
        lasers: all of them; the first one has a name of its own, too.
        faults: injected; they may change at any time.
        motion: of the last step.
        steps: milliseconds since power-on.
        bumper_steps: steps in which a bumper strip was hit.
    """

    def __init__(self, plant: Plant | None = None, believed: ChairSettings | None = None) -> None:
        self.plant = plant or Plant()
        self.faults = Faults()
        drive = "atmega2560", "drive.elf", (BAUD, IBUS_BAUD)
        ranges = "atmega328p", "range.elf", (BAUD, 0)
        self.drive, self.range = EmulatedBoard(*drive), EmulatedBoard(*ranges)
        chair = self.plant.chair
        wanted = drive_parameters(believed or chair.settings)
        self.drive.set_eeprom(stored_parameters(*drive, tuple(wanted.items())))
        wanted = range_parameters(chair.sensors.ultrasonic)
        self.range.set_eeprom(stored_parameters(*ranges, tuple(wanted.items())))
        for i in range(4):
            self.range.call("pulse_sonar", b"D", 4 + i, b"B", i)
        for i in range(len(chair.sensors.ultrasonic.mounted) - 4):
            self.range.call("bus_sonar", _BUS_SONAR + 2 * i)
        self.range.on_ping(self._ping)
        self.lasers = [
            TwinLaser(functools.partial(self.plant.scan, which=k), laser, lambda: self.steps)
            for k, laser in enumerate(chair.sensors.lasers)
        ]
        self.laser = self.lasers[0]
        for bit in range(4):
            self.drive.set_pin("B", bit, False)
        self.steps = self.bumper_steps = 0
        self.motion = Motion(0.0, 0.0, 0.0, 0.0, 0.0, False)
        self._turned = [0.0, 0.0]
        self._set: Switch | None = None
        self._strip, self._strip_until = _NONE, 0
        self._pulled, self._moving = False, 0  # the relay: motors at their drivers; steps of change

    def reset(self, episode: Episode, key: int) -> None:
        """Put the chair at an episode's start; the boards and their time go on."""
        self.plant.reset(episode, key)
        # Encoders turn by differences of the motion: the jump to the start is none.
        self.motion = self.plant.step((0.0, 0.0), (False, False), 1.0)

    @property
    def duty(self) -> tuple[float, float]:
        """Duties at the motors' terminals, read from the drive board's registers."""
        board = self.drive
        top, way = board.read_word(_ICR4) + 1, board.read_memory(_PORTL)
        on = board.read_memory(_TCCR4A)
        left = (board.read_word(_OCR4A) + 1) / top if on & _COM4A1 else 0.0
        right = (board.read_word(_OCR4B) + 1) / top if on & _COM4B1 else 0.0
        return (-left if way & 1 else left), (-right if way & 2 else right)

    @property
    def enabled(self) -> bool:
        """Whether drivers and relay are on, by the board, emergency stop and push switch."""
        on = self.drive.read_memory(_PORTL) & self.drive.read_memory(_DDRL) & _ENABLE
        off = self.faults.push_switch or self.faults.switches & Switch.STOP_PRESSED
        return bool(on) and not off

    @property
    def braked(self) -> bool:
        """Whether the spring brakes are closed; their current runs by the emergency stop, too."""
        if self.faults.switches & Switch.FREEWHEEL:
            return False
        held = self.drive.read_memory(_PORTL) & self.drive.read_memory(_DDRL) & _RELEASE
        return not held or bool(self.faults.switches & Switch.STOP_PRESSED)

    def run(self, seconds: float) -> None:
        """Advance by a whole number of milliseconds."""
        for _ in range(round(seconds / TIME_STEP)):
            self._step()

    def _step(self) -> None:
        before, faults, on = self.motion, self.faults, self.enabled
        self._moving = self._moving + 1 if on != self._pulled else 0
        if self._moving > CHANGE_OVER:
            self._pulled, self._moving = on, 0
        closed = on if self._pulled else not faults.push_switch
        self.motion = motion = self.plant.step(
            self._terminals() if self._pulled else (0.0, 0.0),
            (closed, closed),
            faults.brake_fraction if self.braked else 0.0,
            faults.blocked_wheels,
            faults.slope,
            faults.push_force,
        )
        self.steps += 1
        until = self.steps * CYCLES
        self._set_switches()
        battery = motion.battery if self.faults.battery is None else self.faults.battery
        self.drive.call("voltage", 0, round(battery / BATTERY_FULL * ADC_FULL * 1000.0))
        counts = motion.left - before.left, motion.right - before.right
        for wheel, count in enumerate(counts):
            if self.faults.disconnected_encoders[wheel]:
                continue
            start = self._turned[wheel]
            end = start + (-count if self.faults.swapped_encoders[wheel] else count)
            if math.floor(start) != math.floor(end):
                self.drive.rotate_encoder("B", 2 * wheel, start, end, until)
            self._turned[wheel] = end
        if self.faults.joystick is not None and self.steps % EVERY == 0:
            self.drive.write(ibus_frame(self.faults.joystick), 1)
        self.drive.run(until)
        self.range.run(until)
        if self.steps % SCAN_PERIOD_MS == 0:
            for laser in self.lasers:
                laser.turn(self.steps)

    def _terminals(self) -> tuple[float, float]:
        """Duties at the motors: those of the board, changed by the faults."""
        faults = self.faults
        pairs = zip(self.duty, faults.stuck_drivers, strict=True)
        left, right = (duty if stuck is None else stuck for duty, stuck in pairs)
        if faults.swapped_motors:
            left, right = right, left
        inverted = faults.inverted_motors
        return -left if inverted[0] else left, -right if inverted[1] else right

    def _set_switches(self) -> None:
        if self.motion.bumped:
            self.bumper_steps += 1
            forward, turning = self.motion.speed, self.motion.turn
            ahead = abs(forward) > 0.1 * abs(turning)
            sides = Switch.LEFT | Switch.RIGHT
            self._strip = (Switch.FRONT if forward > 0.0 else Switch.REAR) if ahead else sides
            self._strip_until = self.steps + STRIP_HELD
        switches = self.faults.switches
        if self.steps < self._strip_until:
            switches |= self._strip
        if switches == self._set:
            return
        self._set = switches
        for bit in range(8):
            self.drive.set_pin("C", bit, bool(switches >> bit & 1))

    def _ping(self, sonar: int, _cycle: int) -> int:
        which = sonar & 0x7F
        if which in self.faults.silent_ultrasonics:
            return -1
        if sonar != which:
            return 0
        metres = self.faults.stuck_ultrasonics.get(which)
        if metres is None:
            metres = self.plant.ping(which)
        return round(metres * 2.0 / SOUND * 1e6) if math.isfinite(metres) else 0

    def close(self) -> None:
        """Free the boards."""
        self.drive.close()
        self.range.close()
        self.plant.chair.close()
