"""The plugin kinds of rendezvous, and the built-in plugins. Importing registers them."""

from safe_inspect.rendezvous.plugins.base import (
    ApproachPlanner,
    BackEnd,
    Characteriser,
    DepthCameraModel,
    FrontEnd,
    StateEstimator,
    TargetModel,
    Tracker,
    Tumble,
    UncertaintyBound,
)
from safe_inspect.rendezvous.plugins.bound import JointConformalBound, MaxSampleBound
from safe_inspect.rendezvous.plugins.estimation import (
    ISAM2BackEnd,
    MeasuredPoses,
    PipelineEstimator,
    PolhodeCharacteriser,
)
from safe_inspect.rendezvous.plugins.perception import GicpSubmapFrontEnd, ModelFrontEnd
from safe_inspect.rendezvous.plugins.planning import SLSQPPlanner, SplineSCPPlanner
from safe_inspect.rendezvous.plugins.sensing import MeasuredState, TimeOfFlightCamera
from safe_inspect.rendezvous.plugins.target import (
    BoxTarget,
    EnvisatTarget,
    FlatSpin,
    MeshTarget,
    RandomTumble,
    TriAxialTumble,
)
from safe_inspect.rendezvous.plugins.tracking import LinearQuadraticTracker, TubeMPCTracker

__all__ = [
    "ApproachPlanner",
    "BackEnd",
    "BoxTarget",
    "Characteriser",
    "DepthCameraModel",
    "EnvisatTarget",
    "FlatSpin",
    "FrontEnd",
    "GicpSubmapFrontEnd",
    "ISAM2BackEnd",
    "JointConformalBound",
    "LinearQuadraticTracker",
    "MaxSampleBound",
    "MeasuredPoses",
    "MeasuredState",
    "MeshTarget",
    "ModelFrontEnd",
    "PipelineEstimator",
    "PolhodeCharacteriser",
    "RandomTumble",
    "SLSQPPlanner",
    "SplineSCPPlanner",
    "StateEstimator",
    "TargetModel",
    "TimeOfFlightCamera",
    "Tracker",
    "TriAxialTumble",
    "TubeMPCTracker",
    "Tumble",
    "UncertaintyBound",
]
