"""Replacement of actions that are NaN or infinite, in tasks whose safety filter then flies its backup."""

from __future__ import annotations

import numpy as np

from safe_inspect.environments.finite_checks import all_finite
from safe_inspect.environments.layout import Layout
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.simulators.view import View
from safe_inspect.types import AnyArray, BoolArray, FloatArray


def replaced(action: AnyArray, layout: Layout) -> tuple[AnyArray, BoolArray]:
    """Return the actions with neutral ones in place of non-finite ones, and the mask of these rows, shape (N * G,).

    A neutral action is the value nearest to zero within the bounds, or the middle index of a discrete action.

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
    """Return the controls, shape (R, C), with the backup of a safety filter in the rows of invalid actions.

    Without a filter of the agents themselves, the team's filter acts instead and these rows command no thrust.
    """
    if not invalid.any():
        return control
    backup = np.zeros((len(control), 3)) if safety_filter is None else safety_filter.backup(view)
    control = control.copy()
    control[invalid] = 0.0
    control[invalid, :3] = backup[invalid]
    return control
