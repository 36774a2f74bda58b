"""Occlusion analysis: how the action of a learned policy changes where observations are hidden.

After Zeiler and Fergus (2014): a beam and its neighbours get the laser's reach, other keys get
their mean over the episode. The change of the action shows how much it depends on them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from agents.learning.features import Layout
from agents.policies.learned import LearnedDriver
from wheelchair_gym.arrays import Array, Floats
from wheelchair_gym.config import InputError
from wheelchair_gym.geometry import to_world
from wheelchair_gym.rendering import palette
from wheelchair_gym.task.observations import PRIVILEGED

NEIGHBOURS = 1  # beams on each side that are hidden with a beam
NAMES = {"action": "last action", "path": "path ahead", "twist": "velocity"}


def beam_sensitivity(network: Any, observations: Floats, layout: Layout, reach: float) -> Array:
    """Euclidean change of the action (k, beams) where beams get no echo, which reads `reach` [m].

    `network` maps flat observations (n, size) to actions (n, 2); `observations` are (k, size).
    """
    before = network(observations)
    place = layout.slice_of("laser")
    beams = place.stop - place.start
    changes = np.empty((len(observations), beams))
    for beam in range(beams):
        other = observations.copy()
        first, last = max(place.start, beam - NEIGHBOURS), min(place.stop, beam + NEIGHBOURS + 1)
        other[:, first:last] = reach
        changes[:, beam] = np.linalg.norm(network(other) - before, axis=1)
    return changes


def key_sensitivity(network: Any, observations: Floats, layout: Layout) -> dict[str, float]:
    """Mean change of the action where a key has its mean over the episode, by the key's name."""
    before, changes = network(observations), {}
    for key, _ in layout.sizes:
        place = layout.slice_of(key)
        if key in PRIVILEGED:
            continue
        other = observations.copy()
        other[:, place] = observations[:, place].mean(axis=0)
        changes[NAMES.get(key, key)] = float(np.linalg.norm(network(other) - before, axis=1).mean())
    return changes


class OcclusionRecorder:
    """Records an episode: a callback of `drive_episode`, called at each step."""

    def __init__(self, driver: Any) -> None:
        if not isinstance(driver, LearnedDriver) or driver.remembers:
            raise InputError("expected a learned policy that is not recurrent")
        self._driver = driver
        self._observations: list[Floats] = []
        self._poses: list[Array] = []
        self._pose = np.zeros(3)  # estimated, when it acted last

    def __call__(self, env: Any) -> None:
        """Record the observation of the last step."""
        if len(env.unwrapped.task.sensors.lasers) != 1:
            raise InputError("occlusion is drawn of a chair with one laser; this one has others")
        observation = self._driver.observation
        if observation is not None and not any(observation is o for o in self._observations[-1:]):
            self._observations.append(observation)
            self._poses.append(self._pose)
        self._pose = env.unwrapped.task.reading.pose.copy()

    def draw(self, env: Any, moment: float) -> tuple[Figure, dict[str, Any]]:
        """Draw the beams at one moment in the world, and the keys over the whole episode.

        `moment` is a share of the episode, 0 to 1. Returns the figure and its values.
        """
        world, task = env.unwrapped.episode, env.unwrapped.task
        laser = task.sensors.laser
        network, layout = self._driver.network, self._driver.layout
        observations = np.array(self._observations)
        beams = beam_sensitivity(network, observations, layout, laser.reach)
        parts = key_sensitivity(network, observations, layout)
        last = len(observations) - 1
        k = min(last, round(moment * last))
        pose, ranges = self._poses[k], observations[k][layout.slice_of("laser")]
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
        bars.set_title("Keys, over the whole episode", loc="left")
        return figure, {
            "parts": parts,
            "beams": {"angles": angles.tolist(), "mean": beams.mean(axis=0).tolist(),
                      "then": beams[k].tolist()},
            "moment": moment,
        }  # fmt: skip
