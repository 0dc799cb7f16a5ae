"""Done functors: what ends an episode, and how. Importing it registers them."""

from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.dones.range import CrashDoneFunction, MaxDistanceDoneFunction
from safe_inspect.dones.shared import (
    CollisionDoneFunction,
    MultiagentSuccessDoneFunction,
    SetAllDoneFunction,
    SharedDoneFunction,
)
from safe_inspect.dones.success import SuccessfulInspectionDoneFunction
from safe_inspect.dones.time_limit import EpisodeLengthDone

__all__ = [
    "CollisionDoneFunction",
    "CrashDoneFunction",
    "DoneFunction",
    "DoneStatus",
    "EpisodeLengthDone",
    "MaxDistanceDoneFunction",
    "MultiagentSuccessDoneFunction",
    "SetAllDoneFunction",
    "SharedDoneFunction",
    "SuccessfulInspectionDoneFunction",
]
