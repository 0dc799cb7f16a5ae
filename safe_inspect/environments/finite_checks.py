"""Checks for NaN, infinity and wrong shapes, whose errors name the plugin, and the replacement of invalid actions."""

from __future__ import annotations

import operator
import os
import tempfile
from collections.abc import Sequence

import numpy as np

from safe_inspect.environments.layout import Layout
from safe_inspect.errors import ArgumentError, PluginValueError
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.simulators import State, View
from safe_inspect.types import AnyArray, BoolArray, FloatArray

#: Environment variable with the folder for states that caused an error; during training it is the run folder.
CRASH_FOLDER_VARIABLE = "SAFE_INSPECT_CRASH_FOLDER"


def checked_seed(seed: int) -> int:
    """Return a seed as an int.

    Raises:
        TypeError: The seed is not a whole number.
        ValueError: The seed is out of range.
    """
    try:
        number = operator.index(seed)
    except TypeError:
        raise TypeError(f"a seed must be a whole number from 0 to 2**64 - 1, not {seed!r}") from None
    if not 0 <= number < 2**64:
        raise ValueError(f"a seed must be a whole number from 0 to 2**64 - 1, not {number}")
    return number


def require_shape(what: str, value: AnyArray, shape: tuple[int, ...]) -> None:
    """Raise an error when a plugin returned an array of the wrong shape.

    Raises:
        PluginValueError: The array does not have the expected shape.
    """
    if value.shape != shape:
        meant = "one entry for each row of the batch"
        if not value.shape:
            meant += "; sums and norms of a row need `axis=-1`"
        raise PluginValueError(f"{what} gave an array of shape {value.shape}; expected shape {shape}, {meant}")


def require_choices(agents: Sequence[str], layout: Layout, action: FloatArray) -> None:
    """Raise an error when an element of a discrete action is not a valid index.

    Args:
        agents: Names of the agents; row i belongs to agent i modulo their number.
        layout: The layout of a discrete action.
        action: Finite numbers, shape (R, A).

    Raises:
        ArgumentError: An element is a fraction or out of range.
    """
    valid = np.minimum(np.maximum(np.rint(action), 0.0), layout.last_choices) == action
    if np.count_nonzero(valid) == valid.size:
        return
    row, element = (int(index) for index in np.argwhere(~valid)[0])
    raise ArgumentError(
        f"the action of {agents[row % len(agents)]} is invalid in environment {row // len(agents)}: "
        f"`{layout.names[element]}` is {action[row, element]:g}, "
        f"but must be a whole number from 0 to {layout.choices[element] - 1}"
    )


def all_finite(value: AnyArray) -> bool:
    """Return whether all elements are finite. Counting is much faster than `all` on a small array."""
    return bool(np.count_nonzero(np.isfinite(value)) == value.size)


def numbers(what: str, value: object) -> FloatArray:
    """Return the value that a plugin returned as a float64 array.

    Raises:
        PluginValueError: The value is not an array of numbers.
    """
    if value is None:
        raise PluginValueError(f"{what} gave None; return an array of numbers")
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise PluginValueError(f"{what} gave {str(value)[:80]!r}; expected an array of numbers") from None


def require_finite(what: str, value: AnyArray, after: State, before: State | None = None) -> None:
    """Raise an error when an array contains NaN or infinity.

    The states of the rows in question are saved as ``.npz`` files in the folder given by the environment variable
    ``SAFE_INSPECT_CRASH_FOLDER``, or else in a new temporary folder.

    Args:
        what: Source of the array, such as ``reward ObservedPointsReward``.
        value: The array; its first axis has one or more rows for each environment.
        after: State at the end of the step.
        before: State at the start of the step, if there is one.

    Raises:
        PluginValueError: The array is not finite.
    """
    if all_finite(value):
        return
    finite = np.isfinite(value)
    bad = np.flatnonzero(~finite.reshape(len(value), -1).all(axis=-1))
    rows = np.unique(bad * after.num_envs // len(value))
    folder = os.environ.get(CRASH_FOLDER_VARIABLE) or tempfile.mkdtemp(prefix="safe_inspect_")
    os.makedirs(folder, exist_ok=True)
    saved = []
    for name, state in (("before", before), ("after", after)):
        if state is not None:
            path = os.path.join(folder, f"state_{name}_{os.getpid()}.npz")
            state.take(rows).save(path)
            saved.append(path)
    first = rows[0] if after.whole_rows is None else after.whole_rows[rows[0]]
    raise PluginValueError(
        f"{what} gave {value[bad[0]].ravel().tolist()} in environment {first}, step {int(after.step[rows[0]])} "
        f"({len(rows)} of {after.num_envs} environments); the states are saved in {' and '.join(saved)}"
    )


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
