"""Read-only arrays for plugins, and writable contiguous arrays for compiled kernels."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from safe_inspect.types import AnyArray

Array = TypeVar("Array", bound=NDArray[Any])


def read_only(array: Array) -> Array:
    """Return a read-only view of an array."""
    shown = array.view()
    shown.setflags(write=False)
    return shown


def for_kernel(array: AnyArray, dtype: Any = None) -> AnyArray:
    """Return a contiguous and writable array: the array itself, or a copy.

    For Numba a read-only array has a different type, for which it would compile the kernel again.
    """
    array = np.ascontiguousarray(array, dtype=dtype)
    return array if array.flags.writeable else array.copy()
