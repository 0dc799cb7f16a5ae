"""Safety constraints of run-time assurance: plugins that compute phi, h and the gradient of h in closed form."""

from typing import Any

from safe_inspect.rta.constraints.axis_speed import AlongTrackSpeed, AxisSpeed, CrossTrackSpeed, RadialSpeed
from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.certified import NAMES
from safe_inspect.rta.constraints.chief_collision import ChiefCollision
from safe_inspect.rta.constraints.deputies import DeputyCollision, DeputyPassiveSafety, DeputySunKeepOut
from safe_inspect.rta.constraints.maximum_range import MaximumRange
from safe_inspect.rta.constraints.parameters import ConstraintParameters, braking_acceleration
from safe_inspect.rta.constraints.passive_safety import PassivelySafeManoeuvre
from safe_inspect.rta.constraints.relative_speed import RelativeSpeedLimit
from safe_inspect.rta.constraints.sets import constraint_set
from safe_inspect.rta.constraints.sun import SunKeepOut

__all__ = [
    "NAMES",
    "AlongTrackSpeed",
    "AxisSpeed",
    "ChiefCollision",
    "Constraint",
    "ConstraintParameters",
    "ConstraintValues",
    "CrossTrackSpeed",
    "DeputyCollision",
    "DeputyPassiveSafety",
    "DeputySunKeepOut",
    "MaximumRange",
    "PassivelySafeManoeuvre",
    "RadialSpeed",
    "RelativeSpeedLimit",
    "RelativeState",
    "SunKeepOut",
    "braking_acceleration",
    "constraint_set",
]


def __getattr__(name: str) -> Any:
    """Return `ConstraintValues` for its former name `Evaluation`, which existing plugins may import."""
    if name == "Evaluation":
        return ConstraintValues
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
