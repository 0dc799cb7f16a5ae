"""Checks of the arguments of `reset` in the façades."""

from __future__ import annotations

import secrets
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from safe_inspect.errors import ArgumentError
from safe_inspect.types import IntArray

_MASK = "reset_mask"


def fresh_seed() -> int:
    """Return a seed from the operating system, for an environment without a given seed."""
    return secrets.randbits(64)


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


def masked_rows(options: Mapping[str, Any] | None, num_envs: int, seed: int | None) -> IntArray | None:
    """Return the indices of the environments that ``options["reset_mask"]`` selects; None without a mask.

    Raises:
        ArgumentError: An option is unknown, the mask is not bool of shape (N,), or both a mask and a seed are given.
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
    return np.flatnonzero(mask)
