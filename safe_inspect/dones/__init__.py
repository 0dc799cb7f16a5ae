"""Done functors, which end an episode and set its status. Importing the package registers them."""

from safe_inspect.dones import limits, motion, success  # noqa: F401
from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.dones.shared import SharedDoneFunction

__all__ = ["DoneFunction", "DoneStatus", "SharedDoneFunction"]
