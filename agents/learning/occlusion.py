"""What a learned policy looks at: how its action changes where a part of what it sees is hidden.

Occlusion as of Zeiler and Fergus (2014): a beam and its neighbours are told to see nothing, other
parts to be as they are on average; what the action then changes by says how much hung on them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from agents.learning.features import Layout
from agents.policies.learned import LearnedDriver
from wheelchair_gym.config import InputError
from wheelchair_gym.geometry import to_world
from wheelchair_gym.rendering import palette
from wheelchair_gym.task.observation_layout import PRIVATE

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
BESIDE = 1  # beams on each side that are hidden, too
NAMES = {"action": "last action", "path": "path ahead", "twist": "velocity"}


def hidden_beams(network: Any, told: Floats, layout: Layout, reach: float) -> Array:
    """Change of the action (k, beams), Euclidean, where beams see nothing.

    Args:
        network: actions (n, 2) of flat observations (n, room).
        told: flat observations (k, room).
        layout: of the observations.
        reach: what the laser tells where it sees nothing [m].
    """
    before = network(told)
    place = layout.place("laser")
    beams = place.stop - place.start
    changes = np.empty((len(told), beams))
    for beam in range(beams):
        other = told.copy()
        other[:, max(place.start, beam - BESIDE) : min(place.stop, beam + BESIDE + 1)] = reach
        changes[:, beam] = np.linalg.norm(network(other) - before, axis=1)
    return changes


def hidden_parts(network: Any, told: Floats, layout: Layout) -> dict[str, float]:
    """Mean change of the action where a whole part is as it is on average, by the part's name."""
    before, changes = network(told), {}
    for key, _ in layout.sizes:
        place = layout.place(key)
        if key in PRIVATE:
            continue
        other = told.copy()
        other[:, place] = told[:, place].mean(axis=0)
        changes[NAMES.get(key, key)] = float(np.linalg.norm(network(other) - before, axis=1).mean())
    return changes


class Looking:
    """Takes notes at each step of an episode; to be called as `drive_episode` does."""

    def __init__(self, driver: Any) -> None:
        if not isinstance(driver, LearnedDriver) or driver.remembers:
            raise InputError("only learned policies without a memory are looked into")
        self._driver = driver
        self._told: list[Floats] = []
        self._poses: list[Array] = []
        self._pose = np.zeros(3)  # by its own estimate, when it acted last

    def __call__(self, env: Any) -> None:
        """Take a note before the next step."""
        told = getattr(self._driver, "told", None)
        if told is not None and (not self._told or told is not self._told[-1]):
            self._told.append(told)
            self._poses.append(self._pose)
        self._pose = env.unwrapped.task.reading.pose.copy()

    def changes(self, reach: float) -> tuple[Array, dict[str, float]]:
        """See `hidden_beams` and `hidden_parts`."""
        told, own = np.array(self._told), self._driver
        return (
            hidden_beams(own.network, told, own.layout, reach),
            hidden_parts(own.network, told, own.layout),
        )

    def draw(self, env: Any, moment: float) -> tuple[Figure, dict[str, Any]]:
        """The beams at a moment over the world's walls, and the parts over the whole episode.

        Args:
            env: of the episode.
            moment: a share of the episode, 0 to 1.
        """
        world, task = env.unwrapped.episode, env.unwrapped.task
        laser = task.sensors.laser
        beams, parts = self.changes(laser.reach)
        k = min(len(self._told) - 1, round(moment * (len(self._told) - 1)))
        pose, ranges = self._poses[k], self._told[k][self._driver.layout.place("laser")]
        count = len(ranges)
        angles = laser.yaw + laser.fov * ((np.arange(count) + 0.5) / count - 0.5)
        mount = to_world((laser.x, laser.y), pose)
        ends = mount + ranges[:, None] * np.stack(
            [np.cos(pose[2] + angles), np.sin(pose[2] + angles)], axis=1
        )
        figure = Figure(figsize=(9.0, 4.2), layout="constrained")
        view, bars = figure.subplots(1, 2, width_ratios=(3, 2))
        for x0, y0, x1, y1 in np.asarray(world.walls).reshape(-1, 4):
            view.plot((x0, x1), (y0, y1), color=palette.css(palette.SOLID), lw=1.5, zorder=3)
        for x, y, radius in np.asarray(world.discs).reshape(-1, 3):
            view.add_patch(Circle((x, y), radius, color=palette.css(palette.SOLID), zorder=3))
        most = max(float(beams[k].max()), 1e-9)
        for end, change in sorted(zip(ends, beams[k], strict=True), key=lambda pair: pair[1]):
            view.plot(
                (mount[0], end[0]), (mount[1], end[1]), color=palette.css(palette.LASER),
                alpha=0.08 + 0.92 * change / most, lw=0.8 + 2.2 * change / most,
            )  # fmt: skip
        outline = to_world(task.footprint.corners, pose)
        view.fill(*outline.T, color=palette.css(palette.CHAIR), alpha=0.6, zorder=4)
        view.plot(*world.goal[:2], "*", color=palette.css(palette.GOAL), ms=12, zorder=4)
        view.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
        near = np.concatenate([ends, outline, [pose[:2]]])
        view.set_xlim(near[:, 0].min() - 0.3, near[:, 0].max() + 0.3)
        view.set_ylim(near[:, 1].min() - 0.3, near[:, 1].max() + 0.3)
        view.set_title(f"Beams, {100 * moment:.0f} % into the episode", loc="left")
        names = sorted(parts, key=lambda name: parts[name])
        bars.barh(names, [parts[name] for name in names], color=palette.css(palette.BLUE))
        bars.set_xlabel("mean change of the action, each of two in [-1, 1]")
        bars.set_title("Parts, over the whole episode", loc="left")
        return figure, {
            "parts": parts,
            "beams": {"angles": angles.tolist(), "mean": beams.mean(axis=0).tolist(),
                      "then": beams[k].tolist()},
            "moment": moment,
        }  # fmt: skip
