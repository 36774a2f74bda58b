"""Settings of a simulated person who drives: what it intends, sees, does with its hand, and holds.

Sources that end in "assumed" are values that no publication was found for.
"""

import math
from collections.abc import Mapping
from typing import Any, Final, Literal

from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.settings import InputError, load, setting, settings, suggest

_ASSUMED = "assumed: no published value found"
_REACTION = "0.25 to 0.3 s, with impairments 0.5 to 1.0 s: assumed"


@settings
class Intention:
    """Route that a person wants to drive, and the choice of its next signal."""

    way: Literal["outline", "route", "obstacle"] = setting(default="outline")
    """Aim of the person: the quickest way of the chair's outline, the shortest route of a disc (a
    person who does not think of the chair's corners), or the nearest obstacle (a hostile one)."""
    speed: float = setting(default=1.0, low=0.05, high=1.0)
    """Largest deflection that it uses, as a share."""
    period: float = setting(default=0.4, unit="s", low=0.05, high=5.0, source="0.3 to 0.5: assumed")
    """Time between two decisions."""
    horizon: float = setting(default=1.6, unit="s", low=0.2, high=6.0)
    """Time that it looks ahead along the arc of a signal."""
    clearance: float = setting(default=0.25, unit="m", low=0.0, high=2.0)
    """Distance to obstacles that it likes to keep."""
    steadiness: float = setting(default=0.15, unit="s", low=0.0, high=10.0)
    """Seconds that a full change of the signal is worth: more makes fewer movements."""
    indecision: float = setting(default=0.0, unit="s", low=0.0, high=10.0, source=_ASSUMED)
    """Standard deviation of the error of a signal's judged worth: more makes more movements."""
    mind_changes: float = setting(default=0.0, unit="1/min", low=0.0, high=60.0, source=_ASSUMED)
    """Rate of turns to another free direction for a while."""
    looks: float = setting(default=0.0, unit="1/min", low=0.0, high=60.0, source=_ASSUMED)
    """Rate of slow drives up to something ahead, such as a desk, to look at it."""
    patience: float = setting(default=3.0, unit="s", low=0.1, high=600.0, source=_ASSUMED)
    """How long it pushes without any motion before it backs off; and how long it hesitates before
    it likes to keep half the distance."""
    retreat: float = setting(default=1.5, unit="s", low=0.0, high=60.0, source=_ASSUMED)
    """Time for which it then backs off."""
    adaptation: float = setting(default=2.0, unit="s", low=0.05, high=1e6, source=_ASSUMED)
    """Time constant with which it learns how much the chair turns beside what a stick asks for."""


@settings
class Perception:
    """A person's perception of its surroundings, and the delay until it acts on it.

    Obstacles are those that the first scanner shows; its place is the true one.
    """

    reaction: float = setting(default=0.28, unit="s", low=0.0, high=2.0, source=_REACTION)
    """Time from seeing to acting."""
    anticipation: float = setting(default=1.0, low=0.0, high=1.5, source=_ASSUMED)
    """Share of its delays and the interface's for which it foresees where the chair will be."""
    left: float = setting(default=math.pi, unit="rad", low=0.0, high=math.pi)
    """Obstacles farther to the left are not seen."""
    right: float = setting(default=math.pi, unit="rad", low=0.0, high=math.pi)
    """Obstacles farther to the right are not seen."""
    neglect: float = setting(
        default=math.pi, unit="rad", low=-math.pi, high=math.pi, source="neglect: 10 deg, assumed"
    )
    """Obstacles farther to the left than this angle are noticed by chance."""
    noticed: float = setting(default=1.0, low=0.0, high=1.0, source="neglect: 0.2, assumed")
    """Probability that one of these directions is noticed, drawn anew each second."""
    drift: float = setting(
        default=0.0, unit="m", low=-1.0, high=1.0, source="Turton 2009: to the left; 0.1 m assumed"
    )
    """Distance that it keeps to the left of its way."""
    lapses: float = setting(default=0.0, unit="1/min", low=0.0, high=60.0, source="1 to 3, assumed")
    """Rate of lapses of attention; its last signal then goes on."""


@settings
class Hand:
    """Effect of a body on an intended deflection; only sticks use it."""

    tremor: float = setting(
        default=0.0, low=0.0, high=1.0, source="0.05, 0.15, 0.35 by severity: assumed"
    )
    """Amplitude of a tremor, as a share of full deflection; of a sine of equal power."""
    tremor_frequency: float = setting(
        default=6.0,
        unit="Hz",
        low=0.5,
        high=25.0,
        source="PMC6806079: essential 4 to 12 Hz, Parkinson 3 to 8; cerebellar 2 to 5",
    )
    """Centre of the tremor's band."""
    tremor_band: float = setting(default=1.0, unit="Hz", low=0.05, high=10.0, source=_ASSUMED)
    """Width of its band."""
    tremor_at_goal: float = setting(
        default=1.0, low=1.0, high=10.0, source="cerebellar tremor rises near the target: assumed"
    )
    """Factor on the tremor within a metre of the goal."""
    bursts: float = setting(
        default=0.0, unit="1/min", low=0.0, high=60.0, source="spasticity 0.5 to 2: assumed"
    )
    """Rate of spasms that push the hand to a corner."""
    forward: float = setting(default=1.0, low=0.0, high=1.0, source="weakness 0.3 to 0.7: assumed")
    """Share of a deflection forward that the hand brings about."""
    backward: float = setting(default=1.0, low=0.0, high=1.0, source="weakness 0.3 to 0.7: assumed")
    """The same backward."""
    leftward: float = setting(default=1.0, low=0.0, high=1.0, source="weakness 0.3 to 0.7: assumed")
    """The same to the left."""
    rightward: float = setting(
        default=1.0, low=0.0, high=1.0, source="weakness 0.3 to 0.7: assumed"
    )
    """The same to the right."""
    rotation: float = setting(
        default=0.0, unit="rad", low=-math.pi, high=math.pi, source="15 deg: assumed"
    )
    """Rotation of deflections, counter-clockwise."""
    offset_forward: float = setting(default=0.0, low=-1.0, high=1.0, source="0.1: assumed")
    """Deflection forward at rest."""
    offset_left: float = setting(default=0.0, low=-1.0, high=1.0, source="0.1: assumed")
    """Deflection to the left at rest."""
    lag: float = setting(default=0.10, unit="s", low=0.001, high=5.0, source=_ASSUMED)
    """Time constant of the hand's motion."""
    return_lag: float = setting(default=0.10, unit="s", low=0.001, high=5.0, source=_ASSUMED)
    """Time constant of its return to the centre."""


@settings
class ProportionalStick:
    """A proportional stick, for hand or chin, or an isometric one, which has no throw."""

    kind: Literal["stick"] = setting(default="stick")
    """The interface of these settings."""
    gain: float = setting(default=1.0, low=0.05, high=1.0, source="chin 0.5: assumed")
    """Share of full speed at full deflection."""
    dead_zone: float = setting(
        default=0.10,
        low=0.0,
        high=0.9,
        source="5 to 20 %: assumed; Roboteq AX500 manual: 0 to 54 %, 16 % set",
    )
    """Radius of the dead zone, as a share of full deflection."""
    levels: float = setting(default=127.0, low=1.0, high=1e6, source="R-net: a signed byte an axis")
    """Steps from the centre to full deflection."""
    smoothing: float = setting(default=0.05, unit="s", low=0.0, high=5.0, source=_ASSUMED)
    """Time constant of the filter before the sampling."""
    delay: float = setting(default=0.0, unit="s", low=0.0, high=2.0, source="chin 0.1: assumed")
    """Time added to each change."""


@settings
class Switches:
    """Switches that give directions, on or off: head array, sip-and-puff, keyboard."""

    kind: Literal["switches"] = setting(default="switches")
    """The interface of these settings."""
    directions: Literal[4, 8] = setting(
        default=8, source="head array: 8 directions (argallab/interface_assessments)"
    )
    """4: forward, back, or a turn in place; 8: turns while driving, too."""
    latched: bool = setting(default=False)
    """True: forward and back go on after the switch is let go, and an opposite signal stops them;
    turns are held (R-net Omni manual: sip-and-puff)."""
    speed: float = setting(default=0.6, low=0.05, high=1.0)
    """Deflection forward that a switch stands for."""
    turn: float = setting(default=0.5, low=0.05, high=1.0)
    """Deflection to a side that a switch stands for."""
    delay: float = setting(default=0.3, unit="s", low=0.0, high=5.0, source="head array: assumed")
    """Time to bring about another signal."""
    error: float = setting(
        default=0.03, low=0.0, high=1.0, source="wrong pad 3 %, hard for soft breath 5 %: assumed"
    )
    """Probability that another signal comes about."""


@settings
class Scanning:
    """A single switch: it picks the command that is lit, and a press while driving stops."""

    speed, turn = 0.4, 0.3  # deflections of a command, forward and to a side; assumed
    kind: Literal["scanning"] = setting(default="scanning")
    """The interface of these settings."""
    scan_period: float = setting(
        default=1.25,
        unit="s",
        low=0.1,
        high=10.0,
        source="Simpson 2007: reaction time / 0.65; 1.0 to 1.5 s assumed",
    )
    """Time for which each of the four commands is lit."""
    delay: float = setting(default=0.1, unit="s", low=0.0, high=5.0, source=_ASSUMED)
    """Time of a press."""
    error: float = setting(default=0.05, low=0.0, high=1.0, source=_ASSUMED)
    """Probability that the press comes when the next command is lit."""


@settings
class BrainComputer:
    """Motor imagery, left or right, and none: straight on. A switch starts and stops the chair."""

    speed, turn = 0.3, 0.4  # deflections of a command, forward and to a side; assumed
    delay = 0.5  # s: time to start or stop by the switch; assumed
    kind: Literal["brain_computer"] = setting(default="brain_computer")
    """The interface of these settings."""
    accuracy: float = setting(
        default=0.85, low=0.0, high=1.0, source="Leeb 2015: more than 70 % to take part; Tonin 2022"
    )
    """Probability that a command is the one that was meant; else it is its opposite."""


INTERFACES: Final[dict[str, Any]] = {
    "stick": ProportionalStick,
    "switches": Switches,
    "scanning": Scanning,
    "brain_computer": BrainComputer,
}


@settings
class Driver:
    """A simulated person who drives a chair."""

    intention: Intention = Intention()
    perception: Perception = Perception()
    hand: Hand = Hand()
    interface: Any = setting(default=None)
    """Input device: settings of a stick, switches, scanning or a brain-computer interface, which
    their `kind` tells apart; none: a stick."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "interface", interface_of(self.interface))


def interface_of(value: Any) -> Any:
    """The settings of an interface: themselves, or those of an object with their `kind`.

    Raises:
        InputError: the kind is unknown, or a setting is wrong.
    """
    if value is None:
        return ProportionalStick()
    if type(value) in INTERFACES.values():
        return value
    if not isinstance(value, Mapping):
        raise InputError(f"interface is {shorten(value)}; expected an object with a kind")
    kind = value.get("kind", "stick")
    if not isinstance(kind, str) or kind not in INTERFACES:
        near = suggest(kind, INTERFACES)
        known = ", ".join(INTERFACES)
        raise InputError(f"interface.kind is {shorten(kind)}; expected one of {known}{near}")
    return load(INTERFACES[kind], value, "interface")
