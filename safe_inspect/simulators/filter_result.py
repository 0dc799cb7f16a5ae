"""Result of a safety filter for the desired controls of a step, as steps and plugins read it."""

from __future__ import annotations

from dataclasses import dataclass

from safe_inspect.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class FilterResult:
    """Result of a filter for R desired controls.

    Attributes:
        control: The admissible control [N], Hill frame, shape (R, 3).
        intervening: True where |control - desired| > 0.01 N, shape (R,).
        infeasible: True where the filter cannot guarantee safety, shape (R,): no control meets all conditions of the
            continuous filter, or, for the other filters, no backup plan is known.
        backup: True where the control comes from a backup, shape (R,).
        active: Bits of the constraints that rejected the desired control, bit j for the j-th name, shape (R,).
        phi: The constraints' plain safety quantities before the hold, in the order of the names, shape (R, C).
        names: The names of the C constraints.
    """

    control: FloatArray
    intervening: BoolArray
    infeasible: BoolArray
    backup: BoolArray
    active: IntArray
    phi: FloatArray
    names: tuple[str, ...]

    def active_names(self, row: int) -> tuple[str, ...]:
        """Return the names of the constraints that rejected the desired control of a row."""
        return tuple(name for j, name in enumerate(self.names) if self.active[row] >> j & 1)
