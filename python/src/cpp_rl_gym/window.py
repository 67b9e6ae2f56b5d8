"""The window of ``render_mode="human"``."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.error import DependencyNotInstalled


class Window:
    """Shows pictures at a given rate. It opens when the first one comes."""

    def __init__(self, title: str, frames_per_second: int) -> None:
        self._pygame = _pygame()
        self._title = title
        self._frames_per_second = frames_per_second
        self._clock = self._pygame.time.Clock()
        self._screen: Any = None

    def show(self, frame: npt.NDArray[np.uint8]) -> None:
        """Shows ``frame``, ``[height, width, 3]``, and waits until the next may come."""
        size = (frame.shape[1], frame.shape[0])
        if self._screen is None or self._screen.get_size() != size:
            self._pygame.display.init()
            self._pygame.display.set_caption(self._title)
            self._screen = self._pygame.display.set_mode(size)
        self._pygame.surfarray.blit_array(self._screen, frame.swapaxes(0, 1))
        self._pygame.event.pump()
        self._pygame.display.flip()
        self._clock.tick(self._frames_per_second)

    def close(self) -> None:
        """Closes the window."""
        self._pygame.display.quit()


def _pygame() -> Any:
    try:
        import pygame
    except ImportError as error:
        raise DependencyNotInstalled(
            'render_mode="human" needs pygame to open a window; install it with: pip install pygame-ce '
            '(render_mode="rgb_array" does not need it)'
        ) from error
    return pygame
