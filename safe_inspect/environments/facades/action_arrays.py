"""The actions that a façade is given, as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.types import AnyArray


def action_array(given: Any, shape: tuple[int, ...] | None) -> tuple[AnyArray, str]:
    """Return actions as an array of numbers, and what is wrong with them (empty when nothing is).

    Args:
        given: The actions.
        shape: Their shape.
    """
    try:
        array = np.asarray(given)
    except ValueError:
        return np.empty(0), f"is ragged; an array of the shape {shape} is wanted"
    if array.shape != shape:
        return array, f"has the shape {array.shape}; {shape} is wanted"
    if array.dtype.kind not in "biuf":
        return array, f"holds other things than numbers ({array.dtype}); numbers of the shape {shape} are wanted"
    return array, ""
