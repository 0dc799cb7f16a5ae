"""Actions that are NaN or infinite, where the rows in question fly the backup of a safety filter."""

from __future__ import annotations

import numpy as np

from safe_inspect.environments.finite_checks import all_finite
from safe_inspect.environments.layout import Layout
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.simulators.view import View
from safe_inspect.types import AnyArray, BoolArray, FloatArray


def replaced(action: AnyArray, layout: Layout) -> tuple[AnyArray, BoolArray]:
    """Return actions with neutral ones in place of those that are not finite, and the rows of these, shape (N * G,).

    Neutral is what is nearest to zero, of a discrete action the middle one of its values.

    Args:
        action: The actions, shape (N, G, A).
        layout: Their layout.
    """
    action = np.asarray(action, dtype=np.float64)
    if all_finite(action):
        return action, np.zeros(action.shape[0] * action.shape[1], dtype=np.bool_)
    invalid = np.asarray(~np.isfinite(action).all(axis=-1))
    neutral = np.floor(0.5 * layout.last_choices) if layout.choices else np.clip(0.0, layout.low, layout.high)
    return np.where(invalid[..., None], neutral, action), invalid.reshape(-1)


def with_backup(
    control: FloatArray, invalid: BoolArray, safety_filter: SafetyGlue | None, view: View
) -> FloatArray:  # fmt: skip
    """Return the controls with the backup of a safety filter in the rows of invalid actions, shape (R, C).

    Without a filter of the agents' own, which the team's acts instead of, they ask for no thrust.
    """
    if not invalid.any():
        return control
    backup = np.zeros((len(control), 3)) if safety_filter is None else safety_filter.backup(view)
    control = control.copy()
    control[invalid] = 0.0
    control[invalid, :3] = backup[invalid]
    return control
