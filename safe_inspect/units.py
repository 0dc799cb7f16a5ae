"""Units of configured values: a configuration may use any unit, but the code only uses SI units.

A field is declared with its SI unit (`radius: Length`) and accepts a number in
that unit, a string (``"0.8 km"``) or a mapping (``{value: 800, units: meters}``).
The value is converted once, when the field is validated.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from safe_inspect.errors import UnitError, did_you_mean


@dataclass(frozen=True)
class Unit:
    """A unit of measurement.

    Attributes:
        symbol: SI unit of the same dimension, such as ``m/s``.
        factor: Factor from this unit to the SI unit.
    """

    symbol: str
    factor: float


_SPELLINGS: dict[str, tuple[str, float, tuple[str, ...]]] = {
    "m": ("m", 1.0, ("meter", "meters", "metre", "metres")),
    "km": ("m", 1e3, ("kilometer", "kilometers", "kilometre", "kilometres")),
    "cm": ("m", 1e-2, ("centimeter", "centimeters", "centimetre", "centimetres")),
    "mm": ("m", 1e-3, ("millimeter", "millimeters", "millimetre", "millimetres")),
    "ft": ("m", 0.3048, ("foot", "feet")),
    "s": ("s", 1.0, ("sec", "second", "seconds")),
    "ms": ("s", 1e-3, ("millisecond", "milliseconds")),
    "min": ("s", 60.0, ("minute", "minutes")),
    "h": ("s", 3600.0, ("hr", "hour", "hours")),
    "rad": ("rad", 1.0, ("radian", "radians")),
    "deg": ("rad", math.pi / 180.0, ("degree", "degrees")),
    "kg": ("kg", 1.0, ("kilogram", "kilograms")),
    "g": ("kg", 1e-3, ("gram", "grams")),
    "N": ("N", 1.0, ("n", "newton", "newtons")),
    "mN": ("N", 1e-3, ("millinewton", "millinewtons")),
    "Hz": ("Hz", 1.0, ("hertz", "hz")),
    "m/s": ("m/s", 1.0, ("meters/second", "meter/second", "meter_per_second", "meters_per_second", "mps")),
    "km/s": ("m/s", 1e3, ()),
    "cm/s": ("m/s", 1e-2, ()),
    "mm/s": ("m/s", 1e-3, ()),
    "km/h": ("m/s", 1.0 / 3.6, ("kph",)),
    "ft/s": ("m/s", 0.3048, ("fps",)),
    "m/s^2": ("m/s^2", 1.0, ("m/s**2", "m/s2")),
    "rad/s": ("rad/s", 1.0, ("radians/second", "radian/second", "radian / second")),
    "rad/s^2": ("rad/s^2", 1.0, ("rad/s**2", "rad/s2")),
    "deg/s^2": ("rad/s^2", math.pi / 180.0, ("deg/s**2", "deg/s2")),
    "deg/s": ("rad/s", math.pi / 180.0, ("degrees/second", "degree/second")),
    "N s": ("N s", 1.0, ("Ns", "N*s", "newton seconds")),
    "mN s": ("N s", 1e-3, ("mNs", "mN*s")),
    "m^2/kg": ("m^2/kg", 1.0, ("m2/kg", "m**2/kg")),
    "kg/m^3": ("kg/m^3", 1.0, ("kg/m3", "kg/m**3")),
    "N m": ("N m", 1.0, ("Nm", "N*m", "newton meters")),
    "kg m^2": ("kg m^2", 1.0, ("kg*m^2", "kg m2")),
    "1": ("", 1.0, ("", "-", "dimensionless", "none", "N/A", "n/a")),
}
_UNITS: dict[str, Unit] = {
    spelling: Unit(symbol, factor)
    for name, (symbol, factor, others) in _SPELLINGS.items()
    for spelling in (name, *others)
}
_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*\Z")


def unit(name: str) -> Unit:
    """Return the unit of that name.

    Raises:
        UnitError: The name is unknown.
    """
    found = _UNITS.get(name.strip()) or _UNITS.get(name.strip().lower())
    if found is None:
        raise UnitError(f"unknown unit {name!r}; {did_you_mean(name, (spelling for spelling in _UNITS if spelling))}")
    return found


def factor(name: str, symbol: str) -> float:
    """Return the factor from the unit `name` to the SI unit `symbol`.

    Raises:
        UnitError: The unit is unknown or has another dimension.
    """
    found = unit(name)
    if found.symbol != symbol:
        fitting = ", ".join(repr(name) for name, (of, _, _) in _SPELLINGS.items() if of == symbol)
        use = f"use {' or '.join(fitting.rsplit(', ', 1))}" if symbol else "write a number without a unit"
        raise UnitError(f"{name!r} is not a unit of {_describe(symbol)}; {use}")
    return found.factor


def to_si(value: Any, symbol: str) -> Any:
    """Convert a configured value to the SI unit `symbol`.

    Numbers are returned unchanged; ``"800 m"`` and ``{value: 0.8, units: km}`` are converted.

    Raises:
        UnitError: The value is not a quantity, or its unit has another dimension.
    """
    if isinstance(value, bool):
        raise UnitError(f"{str(value).lower()} is not a quantity; write a number in {symbol or 'no unit'}")
    if isinstance(value, str):
        match = _QUANTITY.match(value)
        if match is None:
            raise UnitError(f"{value!r} is not a quantity; write a number in {symbol or 'no unit'}, or '1.5 {symbol}'")
        number, name = float(match[1]), match[2] or None
    elif isinstance(value, Mapping):
        unknown = set(value) - {"value", "units", "name"}
        if unknown or "value" not in value:
            raise UnitError(f"a quantity must have the keys `value` and `units`, not {sorted(map(str, value))}")
        number = value["value"]
        if isinstance(number, bool) or not isinstance(number, (int, float)):
            raise UnitError(f"the value {number!r} is not a number")
        name = value.get("units")
    else:
        return value
    return float(number) if name is None else float(number) * factor(str(name), symbol)


def _describe(symbol: str) -> str:
    names = {
        "m": "length", "s": "time", "rad": "angle", "kg": "mass", "N": "force", "Hz": "frequency",
        "m/s": "speed", "m/s^2": "acceleration", "rad/s": "angular rate", "rad/s^2": "angular acceleration",
        "N m": "torque", "kg m^2": "moment of inertia", "": "a pure number", "N s": "impulse",
        "m^2/kg": "area per mass", "kg/m^3": "density",
    }  # fmt: skip
    return names.get(symbol, symbol)


#: How a number must compare with each kind of limit, and the words for it.
_LIMITS: dict[str, tuple[Callable[[float, float], bool], str]] = {
    "gt": (operator.gt, "above {}"),
    "ge": (operator.ge, "of {} or more"),
    "lt": (operator.lt, "below {}"),
    "le": (operator.le, "of {} or less"),
}


def quantity(symbol: str, **limits: Any) -> Any:
    """Return a field type: a float in the SI unit `symbol`, within the limits (`gt`, `ge`, `lt`, `le`)."""

    def convert(value: Any) -> Any:
        number = to_si(value, symbol)
        if symbol == "rad" and isinstance(number, int | float) and isinstance(value, str | Mapping):
            for name, (inside, text) in _LIMITS.items():
                if name in limits and not inside(number, limits[name]):
                    most, given = math.degrees(limits[name]), math.degrees(number)
                    raise UnitError(f"expected an angle {text.format(f'{most:g} deg')}, got {given:g} deg")
        return number

    return Annotated[
        float,
        Field(allow_inf_nan=False, json_schema_extra={"units": symbol}, **limits),
        BeforeValidator(convert, json_schema_input_type=float | str | dict[str, Any]),
    ]


Length = quantity("m")
PositiveLength = quantity("m", gt=0)
NonNegativeLength = quantity("m", ge=0)
Speed = quantity("m/s")
NonNegativeSpeed = quantity("m/s", ge=0)
PositiveSpeed = quantity("m/s", gt=0)
Angle = quantity("rad")
NonNegativeAngle = quantity("rad", ge=0)
#: Angle between two directions, at most 180 degrees.
PolarAngle = quantity("rad", ge=0, le=math.pi)
#: Angle of an error, at most 90 degrees.
ErrorAngle = quantity("rad", ge=0, le=0.5 * math.pi)
#: Angle of an error, less than 45 degrees.
SmallAngle = quantity("rad", ge=0, lt=0.25 * math.pi)
ElevationAngle = quantity("rad", ge=-0.5 * math.pi, le=0.5 * math.pi)
AngularRate = quantity("rad/s")
PositiveAngularRate = quantity("rad/s", gt=0)
NonNegativeAngularRate = quantity("rad/s", ge=0)
#: Full angle of a cone, up to 2 pi, which contains every direction.
ConeOfView = quantity("rad", gt=0, le=2.0 * math.pi)
#: Full angle of a cone about a line to a body, up to a half-space.
ConeToBody = quantity("rad", gt=0, le=math.pi)
#: Full opening angle; a cone of half a turn or more would cover the whole half space.
ConeAngle = quantity("rad", gt=0, lt=math.pi)
PositiveAngularAcceleration = quantity("rad/s^2", gt=0)
PositiveMomentOfInertia = quantity("kg m^2", gt=0)
Torque = quantity("N m")
PositiveDuration = quantity("s", gt=0)
NonNegativeDuration = quantity("s", ge=0)
NonNegativeMass = quantity("kg", ge=0)
NonNegativeImpulse = quantity("N s", ge=0)
NonNegativeAreaPerMass = quantity("m^2/kg", ge=0)
NonNegativeDensity = quantity("kg/m^3", ge=0)
PositiveMass = quantity("kg", gt=0)
Force = quantity("N")
PositiveForce = quantity("N", gt=0)
NonNegativeForce = quantity("N", ge=0)
PositiveTorque = quantity("N m", gt=0)
NonNegativeTorque = quantity("N m", ge=0)
PositiveFrequency = quantity("Hz", gt=0)
PositiveAcceleration = quantity("m/s^2", gt=0)
#: Slope of a speed over a range, (m/s)/m.
SpeedSlope = quantity("Hz", ge=0)
