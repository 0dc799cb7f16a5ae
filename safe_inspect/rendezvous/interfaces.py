"""The types that plugins of a rendezvous receive and return, for packages that define such plugins.

The base classes are in `safe_inspect.rendezvous.plugins`; docs/rendezvous.md lists the arguments and the return value
of each kind.
"""

from safe_inspect.rendezvous.control.bound import Bound
from safe_inspect.rendezvous.control.design import DesignRequest, TubeDesign, design_without_tube
from safe_inspect.rendezvous.control.tracker import TrackerOutput
from safe_inspect.rendezvous.control.tube import Axis, TrackedReference, TrackingLimits
from safe_inspect.rendezvous.estimate import BodyState, EstimateErrors, JointErrors, StateEstimate, unknown_estimate
from safe_inspect.rendezvous.estimation.estimators import EstimatorContext
from safe_inspect.rendezvous.front_end.base import FrontEndContext
from safe_inspect.rendezvous.planner.checks import Certificate, certify, plan_mistake
from safe_inspect.rendezvous.planner.paths import ApproachPath, SampledPath
from safe_inspect.rendezvous.planner.problem import mating_state, sampled_plan
from safe_inspect.rendezvous.planner.query import Limits, Plan, PlanQuery, PlanReport, PlanStatus
from safe_inspect.rendezvous.poses import MODEL, Edge
from safe_inspect.rendezvous.readings import Command, Reading, Readings
from safe_inspect.rendezvous.sensors.imu import ImuNoise, InertialSample
from safe_inspect.rendezvous.sensors.measured import PoseFrame, StateReading
from safe_inspect.rendezvous.sensors.tof import DepthCamera, DepthFrame
from safe_inspect.rendezvous.target.model import Target, TriangleMesh

__all__ = [
    "MODEL",
    "ApproachPath",
    "Axis",
    "BodyState",
    "Bound",
    "Certificate",
    "Command",
    "DepthCamera",
    "DepthFrame",
    "DesignRequest",
    "Edge",
    "EstimateErrors",
    "EstimatorContext",
    "FrontEndContext",
    "ImuNoise",
    "InertialSample",
    "JointErrors",
    "Limits",
    "Plan",
    "PlanQuery",
    "PlanReport",
    "PlanStatus",
    "PoseFrame",
    "Reading",
    "Readings",
    "SampledPath",
    "StateEstimate",
    "StateReading",
    "Target",
    "TrackedReference",
    "TrackerOutput",
    "TrackingLimits",
    "TriangleMesh",
    "TubeDesign",
    "certify",
    "design_without_tube",
    "mating_state",
    "plan_mistake",
    "sampled_plan",
    "unknown_estimate",
]
