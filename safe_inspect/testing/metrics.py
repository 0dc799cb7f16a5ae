"""Contract of the metrics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

import numpy as np

from safe_inspect.metrics.base import BaseMetric, Metric, Reduce, TeamMetric
from safe_inspect.platforms.base import Part
from safe_inspect.simulators.team import TeamStep, TeamView
from safe_inspect.simulators.view import Step
from safe_inspect.testing.calls import Call, Inputs, Shape, check_call
from safe_inspect.testing.report import Report
from safe_inspect.testing.samples import sample_team_steps, team_sizes
from safe_inspect.testing.values import ROWS, call_of_step, each_world
from safe_inspect.types import AnyArray


def check_metric(plugin: BaseMetric, parts: Sequence[Part], report: Report) -> None:
    """Check a metric: float (R,) or (N,), NaN allowed; a unit, a reduction, and a label."""
    reduce = getattr(plugin, "reduce", None)
    report.expect(
        reduce in get_args(Reduce),
        "reduce",
        f"the class attribute `reduce` is {reduce!r}",
        f"set it to one of {', '.join(get_args(Reduce))}",
    )
    for name in ("unit", "label"):
        value = getattr(plugin, name, None)
        right = isinstance(value, str) and value != ""
        report.expect(right, name, f"its `{name}` is {value!r}", "give a text; the unit of a pure number is '-'")
    if isinstance(plugin, Metric):
        _check_own(plugin, parts, report)
    elif isinstance(plugin, TeamMetric):
        _check_team(plugin, parts, report)
    else:
        report.add("base", f"{type(plugin).__name__} is not a metric of agents or teams", "extend Metric or TeamMetric")


def _check_own(plugin: Metric, parts: Sequence[Part], report: Report) -> None:
    def measure(step: Step) -> Any:
        return _without_nan(plugin(step))

    def conclude(step: Step) -> Any:
        rows = step.after.num_rows
        some = plugin(step)
        return np.asarray(_without_nan(plugin.conclude(some, step)) + _without_nan(plugin.conclude(_nan(rows), step)))

    for step in each_world(plugin, parts, report):
        check_call(call_of_step("the metric", measure, step, Shape()), report)
        if type(plugin).conclude is not Metric.conclude:
            check_call(call_of_step("`conclude`", conclude, step, Shape()), report)


def _check_team(plugin: TeamMetric, parts: Sequence[Part], report: Report) -> None:
    known = len(report.breaches)
    for deputies in team_sizes(plugin):
        if len(report.breaches) > known:
            return
        step = sample_team_steps(None, ROWS, parts=parts, deputies=deputies)

        def make(rows: AnyArray, step: TeamStep = step) -> Inputs:
            before, after = (TeamView(team.state.take(rows), team.world) for team in (step.before, step.after))
            taken = TeamStep(before, after, {}, step.status[rows], step.dt, {})
            arrays = {"step.status": taken.status}
            for side, team in (("before", before), ("after", after)):
                arrays |= {f"step.{side}'s {name}": array for name, array in team.state.arrays.items()}
            return Inputs((taken,), arrays)

        def measure(given: TeamStep) -> Any:
            return _without_nan(plugin(given))

        label = "the metric" if deputies == 1 else f"the metric with {deputies} deputies"
        check_call(Call(label, measure, make, ROWS, Shape((), "f", "(N,)")), report)


def _nan(rows: int) -> AnyArray:
    return np.full(rows, np.nan)


def _without_nan(value: Any) -> Any:
    """Replace NaN, which means that there is no value, by a number; infinity remains and is a breach."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return np.where(np.isnan(value), -1.2345, value)
    return value
