"""Safety constraints of run-time assurance: plugins that compute phi, h and the gradient of h in closed form."""

from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.ranges import DeputyCollision, DeputyPassiveSafety, PairConstraint
from safe_inspect.rta.constraints.sets import NAMES, constraint_set

__all__ = [
    "NAMES",
    "Constraint",
    "ConstraintParameters",
    "ConstraintValues",
    "DeputyCollision",
    "DeputyPassiveSafety",
    "PairConstraint",
    "RelativeState",
    "constraint_set",
]
