"""Array types of the public signatures, and the declaration of an array of the state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]
AnyArray: TypeAlias = NDArray[Any]
#: Observations, float32.
Observation: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True)
class ArraySpec:
    """Declaration of an array of the state.

    Attributes:
        shape: Shape without the environment axis.
        dtype: NumPy type.
        fill: Value at a reset.
        constant: Whether its value is constant during an episode.
    """

    shape: tuple[int, ...]
    dtype: Any = np.float64
    fill: float = 0
    constant: bool = False
