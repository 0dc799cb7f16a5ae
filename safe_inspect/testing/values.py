"""Values to call plugins with, and the check of their bounds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from safe_inspect.simulators.view import Step
from safe_inspect.testing.calls import Inputs
from safe_inspect.testing.report import Report
from safe_inspect.testing.samples import take_rows
from safe_inspect.types import AnyArray, FloatArray

Make = Callable[[AnyArray], Inputs]


def spread(low: FloatArray, high: FloatArray, rows: int) -> FloatArray:
    """Return values from `low` to `high`, the ends among them, shape (R, k); without a bound, from -3 to 3."""
    low, high = np.where(np.isfinite(low), low, -3.0), np.where(np.isfinite(high), high, 3.0)
    share = np.random.default_rng(5).random((rows, len(low)))
    share[0], share[-1] = 0.0, 1.0
    return np.asarray(low * (1.0 - share) + high * share)


def of_step(step: Step) -> Make:
    """Return what gives rows of a step, as rewards and dones are called with."""

    def make(rows: AnyArray) -> Inputs:
        taken = take_rows(step, rows)
        arrays = {
            "step.action": taken.action,
            "step.control": taken.control,
            "step.desired_control": taken.desired_control,
            "step.intervening": taken.intervening,
        }
        for side, view in (("before", taken.before), ("after", taken.after)):
            arrays |= {f"step.{side}'s {name}": array for name, array in view.state.arrays.items()}
        return Inputs((taken,), arrays)

    return make


def of_view(step: Step) -> Make:
    """Return what gives rows of the view at the end of a step, as sensors and glues are called with."""

    def make(rows: AnyArray) -> Inputs:
        view = take_rows(step, rows).after
        return Inputs((view,), {f"the state's {name}": array for name, array in view.state.arrays.items()})

    return make


def check_bounds(
    values: FloatArray, low: FloatArray, high: FloatArray, what: str, where: str, report: Report
) -> None:  # fmt: skip
    """Check that values lie within the bounds that are declared for them."""
    outside = ((values < low) | (values > high)).any(axis=-1) if values.ndim > 1 else (values < low) | (values > high)
    if outside.any():
        row = int(np.flatnonzero(outside)[0])
        report.add(
            "bounds",
            f"{what} is {values[row].tolist()} in row {row}, outside of {low.tolist()} to {high.tolist()}",
            f"widen the bounds that {where} declares, or keep the value within them",
        )
