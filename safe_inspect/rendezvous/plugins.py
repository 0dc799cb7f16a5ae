"""The plugin kinds of rendezvous and the built-in plugins. Importing this module registers them.

A plugin instance contains the options. Calling it returns a result, or a run that contains the state of one mission.
"""

from safe_inspect.rendezvous.control.tracker import LQRTracker as LQRTracker
from safe_inspect.rendezvous.control.tracker import Tracker as Tracker
from safe_inspect.rendezvous.control.tracker import TubeTracker as TubeTracker
from safe_inspect.rendezvous.estimation.estimators import MeasuredState as MeasuredState
from safe_inspect.rendezvous.estimation.estimators import PipelineEstimator as PipelineEstimator
from safe_inspect.rendezvous.estimation.estimators import StateEstimator as StateEstimator
from safe_inspect.rendezvous.estimation.mapping import MappingEstimator as MappingEstimator
from safe_inspect.rendezvous.front_end.base import FrontEnd as FrontEnd
from safe_inspect.rendezvous.front_end.base import MeasuredPoses as MeasuredPoses
from safe_inspect.rendezvous.front_end.model import ModelFrontEnd as ModelFrontEnd
from safe_inspect.rendezvous.front_end.submap import GicpSubmapFrontEnd as GicpSubmapFrontEnd
from safe_inspect.rendezvous.planner.approach import ApproachPlanner as ApproachPlanner
from safe_inspect.rendezvous.planner.approach import SplineSCPPlanner as SplineSCPPlanner
from safe_inspect.rendezvous.target.boxes import BoxTarget as BoxTarget
from safe_inspect.rendezvous.target.boxes import EnvisatTarget as EnvisatTarget
from safe_inspect.rendezvous.target.mesh import MeshTarget as MeshTarget
from safe_inspect.rendezvous.target.model import TargetModel as TargetModel
from safe_inspect.tasks.docking.tumble_parameter import RandomTumble as RandomTumble
from safe_inspect.tasks.docking.tumble_parameter import TriAxialTumble as TriAxialTumble
