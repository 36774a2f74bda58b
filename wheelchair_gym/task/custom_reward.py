"""Rewards of one's own: a function in place of the weighted sum of terms.

`reward(terms, sensed, action) -> float` is called after each step with

- `terms`: the weighted terms by name, as in `info["reward_terms"]`: `terms.progress`;
- `sensed`: a record of `wheelchair_gym.sim.state.SENSED`: what the chair senses, and the truth
  (`sensed.true_pose`, `sensed.clearance`, `sensed.contact`, `sensed.energy`, ...);
- `action`: (2,) in [-1, 1], as the policy gave it.

The vector environment compiles it with numba, so there it may use numbers, arrays and `math` only.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final

import numba
import numpy as np

from wheelchair_gym.base.arrays import Array, Rows
from wheelchair_gym.base.errors import InputError, shorten
from wheelchair_gym.base.registry import Registry, is_place
from wheelchair_gym.sim.state import SENSED
from wheelchair_gym.task.rewards import TERM_VALUES, VERDICT

RewardFunction = Callable[[Any, Any, Array], float]

# Names that other packages add, each with its `module:function`; this project adds none.
REWARDS: Final = Registry("reward", {}, group="wheelchair_gym.rewards")


def make_reward(spec: Any) -> RewardFunction | None:
    """The function of a setting: a callable, a name or `module:function`; None of None.

    Raises:
        InputError: it is none of these, or it gives no number for a blank step.
    """
    if spec is None:
        return None
    name = spec if isinstance(spec, str) else getattr(spec, "__name__", shorten(spec))
    if isinstance(spec, str):
        if spec not in REWARDS.places and not is_place(spec):
            known = ", ".join([*REWARDS, "module:function"])
            raise InputError(f"reward {spec!r} is unknown; expected {known}")
        spec = REWARDS[spec]
    if not callable(spec):
        raise InputError(f"reward is {shorten(spec)}; expected a function or module:function")
    function: RewardFunction = spec
    try:
        terms, sensed = as_record(np.zeros(1, TERM_VALUES)), as_record(np.zeros(1, SENSED))
        value = function(terms, sensed, np.zeros(2))
    except Exception as error:  # whatever somebody's function raises
        why = f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"
        known = ", ".join([*(TERM_VALUES.names or ()), *(SENSED.names or ())])
        raise InputError(
            f"reward {name}: with a step of zeros it raises {why}; terms and sensed have {known}"
        ) from error
    checked(value, name)
    return function


def as_record(rows: Rows) -> Any:
    """The first of some rows, with its fields as attributes."""
    return rows.view(np.recarray)[0]


def checked(value: Any, name: str = "function") -> float:
    """A reward as a float.

    Raises:
        InputError: it is no finite number.
    """
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"reward {name} gave {shorten(value)}; expected a finite number")
    return number


@lru_cache(maxsize=8)  # a function may hold an environment
def compiled_rewards(function: RewardFunction) -> Callable[[Rows, Rows, Array, Array], None]:
    """A compiled loop that writes the rewards (n,) of verdicts, sensed records and actions.

    Raises:
        InputError: numba cannot compile the function.
    """
    one: Any = function if hasattr(function, "py_func") else numba.njit(function)

    @numba.njit(error_model="numpy")
    def rewards_of_rows(verdicts: Any, sensed: Any, actions: Array, rewards: Array) -> None:
        for i in range(rewards.shape[0]):
            rewards[i] = one(verdicts[i].terms, sensed[i], actions[i])

    try:
        rewards_of_rows(np.zeros(1, VERDICT), np.zeros(1, SENSED), np.zeros((1, 2)), np.zeros(1))
    except Exception as error:  # numba has errors of several kinds
        name = getattr(function, "__name__", "function")
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        telling = [line for line in lines if not line.startswith(("Failed in", "During", "File"))]
        why = next(iter(telling or lines), type(error).__name__)
        raise InputError(
            f"reward {name}: numba cannot compile it, as the vector environment needs ({why})"
        ) from error
    return rewards_of_rows
