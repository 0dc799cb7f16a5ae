"""Constants of the Earth, the size of circular orbits about it, and its shadow on them, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

from safe_inspect.compiling import njit

#: Gravitational parameter [m^3/s^2] and equatorial radius [m], EGM2008.
EARTH_GRAVITY = 3.986004418e14
EARTH_RADIUS = 6_378_136.3
#: Coefficient J2 of the Earth's oblateness, without a tide [-], EGM2008.
EARTH_J2 = 1.0826355e-3


def semi_major_axis(mean_motion: float) -> float:
    """Return the semi-major axis [m] of an orbit with a mean motion [rad/s]."""
    return float((EARTH_GRAVITY / mean_motion**2) ** (1.0 / 3.0))


#: Radius of the sun [m].
SUN_RADIUS = 695_700_000.0


class Shadow(NamedTuple):
    """The Earth's shadow on a circular orbit, in the form that compiled kernels use.

    Attributes:
        edge: Cosine between the directions to the sun and away from the Earth's centre at which the centre of the sun's
            disc is on the limb of the Earth [-]; in darkness, it is smaller.
        earth: Apparent radius of the Earth [rad].
        sun: Apparent radius of the sun [rad].
    """

    edge: float
    earth: float
    sun: float


def earth_shadow(mean_motion: float, sun_distance: float) -> Shadow:
    """Return the shadow on the circular orbit with a mean motion.

    Args:
        mean_motion: Mean motion of the orbit [rad/s].
        sun_distance: Distance of the sun [m].

    Raises:
        ValueError: The orbit is not outside of the Earth, or the sun is not farther away than its radius.
    """
    if not sun_distance > SUN_RADIUS:
        raise ValueError(f"the sun's distance must be more than its radius, {SUN_RADIUS:g} m, not {sun_distance:g} m")
    orbit = semi_major_axis(mean_motion)
    if orbit <= EARTH_RADIUS:
        fastest = math.sqrt(EARTH_GRAVITY / EARTH_RADIUS**3)
        raise ValueError(
            f"a circular orbit with the `mean_motion` {mean_motion:g} rad/s is inside of the Earth; `eclipse` requires "
            f"at most {fastest:.6f} rad/s"
        )
    earth = math.asin(EARTH_RADIUS / orbit)
    return Shadow(-math.cos(earth), earth, math.asin(SUN_RADIUS / sun_distance))


@njit
def sunlight_row(cosine: float, shadow: Shadow) -> float:
    """Return the fraction of the sun's disc that is not behind the Earth [-], 0 to 1.

    The two discs overlap as circles in the plane. Atmosphere and oblateness of the Earth are neglected.

    Args:
        cosine: Cosine between the directions to the sun and away from the Earth's centre [-].
        shadow: The shadow.

    Source:
        Montenbruck and Gill, "Satellite Orbits", 2000, equations 3.87 to 3.94.
    """
    a, b = shadow.sun, shadow.earth
    c = math.acos(min(max(-cosine, -1.0), 1.0))
    if c >= a + b:
        return 1.0
    if c <= b - a:
        return 0.0
    if c <= a - b:
        return 1.0 - (b / a) ** 2
    x = (c * c + a * a - b * b) / (2.0 * c)
    y = math.sqrt(max(0.0, a * a - x * x))
    area = a * a * math.acos(min(max(x / a, -1.0), 1.0)) + b * b * math.acos(min((c - x) / b, 1.0)) - c * y
    return min(max(1.0 - area / (math.pi * a * a), 0.0), 1.0)
