"""Constraints of the inspection task with one deputy, which the certifying filters evaluate with row kernels.

The index of a constraint is its code in compiled rows. The machine code depends on their order: this file mentions
@njit so that the cache of `safe_inspect.compiling` notices when the file changes.
"""

from __future__ import annotations

from safe_inspect.rta.constraints.axis_speed import AlongTrackSpeed, CrossTrackSpeed, RadialSpeed
from safe_inspect.rta.constraints.base import Constraint
from safe_inspect.rta.constraints.chief_collision import ChiefCollision
from safe_inspect.rta.constraints.maximum_range import MaximumRange
from safe_inspect.rta.constraints.passive_safety import PassivelySafeManoeuvre
from safe_inspect.rta.constraints.relative_speed import RelativeSpeedLimit
from safe_inspect.rta.constraints.sun import SunKeepOut

CERTIFIED: tuple[type[Constraint], ...] = (
    ChiefCollision, RelativeSpeedLimit, SunKeepOut, MaximumRange, PassivelySafeManoeuvre,
    RadialSpeed, AlongTrackSpeed, CrossTrackSpeed,
)  # fmt: skip
#: The names of these constraints.
NAMES = tuple(constraint.registered_name for constraint in CERTIFIED)
#: Codes of the two constraints on the distance from the chief: the filters search for the closest approach separately.
COLLISION, PSM = CERTIFIED.index(ChiefCollision), CERTIFIED.index(PassivelySafeManoeuvre)
#: Code of the constraint that rotates with the sun.
SUN = CERTIFIED.index(SunKeepOut)
