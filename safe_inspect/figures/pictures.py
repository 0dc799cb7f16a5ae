"""`Pictures`: base class of the films."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np

from safe_inspect.figures.drawing import style
from safe_inspect.types import AnyArray


class Pictures(ABC):
    """Base class of a sequence of pictures that are equally spaced in time.

    Args:
        frames: Number of pictures, at least 2.
        width: Width of a picture [pixels]; it is 1.6 times its height.

    Raises:
        ValueError: A number is out of range.
    """

    _canvas: Any

    def __init__(self, frames: int, width: int) -> None:
        if frames < 2 or not 320 <= width <= 3840:
            raise ValueError(f"expected at least 2 frames and a width of 320 to 3840 pixels, got {frames} and {width}")
        self.frames = frames
        self._size = (2 * (width // 2), 2 * round(width / 3.2))  # video codecs require even numbers

    @abstractmethod
    def _show(self, share: float) -> None:
        """Update the figure to a share of the film's time, from 0 to 1."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a picture [pixels]."""
        return self._size

    def __len__(self) -> int:
        return self.frames

    def __iter__(self) -> Iterator[AnyArray]:
        """Yield the pictures in red, green and blue, uint8, shape (height, width, 3)."""
        for index in range(self.frames):
            yield self.picture(index)

    def picture(self, index: int) -> AnyArray:
        """Return a picture by its index from 0, in red, green and blue, uint8, shape (height, width, 3)."""
        with style():
            self._show(index / (self.frames - 1))
            self._canvas.draw()
            return np.asarray(self._canvas.buffer_rgba())[..., :3].copy()
