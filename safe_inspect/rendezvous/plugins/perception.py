"""Front ends: from depth frames to relative poses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from pydantic import Field

from safe_inspect.errors import ConfigError
from safe_inspect.rendezvous.plugins.base import FrontEnd
from safe_inspect.units import NonNegativeLength, PositiveLength, quantity

if TYPE_CHECKING:
    from safe_inspect.rendezvous.front_end.context import FrontEndContext
    from safe_inspect.rendezvous.front_end.gicp_front_end import SubmapFrontEndRun
    from safe_inspect.rendezvous.front_end.model.run import ModelFrontEndRun

_PositiveAngle = quantity("rad", gt=0)


def _assembly() -> Any:
    """Return what puts the front ends together; SciPy comes with it."""
    from safe_inspect.rendezvous.front_end import assembly

    return assembly


class ModelFrontEnd(FrontEnd):
    """Registers each frame to the known shape of the target: poses whose errors do not add up over time.

    Points are laid on the faces that look to the camera and the shape on the frame's silhouette; the first pose comes
    from a search over all attitudes. Shapes that look alike when they are turned are told apart by several views.

    Attributes:
        range_sigma: Standard deviation of a measured range, its constant part [m].
        range_growth: Its part that grows with the square of the range, for each square metre [m].
        cut: Distance to the shape from which a point does not count [m].
        edge: Difference of depth to a neighbour from which a pixel is dropped [m]; null keeps all, as the cut sees to
            pixels that fly, and a thin part has no others.
        least_points: Frames with fewer points are not used.
        margin: Sum of the differences of scores over distinct views that rules out an attitude [m].
        covariance_scale: Factor of the covariances, calibrated on simulation.
    """

    range_sigma: PositiveLength = 3e-3  # type: ignore[valid-type]
    range_growth: NonNegativeLength = 1.5e-3  # type: ignore[valid-type]
    cut: PositiveLength = 0.03  # type: ignore[valid-type]
    edge: PositiveLength | None = None  # type: ignore[valid-type]
    least_points: int = Field(default=150, ge=10)
    margin: PositiveLength = 3e-3  # type: ignore[valid-type]
    covariance_scale: float = Field(default=1.0, gt=0.0)

    def __call__(self, context: FrontEndContext) -> ModelFrontEndRun:
        """Return the front end of a mission.

        Raises:
            ConfigError: The target's shape is not known.
        """
        if context.target is None:
            raise ConfigError("ModelFrontEnd needs the shape of the target; give a target, or use GicpSubmapFrontEnd")
        parts = _assembly()
        edge = math.inf if self.edge is None else self.edge
        noise = (self.range_sigma, self.range_growth, self.cut)
        tracking = parts.ModelTracking(least_points=self.least_points, margin=self.margin, scale=self.covariance_scale)
        run: ModelFrontEndRun = parts.model_front_end(
            context.camera, context.T_BC, context.target, noise, edge, tracking
        )
        return run


class GicpSubmapFrontEnd(FrontEnd):
    """Registers each frame to a submap of keyframes by generalised ICP; the shape need not be known.

    A new keyframe is also registered to the ones before it and, when its view was seen before, to those of that view.
    After failures a frame is looked for among the keyframes by features.

    Attributes:
        voxel: Edge of the grid that thins a cloud [m].
        keyframe_angle: Turn that makes a new keyframe [rad].
        submap: Number of the newest keyframes that frames are registered to.
        skips: To how many keyframes before the last one a new keyframe is registered.
        loops: Whether keyframes are registered to earlier ones of about the same view.
        least_points: Frames with fewer points are not used.
        covariance_scale: Factor of the covariances, calibrated on simulation.
    """

    voxel: PositiveLength = 0.012  # type: ignore[valid-type]
    keyframe_angle: _PositiveAngle = 0.20943951023931953  # type: ignore[valid-type]
    submap: int = Field(default=100, ge=1)
    skips: int = Field(default=2, ge=0)
    loops: bool = True
    least_points: int = Field(default=150, ge=10)
    covariance_scale: float = Field(default=10.0, gt=0.0)

    def __call__(self, context: FrontEndContext) -> SubmapFrontEndRun:
        """Return the front end of a mission."""
        parts = _assembly()
        odometry = parts.SubmapOdometry(
            least_points=self.least_points,
            keyframe_angle=self.keyframe_angle,
            submap=self.submap,
            skips=self.skips,
            loops=self.loops,
            scale=self.covariance_scale,
        )
        run: SubmapFrontEndRun = parts.submap_front_end(
            context.camera, context.T_BC, self.voxel, odometry, context.streams
        )
        return run
