"""Who takes part in a planner benchmark: every registered planner, and peers that are installed."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import inspect
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import FrameType
from typing import Any

import numpy as np

from agents.benchmarks.cases import Case
from agents.peers import PEERS, installed
from planners import PLANNERS, Plan, Problem, Space, make_planner
from wheelchair_gym.config import InputError, dump

EXTRA = "wheelchair_gym[peers]"
UNLIMITED = 1_000_000_000  # iterations under a deadline: time alone is to end a run


@dataclass(frozen=True)
class Entrant:
    """A planner that takes part.

    Attributes:
        name: in results.
        own: its settings.
        lifted: its settings under a deadline, with no limit on iterations.
        package: the package and version that a peer is from; None for ours.
        timed: whether it takes a deadline; otherwise its answers count from when they come.
        calls: the planners that it calls, which makes it a hybrid.
    """

    name: str
    config: Any
    unlimited: Any
    package: str | None = None
    timed: bool = True
    calls: tuple[str, ...] = ()

    def prepare(self, case: Case) -> tuple[Any, Any] | None:
        """What plans on a map, without and with a deadline; None if the map is none for it."""
        if self.package is None:
            return self.config, self.unlimited
        ready = self.config.at(case)
        return None if ready is None else (ready, ready)

    @property
    def description(self) -> dict[str, Any]:
        """The contender as results tell it."""
        return {
            "name": self.name,
            "package": self.package,
            "takes_deadline": self.timed,
            "calls": list(self.calls),
            "settings": dump(self.config),
        }


def make_plan(planner: Any, problem: Problem, seed: int, deadline: float | None = None) -> Plan:
    """The plan for a seed; a deadline is given on only where there is one."""
    rng = np.random.default_rng(seed)
    plan: Plan = (
        planner.plan(problem, rng) if deadline is None else planner.plan(problem, rng, deadline)
    )
    return plan


def takes_deadline(planner: Any) -> bool:
    """Whether a planner's `plan` has a deadline."""
    return "deadline" in inspect.signature(planner.plan).parameters


def with_iterations(planner: Any, iterations: int) -> Any:
    """A planner of so many iterations, its own and those of planners in its settings."""
    changes: dict[str, Any] = {}
    for field in dataclasses.fields(planner):
        value = getattr(planner, field.name)
        if field.name == "iterations" and isinstance(value, int):
            changes[field.name] = iterations
        elif PLANNERS.name_of(value) is not None:
            changes[field.name] = with_iterations(value, iterations)
    return replace(planner, **changes) if changes else planner


def named_planners(values: Any) -> Iterator[str]:
    """The planners that settings name, such as the one for a first path."""
    if isinstance(values, str) and values in PLANNERS:
        yield values
    elif isinstance(values, Mapping):
        for key, value in values.items():
            if key != "name":
                yield from named_planners(value)
            elif value in PLANNERS:
                yield value


def called_planners(planner: Any) -> tuple[str, ...]:
    """The planners that one calls, seen while it solves a small problem, or names in its settings.

    A part that only lends its settings, such as the tree of a variant of RRT*, is not called.
    """
    kinds: dict[str, Any] = dict(PLANNERS)
    code = {kind.plan.__code__: name for name, kind in kinds.items()}
    own = type(planner).plan.__code__
    seen = dict.fromkeys(named_planners(dump(planner)))

    def watch(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code in code and frame.f_code is not own:
            seen[code[frame.f_code]] = None

    before = sys.getprofile()
    sys.setprofile(watch)
    try:
        make_plan(planner, small_problem(), 0)
    finally:
        sys.setprofile(before)
    return tuple(seen)


def small_problem() -> Problem:
    """A block in a hall, which no straight line passes: to compile on."""
    space = Space.from_rectangles([(2.0, 1.5, 3.0, 2.5)], (0.0, 0.0, 5.0, 4.0))
    return Problem(space, np.array([1.0, 2.0]), np.array([4.0, 2.0]), name="small")


def make_entrants(specs: Sequence[Any], peers: Sequence[str]) -> list[Entrant]:
    """Who takes part, compiled and ready.

    Args:
        specs: planners of ours by name, or mappings with `name`, settings and perhaps `label`.
        peers: names of `PEERS`; their packages are installed.

    Raises:
        InputError: a planner or a peer is unknown, or a setting is wrong.
    """
    found = []
    for spec in specs:
        values = {"name": spec} if isinstance(spec, str) else dict(spec)
        label = str(values.pop("label", values.get("name")))
        planner = make_planner(values)
        calls, timed = called_planners(planner), takes_deadline(planner)
        found.append(
            Entrant(label, planner, with_iterations(planner, UNLIMITED), timed=timed, calls=calls)
        )
    small = Case(small_problem(), None, "nobody", np.array([[2.0, 1.5, 3.0, 2.5]]))
    for name in peers:
        peer = PEERS[name]
        package = f"{peer.package} {importlib.metadata.version(peer.package)}"
        ready = peer.settings.at(small)
        calls = called_planners(ready)
        found.append(Entrant(name, peer.settings, peer.settings, package, peer.timed, calls))
    return found


def select_peers(wanted: Sequence[str] | None) -> tuple[list[str], list[str]]:
    """The names of peers to run, and a line for each package that is missing.

    Args:
        wanted: names of `PEERS`; None: all that are installed.

    Raises:
        InputError: a name is unknown, or its package is not installed.
    """
    for name in wanted or ():
        if name not in PEERS:
            raise InputError(f"peer {name!r} is unknown; there are {', '.join(PEERS)}")
    missing = sorted({peer.package for peer in PEERS.values() if not installed(peer.package)})
    lines = [f"{package} is not installed: pip install '{EXTRA}'" for package in missing]
    for name in wanted or ():
        if PEERS[name].package in missing:
            raise InputError(
                f"peer {name}: {PEERS[name].package} is not installed: pip install '{EXTRA}'"
            )
    here = [name for name, peer in PEERS.items() if peer.package not in missing]
    return (here, lines) if wanted is None else (list(wanted), [])
