"""Array types that the public signatures use, and how an array of the state is declared."""

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
    """One declared array of the state.

    Attributes:
        shape: Shape behind the environment axis.
        dtype: NumPy type.
        fill: Value at a reset.
        constant: Whether it keeps its value through an episode.
    """

    shape: tuple[int, ...]
    dtype: Any = np.float64
    fill: float = 0
    constant: bool = False
