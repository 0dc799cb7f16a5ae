"""Constants of the rule by which a point of the chief is lit well enough to be inspected."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

Colour = tuple[float, float, float]

_NO_COLOUR: Colour = (0.0, 0.0, 0.0)


class Light(NamedTuple):
    """The rule of light, in the form that compiled kernels use.

    A point with the outward normal n is on the sun's side when ``n . s > threshold``, where s is the direction to the
    sun. A binary light has no further condition. Otherwise the colour by Blinn and Phong is ``ambient`` plus, on the
    sun's side only, ``diffuse (n . s) + specular (n . h)^exponent``, with h halfway between s and the direction from
    the point to the viewer; products below 0 count as 0. The point is lit when red is at least `dark` and red, green
    and blue are not all above `bright`.

    Attributes:
        binary: Whether being on the sun's side is the only condition.
        threshold: Cosine of the largest angle between normal and sun [-]; 0 is the terminator.
        ambient: Red, green and blue of the ambient colour of the surface [-].
        diffuse: The same of the diffuse reflection.
        specular: The same of the specular highlight.
        exponent: Sharpness of the highlight.
        dark: Smallest red of a point that is bright enough.
        bright: A point brighter than this in all three channels is overexposed.
    """

    binary: bool
    threshold: float
    ambient: Colour
    diffuse: Colour
    specular: Colour
    exponent: float
    dark: float
    bright: float


def full_light() -> Light:
    """Return the light in which every point is lit, for tasks without a sun."""
    return _binary(-math.inf)


def binary_light(radius: float, ray_offset: float = 0.0) -> Light:
    """Return the light in which a point is lit when the ray from it to the sun does not meet the sphere.

    For parallel rays from the surface itself: ``n . s > 0``. A ray that starts `ray_offset` above the surface misses
    the sphere slightly beyond the terminator: ``n . s > -sqrt(1 - (R/(R + ray_offset))^2)``.

    Args:
        radius: Radius R of the chief's sphere [m].
        ray_offset: Height of the start of the ray above the surface [m].
    """
    return _binary(_terminator(radius, ray_offset))


def phong_light(
    radius: float,
    *,
    light_ambient: Sequence[float] = (1.0, 1.0, 1.0),
    light_diffuse: Sequence[float] = (1.0, 1.0, 1.0),
    light_specular: Sequence[float] = (1.0, 1.0, 1.0),
    chief_ambient: Sequence[float] = (0.1, 0.0, 0.0),
    chief_diffuse: Sequence[float] = (0.7, 0.0, 0.0),
    chief_specular: Sequence[float] = (1.0, 1.0, 1.0),
    shininess: float = 100.0,
    ray_offset: float = 0.0,
    dark: float = 0.12,
    bright: float = 0.8,
) -> Light:
    """Return the light of Blinn and Phong's reflection model; see `Light` for the rule.

    Each colour of the sun's light is multiplied by the same colour of the chief's surface, channel by channel; the
    exponent of the highlight is a quarter of the shininess. The defaults are a white sun and a red chief.

    Args:
        radius: Radius of the chief's sphere [m].
        light_ambient: Red, green and blue of the light's ambient part [-], 0 or more.
        light_diffuse: The same of its diffuse part.
        light_specular: The same of its specular part.
        chief_ambient: Red, green and blue of the chief's ambient reflection [-], 0 or more.
        chief_diffuse: The same of its diffuse reflection.
        chief_specular: The same of its specular reflection.
        shininess: Shininess of the chief, positive.
        ray_offset: Height above the surface at which the ray to the sun starts [m]; see `binary_light`.
        dark: Smallest red of a point that is bright enough, in [0, 1].
        bright: A point brighter than this in all three channels is overexposed, in [0, 1].

    Raises:
        ValueError: A colour is not three finite numbers of at least 0.

    Source:
        Blinn, "Models of light reflection for computer synthesized pictures", 1977.
    """
    return Light(
        binary=False,
        threshold=_terminator(radius, ray_offset),
        ambient=_product("ambient", light_ambient, chief_ambient),
        diffuse=_product("diffuse", light_diffuse, chief_diffuse),
        specular=_product("specular", light_specular, chief_specular),
        exponent=shininess / 4.0,
        dark=float(dark),
        bright=float(bright),
    )


def _binary(threshold: float) -> Light:
    return Light(True, threshold, _NO_COLOUR, _NO_COLOUR, _NO_COLOUR, 1.0, 0.0, 1.0)


def _terminator(radius: float, ray_offset: float) -> float:
    """Return the cosine of the angle from the sun at which a ray that starts above the surface touches the sphere."""
    if ray_offset == 0.0:
        return 0.0
    # 1 - (R/(R + e))^2 = e (2 R + e)/(R + e)^2, which avoids the difference of nearly equal numbers
    return -math.sqrt(ray_offset * (2.0 * radius + ray_offset)) / (radius + ray_offset)


def _product(name: str, light: Sequence[float], chief: Sequence[float]) -> Colour:
    """Return the product of two colours, channel by channel."""
    for owner, colour in (("light", light), ("chief", chief)):
        if len(colour) != 3 or not all(math.isfinite(part) and part >= 0.0 for part in colour):
            raise ValueError(f"{owner}_{name} must be three finite numbers of at least 0, got {list(colour)}")
    red, green, blue = (float(a) * float(b) for a, b in zip(light, chief, strict=True))
    return red, green, blue
