"""Contract of the glues."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safe_inspect.glues.base import ActionGlue, Bounds, Glue, ObservationGlue
from safe_inspect.platforms.base import Part
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.testing.calls import Call, Inputs, Shape, check_call
from safe_inspect.testing.report import Report
from safe_inspect.testing.samples import sample_spec, sample_steps
from safe_inspect.testing.values import ROWS, call_of_view, check_bounds, each_world, spread
from safe_inspect.types import AnyArray


def check_glue(plugin: Glue, parts: Sequence[Part], report: Report) -> None:
    """Check a glue: its names and bounds, and its part of the observation (R, size) or its thrust (R, 3)."""
    named = sample_spec(plugin, parts=parts).agents[0].parts
    bounds: Bounds | None = None
    with report.attempt("`names` or `bounds`"):
        names, bounds = plugin.names(named), plugin.bounds(named)
    if bounds is None:
        return
    size = len(names)
    low, high = bounds
    right = all(isinstance(bound, np.ndarray) and bound.shape == (size,) for bound in bounds)
    remedy = f"return two arrays of shape ({size},), one number for each of the names {names}"
    if not report.expect(right, "bounds", f"the bounds are {low} and {high}", remedy):
        return
    report.expect((low <= high).all(), "bounds", f"a lower bound is above the upper: {low}, {high}", "swap them")
    report.expect(len(set(names)) == size, "names", f"a name occurs twice in {names}", "name every element once")
    if isinstance(plugin, ObservationGlue):
        shape = Shape((size,), "f", f"(R, {size})")
        for step in each_world(plugin, parts, report):
            values = check_call(call_of_view("the glue", plugin, step, shape), report)
            if values is not None:
                check_bounds(values, low, high, "the observation", "`bounds`", report)
    elif isinstance(plugin, ActionGlue):
        actions = spread(low, high, ROWS) if size else np.zeros((ROWS, 0))

        def make(rows: AnyArray) -> Inputs:
            given = actions[rows].copy()
            return Inputs((given, named), {"the action": given})

        check_call(Call("the glue", plugin, make, ROWS, Shape((3,), "f", "(R, 3), thrust [N]")), report)
        if isinstance(plugin, SafetyGlue):
            _check_refusals(plugin, report)
    else:
        report.add("glue", f"{type(plugin).__name__} is neither kind of glue", "extend ObservationGlue or ActionGlue")


def _check_refusals(plugin: SafetyGlue, report: Report) -> None:
    """Check the initial states that a safety glue rejects: bool (R,) for each constraint."""
    view = sample_steps(None, ROWS).after

    def make(rows: AnyArray) -> Inputs:
        states = {
            "position": view.position[rows].copy(),
            "velocity": view.velocity[rows].copy(),
            "sun_angle": view.sun_angle[rows].copy(),
        }
        return Inputs((states,), states)

    check_call(Call("`refusals`", plugin.refusals, make, ROWS, Shape((), "b", "(R,) for each constraint")), report)
