"""What local control is for: one objective of named terms, for every follower that rolls out."""

from __future__ import annotations

from agents.control.rollout import Weights
from wheelchair_gym.config import setting, settings


@settings
class Objective:
    """What a roll-out is worth; every term counts in metres of way."""

    horizon: float = setting(default=1.5, unit="s", source="tuned on training floor plans", low=0.3)
    foresight: float = setting(
        default=4.0, unit="s", source="of movers: a chair at rest leaves its place in 3", low=0.3
    )
    wish: float = setting(default=0.20, unit="m", source="half the play in a 1.0 m door", low=0.01)
    room: float = setting(
        default=0.45, unit="m", source="from what moves: personal space begins there", low=0.01
    )
    progress: float = setting(default=1.0, source="m per m along the path: the unit", low=0.0)
    clearance: float = setting(
        default=0.8, source="m per m in touch; less than progress, or nothing tight is entered",
        low=0.0,
    )  # fmt: skip
    path: float = setting(default=1.5, source="m per m beside the path; tuned", low=0.0)
    comfort: float = setting(
        default=0.05, unit="s", source="of a change of the twist, against wobble; tuned", low=0.0
    )
    reverse: float = setting(default=0.5, source="m per m in reverse; tuned", low=0.0)
    struck: float = setting(
        default=6.0, unit="m", source="of being where a mover comes; tuned", low=0.0
    )

    @property
    def weights(self) -> Weights:
        """The objective as kernels take it."""
        return Weights(
            self.horizon, self.foresight, self.wish, self.room, self.progress, self.clearance,
            self.path, self.comfort, self.reverse, self.struck,
        )  # fmt: skip
