"""The twin as a chair that stands at the start of each episode, in simulated time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wheelchair_gym.arrays import Array
from wheelchair_gym.config import InputError
from wheelchair_gym.hardware.registry import check_extras
from wheelchair_gym.hardware.twin.board import TARGETS, build_target
from wheelchair_gym.hardware.twin.inprocess import TwinChair
from wheelchair_gym.hardware.twin.lockstep import Twin
from wheelchair_gym.hardware.twin.plant import Plant
from wheelchair_gym.types import Belief, Chair, Episode, NotCopyable, Reading, Truth

if TYPE_CHECKING:
    from wheelchair_gym.envs.settings import EnvSettings

_STANDS_BY = 0.05  # s between two looks whether the chair must be re-armed


class EpisodeTwin(NotCopyable, Chair):
    """A hardware chair over emulated boards; a reset carries it to an episode's start.

    A person stands by who re-arms the chair when a reset waits for it. Energy is not measured.

    Args:
        settings: of the environment that drives it.

    Raises:
        InputError: the extra 'hardware', a compiler or the emulator is missing.
    """

    def __init__(self, settings: EnvSettings) -> None:
        check_extras("hardware")
        for target in TARGETS:
            build_target(target)
        self._twin = Twin(Plant(settings.chair, settings.sensors))
        self._hosted = TwinChair(self._twin, 1.0 / settings.rate, settings.hardware)
        self._chair, self.real_time = self._hosted.chair, False
        self._chair.on_wait = lambda line: None
        self._hosted.clock.call_every(self._stand_by, _STANDS_BY, "person")

    def _stand_by(self) -> None:
        if self._chair.waiting_for:
            self._chair.rearm()

    def reset(self, episode: Episode, key: int) -> Reading:
        """See `Chair.reset`.

        Raises:
            InputError: something moves in the episode, which the twin's boards know nothing of.
        """
        if len(episode.actors):
            raise InputError(f"{episode.name}: somebody moves there; expected a still place")
        self._twin.reset(episode, key)
        return self._chair.reset(episode, key)

    def drive(self, twist: Array, protective: bool = False) -> Reading:
        """See `Chair.drive`."""
        return self._chair.drive(twist, protective)

    def set_localized_pose(self, pose: Array) -> None:
        """See `Chair.set_localized_pose`."""
        self._chair.set_localized_pose(pose)

    @property
    def truth(self) -> Truth:
        """Where the chair truly is, and for the rest the best that its sensors know."""
        return self._chair.truth._replace(pose=self._twin.plant.pose)

    @property
    def belief(self) -> Belief:
        """See `HardwareChair.belief`."""
        return self._chair.belief

    @property
    def report(self) -> dict[str, float | str]:
        """See `HardwareChair.report`."""
        return self._chair.report

    def close(self) -> None:
        """Stop the chair and free the boards; may be called again."""
        self._chair.close()
        self._twin.close()
