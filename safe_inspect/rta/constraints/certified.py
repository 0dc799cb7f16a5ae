"""The constraints of the inspection task with one deputy, which certifying filters know by their row kernels.

The index of a constraint is its code in compiled rows. (Machine code depends on the order: that this file names @njit
lets the cache of `safe_inspect.compiling` notice when it changes.)
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
#: Their names.
NAMES = tuple(constraint.registered_name for constraint in CERTIFIED)
#: Codes of the two that keep off the chief: the filters have a search of their own for the closest approach.
COLLISION, PSM = CERTIFIED.index(ChiefCollision), CERTIFIED.index(PassivelySafeManoeuvre)
#: Code of the one that turns.
SUN = CERTIFIED.index(SunKeepOut)
