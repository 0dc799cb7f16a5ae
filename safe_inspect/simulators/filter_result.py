"""What a safety filter did to the desired controls of a step, as steps and plugins read it."""

from __future__ import annotations

from dataclasses import dataclass

from safe_inspect.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class FilterResult:
    """What a filter did to R desired controls.

    Attributes:
        control: The admissible control [N], Hill frame, shape (R, 3).
        intervening: True where |control - desired| > 0.01 N, shape (R,).
        infeasible: True where the filter can promise nothing, shape (R,): no control meets all conditions of the
            continuous filter; no backup plan is known to the others.
        backup: True where a backup shaped the control, shape (R,).
        active: Bits of the constraints that refused the desired control, bit j for the j-th name, shape (R,).
        phi: The constraints' plain safety quantities before the hold, in the order of the names, shape (R, C).
        names: The names of the constraints, C of them.
    """

    control: FloatArray
    intervening: BoolArray
    infeasible: BoolArray
    backup: BoolArray
    active: IntArray
    phi: FloatArray
    names: tuple[str, ...]

    def active_names(self, row: int) -> tuple[str, ...]:
        """Return the names of the constraints that refused a row's desired control."""
        return tuple(name for j, name in enumerate(self.names) if self.active[row] >> j & 1)
