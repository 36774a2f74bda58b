"""Maps side by side, each with the way that was driven."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from wheelchair_gym.maps import OccupancyGrid
from wheelchair_gym.rendering import floor, palette
from wheelchair_gym.rendering.canvas import Image

_MARGIN = 0.3  # m round what is known
_TRAIL = 1.5  # pixels


def draw_map(maps: Sequence[tuple[str, OccupancyGrid, ArrayLike]], size: int = 900) -> Image:
    """A picture (h, w, 3) RGB of maps at one scale, each with its trail and where that began.

    Args:
        maps: for each its caption (ASCII), the grid and poses (n, 2 or 3) [m, m, rad].
        size: long side of each [pixels].
    """
    corners = np.concatenate([floor.known_area(grid) for _, grid, _ in maps])
    bounds = floor.bounding_box(corners, _MARGIN)
    panels = []
    for caption, grid, trail in maps:
        fine = floor.new_canvas(bounds, size).upsampled(floor.FINE)
        floor.draw_grid(fine, grid)
        poses = np.asarray(trail, dtype=np.float64)
        fine.line(poses, palette.TRAIL, _TRAIL)
        if len(poses):
            floor.draw_start(fine, poses[0])
        floor.draw_scale_bar(fine)
        panel = fine.downsampled(floor.FINE)
        floor.write_caption(panel, caption)
        panels.append(panel.image)
    return np.hstack(panels)
