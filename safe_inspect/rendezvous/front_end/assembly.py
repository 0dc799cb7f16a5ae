"""The built-in front ends, put together from their parts."""

from __future__ import annotations

from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.front_end.cleaning import Cleaning
from safe_inspect.rendezvous.front_end.feature_matching import FeatureMatching
from safe_inspect.rendezvous.front_end.gicp import GicpRegistration
from safe_inspect.rendezvous.front_end.gicp_front_end import SubmapFrontEndRun, SubmapOdometry
from safe_inspect.rendezvous.front_end.model.registration import ModelRegistration
from safe_inspect.rendezvous.front_end.model.run import ModelFrontEndRun, ModelTracking
from safe_inspect.rendezvous.sensors.tof import DepthCamera
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray

__all__ = ["ModelTracking", "SubmapOdometry", "model_front_end", "submap_front_end"]


def model_front_end(
    camera: DepthCamera,
    T_BC: FloatArray,  # noqa: N803
    target: Target,
    noise: tuple[float, float, float],
    edge: float,
    tracking: ModelTracking,
) -> ModelFrontEndRun:
    """Return the front end of a mission.

    Args:
        camera: Geometry of the camera.
        T_BC: Its pose in B, shape (4, 4).
        target: The known target.
        noise: Standard deviation of a range, its growth with the square of the range, and the cut; see
            `ModelRegistration`.
        edge: Difference of depth to a neighbour from which a pixel is dropped [m].
        tracking: Gates and thresholds.
    """
    return ModelFrontEndRun(
        Cleaning(camera, edge=edge), ModelRegistration(target, camera, T_BC, *noise), T_BC, tracking
    )


def submap_front_end(
    camera: DepthCamera,
    T_BC: FloatArray,  # noqa: N803
    voxel: float,
    odometry: SubmapOdometry,
    streams: Streams,
) -> SubmapFrontEndRun:
    """Return the front end of a mission.

    Args:
        camera: Geometry of the camera.
        T_BC: Its pose in B, shape (4, 4).
        voxel: Edge of the grid that thins a cloud [m].
        odometry: Gates and rates.
        streams: The random streams of the mission.
    """
    return SubmapFrontEndRun(Cleaning(camera), GicpRegistration(voxel), FeatureMatching(), T_BC, odometry, streams)
