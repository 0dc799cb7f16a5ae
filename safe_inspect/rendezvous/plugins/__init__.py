"""The plugin kinds of rendezvous and the built-in plugins. Importing this module registers them.

A plugin instance contains the options. Calling it returns a result, or a run that contains the state of one mission.
"""

from safe_inspect.rendezvous.control.lqr import LQRTracker
from safe_inspect.rendezvous.control.mpc import TubeMPCTracker
from safe_inspect.rendezvous.control.tracker import Tracker
from safe_inspect.rendezvous.front_end.context import FrontEnd
from safe_inspect.rendezvous.front_end.gicp_front_end import GicpSubmapFrontEnd
from safe_inspect.rendezvous.front_end.measured import MeasuredPoses
from safe_inspect.rendezvous.front_end.model.run import ModelFrontEnd
from safe_inspect.rendezvous.planner.approach import ApproachPlanner, SplineSCPPlanner
from safe_inspect.rendezvous.plugins.base import StateEstimator
from safe_inspect.rendezvous.plugins.estimation import PipelineEstimator
from safe_inspect.rendezvous.plugins.sensing import MeasuredState
from safe_inspect.rendezvous.target.box import BoxTarget
from safe_inspect.rendezvous.target.envisat import EnvisatTarget
from safe_inspect.rendezvous.target.mesh import MeshTarget
from safe_inspect.rendezvous.target.model import TargetModel
from safe_inspect.rendezvous.target.tumble import RandomTumble, TriAxialTumble, Tumble

__all__ = [
    "ApproachPlanner",
    "BoxTarget",
    "EnvisatTarget",
    "FrontEnd",
    "GicpSubmapFrontEnd",
    "LQRTracker",
    "MeasuredPoses",
    "MeasuredState",
    "MeshTarget",
    "ModelFrontEnd",
    "PipelineEstimator",
    "RandomTumble",
    "SplineSCPPlanner",
    "StateEstimator",
    "TargetModel",
    "Tracker",
    "TriAxialTumble",
    "TubeMPCTracker",
    "Tumble",
]
