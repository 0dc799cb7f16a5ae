"""`Thrusters`: the map from the actions of an agent to the control that they command."""

from __future__ import annotations

import numpy as np

from safe_inspect.config.spec import AgentSpec
from safe_inspect.glues.base import ActionGlue
from safe_inspect.glues.controller_glue import ControllerGlue
from safe_inspect.glues.discrete_controller_glue import DiscreteControllerGlue
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
        plain = [self._plain(glue) for glue, _ in self.commands]
        axes = [controller.axis for controller in plain if controller is not None]
        self._axes: list[int] | slice | None = None
        self._levels: FloatArray | None = None
        self.plain: tuple[IntArray, FloatArray, FloatArray] | None = None
        if plain and len(set(axes)) == len(plain):
            self._axes = slice(0, 3) if axes == [0, 1, 2] else axes
            tables = [glue.table for glue, _ in self.commands if isinstance(glue, DiscreteControllerGlue)]
            if len(tables) == len(plain):
                self._columns = np.arange(len(tables))
                self._levels = np.zeros((len(tables), max(map(len, tables))))
                for row, table in zip(self._levels, tables, strict=True):
                    row[: len(table)] = table
            elif tables:
                self._axes = None
            else:
                limits = [controller.limits for controller in plain if controller is not None]
                self._low, self._high = (np.concatenate([limit[side] for limit in limits]) for side in (0, 1))
                self.plain = (np.array(axes, dtype=np.int64), self._low, self._high)

    def __call__(self, action: FloatArray) -> FloatArray:
        """Return the control [N, N m], shape (R, C), for actions within their bounds, shape (R, A)."""
        control = np.zeros((len(action), self.size))
        if self._levels is not None:
            control[:, self._axes] += self._levels[self._columns, action.astype(np.int64)]
        elif self._axes is not None:
            control[:, self._axes] += np.minimum(np.maximum(action, self._low), self._high)
        else:
            for glue, columns in self.commands:
                share = glue(action[:, columns], self._parts)
                control[:, : share.shape[1]] += share
        return control

    def _plain(self, glue: ActionGlue) -> RateController | None:
        """Return the controller of a glue that only passes a value or a level to it; None for any other glue."""
        if type(glue) is ControllerGlue:
            if glue.normalization.active is not None:
                return None
        elif type(glue) is not DiscreteControllerGlue:
            return None
        controller = self._parts[glue.controller]
        return controller if isinstance(controller, RateController) else None
