"""Followers: from a path and what stands round the chair to the next twist."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from agents.control.controls import ControlsFollower
from agents.control.fan import DynamicWindow, Window
from agents.control.mppi import PathIntegral
from agents.control.pursuit import PurePursuit
from agents.control.whales import WhaleFollower
from wheelchair_gym.config import InputError, load

FOLLOWERS: dict[str, type] = {
    "controls": ControlsFollower,
    "dwa": DynamicWindow,
    "mppi": PathIntegral,
    "pure_pursuit": PurePursuit,
    "window": Window,
    "woa": WhaleFollower,
}


def make_follower(spec: Mapping[str, Any]) -> Any:
    """Settings of a follower from `{"name": name, **settings}`.

    Raises:
        InputError: the name is unknown or a setting is wrong.
    """
    values = dict(spec)
    name = values.pop("name", "window")
    if not isinstance(name, str) or name not in FOLLOWERS:
        raise InputError(f"follower {name!r} is unknown; known: {', '.join(sorted(FOLLOWERS))}")
    return load(FOLLOWERS[name], values, f"follower {name}")
