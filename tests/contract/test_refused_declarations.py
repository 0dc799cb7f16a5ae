"""Each way in which what a plugin declares can break the contract, with the exact words of the report."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict, Field, PlainSerializer, model_validator

from safe_inspect.dones.motion import CrashDoneFunction
from safe_inspect.plugins import SensorName
from safe_inspect.plugins.functor import functor_field
from safe_inspect.plugins.plugin import documented_fields
from safe_inspect.rewards import Reward
from safe_inspect.testing import check_plugin
from safe_inspect.units import PositiveAngularRate, PositiveLength

from .making import made
from .reports import breaches

pytestmark = pytest.mark.usefixtures("clean_registry")


def paying(doc: str, **members: Any) -> type:
    """Return a reward of 1."""
    return made(Reward, doc, __call__=lambda self, step: np.ones(len(step.control)), **members)


def documented(kind: Any, default: Any, unit: str = "", **members: Any) -> type:
    """Return a reward with one documented field."""
    doc = DOCUMENTED.format(f" [{unit}]" if unit else "")
    return paying(doc, __annotations__={"field": kind}, field=default, **members)


class Tight(BaseModel):
    """A sound model."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    value: float = 1.0


class Changing(BaseModel):
    """A model that can be changed."""

    model_config = ConfigDict(extra="forbid")


class Greedy(BaseModel):
    """A model that takes further keys."""

    model_config = ConfigDict(frozen=True)


class Around(BaseModel):
    """A sound model around another one."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    inner: Greedy = Greedy()
    further: Changing | None = None


class Opaque:
    """What YAML cannot hold."""

    def __repr__(self) -> str:
        return "Opaque()"


@model_validator(mode="before")
@classmethod
def _drop_unknown(cls: Any, values: Any) -> Any:
    return {key: value for key, value in values.items() if key in cls.model_fields}


DOCUMENTED = "Pay 1.\n\nAttributes:\n    field: Something{}.\n"
Rate = Annotated[float, Field(json_schema_extra={"units": "Hz"})]
Acceleration = Annotated[float, Field(json_schema_extra={"units": "m/s^2"})]
Plain = Annotated[float, Field(json_schema_extra={"example": 1.0})]
Rounded = Annotated[float, PlainSerializer(lambda value: round(value))]
Worded = Annotated[float, PlainSerializer(lambda value: f"{value} of something")]


REFUSED = {
    "frozen alone": lambda: paying("Pay 1.", model_config=ConfigDict(frozen=False)),
    "extra keys alone": lambda: paying("Pay 1.", model_config=ConfigDict(extra="ignore")),
    "keys dropped by a validator": lambda: paying("Pay 1.", drop=_drop_unknown),
    "changing model": lambda: documented(Changing, Changing()),
    "greedy model in a list": lambda: documented(tuple[Greedy, ...], ()),
    "models within a model": lambda: documented(Around, Around()),
    "any object": lambda: documented(object, 1.0),
    "two undocumented fields": lambda: paying("Pay 1.", __annotations__={"one": float, "two": float}, one=1.0, two=2.0),
    "no sentence": lambda: paying("Pay 1"),
    "nothing": lambda: paying(""),
    "unit of another kind": lambda: documented(PositiveLength, 1.0, "s"),
    "no unit": lambda: documented(PositiveLength | None, 1.0),
    "no rate": lambda: documented(Rate, 1.0, "s"),
    "field that is not there": lambda: paying(DOCUMENTED.format("")),
    "two failures of the defaults": lambda: paying(
        "Pay 1.", __annotations__={"one": float, "two": PositiveLength}, two=-1.0
    ),
    "not as YAML": lambda: documented(Opaque, Opaque(), model_config=ConfigDict(arbitrary_types_allowed=True)),
    "changed by YAML": lambda: documented(Rounded, 1.25),
    "not read from YAML": lambda: documented(Worded, 1.25),
    "a sensor that is not there": lambda: documented(SensorName, "Sensor_Velocty"),
}
ACCEPTED = {
    "nothing": lambda: paying("Pay 1."),
    "colon": lambda: paying("Pay this::\n\n    1\n"),
    "sound model": lambda: documented(Tight | None, Tight()),
    "plugin": lambda: documented(functor_field("done"), CrashDoneFunction()),
    "length": lambda: documented(PositiveLength, 1.0, "m"),
    "rate in 1/s": lambda: documented(Rate, 1.0, "1/s"),
    "rate in Hz": lambda: documented(Rate, 1.0, "Hz"),
    "acceleration": lambda: documented(Acceleration, 1.0, "m/s2"),
    "acceleration in Python": lambda: documented(Acceleration, 1.0, "m/s**2"),
    "angular rate": lambda: documented(PositiveAngularRate, 1.0, "1/s"),
    "schema without a unit": lambda: documented(Plain, 1.0),
    "no sensor": lambda: documented(SensorName | None, None),
    "a property": lambda: paying(DOCUMENTED.format(""), field=property(lambda self: 1.0)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_declaration_is_refused_in_exact_words(name: str) -> None:
    assert breaches(REFUSED[name]())


@pytest.mark.parametrize("name", ACCEPTED)
def test_a_sound_declaration_passes(name: str) -> None:
    check_plugin(ACCEPTED[name]())


def test_fields_are_documented_by_their_class_or_its_bases() -> None:
    class Base(BaseModel):
        """A base.

        Attributes:
            one: Of the base.
            two (float): Of the base,
                in two lines.

        Further text:
            three: No field.
        """

    class Own(Base):
        """A class.

        Attributes:
            one: Its own.
        """

    found = {name: text for name, text in documented_fields(Own).items() if not name.startswith("__")}
    assert found == {"one": "Its own.", "two": "Of the base, in two lines."}
