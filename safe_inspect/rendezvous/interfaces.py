"""What plugins of a rendezvous are called with and what they return, for packages that bring some of their own.

The kinds are in `safe_inspect.rendezvous.plugins`; docs/rendezvous.md lists what each is called with and returns.
"""

from safe_inspect.rendezvous.back_end.options import CentrePrior, ChaserStart, GraphEstimate
from safe_inspect.rendezvous.bound.conformal import Bound
from safe_inspect.rendezvous.bound.query import BoundQuery, EstimateErrors, JointErrors, Updates
from safe_inspect.rendezvous.characterise.history import History, TargetEstimate
from safe_inspect.rendezvous.control.axis import Axis
from safe_inspect.rendezvous.control.design import TubeDesign
from safe_inspect.rendezvous.control.lqr import AxisStatus, TrackerOutput
from safe_inspect.rendezvous.control.tightening import TrackedReference, TrackingLimits
from safe_inspect.rendezvous.edges import MODEL, Edge
from safe_inspect.rendezvous.estimate import BodyState, StateEstimate, unknown_estimate
from safe_inspect.rendezvous.estimation.context import EstimatorContext
from safe_inspect.rendezvous.front_end.context import FrontEndContext
from safe_inspect.rendezvous.planner.certificate import Certificate, certify
from safe_inspect.rendezvous.planner.checks import plan_mistake
from safe_inspect.rendezvous.planner.path import ApproachPath, SampledPath
from safe_inspect.rendezvous.planner.problem import mating_state, sampled_plan
from safe_inspect.rendezvous.planner.query import Limits, Plan, PlanQuery, PlanReport, PlanStatus
from safe_inspect.rendezvous.readings import Command, Reading, Readings
from safe_inspect.rendezvous.sensors.imu import ImuNoise, InertialSample
from safe_inspect.rendezvous.sensors.poses import PoseFrame
from safe_inspect.rendezvous.sensors.state import StateReading
from safe_inspect.rendezvous.sensors.tof import DepthCamera, DepthFrame, DepthRenderer
from safe_inspect.rendezvous.target.model import Target, TriangleMesh
from safe_inspect.rendezvous.tracking import DesignRequest, design_without_tube

__all__ = [
    "MODEL",
    "ApproachPath",
    "Axis",
    "AxisStatus",
    "BodyState",
    "Bound",
    "BoundQuery",
    "CentrePrior",
    "Certificate",
    "ChaserStart",
    "Command",
    "DepthCamera",
    "DepthFrame",
    "DepthRenderer",
    "DesignRequest",
    "Edge",
    "EstimateErrors",
    "EstimatorContext",
    "FrontEndContext",
    "GraphEstimate",
    "History",
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
    "TargetEstimate",
    "TrackedReference",
    "TrackerOutput",
    "TrackingLimits",
    "TriangleMesh",
    "TubeDesign",
    "Updates",
    "certify",
    "design_without_tube",
    "mating_state",
    "plan_mistake",
    "sampled_plan",
    "unknown_estimate",
]
