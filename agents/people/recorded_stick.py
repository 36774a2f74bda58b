"""Recorded sessions of a person at a stick or switches, and prompts that ask for deflections."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.people.drivers.intention import NEAR_GOAL
from wheelchair_gym.recording.replay import RecordedEpisode

HOLD, REST = 2.5, 2.0  # s for which a prompt asks for a deflection, and for the centre after it
# What is held, as kinds of interfaces of drivers.
_KINDS = {"board": "stick", "gamepad": "stick", "touch": "stick", "keyboard": "switches"}


class StickSession(NamedTuple):
    """The stick of one recorded session."""

    period: float  # s between two sticks
    sticks: Array  # (n, 2) forward, left
    latched: bool  # a stick of it was
    near_goal: NDArray[np.bool_]  # (n,) where a tremor may be larger
    prompts: Array  # (k, 3) s, forward, left; none in a drive
    interface: str  # which was held
    share: float  # of full speed at full deflection


def schedule(
    seed: int, sizes: Sequence[float] = (1.0, 0.5), directions: int = 8
) -> list[list[float]]:
    """Prompts in an order that cannot be foreseen: rows of time [s], forward, left.

    Args:
        seed: of the order.
        sizes: deflections that each direction is asked for; of switches, 1 each time.
        directions: 8, or 4 without those between.

    Returns:
        Rows; between two deflections the centre is asked for.
    """
    ways = [
        (x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if 0 < abs(x) + abs(y) < directions / 2.5
    ]
    asked = [(size * x / math.hypot(x, y), size * y / math.hypot(x, y))
             for x, y in ways for size in sizes]  # fmt: skip
    order = np.random.default_rng(seed).permutation(len(asked))
    rows, now = [[0.0, 0.0, 0.0]], REST
    for k in order:
        rows += [[now, *asked[k]], [now + HOLD, 0.0, 0.0]]
        now += HOLD + REST
    return rows


def prompt_text(forward: float, left: float) -> str:
    """Return the prompt that asks a person for a deflection."""
    if forward == left == 0.0:
        return "let go: centre"
    ways = [("forward", forward), ("backward", -forward), ("left", left), ("right", -left)]
    size = "fully" if math.hypot(forward, left) > 0.75 else "by half"
    return f"push {size} {' and '.join(name for name, value in ways if value > 0.1)}"


def session_of(recorded: RecordedEpisode) -> StickSession:
    """The stick of a recorded episode.

    Raises:
        InputError: no person drove, or with more than one interface.
    """
    if not recorded.has_person:
        raise InputError("expected recordings in which a person drives")
    if others := {"interface", "hand"}.intersection(recorded.changed):
        raise InputError(f"the {' and the '.join(sorted(others))} changed in mid-drive")
    found: Any = [state.reading.stick for state in recorded.states]
    labels, places = recorded.labels, np.array([state.truth.pose[:2] for state in recorded.states])
    near = np.hypot(*(places - recorded.episode.goal[:2]).T) < NEAR_GOAL
    if recorded.settings.driver is None:  # the goal is none of the person's
        near[:] = False
    interface = str(labels.get("interface", "stick"))
    try:
        prompts = np.array(labels.get("prompts", []), np.float64).reshape(-1, 3)
        share = float(labels.get("share", 1.0))
    except (TypeError, ValueError):
        raise InputError("the recording's prompts or share of full speed are malformed") from None
    return StickSession(
        1.0 / recorded.settings.rate,
        np.array([(stick.forward, stick.left) for stick in found]),
        any(stick.latched for stick in found),
        near,
        prompts,
        _KINDS.get(interface, interface),
        share,
    )


def before_dead_zone(sticks: Array, device: Any, share: float) -> Array:
    """Deflections (n, 2) before the dead zone; NaN where the stick is within it."""
    size = np.hypot(*sticks.T)
    with np.errstate(divide="ignore", invalid="ignore"):
        before = device.dead_zone + (1.0 - device.dead_zone) * size / (device.gain * share)
        raw: Array = sticks * (before / size)[:, None]
    raw[size == 0.0] = math.nan
    return raw
