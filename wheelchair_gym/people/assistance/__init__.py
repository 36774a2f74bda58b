"""Compiled assistants: from a person's stick and the chair's sensors to the twist asked for.

One compiled function steps them for the policy `assisted`, for an environment whose setting
`assistant` names one, and for each row of a batch. Assistants in Python are in `agents.people`,
which knows these, too.
"""

from collections.abc import Mapping
from typing import Any, Final

from wheelchair_gym.base.errors import shorten
from wheelchair_gym.base.registry import Registry, in_module
from wheelchair_gym.base.settings import InputError

# Settings class of every compiled assistant.
_METHODS: Final = "wheelchair_gym.people.assistance.methods"
_OWN: Final = in_module(_METHODS, "Direct SharedDwa Slide Teleop Vfh")
COMPILED: Final = Registry("assistant", {"shield": f"{_METHODS}:Shielded", **_OWN})


def make_compiled(spec: str | Mapping[str, Any] | Any) -> Any:
    """Settings of a compiled assistant from a name, `{"name": name, **settings}`, or themselves.

    Raises:
        InputError: it is none of them (the message lists those known), or a setting is wrong.
    """
    try:
        return COMPILED.make(spec)
    except InputError as error:
        if isinstance(spec, Mapping) and spec.get("name") in COMPILED:
            raise
        raise InputError(
            f"assistant: {shorten(spec)} is none that an environment can hold: {error}; others "
            "drive by the policy assisted"
        ) from None
