"""The types that plugins of a rendezvous receive and return, for packages that define such plugins.

The base classes are in `safe_inspect.rendezvous.plugins`; docs/rendezvous.md lists the arguments and the return value
of each kind.
"""

from safe_inspect.rendezvous.control.bound import Bound as Bound
from safe_inspect.rendezvous.control.design import DesignRequest as DesignRequest
from safe_inspect.rendezvous.control.design import TubeDesign as TubeDesign
from safe_inspect.rendezvous.control.design import design_without_tube as design_without_tube
from safe_inspect.rendezvous.control.tracker import TrackerOutput as TrackerOutput
from safe_inspect.rendezvous.control.tube import Axis as Axis
from safe_inspect.rendezvous.control.tube import TrackedReference as TrackedReference
from safe_inspect.rendezvous.control.tube import TrackingLimits as TrackingLimits
from safe_inspect.rendezvous.depth_camera import DepthCamera as DepthCamera
from safe_inspect.rendezvous.depth_camera import DepthFrame as DepthFrame
from safe_inspect.rendezvous.estimate import BodyState as BodyState
from safe_inspect.rendezvous.estimate import EstimateErrors as EstimateErrors
from safe_inspect.rendezvous.estimate import JointErrors as JointErrors
from safe_inspect.rendezvous.estimate import StateEstimate as StateEstimate
from safe_inspect.rendezvous.estimate import unknown_estimate as unknown_estimate
from safe_inspect.rendezvous.estimation.estimators import EstimatorContext as EstimatorContext
from safe_inspect.rendezvous.front_end.base import FrontEndContext as FrontEndContext
from safe_inspect.rendezvous.inertial_unit import ImuNoise as ImuNoise
from safe_inspect.rendezvous.inertial_unit import InertialSample as InertialSample
from safe_inspect.rendezvous.measured_poses import PoseFrame as PoseFrame
from safe_inspect.rendezvous.measured_poses import StateReading as StateReading
from safe_inspect.rendezvous.planner.checks import Certificate as Certificate
from safe_inspect.rendezvous.planner.checks import certify as certify
from safe_inspect.rendezvous.planner.checks import plan_mistake as plan_mistake
from safe_inspect.rendezvous.planner.paths import ApproachPath as ApproachPath
from safe_inspect.rendezvous.planner.paths import SampledPath as SampledPath
from safe_inspect.rendezvous.planner.problem import mating_state as mating_state
from safe_inspect.rendezvous.planner.problem import sampled_plan as sampled_plan
from safe_inspect.rendezvous.planner.query import Limits as Limits
from safe_inspect.rendezvous.planner.query import Plan as Plan
from safe_inspect.rendezvous.planner.query import PlanQuery as PlanQuery
from safe_inspect.rendezvous.planner.query import PlanReport as PlanReport
from safe_inspect.rendezvous.planner.query import PlanStatus as PlanStatus
from safe_inspect.rendezvous.poses import MODEL as MODEL
from safe_inspect.rendezvous.poses import Edge as Edge
from safe_inspect.rendezvous.readings import Command as Command
from safe_inspect.rendezvous.readings import Reading as Reading
from safe_inspect.rendezvous.readings import Readings as Readings
from safe_inspect.rendezvous.target.model import Target as Target
from safe_inspect.rendezvous.target.model import TriangleMesh as TriangleMesh
