"""Start and goal chosen with the mouse on a map: press where it is, drag to where it faces."""

from __future__ import annotations

import math

import numpy as np

from wheelchair_gym.arrays import Array
from wheelchair_gym.config import InputError
from wheelchair_gym.geometry import Footprint, to_world
from wheelchair_gym.maps import MapWithWalls
from wheelchair_gym.rendering import floor, palette
from wheelchair_gym.rendering.canvas import Canvas
from wheelchair_gym.rendering.video import Window
from wheelchair_gym.scenes.map_file import is_free_on
from wheelchair_gym.types import no_discs

_SIZE = 960  # pixels: the long side
_RATE = 30.0  # 1/s
_TURNS = 0.3  # m that a drag must have, to give the heading


def pick_poses(of: MapWithWalls, footprint: Footprint) -> tuple[list[float], list[float]]:
    """The start and the goal, each x, y [m] and yaw [rad], that a person chooses in a window.

    A pose at which the chair would touch something is shown, and not taken.

    Raises:
        InputError: the window was closed before, or there is no display.
    """
    window = Window("start and goal", _RATE)
    chosen: list[list[float]] = []
    picture = floor.new_canvas(floor.bounding_box(floor.known_area(of.grid), 0.3), _SIZE)
    floor.draw_grid(picture, of.grid)
    floor.draw_obstacles(picture, of.walls, no_discs())
    floor.draw_scale_bar(picture)
    pressed: Array | None = None
    said = ""
    try:
        while len(chosen) < 2:
            name = ("start", "goal")[len(chosen)]
            pointer = _metres(picture, window)
            for down, at in window.presses():
                place = _metres(picture, window, at)
                if down:
                    pressed, said = place, ""
                elif pressed is not None:
                    pose = _pose(pressed, place)
                    if is_free_on(*of, pose, footprint):
                        chosen.append(pose)
                    else:
                        said = "the chair cannot stand there. "
                    pressed = None
            drawn = Canvas(picture.image.copy(), picture.frame, picture.stroke_scale)
            if chosen:
                floor.draw_start(drawn, chosen[0])
            pose = _pose(pointer if pressed is None else pressed, pointer)
            free = is_free_on(*of, pose, footprint)
            outline = to_world(footprint.corners, np.array(pose))
            drawn.line(outline, palette.GOAL if free else palette.VERMILION, 2.0, closed=True)
            floor.write_caption(drawn, f"{said}press at the {name}, drag to turn it")
            if not window.show(drawn.image):
                raise InputError("the window was closed before start and goal were chosen")
    finally:
        window.close()
    return chosen[0], chosen[1]


def _metres(canvas: Canvas, window: Window, at: tuple[float, float] | None = None) -> Array:
    """The place (2,) [m] of a point of the picture, or of the mouse."""
    column, row = window.pointer() if at is None else at
    frame = canvas.frame
    return np.array([(column - frame.left) / frame.scale, (frame.bottom - row) / frame.scale])


def _pose(place: Array, towards: Array) -> list[float]:
    dx, dy = (towards - place).tolist()
    yaw = math.atan2(dy, dx) if math.hypot(dx, dy) > _TURNS else 0.0
    return [*np.round(place, 3).tolist(), round(yaw, 3)]
