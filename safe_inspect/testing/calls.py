"""Calls of a plugin with many selections of rows, with checks of the results and of unchanged inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.platforms.base import Part
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rta.constraints.base import RelativeState
from safe_inspect.simulators.team import TeamStep, TeamView
from safe_inspect.simulators.view import Step, View
from safe_inspect.testing.flights import Flown, fly, take_rows
from safe_inspect.testing.report import WRITES, Report
from safe_inspect.testing.samples import ROWS, sample_steps, team_sizes
from safe_inspect.types import AnyArray, FloatArray

SampleParts = Sequence[Part]
#: Check of a plugin of some kind, given the further parts of the sample world.
Check = Callable[[Any, SampleParts, Report], None]

_ALONE = 6


@dataclass(frozen=True)
class Shape:
    """Expected shape and type of a result.

    Attributes:
        of: Shape of a row; None: any.
        kind: Kind of its elements: ``f`` for float, ``b`` for bool, ``i`` for integers; empty for any.
        text: The whole shape as shown in a message.
    """

    of: tuple[int, ...] | None = ()
    kind: str = "f"
    text: str = "(R,)"


@dataclass(frozen=True)
class Call:
    """Function of a plugin and the arguments with which it is called, in which `take_rows` selects rows.

    Attributes:
        what: Name of the call in messages; the number of deputies is added if a step or a view has several.
        function: The function.
        arguments: The arguments, by their names in messages. The function must not change their arrays.
        shape: Expected shape of the result, or of each array of a mapping of results.
        shapes: Expected shapes of individual arrays of a mapping.
        rows: Number of rows of the arguments: the number of environments, N, of a step or a view.
    """

    what: str
    function: Callable[..., Any]
    arguments: Mapping[str, Any]
    shape: Shape = Shape()
    shapes: Mapping[str, Shape] = field(default_factory=dict)
    rows: int = ROWS

    @property
    def title(self) -> str:
        """Name of the call in messages."""
        return with_deputies(self.what, next((view.world.num_deputies for view in self._views), 1))

    @property
    def agents(self) -> int:
        """Number of rows of the result for each selected row: the size of the group of a step or view, otherwise 1."""
        return next((view.group.size for view in self._views if isinstance(view, View)), 1)

    @property
    def _views(self) -> Iterator[View | TeamView]:
        for value in self.arguments.values():
            view = value.after if isinstance(value, Step | TeamStep) else value
            if isinstance(view, View | TeamView):
                yield view


def with_deputies(what: str, deputies: int) -> str:
    """Return the name of a call in a world with one or several deputies."""
    return what if deputies == 1 else f"{what} with {deputies} deputies"


def each_team(plugin: Plugin | None, report: Report) -> Iterator[int]:
    """Yield the numbers of deputies of the sample worlds: one, if the plugin allows it, and, without a breach, many."""
    known = len(report.breaches)
    for deputies in team_sizes(plugin):
        if len(report.breaches) == known:
            yield deputies


def each_world(plugin: Plugin | None, parts: SampleParts, report: Report, rows: int = ROWS) -> Iterator[Step]:
    """Yield the steps of each sample world, see `each_team`."""
    for deputies in each_team(plugin, report):
        yield sample_steps(plugin, rows, parts=parts, deputies=deputies)


def spread(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return values from `low` to `high`, including both, shape (R, k); an infinite bound is replaced by -3 or 3."""
    low, high = np.where(np.isfinite(low), low, -3.0), np.where(np.isfinite(high), high, 3.0)
    share = np.random.default_rng(5).random((ROWS, len(low)))
    share[0], share[-1] = 0.0, 1.0
    return np.asarray(low * (1.0 - share) + high * share)


def check_bounds(values: FloatArray, low: FloatArray, high: FloatArray, what: str, where: str, report: Report) -> None:
    """Check that values are within their declared bounds."""
    outside = ((values < low) | (values > high)).reshape(len(values), -1).any(axis=-1)
    if outside.any():
        row = int(np.flatnonzero(outside)[0])
        report.add(
            "bounds",
            f"{what} is {values[row].tolist()} in row {row}, outside of {low.tolist()} to {high.tolist()}",
            f"widen the bounds that {where} declares, or keep the value within them",
        )


def check_call(call: Call, report: Report) -> Any:
    """Check a call against every rule for arrays of rows.

    Returns:
        The result for all rows; None if the call failed or its result has another shape.
    """
    everything = np.arange(call.rows)
    inputs = take_rows(call.arguments, everything)
    given = {name: array for argument, value in inputs.items() for name, array in _arrays_in(argument, value)}
    before = {name: array.copy() for name, array in given.items()}
    first = _result(call, inputs, report, "with the sample world")
    if first is None or not _check_shape(call, first, report):
        return None
    kept = {name: array.copy() for name, array in first.items()}
    for name, array in given.items():
        report.expect(_same(array, before[name]), "inputs unchanged", f"{call.title} changed {name}", WRITES)

    def repeats(again: Mapping[str, Any], wanted: Any, when: str, rule: str, problem: str, remedy: str) -> bool:
        """Check that a further call gives the wanted rows of the first result; return whether it does."""
        found = _result(call, again, report, when)
        if found is None:
            return False
        same = found.keys() == kept.keys() and all(_same(array[wanted], found[name]) for name, array in kept.items())
        return report.expect(same, rule, f"{call.title}{problem}", remedy)

    repeats(
        inputs,
        slice(None),
        "for the second time",
        "no memory",
        ", called twice with the same input, gave two results",
        "let the result depend on the input alone, and change no array that it is given or computes from",
    )
    for name, rows in _choices(call.rows):
        if not repeats(
            take_rows(call.arguments, rows),
            (rows[:, None] * call.agents + np.arange(call.agents)).reshape(-1),
            f"with {name}",
            "row-wise",
            f" with {name} gave other values than in the whole batch",
            "compute each row from itself: no mean, sort or test over the rows, and no matrix product "
            "(its rounding depends on the size)",
        ):
            return kept.get("", kept)
    repeats(
        take_rows(call.arguments, everything),
        slice(None),
        "again after other rows",
        "no memory",
        " gave another result after calls with other rows",
        "keep nothing between calls; what must be remembered is a declared array of the state",
    )
    for agent in range(call.agents) if call.agents > 1 else ():
        if not repeats(
            take_rows(call.arguments, everything, agent),
            slice(agent, None, call.agents),
            "with one agent of several",
            "agents",
            f" gave agent {agent} of the group another value than it gets by itself",
            "rows go environment by environment and, in each, agent by agent: use the arrays of the view "
            "(`position`, `own_index`, ...), which have these rows, or its `per_agent` and `per_environment`",
        ):
            break
    return kept.get("", kept)


def _choices(rows: int) -> Iterator[tuple[str, AnyArray]]:
    """Yield selections of rows, with their names in messages."""
    generator, everything = np.random.default_rng(7), np.arange(rows)
    yield "the rows in another order", generator.permutation(rows)
    yield "every third row", everything[::3]
    yield "the rows thrice over", np.tile(everything, 3)
    for row in generator.permutation(rows)[:_ALONE]:
        yield f"row {row} alone", np.array([row])


def _check_shape(call: Call, result: Mapping[str, Any], report: Report) -> bool:
    sound = True
    for name, array in result.items():
        shape = call.shapes.get(name, call.shape)
        what = f"{call.title}" + (f", {name!r}" if name else "")
        wanted = {"f": "float", "b": "bool", "i": "int", "": "numbers"}[shape.kind]
        remedy = f"return a NumPy array of {wanted}, shape {shape.text}"
        if not isinstance(array, np.ndarray):
            report.add("shape", f"{what} gave {type(array).__name__}, not an array", remedy)
            sound = False
            continue
        rows = call.rows * call.agents
        right = array.ndim > 0 and len(array) == rows and (shape.of is None or array.shape[1:] == shape.of)
        sound &= report.expect(right, "shape", f"{what} gave the shape {array.shape} for {rows} rows", remedy)
        right = shape.kind in ("", array.dtype.kind)
        sound &= report.expect(right, "shape", f"{what} gave elements of the type {array.dtype}", remedy)
        if sound and shape.kind == "f" and not np.isfinite(array).all():
            row = int(np.flatnonzero(~np.isfinite(array.reshape(rows, -1)).all(axis=-1))[0])
            report.add(
                "finite",
                f"{what} gave {array[row].tolist()} in row {row} of the sample world",
                "guard divisions and roots; a run stops at the first NaN or infinity",
            )
    return sound


def _result(call: Call, inputs: Mapping[str, Any], report: Report, when: str) -> dict[str, Any] | None:
    """Return the arrays of a result by name, a single one under the empty name; None if the call failed."""
    with report.attempt(f"{call.title} {when}"):
        result = call.function(*inputs.values())
        return dict(result) if isinstance(result, Mapping) else {"": result}
    return None


def _arrays_in(name: str, value: Any) -> Iterator[tuple[str, AnyArray]]:
    """Yield the arrays within an argument with their names in messages."""
    if isinstance(value, np.ndarray):
        yield name, value
    elif isinstance(value, View | TeamView):
        yield from ((f"{name}'s {key}", array) for key, array in value.state.arrays.items())
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from _arrays_in(f"{name}[{key!r}]", item)
    elif isinstance(value, Step):
        for key in ("before", "after", "action", "control", "desired_control", "intervening"):
            yield from _arrays_in(f"{name}.{key}", getattr(value, key))
    elif isinstance(value, TeamStep | RelativeState):
        for key, item in vars(value).items():
            yield from _arrays_in(f"{name}.{key}", item)


def _same(this: AnyArray, that: Any) -> bool:
    """Return whether two arrays are bit-identical."""
    alike = isinstance(that, np.ndarray) and this.shape == that.shape and this.dtype == that.dtype
    return alike and this.tobytes() == that.tobytes()


def check_alone(
    spec: EnvironmentSpec, values: Callable[[Flown], Mapping[str, AnyArray]], problem: str, remedy: str, report: Report
) -> None:
    """Check that an environment gives the same values alone as in a batch.

    Args:
        spec: The environment.
        values: Returns the compared arrays of a step by name.
        problem: The mistake as it follows "after 3 steps"; braces are replaced by the name of the array.
        remedy: How to fix it.
        report: The report.
    """
    batch, length = 5, 12
    together = fly(TeamEnvironment(spec, batch, seed=1), length=length)
    for slot in (0, batch - 1):
        alone = fly(TeamEnvironment(spec, 1, seed=1, first_slot=slot), first_slot=slot, length=length)
        row = np.array([slot])
        for one, single in zip(together, alone, strict=True):
            whole = values(Flown(take_rows(one.step, row), one.status[row], one.over[row]))
            for name, array in values(single).items():
                if array.tobytes() != whole[name].tobytes():
                    report.add("row-wise", f"after {single.step.after.step[0]} steps {problem.format(name)}", remedy)
                    return
