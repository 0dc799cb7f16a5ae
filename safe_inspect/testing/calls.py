"""Calls of a plugin with many selections of rows, with checks of the results and of unchanged inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from safe_inspect.testing.report import WRITES, Report
from safe_inspect.types import AnyArray

_ALONE = 6
_RAISED = object()


@dataclass(frozen=True)
class Inputs:
    """Inputs of a call for some rows, newly created.

    Attributes:
        arguments: The arguments.
        arrays: Arrays that the plugin must not change, by name.
    """

    arguments: Sequence[Any]
    arrays: Mapping[str, AnyArray]


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
    """Function of a plugin, with a way to create its inputs.

    Attributes:
        what: Name of the call in messages.
        function: The function.
        make: Creates the inputs for some rows from their indices.
        rows: Number of rows that `make` can select; the number of environments, N, if the function receives a group of
            several agents of each environment.
        agents: Number of rows of the result for each selected row: the size of the group, G, otherwise 1.
        alone: Creates the inputs of all rows for one agent of the group, from its index; None without a group.
        shape: Expected shape of the result, or of each array of a mapping of results.
        shapes: Expected shapes of individual arrays of a mapping.
    """

    what: str
    function: Callable[..., Any]
    make: Callable[[AnyArray], Inputs]
    rows: int
    shape: Shape = Shape()
    shapes: Mapping[str, Shape] = field(default_factory=dict)
    agents: int = 1
    alone: Callable[[int], Inputs] | None = None

    def results_of(self, rows: AnyArray) -> AnyArray:
        """Return the rows of the result that belong to the given rows."""
        return np.asarray((rows[:, None] * self.agents + np.arange(self.agents)).reshape(-1))


def check_call(call: Call, report: Report) -> Any:
    """Check a call against every rule for arrays of rows.

    Returns:
        The result for all rows; None if the call failed or its result has another shape.
    """
    everything = np.arange(call.rows)
    inputs = call.make(everything)
    before = {name: array.copy() for name, array in inputs.arrays.items()}
    result = _result(call, inputs, report, "with the sample world")
    if result is _RAISED or not _check_shape(call, result, report):
        return None
    kept = {name: array.copy() for name, array in _arrays(result).items()}
    for name, array in inputs.arrays.items():
        report.expect(
            _same(array, before[name]),
            "inputs unchanged",
            f"{call.what} changed {name}",
            WRITES,
        )
    again = _result(call, inputs, report, "for the second time")
    report.expect(
        again is _RAISED or _equal(kept, _arrays(again)),
        "no memory",
        f"{call.what}, called twice with the same input, gave two results",
        "let the result depend on the input alone, and change no array that it is given or computes from",
    )
    if _check_rows(call, kept, report):
        last = _result(call, call.make(everything), report, "again after other rows")
        report.expect(
            last is _RAISED or _equal(kept, _arrays(last)),
            "no memory",
            f"{call.what} gave another result after calls with other rows",
            "keep nothing between calls; what must be remembered is a declared array of the state",
        )
        _check_agents(call, kept, report)
    return result


def _check_rows(call: Call, kept: dict[str, AnyArray], report: Report) -> bool:
    """Check that the result of a row depends only on that row; return whether it does."""
    generator = np.random.default_rng(7)
    everything = np.arange(call.rows)
    choices = {
        "the rows in another order": generator.permutation(call.rows),
        "every third row": everything[::3],
        "the rows thrice over": np.tile(everything, 3),
    }
    alone = [(f"row {row} alone", np.array([row])) for row in generator.permutation(call.rows)[:_ALONE]]
    for name, rows in (*choices.items(), *alone):
        result = _result(call, call.make(rows), report, f"with {name}")
        if result is _RAISED:
            return False
        wanted = call.results_of(rows)
        if not _equal({key: array[wanted] for key, array in kept.items()}, _arrays(result)):
            report.add(
                "row-wise",
                f"{call.what} with {name} gave other values than in the whole batch",
                "compute each row from itself: no mean, sort or test over the rows, and no matrix product "
                "(its rounding depends on the size)",
            )
            return False
    return True


def _check_agents(call: Call, kept: dict[str, AnyArray], report: Report) -> None:
    """Check that each agent of a group gets the same result as in a group of one."""
    for agent in range(call.agents if call.alone is not None else 0):
        assert call.alone is not None
        result = _result(call, call.alone(agent), report, "with one agent of several")
        if result is _RAISED:
            return
        if not _equal({key: array[agent :: call.agents] for key, array in kept.items()}, _arrays(result)):
            report.add(
                "agents",
                f"{call.what} gave agent {agent} of the group another value than it gets by itself",
                "rows go environment by environment and, in each, agent by agent: use the arrays of the view "
                "(`position`, `own_index`, ...), which have these rows, or its `per_agent` and `per_environment`",
            )
            return


def _check_shape(call: Call, result: Any, report: Report) -> bool:
    sound = True
    for name, array in _arrays(result).items():
        shape = call.shapes.get(name, call.shape)
        what = f"{call.what}" + (f", {name!r}" if name else "")
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


def _result(call: Call, inputs: Inputs, report: Report, when: str) -> Any:
    with report.attempt(f"{call.what} {when}"):
        return call.function(*inputs.arguments)
    return _RAISED


def _arrays(result: Any) -> dict[str, Any]:
    return dict(result) if isinstance(result, Mapping) else {"": result}


def _equal(these: Mapping[str, AnyArray], those: Mapping[str, Any]) -> bool:
    return these.keys() == those.keys() and all(_same(these[name], those[name]) for name in these)


def _same(this: AnyArray, that: Any) -> bool:
    """Return whether two arrays are bit-identical."""
    if not isinstance(that, np.ndarray) or this.shape != that.shape or this.dtype != that.dtype:
        return False
    return this.tobytes() == that.tobytes()
