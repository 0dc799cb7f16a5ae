"""Base class of the rewards."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from safe_inspect.compiling import Kernel, generate
from safe_inspect.simulators.row_plugin import RowPlugin, batch_call
from safe_inspect.simulators.row_terms import RowInput, RowTerm
from safe_inspect.simulators.view import Step
from safe_inspect.types import FloatArray


class Reward(RowPlugin):
    """Base class of a reward term. Called with a `Step`, it returns the reward of each row [-], shape (R,).

    A reward has no state and must not modify its arguments. A subclass defines either ``__call__`` or `row`, a row
    kernel that returns a number.
    """

    kind: ClassVar[str] = "reward"

    @batch_call
    def __call__(self, step: Step) -> FloatArray:
        """Return the reward of each row [-], shape (R,)."""
        return self.call_rows(step)


def paid_if(condition: Kernel[..., bool], scale: float, inputs: Sequence[RowInput]) -> RowTerm:
    """Return the row term that pays `scale` where a condition is true, otherwise 0.

    Args:
        condition: The row kernel of the condition.
        scale: The reward [-].
        inputs: The inputs of the condition.
    """
    source = "def paid(scale, *inputs):\n    return scale if condition(*inputs) else 0.0\n"
    return RowTerm(generate("paid", source, {"condition": condition}), (scale, *inputs))
