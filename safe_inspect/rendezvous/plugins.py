"""The plugin kinds of rendezvous and the built-in plugins. Importing this module registers them.

A plugin instance contains the options. Calling it returns a result, or a run that contains the state of one mission.
"""

from safe_inspect.rendezvous.control.tracker import LQRTracker, Tracker, TubeTracker
from safe_inspect.rendezvous.estimation.estimators import MeasuredState, PipelineEstimator, StateEstimator
from safe_inspect.rendezvous.front_end.base import FrontEnd, MeasuredPoses
from safe_inspect.rendezvous.front_end.model import ModelFrontEnd
from safe_inspect.rendezvous.front_end.submap import GicpSubmapFrontEnd
from safe_inspect.rendezvous.planner.approach import ApproachPlanner, SplineSCPPlanner
from safe_inspect.rendezvous.target.boxes import BoxTarget, EnvisatTarget
from safe_inspect.rendezvous.target.mesh import MeshTarget
from safe_inspect.rendezvous.target.model import TargetModel
from safe_inspect.tasks.rendezvous.tumble_parameter import RandomTumble, TriAxialTumble

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
    "TubeTracker",
]
