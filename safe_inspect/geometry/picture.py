"""Plain projections for pictures, and the colours that all pictures share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.types import BoolArray, FloatArray

# Okabe and Ito's palette, which people with any of the common colour-vision deficiencies can tell apart.
BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
BLACK, GREY, PALE = "#222222", "#7A7A7A", "#D9D9D9"
DEPUTY_COLOURS = (BLUE, GREEN, PURPLE, VERMILION, SKY)
#: Night and day side of the chief; points that are lit and points in the dark that nobody has inspected.
NIGHT, DAY, LIT, DARK = "#B4BAC4", "#FFF1C4", "#FFFFFF", "#4B5563"
#: Elevation over the orbital plane and azimuth from the radial axis from which scenes are seen [degrees].
VIEW = {"elev": 22.0, "azim": -52.0}


def picture_axes(sight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the unit vectors to the right and up for a reader towards whom `sight` points."""
    right = np.cross((0.0, 0.0, 1.0), sight)
    right /= np.sqrt(np.square(right).sum())
    return right, np.cross(sight, right)


@dataclass(frozen=True)
class Camera:
    """An orthographic camera that looks at the chief.

    Attributes:
        sight: Unit vector from the chief to the camera, shape (3,).
    """

    sight: FloatArray

    @classmethod
    def at(cls, elevation: float, azimuth: float) -> Camera:
        """Return the camera at an elevation over the orbital plane and an azimuth from the radial axis [degrees]."""
        up, around = np.radians(elevation), np.radians(azimuth)
        return cls(np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)]))

    def flat(self, points: FloatArray) -> FloatArray:
        """Return where points lie in the picture, to the right and up [m], shape (..., 2)."""
        right, up = picture_axes(self.sight)
        return np.stack(((points * right).sum(axis=-1), (points * up).sum(axis=-1)), axis=-1)

    def hidden(self, points: FloatArray, radius: float) -> BoolArray:
        """Return which points lie behind the chief, shape (...,)."""
        across = np.square(self.flat(points)).sum(axis=-1)
        return np.asarray(((points * self.sight).sum(axis=-1) < 0.0) & (across < radius * radius))

    def day(self, sun: FloatArray, radius: float, corners: int = 24) -> FloatArray:
        """Return the outline of what is seen of a sphere's day side, shape (2 * corners, 2).

        Args:
            sun: Unit vector to the sun, shape (3,).
            radius: Radius of the sphere [m].
            corners: Half the number of corners.
        """
        along = self.flat(sun)
        norm = float(np.sqrt(np.square(along).sum()))
        along = along / norm if norm > 1e-9 else np.array([1.0, 0.0])
        across = np.array([-along[1], along[0]])
        angle = np.linspace(-np.pi / 2.0, np.pi / 2.0, corners)[:, None]
        limb = np.cos(angle) * along + np.sin(angle) * across
        depth = float((sun * self.sight).sum())  # the terminator is an ellipse with this half axis
        terminator = -depth * np.cos(angle) * along + np.sin(angle) * across
        return np.asarray(radius * np.concatenate((limb, terminator[::-1])))
