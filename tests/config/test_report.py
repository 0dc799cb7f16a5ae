from __future__ import annotations

from typing import Any, ClassVar, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from safe_inspect.config.loading.loader import load
from safe_inspect.config.overrides import apply_overrides
from safe_inspect.config.report import problems_of
from safe_inspect.plugins import Plugin
from safe_inspect.plugins.functor import functor_field
from safe_inspect.units import PositiveLength


class Trial(Plugin):
    """A kind of plugin for these tests."""

    kind: ClassVar[str] = "trial_report"


class Scaling(BaseModel):
    model_config = ConfigDict(extra="forbid")

    factor: float = 1.0
    offsets: list[float] = Field(default=[], max_length=2)


class ScaledTrial(Trial):
    """A plugin with fields of several types."""

    scale: float
    count: int = Field(default=1, ge=1)
    radius: PositiveLength = 1.0
    mode: Literal["scale", "constant"] = "scale"
    scaling: Scaling = Scaling()
    offset: float | Literal["auto"] = 0.0
    choice: Scaling | list[int] = Scaling()

    def __call__(self) -> float:
        return self.scale


class WrappingTrial(Trial):
    """A plugin that holds another."""

    wrapped: functor_field("trial_report")  # type: ignore[valid-type]

    def __call__(self) -> float:
        return 0.0


class Experiment(BaseModel):
    model_config = ConfigDict(extra="forbid")

    title: str = "x"
    trials: list[functor_field("trial_report")] = []  # type: ignore[valid-type]
    scalings: dict[str, Scaling] = {}
    either: Scaling | None = None

    @field_validator("title")
    @classmethod
    def short(cls, title: str) -> str:
        if len(title) > 3:
            raise ValueError(f"the title {title!r} is too long")
        return title


def report(tree: Any, model: type[BaseModel] = Experiment) -> list[str]:
    with pytest.raises(ValidationError) as caught:
        model.model_validate(tree)
    return [str(problem) for problem in problems_of(caught.value, tree, model)]


def trial(write, config: str) -> list[str]:
    write({"a.yml": f"trials:\n  - functor: ScaledTrial\n    config:\n      {config}\n"})
    return report(load("a.yml"))


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ("scale: abc", "scale: expected a number, got 'abc'"),
        ("scale: [1]", "scale: expected a number, got [1]"),
        ("scale:", "scale: expected a number, got nothing (`null`)"),
        ("{scale: 1, count: 1.5}", "count: expected a whole number, got 1.5"),
        ("{scale: 1, count: 1, mode: scale, radius: -1}", "radius: expected a number above 0, got -1"),
        ("{scale: 1, count: true}", "count: expected a whole number, got `true`"),
        ("{scale: yes}", "scale: expected a number, got `true`"),
        ("{scale: 1, count: 0}", "count: expected a number of 1 or more, got 0"),
        ("{scale: 1, radius: 3 kg}", "radius: 'kg' is not a unit of length; use 'm', 'km', 'cm', 'mm' or 'ft'"),
        ("{scale: 1, mode: scal}", "mode: expected 'scale' or 'constant', got 'scal'; did you mean `scale`?"),
        ("{scale: 1, scael: 2}", "scael: unknown key `scael`; did you mean `scale`?"),
        ("{scale: 1, scaling: {factr: 2}}", "scaling.factr: unknown key `factr`; did you mean `factor`?"),
        ("{scale: 1, scaling: 3}", "scaling: expected a mapping, got 3"),
        ("{scale: 1, scaling: {offsets: [1, x]}}", "scaling.offsets[1]: expected a number, got 'x'"),
        ("{scale: 1, scaling: {offsets: [1, 2, 3]}}", "scaling.offsets: expected at most 2 items, got [1, 2, 3]"),
        ("{scale: 1, offset: atuo}", "offset: expected a number or 'auto', got 'atuo'"),
        ("{scale: 1, choice: {factor: x}}", "choice.factor: expected a number, got 'x'"),
        ("{scale: 1, choice: [1, x]}", "choice[1]: expected a whole number, got 'x'"),
        ("{scale: 1, choice: 3}", "choice: expected a mapping or a list, got 3"),
    ],
)  # fmt: skip
def test_a_wrong_field_of_a_plugin(write, config, message):
    assert trial(write, config) == [f"a.yml:4 trials[0].config.{message}"]


def test_a_missing_field_is_located_at_the_mapping_it_lacks(write):
    assert trial(write, "count: 1") == ["a.yml:3 trials[0].config.scale: the key is missing"]


def test_wrong_functors(write):
    write(
        {
            "a.yml": "trials:\n"
            "  - functor: ScaledTrail\n"
            "  - functr: ScaledTrial\n"
            "  - functor: WrappingTrial\n"
            "    wrapped:\n"
            "      functor: ScaledTrial\n"
            "      config:\n"
            "        scale: 1\n"
            "        cuont: 2\n"
            "  - ScaledTrial\n"
        }
    )
    first, unknown, needed, nested, bare = report(load("a.yml"))
    assert first.startswith(
        "a.yml:2 trials[0].functor: unknown trial_report 'ScaledTrail'; did you mean `ScaledTrial`?"
    )
    assert unknown == "a.yml:3 trials[1].functr: unknown key; did you mean `functor`?"
    assert needed.startswith("a.yml:3 trials[1]: a trial_report needs the key `functor`")
    assert nested == "a.yml:9 trials[2].wrapped.config.cuont: unknown key `cuont`; did you mean `count`?"
    assert bare == "a.yml:10 trials[3].config.scale: the key is missing"


def test_keys_of_plain_models(write):
    write({"a.yml": "titel: x\nscalings:\n  one: {factr: 1}\n  two:\n    factor: x\neither: {fctor: 1}\n"})
    assert report(load("a.yml")) == [
        "a.yml:3 scalings.one.factr: unknown key `factr`; did you mean `factor`?",
        "a.yml:5 scalings.two.factor: expected a number, got 'x'",
        "a.yml:6 either.fctor: unknown key `fctor`; did you mean `factor`?",
        "a.yml:1 titel: unknown key `titel`; did you mean `title`?",
    ]


def test_a_validators_message_stands_as_it_is(write):
    write({"a.yml": "title: long\n"})
    assert report(load("a.yml")) == ["a.yml:1 title: the title 'long' is too long"]


def test_an_overridden_value_is_located_on_the_command_line(write):
    write({"a.yml": "trials:\n  - {functor: ScaledTrial, config: {scale: 1}}\n"})
    tree = apply_overrides(load("a.yml"), ["ScaledTrial.config.scale=abc"])
    assert report(tree) == [
        "command line: ScaledTrial.config.scale=abc: trials[0].config.scale: expected a number, got 'abc'"
    ]


def test_without_a_model_unknown_keys_are_still_named(write):
    write({"a.yml": "factr: 2\n"})
    tree = load("a.yml")
    with pytest.raises(ValidationError) as caught:
        Scaling.model_validate(tree)
    assert [str(problem) for problem in problems_of(caught.value, tree)] == ["a.yml:1 factr: unknown key `factr`"]


def test_long_values_are_cut_short(write):
    write({"a.yml": "title: [" + "1, " * 100 + "]\neither: '" + "a" * 100 + "'\n"})
    first, second = report(load("a.yml"))
    assert first == "a.yml:1 title: expected a string, got a list of 100"
    assert second == f"a.yml:2 either: expected a mapping, got '{'a' * 56}..."
