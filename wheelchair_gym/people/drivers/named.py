"""People by name: each a function that gives a `Driver`, whose settings others may override."""

from __future__ import annotations

import math

from wheelchair_gym.people.drivers.settings import (
    BrainComputer,
    Driver,
    Hand,
    Intention,
    Perception,
    ProportionalStick,
    Scanning,
    Switches,
)

# Reaction with an impairment, and of somebody who has driven little.
_SLOW, _NEW = Perception(reaction=0.6), Perception(reaction=0.35, anticipation=0.6)


def expert() -> Driver:
    """Somebody who has driven for years: foresees delays, brakes in time, and steers little."""
    return Driver()


def novice() -> Driver:
    """Somebody who has driven little: hesitates, foresees less, and moves the stick often."""
    return Driver(Intention(speed=0.8, indecision=0.25, steadiness=0.05), _NEW)


def essential_tremor() -> Driver:
    """An expert whose hand trembles at 6 Hz, moderately."""
    return Driver(hand=Hand(tremor=0.15, tremor_frequency=6.0))


def ataxia() -> Driver:
    """A cerebellar tremor at 3 Hz that rises near the goal, and slow reactions."""
    hand = Hand(tremor=0.2, tremor_frequency=3.0, tremor_at_goal=2.0, lag=0.2, return_lag=0.3)
    return Driver(Intention(speed=0.7), _SLOW, hand)


def spasticity() -> Driver:
    """A hand that spasms push to a corner once a minute, and that returns slowly."""
    return Driver(Intention(speed=0.8), hand=Hand(bursts=1.0, return_lag=0.4))


def weak_left() -> Driver:
    """A hand that brings about little to the left, and less forward."""
    return Driver(hand=Hand(forward=0.7, leftward=0.4))


def biased() -> Driver:
    """A hand that rests off the centre, in a stick that is turned by 15 degrees."""
    return Driver(hand=Hand(rotation=math.radians(15.0), offset_left=0.1))


def hemineglect() -> Driver:
    """Somebody who rarely notices what is to the left, and keeps to the left."""
    sight = Perception(reaction=0.5, neglect=math.radians(10.0), noticed=0.2, drift=0.1)
    return Driver(Intention(speed=0.8), sight)


def hemianopia() -> Driver:
    """Somebody who sees nothing to the left of straight ahead."""
    return Driver(perception=Perception(left=0.0))


def inattentive() -> Driver:
    """Somebody with a second task: twice a minute, for 1 to 3 s, the last signal goes on."""
    return Driver(perception=Perception(lapses=2.0))


def wavering() -> Driver:
    """Somebody who changes its mind, and drives up to things to look at them."""
    return Driver(Intention(mind_changes=2.0, looks=2.0))


def blind() -> Driver:
    """Somebody who knows the route and sees no obstacle."""
    return Driver(Intention(way="route", speed=0.7), Perception(left=0.0, right=0.0))


def hostile() -> Driver:
    """Somebody who pushes the stick fully towards the nearest obstacle."""
    return Driver(Intention(way="obstacle"))


def chin() -> Driver:
    """A stick that the chin moves: half the speed, 0.1 s later."""
    return Driver(perception=_NEW, interface=ProportionalStick(gain=0.5, delay=0.1))


def isometric() -> Driver:
    """A stick without throw, in a hand that trembles."""
    hand = Hand(tremor=0.15, tremor_frequency=6.0, lag=0.05, return_lag=0.05)
    return Driver(hand=hand, interface=ProportionalStick(smoothing=0.1))


def head_array() -> Driver:
    """Three pads behind the head: eight directions, while pressed."""
    return Driver(interface=Switches())


def sip_and_puff() -> Driver:
    """Breaths: forward and back are latched, turns last as long as the breath."""
    return Driver(interface=Switches(directions=4, latched=True, speed=0.5, turn=0.4, error=0.05))


def keyboard() -> Driver:
    """Four keys, alone or two at once."""
    return Driver(interface=Switches(delay=0.05, error=0.01))


def scanning() -> Driver:
    """A single switch that picks the lit one of four commands."""
    return Driver(Intention(period=0.3, horizon=2.5), interface=Scanning())


def bci() -> Driver:
    """A brain-computer interface: drives on slowly, and turns by 30 degrees at a command."""
    return Driver(Intention(horizon=4.0), interface=BrainComputer())
