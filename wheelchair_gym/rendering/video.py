"""Outputs of pictures: picture and video files, written atomically, and a window."""

import math
import os
import sys
from collections.abc import Iterable
from importlib import import_module
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import Image as Pillow

from wheelchair_gym.base.errors import imports
from wheelchair_gym.base.files import atomic_write
from wheelchair_gym.base.settings import InputError
from wheelchair_gym.rendering.canvas import Image

_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")
_MARGIN = (33, 37, 41)  # RGB around a picture that does not fill the window


def write_png(path: str | Path, image: Image) -> None:
    """Write a picture (h, w, 3) RGB as a PNG file.

    Raises:
        InputError: the name ends otherwise, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix != ".png":
        raise InputError(f"{path}: expected a name that ends in .png")
    with atomic_write(path) as part:
        Pillow.fromarray(image).save(part, "png")


def jpeg(image: Image, quality: int) -> bytes:
    """A picture (h, w, 3) RGB as JPEG of a quality from 1 to 100."""
    bgr = np.ascontiguousarray(image[..., ::-1])
    return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def video_suffix() -> str:
    """The best kind of video that can be written here: .mp4, or .gif where moviepy is missing."""
    return ".mp4" if find_spec("moviepy") and find_spec("imageio_ffmpeg") else ".gif"


def write_video(path: str | Path, frames: Iterable[Image], rate: float) -> None:
    """Write pictures of one size as a video; the name's ending says which kind.

    Args:
        path: ends in .mp4 (H.264, plays in browsers) or .gif (animated, loops).
        frames: pictures (h, w, 3) RGB; may be a generator, which an .mp4 never holds whole.
        rate: pictures a second [1/s].

    Raises:
        InputError: another ending, no frames, or an .mp4 where moviepy is missing.
    """
    path = Path(path)
    if path.suffix not in (".mp4", ".gif"):
        raise InputError(f"{path}: expected a name that ends in .mp4, .gif")
    source = iter(frames)
    first = next(source, None)
    if first is None:
        raise InputError(f"{path}: no pictures to write")
    every = chain([first], source)
    if path.suffix == ".mp4":
        _write_mp4(path, every, rate, first.shape)
    else:
        _write_gif(path, every, rate)


def _write_mp4(path: Path, frames: Iterable[Image], rate: float, shape: tuple[int, ...]) -> None:
    with imports("video files need moviepy (or ask for a .gif)", "view"):
        write_frames = import_module("imageio_ffmpeg").write_frames
    height, width = shape[0] // 2 * 2, shape[1] // 2 * 2  # 4:2:0 colour asks for even sides
    with atomic_write(path) as part:
        writer: Any = write_frames(
            str(part), (width, height), fps=rate, codec="libx264", quality=None,
            pix_fmt_out="yuv420p", macro_block_size=1,
            output_params=["-crf", "20", "-preset", "medium", "-movflags", "+faststart"],
        )  # fmt: skip
        writer.send(None)
        try:
            for frame in frames:
                writer.send(np.ascontiguousarray(frame[:height, :width]))
        finally:
            writer.close()


def _write_gif(path: Path, frames: Iterable[Image], rate: float) -> None:
    # A GIF counts hundredths of a second; browsers slow down anything under two.
    part_of = max(1, math.ceil(rate / 50.0))
    every = list(frames)[::part_of]
    ends = np.round(np.arange(len(every) + 1) * 100.0 * part_of / rate)
    # One palette for all: what stands still keeps its colours, and is stored once.
    some = np.concatenate(every[:: max(1, len(every) // 8)])
    palette = Pillow.fromarray(some).quantize(64)
    first, *others = (
        Pillow.fromarray(frame).quantize(palette=palette, dither=Pillow.Dither.NONE)
        for frame in every
    )
    with atomic_write(path) as part:
        first.save(
            part, save_all=True, append_images=others, loop=0,
            duration=(10 * np.diff(ends)).astype(int).tolist(),
        )  # fmt: skip


class Window:
    """Shows RGB pictures; q, Escape or the window's close button close it for good.

    Args:
        title: of the window.
        rate: pictures a second at most, for which `show` waits [1/s]; None: no limit.

    Raises:
        InputError: pygame-ce is missing, or there is no display to open a window on.
    """

    def __init__(self, title: str = "wheelchair_gym", rate: float | None = None) -> None:
        with imports('render_mode "human" needs pygame-ce', "view"):
            import pygame
        if sys.platform == "linux" and not any(os.environ.get(name) for name in _DISPLAYS):
            # pygame would draw to a display that nobody sees.
            expected = f"none of {', '.join(_DISPLAYS)} is set"
            raise InputError(f"there is no display to open a window on: {expected}")
        self._pygame = pygame
        self._rate = rate
        self.is_open = True  # whether pictures can still be seen
        self._screen: pygame.Surface | None = None
        try:
            pygame.display.init()
        except pygame.error as error:
            raise InputError(f'render_mode "human" found no display ({error})') from None
        pygame.display.set_caption(title)
        self._clock = pygame.time.Clock()

    def show(self, image: Image) -> bool:
        """Show a picture (h, w, 3) RGB as large as the window allows; false once it is closed."""
        if not self.is_open:
            return False
        pygame = self._pygame
        height, width = image.shape[:2]
        if self._screen is None:
            self._screen = pygame.display.set_mode((width, height), pygame.RESIZABLE)
        if any(
            event.type == pygame.QUIT
            or (event.type == pygame.KEYDOWN and event.key in (pygame.K_ESCAPE, pygame.K_q))
            # Keys that are let go are for who reads the keyboard.
            for event in pygame.event.get(exclude=(pygame.KEYUP, pygame.WINDOWFOCUSLOST))
        ):
            self.close()
            return False
        # A resize makes pygame hand out a new surface.
        self._screen = pygame.display.get_surface() or self._screen
        size = self._screen.get_size()
        scale = min(size[0] / width, size[1] / height)
        fitted = (max(1, round(width * scale)), max(1, round(height * scale)))
        picture = pygame.image.frombuffer(np.ascontiguousarray(image), (width, height), "RGB")
        if fitted != (width, height):
            picture = pygame.transform.smoothscale(picture, fitted)
        self._screen.fill(_MARGIN)
        self._screen.blit(picture, ((size[0] - fitted[0]) // 2, (size[1] - fitted[1]) // 2))
        pygame.display.flip()
        if self._rate is not None:
            self._clock.tick(self._rate)
        return True

    def close(self) -> None:
        """Close the window; a second call does nothing."""
        if self.is_open:
            self.is_open = False
            self._screen = None
            self._pygame.display.quit()
