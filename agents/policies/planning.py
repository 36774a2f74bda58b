"""Planning beside driving: a loop that commands a chair does not stand still to think.

One plan is made at a time. It is asked for in one control period and taken in a later one:

    ask(make, take)    idle -> drives             `make` begins
    stand()            drives -> stands           the chair has no path to drive on by
    step()             drives, stands -> idle     once a period: `take` gets what was made
    ask_at_rest(ask)   idle -> stops              what was made does not fit any more
    step()             stops -> stands            as soon as the chair stands: `ask` is called

In real time `make` runs in a thread beside the loop, which compiled planners hardly delay: they
release Python's lock. In simulated time it is made at once, and taken when as many periods have
passed as the settings say that it takes: 0 s is within `ask` itself. Runs then repeat exactly.
"""

import math
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from wheelchair_gym.compiled.clock import clock

SHARE = 0.9  # of the deadline, after which planners end, so that their plans are there in time
SWITCH = 0.0005  # s after which a planner written in Python lets the loop run


@dataclass
class PlanningFigures:
    """Times of planning in an episode, and times that the chair followed or stood meanwhile."""

    times: list[float] = field(default_factory=list)  # s of wall time that each plan took
    late: int = 0  # plans that were not there by their deadline
    discarded: int = 0  # plans that no longer fitted the map or the place of the chair
    followed: float = 0.0  # s on the old path while a plan was made
    stood: float = 0.0  # s of standing still while a plan was made

    def record(self) -> dict[str, Any]:
        """Its entries in the record of an episode."""
        times = 1e3 * np.array(self.times or [0.0])
        p50, p95 = np.percentile(times, (50, 95)).tolist()
        return {
            "plans_ms_p50": p50, "plans_ms_p95": p95, "plans_ms_max": float(times.max()),
            "late_plans": self.late, "discarded_plans": self.discarded,
            "thinking_drove_s": self.followed, "thinking_stood_s": self.stood,
        }  # fmt: skip


Thinking = Enum("Thinking", "IDLE DRIVES STANDS STOPS")  # what the chair does for a plan


class Planning:
    """Makes one plan at a time while the chair drives.

    Args:
        period: of control [s].
        deadline: within which a plan has to be there [s]; in real time, planners end before.
        planning_time: that a plan takes in simulated time [s].
        real_time: time passes while a plan is made.

    Attributes:
        state: what the chair does for a plan.
        periods: passed since the last plan was asked for.
        figures: of all plans so far.
    """

    def __init__(
        self, period: float, deadline: float, planning_time: float, real_time: bool
    ) -> None:
        self.state, self.periods, self.figures = Thinking.IDLE, 0, PlanningFigures()
        self._real_time, self._deadline = real_time, deadline
        if real_time:
            sys.setswitchinterval(min(SWITCH, sys.getswitchinterval()))
        self._maximum = math.ceil(deadline / period - 1e-9)  # periods
        self._delay = math.ceil(planning_time / period - 1e-9)  # periods
        self._made: list[tuple[Any, BaseException | None, float]] = []  # the plan, once it is there

    @property
    def busy(self) -> bool:
        """Whether a plan is being made, or will be as soon as the chair stands."""
        return self.state is not Thinking.IDLE

    def ask(self, make: Callable[[float], Any], take: Callable[[Any], object]) -> None:
        """Begin a plan, while none is being made.

        Args:
            make: makes it until `clock` shows a time [s]; runs beside the loop.
            take: gets it in the loop.
        """
        assert not self.busy
        self.state = Thinking.DRIVES
        self.periods, self._take, self._made = 0, take, []
        if self._real_time:
            work = make, clock() + SHARE * self._deadline, self._made
            threading.Thread(target=_make, args=work, name="planning", daemon=True).start()
        else:
            _make(make, math.inf, self._made)
            self._arrive()

    def stand(self) -> None:
        """Stop the chair until the plan is there, if one is being made."""
        if self.busy:
            self.state = Thinking.STANDS

    def ask_at_rest(self, ask: Callable[[], object]) -> None:
        """Stop the chair; `ask` is called once it stands."""
        self.state, self._ask = Thinking.STOPS, ask

    def step(self, at_rest: bool) -> None:
        """Begin a control period: take the plan if it is there; ask for one if the chair stands.

        Raises:
            Exception: the one with which making it ended.
        """
        if self.state in (Thinking.DRIVES, Thinking.STANDS):
            self.periods += 1
            self.figures.late += self.periods == self._maximum + 1
            self._arrive()
        if self.state is Thinking.STOPS and at_rest:
            self.state = Thinking.IDLE
            self._ask()
            self.stand()

    def _arrive(self) -> None:
        if not self._made or (not self._real_time and self.periods < self._delay):
            return
        (plan, error, seconds), self.state = self._made[0], Thinking.IDLE
        self.figures.times.append(seconds)
        if error is not None:
            raise error
        self._take(plan)


def _make(make: Callable[[float], Any], end: float, made: list[Any]) -> None:
    """Append a plan, or what was raised in place of it, and the seconds that it took."""
    begun, plan, error = time.perf_counter(), None, None
    try:
        plan = make(end)
    except Exception as raised:
        error = raised
    made.append((plan, error, time.perf_counter() - begun))


def figures_of(policy: Any) -> PlanningFigures:
    """The figures of a policy's planning in this episode."""
    while hasattr(policy, "policy"):  # as of one that is slowed
        policy = policy.policy
    planning = getattr(policy, "planning", None)
    return planning.figures if isinstance(planning, Planning) else PlanningFigures()
