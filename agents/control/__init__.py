"""Followers: from a path and what is around the chair to the next twist."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from agents.control import followers
from wheelchair_gym.config import InputError, load
from wheelchair_gym.migration import migrated

FOLLOWERS: dict[str, type] = {
    "controls": followers.ControlsFollower,
    "dwa": followers.DynamicWindow,
    "mppi": followers.PathIntegral,
    "pure_pursuit": followers.PurePursuit,
    "window": followers.Window,
    "woa": followers.WhaleFollower,
}


def make_follower(spec: Mapping[str, Any]) -> Any:
    """Settings of a follower from `{"name": name, **settings}`.

    Raises:
        InputError: the name is unknown or a setting is wrong.
    """
    values = migrated(spec, "follower")
    name = values.pop("name", "window")
    if not isinstance(name, str) or name not in FOLLOWERS:
        raise InputError(f"follower {name!r} is unknown; known: {', '.join(sorted(FOLLOWERS))}")
    return load(FOLLOWERS[name], values, f"follower {name}")
