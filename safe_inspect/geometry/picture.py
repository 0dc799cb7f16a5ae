"""Elements that all images share: colours, the camera, and the shapes of a scene around a body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.types import BoolArray, FloatArray

# Okabe and Ito's palette, which is distinguishable with all common colour-vision deficiencies.
BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"
BLACK, GREY, PALE = "#222222", "#7A7A7A", "#D9D9D9"
DEPUTY_COLOURS = (BLUE, GREEN, PURPLE, VERMILION, SKY)
#: Night side and day side of the chief; uninspected points that are lit, and those that are dark.
NIGHT, DAY, LIT, DARK = "#B4BAC4", "#FFF1C4", "#FFFFFF", "#4B5563"
#: Direction from which scenes are seen: elevation over the orbital plane and azimuth from the radial axis [degrees].
VIEW = {"elev": 22.0, "azim": -52.0}


@dataclass(frozen=True)
class Camera:
    """An orthographic camera that looks at the origin, given by the directions of the image.

    Attributes:
        right: Unit vector to the right, shape (3,).
        up: Unit vector up, shape (3,).
        sight: Unit vector from the origin to the camera, shape (3,).
    """

    right: FloatArray
    up: FloatArray
    sight: FloatArray

    @classmethod
    def along(cls, sight: FloatArray) -> Camera:
        """Return the camera in the direction of a unit vector from the origin, shape (3,), with the third axis up."""
        right = np.cross((0.0, 0.0, 1.0), sight)
        right /= np.sqrt(np.square(right).sum())
        return cls(right, np.cross(sight, right), sight)

    @classmethod
    def at(cls, elevation: float, azimuth: float) -> Camera:
        """Return the camera at an elevation over the first two axes and an azimuth from the first axis [degrees]."""
        up, around = np.radians(elevation), np.radians(azimuth)
        return cls.along(np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)]))

    def turned(self, rotation: FloatArray) -> Camera:
        """Return the camera in another frame; the rotation, shape (3, 3), maps coordinates from there to this frame."""
        return Camera(self.right @ rotation, self.up @ rotation, self.sight @ rotation)

    def flat(self, points: FloatArray) -> FloatArray:
        """Return the positions of points in the image, to the right and up [m], shape (..., 2)."""
        return np.stack((points @ self.right, points @ self.up), axis=-1)

    def hidden(self, points: FloatArray, radius: float) -> BoolArray:
        """Return a mask of the points that are behind a sphere about the origin, shape (...,)."""
        across = np.square(self.flat(points)).sum(axis=-1)
        return np.asarray(((points * self.sight).sum(axis=-1) < 0.0) & (across < radius * radius))

    def day(self, sun: FloatArray, radius: float, corners: int = 24) -> FloatArray:
        """Return the outline of the visible part of a sphere's day side, shape (2 * corners, 2).

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


#: The camera of scenes about a chief.
FRONT = Camera.at(VIEW["elev"], VIEW["azim"])


def circle(radius: float, corners: int = 91) -> FloatArray:
    """Return the outline of a sphere about the origin in an image [m], shape (corners, 2)."""
    angle = np.linspace(0.0, 2.0 * np.pi, corners)
    return radius * np.stack((np.cos(angle), np.sin(angle)), axis=-1)


def ring(radius: float, corners: int = 181) -> FloatArray:
    """Return a circle of constant range in the plane of the first two axes [m], shape (corners, 3)."""
    return np.concatenate((circle(radius, corners), np.zeros((corners, 1))), axis=-1)


def sun_arrow(sun: FloatArray, radius: float) -> FloatArray:
    """Return the points of an arrow towards the sun that ends at a radius: tail, tip, barb, tip, barb, shape (5, 3).

    Args:
        sun: Unit vector to the sun, shape (3,).
        radius: Distance of the tip from the origin [m].
    """
    tip, aside = radius * sun, np.array([-sun[1], sun[0], 0.0])
    barbs = [tip - radius * (0.09 * sun - side * 0.05 * aside) for side in (1.0, -1.0)]
    return np.stack((0.7 * tip, tip, barbs[0], tip, barbs[1]))


def pieces(way: FloatArray, shown: BoolArray) -> FloatArray:
    """Return a line with NaN where it is not shown; each piece extends to the next point, so that pieces meet.

    Args:
        way: Points of the line, shape (K, n).
        shown: Mask of the points that are shown, shape (K, 1), or of the elements, shape (K, n).
    """
    joined = shown.copy()
    joined[1:] |= shown[:-1]
    return np.where(joined, way, np.nan)
