"""Conversion of the actions that are passed to a façade into arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.types import AnyArray


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
