"""Success: the body is inspected."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.plugins.plugin import PointsName
from safe_inspect.simulators.view import Step
from safe_inspect.types import BoolArray


class SuccessfulInspectionDoneFunction(DoneFunction):
    """Win when every point is inspected, or enough of their summed weight; shape (R,).

    Attributes:
        inspection_entity_name: The body that carries the points.
        weight_threshold: Win at this summed weight of inspected points, in (0, 1]; None: win when all are inspected.
    """

    status: ClassVar[DoneStatus] = DoneStatus.WIN

    inspection_entity_name: PointsName = "chief"
    weight_threshold: float | None = Field(default=None, gt=0, le=1)

    def __call__(self, step: Step) -> BoolArray:
        """Return the rows whose inspection is complete, shape (R,)."""
        points = step.after.points(self.inspection_entity_name)
        if self.weight_threshold is None:
            return np.asarray(points.count >= points.num_points)
        return np.asarray(points.inspected_weight >= self.weight_threshold)
