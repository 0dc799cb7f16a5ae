"""Checks of the arguments with which the classes of environments are made, reset and stepped."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from numbers import Integral, Real
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from safe_inspect.errors import ArgumentError, SafeInspectError, did_you_mean
from safe_inspect.types import AnyArray, IntArray

#: Largest first slot, so that all slots of a batch fit in 64 bits.
_LAST_SLOT = 2**62
_MASK = "reset_mask"


def checked_gamma(gamma: Any) -> float:
    """Return the discount per control step.

    Raises:
        ArgumentError: The discount is not a number from 0 to 1.
    """
    if isinstance(gamma, bool) or not isinstance(gamma, Real) or not 0.0 <= float(gamma) <= 1.0:
        raise ArgumentError(f"gamma: a number from 0 to 1 is expected, not {gamma!r}")
    return float(gamma)


def checked_slot(slot: Any, name: str) -> int:
    """Return the index of an environment slot.

    Raises:
        ArgumentError: The slot is not a whole number, is below 0, or is too large.
    """
    if isinstance(slot, bool) or not isinstance(slot, Integral) or not 0 <= int(slot) <= _LAST_SLOT:
        raise ArgumentError(f"{name}: a whole number from 0 to 2**62 is expected, not {slot!r}")
    return int(slot)


def checked_autoreset(mode: Any) -> AutoresetMode:
    """Return the mode that sets when ended environments are reset.

    Raises:
        ArgumentError: There is no such mode.
    """
    try:
        return AutoresetMode(mode)
    except ValueError:
        known = [known.value for known in AutoresetMode]
        raise ArgumentError(f"autoreset_mode: there is no mode {mode!r}; {did_you_mean(str(mode), known)}") from None


def check_options(options: Mapping[str, Any] | None, known: Collection[str] = ()) -> None:
    """Check the options of a reset.

    Raises:
        ArgumentError: An option is unknown, or the options are not a dictionary.
    """
    if options is not None and not isinstance(options, Mapping):
        raise ArgumentError(f"reset: options: a dictionary is expected, not {options!r}")
    unknown = [name for name in options or () if name not in known]
    if unknown:
        taken = f"it takes {', '.join(map(repr, known))} alone" if known else "it takes none"
        raise ArgumentError(f"reset: the options {unknown} are unknown; {taken}")


def masked_rows(options: Mapping[str, Any] | None, num_envs: int, seed: int | None, begun: bool) -> IntArray | None:
    """Return the indices of the environments that ``options["reset_mask"]`` selects; None without a mask.

    Raises:
        ArgumentError: An option is unknown, the mask is not bool of shape (N,), or both a mask and a seed are given.
        SafeInspectError: No episode has begun.
    """
    check_options(options, (_MASK,))
    mask = (options or {}).get(_MASK)
    if mask is None:
        return None
    if seed is not None:
        raise ArgumentError("reset: a seed resets all environments; give a seed or a `reset_mask`, not both")
    mask = np.asarray(mask)
    if mask.dtype != np.bool_ or mask.shape != (num_envs,):
        raise ArgumentError(
            f"reset: `reset_mask` has the shape {mask.shape} and the type {mask.dtype}; "
            f"give one bool for each environment, shape ({num_envs},)"
        )
    if not begun:
        raise SafeInspectError("no episode has begun; call reset() without a reset_mask first")
    return np.flatnonzero(mask)


def action_array(given: Any, shape: tuple[int, ...] | None) -> tuple[AnyArray, str]:
    """Return actions as an array, and a description of what is wrong with them (empty if they are valid).

    Args:
        given: The actions.
        shape: The expected shape.
    """
    try:
        array = np.asarray(given)
    except ValueError:
        return np.empty(0), f"is ragged; expected an array of the shape {shape}"
    if array.shape != shape:
        return array, f"has the shape {array.shape}; expected {shape}"
    if array.dtype.kind not in "biuf":
        return array, f"contains values that are not numbers ({array.dtype}); expected numbers of the shape {shape}"
    return array, ""
