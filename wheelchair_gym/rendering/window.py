"""A window that shows pictures; pygame-ce is imported when one is opened, not before."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wheelchair_gym.config import InputError

_MISSING = 'render_mode "human" needs pygame-ce: pip install "wheelchair_gym[view]"'
_MARGIN = (33, 37, 41)  # RGB around a picture that does not fill the window


class Window:
    """Shows RGB pictures; q, Escape or the window's own button close it for good.

    Args:
        title: of the window.
        rate: the most pictures a second `show` lets through, by waiting [1/s]; None: no waiting.

    Raises:
        InputError: pygame-ce is missing, or there is no display to open a window on.
    """

    def __init__(self, title: str = "wheelchair_gym", rate: float | None = None) -> None:
        try:
            import pygame
        except ImportError:
            raise InputError(_MISSING) from None
        self._pygame = pygame
        self._rate = rate
        self._open = True
        self._screen: pygame.Surface | None = None
        try:
            pygame.display.init()
        except pygame.error as error:
            raise InputError(f'render_mode "human" found no display ({error})') from None
        pygame.display.set_caption(title)
        self._clock = pygame.time.Clock()

    @property
    def is_open(self) -> bool:
        """Whether pictures can still be seen."""
        return self._open

    def show(self, image: NDArray[np.uint8]) -> bool:
        """Show a picture (h, w, 3) RGB as large as the window allows; false once it is closed."""
        if not self._open:
            return False
        pygame = self._pygame
        height, width = image.shape[:2]
        if self._screen is None:
            self._screen = pygame.display.set_mode((width, height), pygame.RESIZABLE)
        if self._closing():
            self.close()
            return False
        # A resize makes pygame hand out a new surface.
        self._screen = pygame.display.get_surface() or self._screen
        room = self._screen.get_size()
        scale = min(room[0] / width, room[1] / height)
        fitted = (max(1, round(width * scale)), max(1, round(height * scale)))
        picture = pygame.image.frombuffer(np.ascontiguousarray(image), (width, height), "RGB")
        if fitted != (width, height):
            picture = pygame.transform.smoothscale(picture, fitted)
        self._screen.fill(_MARGIN)
        self._screen.blit(picture, ((room[0] - fitted[0]) // 2, (room[1] - fitted[1]) // 2))
        pygame.display.flip()
        if self._rate is not None:
            self._clock.tick(self._rate)
        return True

    def _closing(self) -> bool:
        pygame = self._pygame
        return any(
            event.type == pygame.QUIT
            or (event.type == pygame.KEYDOWN and event.key in (pygame.K_ESCAPE, pygame.K_q))
            for event in pygame.event.get()
        )

    def close(self) -> None:
        """Close the window; again does nothing."""
        if self._open:
            self._open = False
            self._screen = None
            self._pygame.display.quit()
