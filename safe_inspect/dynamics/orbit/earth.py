"""Constants of the Earth, and the size of circular orbits about it."""

from __future__ import annotations

#: Gravitational parameter [m^3/s^2] and equatorial radius [m], EGM2008.
EARTH_GRAVITY = 3.986004418e14
EARTH_RADIUS = 6_378_136.3
#: Coefficient J2 of the Earth's oblateness, without a tide [-], EGM2008.
EARTH_J2 = 1.0826355e-3


def semi_major_axis(mean_motion: float) -> float:
    """Return the semi-major axis [m] of an orbit with a mean motion [rad/s]."""
    return float((EARTH_GRAVITY / mean_motion**2) ** (1.0 / 3.0))
