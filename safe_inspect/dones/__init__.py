"""Done functors, which end an episode and set its status. Importing the package registers them."""

from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.dones.docking import SuccessfulDockingDoneFunction
from safe_inspect.dones.mating import ContactDoneFunction, DockedDoneFunction
from safe_inspect.dones.range import CrashDoneFunction, MaxDistanceDoneFunction
from safe_inspect.dones.saturation import TerminalRewardSaturationDoneFunction
from safe_inspect.dones.shared import (
    CollisionDoneFunction,
    MultiagentSuccessDoneFunction,
    SetAllDoneFunction,
    SharedDoneFunction,
)
from safe_inspect.dones.success import (
    CrashAfterSuccessfulInspectionDoneFunction,
    SafeSuccessfulInspectionDoneFunction,
    SuccessfulInspectionDoneFunction,
)
from safe_inspect.dones.time_limit import EpisodeLengthDone, TimeoutDoneFunction

__all__ = [
    "CollisionDoneFunction",
    "ContactDoneFunction",
    "CrashAfterSuccessfulInspectionDoneFunction",
    "CrashDoneFunction",
    "DockedDoneFunction",
    "DoneFunction",
    "DoneStatus",
    "EpisodeLengthDone",
    "MaxDistanceDoneFunction",
    "MultiagentSuccessDoneFunction",
    "SafeSuccessfulInspectionDoneFunction",
    "SetAllDoneFunction",
    "SharedDoneFunction",
    "SuccessfulDockingDoneFunction",
    "SuccessfulInspectionDoneFunction",
    "TerminalRewardSaturationDoneFunction",
    "TimeoutDoneFunction",
]
