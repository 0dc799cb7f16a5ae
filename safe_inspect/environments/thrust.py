"""`Thrusters`: the map from the actions of an agent to the control that they command."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.config.spec import AgentSpec
from safe_inspect.glues.actions import ControllerGlue, DiscreteControllerGlue
from safe_inspect.glues.base import ActionGlue
from safe_inspect.platforms.controllers import RateController
from safe_inspect.types import FloatArray, IntArray


class Thrusters:
    """Sum of the controls that the action glues of an agent command.

    If all controllers are plain and each has a different axis, they are computed at once. The result is bit-identical,
    and this is several times as fast on a small batch.

    Args:
        agent: The agent.
        size: Number of elements of the control, C: three thrusts, and three moments for a vehicle that turns.

    Attributes:
        commands: Each glue and its columns of the action.
        plain: If all controllers are plain: their axes, shape (A,), and their lower and upper limits [N, N m], shape
            (A,) each.
        size: Number of elements of the control, C.
    """

    def __init__(self, agent: AgentSpec, size: int = 3) -> None:
        self._parts = agent.parts
        self.size = size
        self.commands: list[tuple[ActionGlue, slice]] = []
        start = 0
        for glue in (leaf for outer in agent.action_glues for leaf in outer.leaves()):
            end = start + len(glue.names(agent.parts))
            self.commands.append((glue, slice(start, end)))
            start = end
        self._levels: FloatArray | None = None
        self.plain: tuple[IntArray, FloatArray, FloatArray] | None = None
        found = [controller for glue, _ in self.commands if (controller := self._plain(glue)) is not None]
        self._axes = [controller.axis for controller in found]
        if not found or not len(set(self._axes)) == len(found) == len(self.commands):
            return
        tables = [glue.table for glue, _ in self.commands if isinstance(glue, DiscreteControllerGlue)]
        if len(tables) == len(found):
            self._columns = np.arange(len(tables))
            self._levels = np.zeros((len(tables), max(map(len, tables))))
            for row, table in zip(self._levels, tables, strict=True):
                row[: len(table)] = table
        elif not tables:
            low, high = (np.concatenate([controller.limits[side] for controller in found]) for side in (0, 1))
            self.plain = (np.array(self._axes, dtype=np.int64), low, high)

    def __call__(self, action: FloatArray) -> FloatArray:
        """Return the control [N, N m], shape (R, C), for actions within their bounds, shape (R, A)."""
        control = np.zeros((len(action), self.size))
        if self._levels is not None:
            control[:, self._axes] += self._levels[self._columns, action.astype(np.int64)]
            return control
        for glue, columns in self.commands:
            share = glue(action[:, columns], self._parts)
            control[:, : share.shape[1]] += share
        return control

    def clipped(self, action: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return the clipped actions, shape (R, A), and the control that they command [N, N m], shape (R, C).

        The result is None if the controllers are not plain, or an action is not finite.

        Args:
            action: Actions of shape (N, G, A), contiguous.
            low: Lower bounds of the actions, shape (A,).
            high: Upper bounds of the actions, shape (A,).
        """
        if self.plain is None:
            return None
        axes, least, most = self.plain
        if not action.flags.writeable:
            action = action.copy()  # read-only is a different type for Numba, which would compile the kernel again
        rows = action.shape[0] * action.shape[1]
        clipped, control = np.empty((rows, len(axes))), np.empty((rows, self.size))
        finite = _command.dispatcher(action, low, high, least, most, axes, clipped, control)
        return (clipped, control) if finite else None

    def _plain(self, glue: ActionGlue) -> RateController | None:
        """Return the controller of a glue that only passes a value or a level to it; None for any other glue."""
        if not isinstance(glue, ControllerGlue | DiscreteControllerGlue):
            return None
        controller, maps = self._parts[glue.controller], isinstance(glue, ControllerGlue) and glue.normalization.enabled
        return controller if isinstance(controller, RateController) and not maps else None


@njit
def _within(value: float, low: float, high: float) -> float:
    value = value if value >= low else low
    return value if value <= high else high


@njit
def _command(
    action: FloatArray,
    low: FloatArray,
    high: FloatArray,
    least: FloatArray,
    most: FloatArray,
    axes: IntArray,
    clipped: FloatArray,
    control: FloatArray,
) -> bool:
    """Write the clipped actions, shape (R, A), and the control [N, N m], shape (R, C).

    Args:
        action: The actions, shape (N, G, A).
        low: Lower bounds of the actions, shape (A,).
        high: Upper bounds of the actions, shape (A,).
        least: Lower limit of each controller [N, N m], shape (A,).
        most: Upper limit of each controller [N, N m], shape (A,).
        axes: Axis of each controller, all different, shape (A,).
        clipped: Output: the clipped actions.
        control: Output: the control.

    Returns:
        Whether all actions are finite.
    """
    finite, size = True, action.shape[1]
    for row in range(clipped.shape[0]):
        for k in range(control.shape[1]):
            control[row, k] = 0.0
        for a in range(len(axes)):
            value = action[row // size, row % size, a]
            finite &= math.isfinite(value)
            value = _within(value, low[a], high[a])
            clipped[row, a] = value
            control[row, axes[a]] = 0.0 + _within(value, least[a], most[a])  # adding 0 avoids -0
    return finite
