from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

from safe_inspect.errors import UnitError
from safe_inspect.units import (
    Angle,
    AngularRate,
    Force,
    Length,
    NonNegativeSpeed,
    PositiveDuration,
    PositiveFrequency,
    PositiveLength,
    PositiveMass,
    Speed,
    factor,
    quantity,
    to_si,
    unit,
)

#: Value, unit, SI unit, and the value in it, computed by hand.
_BY_HAND = [
    (800.0, "meters", "m", 800.0),
    (0.8, "km", "m", 800.0),
    (12.5, "cm", "m", 0.125),
    (250.0, "mm", "m", 0.25),
    (1000.0, "ft", "m", 304.8),
    (1.5, "h", "s", 5400.0),
    (2.0, "min", "s", 120.0),
    (20.0, "ms", "s", 0.02),
    (180.0, "deg", "rad", math.pi),
    (1.0, "radians", "rad", 1.0),
    (36.0, "km/h", "m/s", 10.0),
    (7.5, "km/s", "m/s", 7500.0),
    (30.0, "cm/s", "m/s", 0.3),
    (100.0, "fps", "m/s", 30.48),
    (90.0, "deg/s", "rad/s", math.pi / 2.0),
    (500.0, "g", "kg", 0.5),
    (12.0, "kilograms", "kg", 12.0),
    (100.0, "mN", "N", 0.1),
    (0.1, "hertz", "Hz", 0.1),
    (9.81, "m/s2", "m/s^2", 9.81),
    (0.5, "N/A", "", 0.5),
    (0.5, "dimensionless", "", 0.5),
]


@pytest.mark.parametrize(("value", "name", "symbol", "si"), _BY_HAND)
def test_conversion_by_hand(value: float, name: str, symbol: str, si: float) -> None:
    assert value * factor(name, symbol) == pytest.approx(si, rel=1e-15)
    assert to_si(f"{value} {name}", symbol) == pytest.approx(si, rel=1e-15)
    assert to_si({"value": value, "units": name}, symbol) == pytest.approx(si, rel=1e-15)


@pytest.mark.parametrize("name", ["Meters", "METERS", " m ", "Km", "Newton", "n", "N"])
def test_case_and_blanks_do_not_matter_where_nothing_is_lost(name: str) -> None:
    assert unit(name).factor == unit(name.strip().lower()).factor


def test_capitals_count_where_they_tell_units_apart() -> None:
    assert unit("mN").symbol == "N"
    assert unit("ms").symbol == "s"
    assert unit("m/s").symbol == "m/s"


_SYMBOLS = {"m": ("km", "cm", "ft"), "s": ("min", "h", "ms"), "rad": ("deg",), "m/s": ("km/h", "ft/s"), "kg": ("g",)}
_PAIRS = st.sampled_from([(name, symbol) for symbol, names in _SYMBOLS.items() for name in names])
_NUMBERS = st.floats(-1e9, 1e9, allow_nan=False).filter(lambda value: value == 0.0 or abs(value) > 1e-9)


@given(_NUMBERS, _PAIRS)
@settings(max_examples=60, deadline=None)
def test_text_mapping_and_factor_agree(value: float, pair: tuple[str, str]) -> None:
    name, symbol = pair
    expected = value * factor(name, symbol)
    assert to_si(f"{value!r} {name}", symbol) == expected
    assert to_si(f"  {value!r}{name} ", symbol) == expected
    assert to_si({"value": value, "units": name}, symbol) == expected
    assert to_si(f"{expected!r} {symbol}", symbol) == expected


@given(_NUMBERS, st.sampled_from(["m", "s", "rad", "N", ""]))
@settings(max_examples=40, deadline=None)
def test_numbers_pass_as_they_are(value: float, symbol: str) -> None:
    assert to_si(value, symbol) == value
    assert to_si(repr(value), symbol) == value
    assert to_si({"value": value}, symbol) == value


@pytest.mark.parametrize(
    ("value", "symbol", "text"),
    [
        ("5 metres/fortnight", "m/s", "unknown unit 'metres/fortnight'"),
        ("5 metrs", "m", "did you mean `metres`|did you mean `meters`"),
        ("5 s", "m", "'s' is not a unit of length; use 'm'"),
        ("5 kg", "", "'kg' is not a unit of a pure number; write a number without a unit"),
        ("five metres", "m", "'five metres' is not a quantity"),
        ("", "m", "is not a quantity"),
        ("1e400e m", "m", "unknown unit|not a quantity"),
        ({"units": "m"}, "m", "keys `value` and `units`"),
        ({"value": 1, "unit": "m"}, "m", "keys `value` and `units`"),
        ({"value": "1", "units": "m"}, "m", "'1' is not a number"),
        ({"value": True, "units": "m"}, "m", "True is not a number"),
        ({"value": 1, "units": 3}, "m", "unknown unit '3'"),
    ],
)
def test_what_is_refused(value: Any, symbol: str, text: str) -> None:
    with pytest.raises(UnitError, match=text):
        to_si(value, symbol)


class Model(BaseModel):
    length: Length = 0.0
    positive: PositiveLength = 1.0
    speed: Speed = 0.0
    limit: NonNegativeSpeed = 0.0
    angle: Angle = 0.0
    rate: AngularRate = 0.0
    duration: PositiveDuration = 1.0
    mass: PositiveMass = 1.0
    force: Force = 0.0
    frequency: PositiveFrequency = 1.0
    maybe: PositiveLength | None = None


def test_fields_convert_once() -> None:
    model = Model(length="-0.8 km", angle={"value": 90, "units": "deg"}, duration="1 min", mass="500 g", maybe="2 ft")
    assert (model.length, model.duration, model.mass) == (-800.0, 60.0, 0.5)
    assert model.angle == pytest.approx(math.pi / 2.0)
    assert model.maybe == pytest.approx(0.6096)
    assert Model.model_validate(model.model_dump()) == model


@pytest.mark.parametrize(
    "wrong",
    [
        {"positive": 0}, {"positive": "-1 km"}, {"limit": -0.1}, {"duration": "0 s"}, {"mass": -1}, {"frequency": 0},
        {"length": float("nan")}, {"length": float("inf")}, {"length": "1e999 m"}, {"length": [1]}, {"length": None},
        {"speed": "3 m"}, {"force": "2 kg"}, {"rate": "3 rad"}, {"maybe": 0},
    ],
)  # fmt: skip
def test_fields_keep_their_limits(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Model(**wrong)


def test_schema_names_the_unit() -> None:
    properties = Model.model_json_schema()["properties"]
    assert properties["speed"]["units"] == "m/s"
    assert properties["frequency"]["units"] == "Hz"


def test_own_quantities() -> None:
    class Own(BaseModel):
        acceleration: quantity("m/s^2", gt=0, le=10)  # type: ignore[valid-type]

    assert Own(acceleration="5 m/s**2").acceleration == 5.0
    with pytest.raises(ValidationError):
        Own(acceleration=11)
