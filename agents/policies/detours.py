"""Detours: when a way round temporary obstacles is looked for, and which is too long to take."""

from __future__ import annotations

from agents.control.reference import Reference
from agents.control.temporary_obstacles import Standing

AHEAD = 3.0  # m of the path on which temporary obstacles count
AGAIN = 3.0  # s until a plan is tried again that led round nothing
DETOUR = 2.0  # m by which a way round may be longer at once, and
STROLL = 0.5  # m/s more the longer it waits: it waits as long as the way round would cost
TOLERATED = 0.06  # m: cells are drawn whole, and hits err


class Detours:
    """What a chair remembers of ways round.

    Attributes:
        taken: the path leads round what is temporary.
    """

    def __init__(self) -> None:
        self.taken = False
        self._looked = 0.0  # s since the last look at what stands on the way
        self._held = 0.0  # s that the chair has waited rather than go a long way round
        self._waited = 0.0  # s until a plan is tried again that led round nothing

    def end_wait(self) -> None:
        """The chair goes on: what it waited for is past."""
        self._held = 0.0

    def wait(self) -> float:
        """No way round is taken for now; for so long [s]."""
        self._waited = AGAIN
        return AGAIN

    def tick(self, period: float) -> None:
        """Time goes by [s]."""
        self._waited -= period

    def too_long(self, way_round: Reference, barred: Reference) -> bool:
        """Whether a way round is so long that the chair rather waits; then it has waited more."""
        long = way_round.left > barred.left + DETOUR + STROLL * self._held
        self._held += AGAIN * long
        return long

    def due(self, period: float, every: float) -> bool:
        """Whether it is time to look at what stands on the way."""
        self._looked += period
        if self._looked < every or self._waited > 0.0:
            return False
        self._looked = 0.0
        return True


def barred(standing: Standing, reference: Reference, clearance: float) -> bool:
    """Whether a temporary obstacle stands on the next metres of the way."""
    rows = reference.rows[reference.at :]
    ahead = rows[rows[:, 3] < reference.way + AHEAD]
    return standing.on_way(ahead, clearance - TOLERATED)
