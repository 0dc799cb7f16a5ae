"""Arrays that plugins may read and not write, and arrays that compiled kernels take."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from safe_inspect.types import AnyArray

Array = TypeVar("Array", bound=NDArray[Any])


def read_only(array: Array) -> Array:
    """Return the same numbers as an array that cannot be written."""
    shown = array.view()
    shown.setflags(write=False)
    return shown


def for_kernel(array: AnyArray, dtype: Any = None) -> AnyArray:
    """Return an array that is contiguous and writable: itself, or a copy.

    Numba takes a read-only array for another type, for which it would compile the kernel again.
    """
    array = np.ascontiguousarray(array, dtype=dtype)
    return array if array.flags.writeable else array.copy()
