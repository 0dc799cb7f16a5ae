"""Values with which plugins are called, and a check of their bounds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from safe_inspect.platforms.base import Part
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.view import Step, View
from safe_inspect.testing.calls import Call, Inputs, Shape
from safe_inspect.testing.flights import take_rows
from safe_inspect.testing.report import Report
from safe_inspect.testing.samples import sample_steps, team_sizes
from safe_inspect.types import AnyArray, FloatArray

#: Environments of a sample, and of one for slow plugins.
ROWS, FEW_ROWS = 48, 16


def each_world(
    plugin: Plugin | None, parts: Sequence[Part], report: Report, rows: int = ROWS
) -> Iterator[Step]:  # fmt: skip
    """Yield steps of the sample world with one deputy, if the plugin allows it, and, without a breach, with several."""
    known = len(report.breaches)
    for deputies in team_sizes(plugin):
        if len(report.breaches) == known:
            yield sample_steps(plugin, rows, parts=parts, deputies=deputies)


def spread(low: FloatArray, high: FloatArray, rows: int) -> FloatArray:
    """Return values from `low` to `high`, including both, shape (R, k); an infinite bound is replaced by -3 or 3."""
    low, high = np.where(np.isfinite(low), low, -3.0), np.where(np.isfinite(high), high, 3.0)
    share = np.random.default_rng(5).random((rows, len(low)))
    share[0], share[-1] = 0.0, 1.0
    return np.asarray(low * (1.0 - share) + high * share)


def call_of_step(what: str, function: Callable[[Step], Any], step: Step, shape: Shape) -> Call:
    """Return the call of a function of a `Step`, such as a reward or a done function."""

    def make(rows: AnyArray, agent: int | None = None) -> Inputs:
        taken = take_rows(step, rows, agent)
        arrays = {
            "step.action": taken.action,
            "step.control": taken.control,
            "step.desired_control": taken.desired_control,
            "step.intervening": taken.intervening,
        }
        for side, view in (("before", taken.before), ("after", taken.after)):
            arrays |= {f"step.{side}'s {name}": array for name, array in view.state.arrays.items()}
        return Inputs((taken,), arrays)

    return _call(what, function, step, shape, make)


def call_of_view(what: str, function: Callable[[View], Any], step: Step, shape: Shape) -> Call:
    """Return the call of a function of a `View`, such as a sensor or a glue, with the view at the end of a step."""

    def make(rows: AnyArray, agent: int | None = None) -> Inputs:
        view = take_rows(step, rows, agent).after
        return Inputs((view,), {f"the state's {name}": array for name, array in view.state.arrays.items()})

    return _call(what, function, step, shape, make)


def _call(
    what: str, function: Callable[..., Any], step: Step, shape: Shape, make: Callable[..., Inputs]
) -> Call:  # fmt: skip
    rows, agents = step.after.state.num_envs, step.after.group.size
    label = what if agents == 1 else f"{what} with {agents} deputies"
    everything = np.arange(rows)

    def alone(agent: int) -> Inputs:
        return make(everything, agent)

    return Call(label, function, make, rows, shape, agents=agents, alone=alone if agents > 1 else None)


def check_bounds(
    values: FloatArray, low: FloatArray, high: FloatArray, what: str, where: str, report: Report
) -> None:  # fmt: skip
    """Check that values are within their declared bounds."""
    outside = ((values < low) | (values > high)).any(axis=-1) if values.ndim > 1 else (values < low) | (values > high)
    if outside.any():
        row = int(np.flatnonzero(outside)[0])
        report.add(
            "bounds",
            f"{what} is {values[row].tolist()} in row {row}, outside of {low.tolist()} to {high.tolist()}",
            f"widen the bounds that {where} declares, or keep the value within them",
        )
