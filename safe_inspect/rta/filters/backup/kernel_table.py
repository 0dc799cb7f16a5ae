"""Table of the kernels of further constraints for the compiled rows."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from safe_inspect.rta.constraints.base import Constraint
from safe_inspect.rta.filters.backup.model import FilterModel
from safe_inspect.rta.filters.base import compiled
from safe_inspect.types import FloatArray, IntArray


class KernelTable:
    """Addresses of kernels and of their parameters, created when they are first needed in a process.

    Attributes:
        constraints: Constraints that define `Constraint.half_space`.
    """

    def __init__(self, constraints: Iterable[Constraint] = ()) -> None:
        """Store the constraints; nothing is compiled yet."""
        self.constraints = tuple(constraints)
        self._table: IntArray | None = None
        self._parameters: list[FloatArray] = []

    def __getstate__(self) -> dict[str, Any]:
        """Exclude the addresses from pickles, because they are valid in one process only."""
        return {**self.__dict__, "_table": None, "_parameters": []}

    def into(self, model: FilterModel) -> FilterModel:
        """Return a model with the constraints of this table, which must exist as long as the model.

        Raises:
            PluginValueError: A kernel does not compile.
        """
        if not self.constraints:
            return model
        if self._table is None:
            kernel = compiled("backup.half_spaces").kernel
            self._parameters = [np.array([*c.half_space_parameters(), 0.0]) for c in self.constraints]
            addresses = [kernel(type(constraint).half_space).address for constraint in self.constraints]
            self._table = np.array(
                [*zip(addresses, (numbers.ctypes.data for numbers in self._parameters), strict=True)], dtype=np.int64
            )
        return model._replace(further=len(self.constraints), kernels=self._table.ctypes.data)
