"""`ActionInverse`: from a control to the action of an agent that asks for it, as nearly as it can."""

from __future__ import annotations

import numpy as np

from safe_inspect.environments.group import AgentGroup
from safe_inspect.errors import SafeInspectError
from safe_inspect.types import FloatArray


class ActionInverse:
    """The actions whose controls are nearest to given ones.

    Each element of the action commands an axis of the control of its own: a level is the nearest, a real number that of
    the straight line between the element's bounds. That of a `CoastGlue` says how long it lasts: as short as it can.

    Args:
        group: The agents.

    Raises:
        SafeInspectError: An element commands no axis of the control, several, or one that another commands too.
    """

    def __init__(self, group: AgentGroup) -> None:
        layout, thrusters = group.action_layout, group.thrusters
        self._low, self._high = layout.low, layout.high
        self._tables: list[tuple[int, FloatArray]] = []
        self.coast = layout.coast
        counts = layout.choices or (0,) * layout.size
        for element, count in enumerate(counts[:-1] if layout.coast is not None else counts):
            values = np.arange(count) if count else np.array([layout.low[element], layout.high[element]])
            tried = np.repeat(layout.low[None], len(values), axis=0)
            tried[:, element] = values
            controls = thrusters(tried)
            axes = np.flatnonzero(np.ptp(controls, axis=0) > 0.0)
            if len(axes) != 1 or int(axes[0]) in [axis for axis, _ in self._tables]:
                raise SafeInspectError(
                    f"imitation: the element {layout.names[element]!r} of the action does not command one axis of the "
                    "control by itself, so a teacher's thrust is no action; leave `imitation` out"
                )
            self._tables.append((int(axes[0]), controls[:, axes[0]]))
        self._discrete = bool(layout.choices)

    def __call__(self, control: FloatArray) -> FloatArray:
        """Return the actions, shape (R, A), for controls [N, N m], shape (R, C)."""
        found = np.zeros((len(control), len(self._low)))
        for element, (axis, table) in enumerate(self._tables):
            wanted = control[:, axis]
            if self._discrete:
                found[:, element] = np.abs(wanted[:, None] - table).argmin(axis=1)
                continue
            share = np.clip((wanted - table[0]) / (table[1] - table[0]), 0.0, 1.0)
            found[:, element] = self._low[element] + share * (self._high[element] - self._low[element])
        return found
