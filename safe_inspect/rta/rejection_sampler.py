"""`RejectionSampler`: samples initial states until safe ones are found, for all rows at once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, model_validator
from pydantic_core import PydanticCustomError

from safe_inspect.errors import InitialStateError, did_you_mean
from safe_inspect.plugins.functor import build, functor_field, misplaced
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.simulators.resets.initializers import Initializer
from safe_inspect.simulators.resets.parameters import Draw, Parameter, either
from safe_inspect.simulators.resets.plan import BodyReset
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: The statistics of a sampler are returned with its states, under this name followed by a slash.
REJECTIONS = "rejections"


class SafetyTest(BaseModel):
    """Test of which initial states count as safe.

    Attributes:
        functor: A safety glue; its constraints are the test.
        states: Names of the states that it tests.
        args: Values, by key.
        arg_map: Fields of the glue, each with its key in `args`.
        config: Fields of the glue that are given directly.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    functor: str
    states: tuple[str, ...] = ("position", "velocity", "sun_angle")
    args: dict[str, Any] = Field(default_factory=dict)
    arg_map: dict[str, str] = Field(default_factory=dict)
    config: dict[str, Any] = Field(default_factory=dict)
    _glue: SafetyGlue = PrivateAttr()
    _filter_glue: SafetyGlue | None = PrivateAttr(default=None)

    def model_post_init(self, context: Any) -> None:
        """Build the glue.

        Raises:
            PydanticCustomError: A value is missing, or the glue rejects one.
        """
        unknown = [(field, key) for field, key in self.arg_map.items() if key not in self.args]
        if unknown:
            hints = [f"`args` has no {key!r}; {did_you_mean(key, self.args)}" for _, key in unknown]
            raise misplaced((("arg_map", field), hint) for (field, _), hint in zip(unknown, hints, strict=True))
        fields = self.config | {field: self.args[key] for field, key in self.arg_map.items()}
        try:
            glue = build("glue", {"functor": self.functor, "config": fields})
        except PydanticCustomError as error:
            problems = [self._relocate(problem) for problem in (error.context or {})["errors"]]
            raise PydanticCustomError("functor", "the safety test is wrong", {"errors": problems}) from None
        if not isinstance(glue, SafetyGlue):
            message = f"{glue.registered_name} is not a safety glue; use one such as RTAGlueCWHInspection1v1"
            raise misplaced([(("functor",), message)])
        missing = ", ".join(f"`{name}`" for name in glue.tests if name not in self.states)
        if missing:
            message = f"{glue.registered_name} also tests {missing}; add what is missing"
            raise misplaced([(("states",), message)])
        self._glue = glue

    def _relocate(self, problem: dict[str, Any]) -> dict[str, Any]:
        loc = problem["loc"]
        if len(loc) > 1 and loc[0] == "config" and loc[1] in self.arg_map:
            key = self.arg_map[loc[1]]
            return {**problem, "loc": ("args", key, *loc[2:])}
        return problem

    def for_filtered(self, safety_filter: SafetyGlue) -> SafetyTest:
        """Return the test for a deputy that `safety_filter` acts on: the filter must also be able to keep it safe."""
        test = self.with_glue(self._glue)
        test._filter_glue = safety_filter.for_starts()
        return test

    def with_glue(self, glue: SafetyGlue) -> SafetyTest:
        """Return a copy of the test that uses another safety glue."""
        test = self.model_copy()
        test._glue, test._filter_glue = glue, self._filter_glue
        return test

    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return, for each constraint, the mask of the rows of named states that it rejects, shape (R,)."""
        tested = {name: states[name] for name in self.states}
        refused = self._glue.refusals(tested)
        return refused if self._filter_glue is None else either(refused, self._filter_glue.refusals(tested))

    @property
    def glue(self) -> SafetyGlue:
        """The safety glue."""
        return self._glue


class RejectionSampler(Parameter):
    """Parameter that samples states until every row has a safe one.

    Attributes:
        initializer: Converts the sampled parameters to states.
        rta: The safety test; None accepts every sample.
        wrapped: The parameters that the initialiser takes, by name.
        max_rejections: Number of rejected samples of a row after which the run stops with an error.
    """

    initializer: functor_field("initializer")  # type: ignore[valid-type]
    rta: SafetyTest | None = None
    wrapped: dict[str, functor_field("parameter")] = Field(default_factory=dict)  # type: ignore[valid-type]
    max_rejections: int = Field(default=1000, ge=1)

    @model_validator(mode="after")
    def _parameters_fit(self) -> RejectionSampler:
        check_parameters(self.initializer, self.wrapped, "wrapped")
        given, problems = self.initializer.gives, []
        for index, name in enumerate(self.rta.states if self.rta is not None and given else ()):
            if name not in given:
                message = f"{self.initializer.registered_name} gives no state {name!r}; {did_you_mean(name, given)}"
                problems.append((("rta", "states", index), message))
        if problems:
            raise misplaced(problems)
        return self

    def __call__(self, draw: Draw) -> dict[str, FloatArray]:
        """Return the first safe state of every row, each array with R rows.

        The result also contains ``rejections/draws``, the number of samples of each row, and ``rejections/NAME`` for
        every constraint, the number of samples that it rejected.

        Raises:
            InitialStateError: `max_rejections` samples of a row were rejected.
        """
        rows = np.arange(len(draw.streams))
        accepted: dict[str, FloatArray] = {}
        for attempt in range(self.max_rejections):
            states, refused = self.candidates(draw, rows, attempt)
            if not accepted:
                accepted = {name: np.empty((len(draw.streams), *array.shape[1:])) for name, array in states.items()}
                counts = {name: np.zeros(len(draw.streams)) for name in ("draws", *refused)}
            safe = np.ones(len(rows), dtype=np.bool_)
            counts["draws"][rows] += 1
            for name, unsafe in refused.items():
                counts[name][rows] += unsafe
                safe &= ~unsafe
            for name, array in states.items():
                accepted[name][rows[safe]] = array[safe]
            rows = rows[~safe]
            if not len(rows):
                return accepted | {f"{REJECTIONS}/{name}": count for name, count in counts.items()}
        totals = Counter({name: int(count.sum()) for name, count in counts.items() if name != "draws"})
        counted = ", ".join(f"{name} {count}" for name, count in totals.most_common() if count)
        raise InitialStateError(
            f"`{draw.purpose}`: no safe initial state in {self.max_rejections} draws for {len(rows)} environments; "
            f"refused by {counted}; widen the limits or narrow the distributions"
        )

    def candidates(
        self, draw: Draw, rows: IntArray | None = None, attempt: int = 0
    ) -> tuple[dict[str, FloatArray], dict[str, BoolArray]]:
        """Sample states without accepting or rejecting them.

        Args:
            draw: The draw.
            rows: Indices of the rows to sample, shape (R,); by default, all of them.
            attempt: Number of the attempt.

        Returns:
            The states, each with R rows, and for each constraint the mask of the rows that it rejects, shape (R,).
        """
        rows = np.arange(len(draw.streams)) if rows is None else rows
        drawn = BodyReset(self.initializer, self.wrapped)(draw.part(rows, attempt))
        states = drawn | {name: array[rows] for name, array in draw.fixed.items() if name in drawn}
        refused = {} if self.rta is None else self.rta.refusals(states)
        return states, refused if draw.test is None else either(refused, draw.test(states, rows))


def check_parameters(initializer: Initializer, parameters: Mapping[str, Parameter], field: str) -> None:
    """Check that an initialiser is given the parameters that it takes, in units of the right dimension.

    Raises:
        PydanticCustomError: It is not; every mistake is listed under `field`.
    """
    wanted = initializer.parameters
    problems: list[tuple[tuple[int | str, ...], str]] = []
    for name in parameters:
        if name not in wanted:
            message = f"{initializer.registered_name} takes no {name!r}; {did_you_mean(name, wanted)}"
            problems.append(((field, name), message))
        elif wanted[name] is not None and parameters[name].symbol not in (None, wanted[name]):
            message = f"{name!r} is given in {parameters[name].symbol}, but is measured in {wanted[name]}"
            problems.append(((field, name, "config", "units"), message))
    missing = [f"`{name}`" for name in wanted if name not in parameters and name not in initializer.defaults]
    if missing:
        problems.append(((field,), f"{initializer.registered_name} needs {', '.join(missing)}"))
    if problems:
        raise misplaced(problems)
