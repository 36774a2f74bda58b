"""Drawing: an environment's episode from above, as a picture or in a window."""

from array import array
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.base.arrays import Array
from wheelchair_gym.envs.settings import EnvSettings
from wheelchair_gym.task.task import Task
from wheelchair_gym.types import Episode, Shown, Truth

if TYPE_CHECKING:
    from wheelchair_gym.rendering.picture import TopView
    from wheelchair_gym.rendering.video import Window

LONGEST_TRAIL = 20_000  # points: of a longer drive, the trail is thinned out


class EpisodeRenderer:
    """Draws a chair with its trail and its guidance; the view is made when first needed."""

    def __init__(self, settings: EnvSettings) -> None:
        self._settings = settings
        self._trail = array("d")  # x, y, yaw of each pose
        self._view: TopView | None = None
        self._window: Window | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Without picture and window: a copy makes its own when it is asked to draw."""
        return self.__dict__ | {"_view": None, "_window": None}

    def begin(self) -> None:
        """A new episode begins."""
        self._trail, self._view = array("d"), None

    def follow(self, pose: Array) -> None:
        """The chair has come to a pose (3,) [m, m, rad]."""
        self._trail.extend(pose.tolist())
        if len(self._trail) > 3 * LONGEST_TRAIL:
            self._trail = array("d", self._poses[::2].ravel().tolist())

    @property
    def _poses(self) -> Array:
        return np.array(self._trail).reshape(-1, 3)

    def picture(
        self, episode: Episode, truth: Truth, task: Task, shown: Shown, ahead: Array | None
    ) -> NDArray[np.uint8]:
        """An RGB picture of the size that is set.

        It shows path and roll-out and, ahead of the chair, points (n, 2) [m] of the guidance.
        """
        (v, w), rest = task.reading.twist, task.way_to_go(task.reading.pose)
        caption = f"{v:5.2f} m/s  {w:5.2f} rad/s   {rest:5.1f} m to go"
        return self.draw(
            episode, task.tolerance, truth.pose,
            reading=task.reading,
            path=shown.path,
            rollout=shown.rollout,
            look_ahead=ahead,
            caption=f"{task.reading.stamp:6.1f} s   {caption}",
            actors=truth.actor_poses if len(truth.actor_poses) else None,
        )  # fmt: skip

    def draw(
        self, episode: Episode, tolerance: float, pose: Array, **shown: Any
    ) -> NDArray[np.uint8]:
        """An RGB picture of the chair at a pose (3,), with what `TopView.draw` takes by name."""
        if self._view is None:
            from wheelchair_gym.rendering.picture import TopView

            s = self._settings
            self._view = TopView(
                episode, s.chair.footprint, s.chair.drive, s.sensors,
                size=(s.render_height, s.render_width), tolerance=tolerance,
            )  # fmt: skip
        return self._view.draw(pose, trail=self._poses[:, :2], **shown)

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Show a picture in a window."""
        if self._window is None:
            from wheelchair_gym.rendering.video import Window

            self._window = Window("wheelchair_gym", self._settings.rate)
        self._window.show(picture)

    def close(self) -> None:
        """Close the window; may be called again."""
        if self._window is not None:
            self._window.close()
            self._window = None
