"""Build the constraints of a task by name, and the constraints that the certifying filters evaluate with row kernels.

The index of a constraint in `CERTIFIED` is its code in compiled rows. The machine code depends on their order: this
file mentions @njit so that the cache of `safe_inspect.compiling` notices when the file changes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, cast

from pydantic import BeforeValidator, PlainSerializer, WithJsonSchema

from safe_inspect.errors import RegistryError
from safe_inspect.plugins.functor import SCHEMA_KIND, build, describe
from safe_inspect.plugins.registry import registry
from safe_inspect.rta.constraints.base import Constraint
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.ranges import ChiefCollision, MaximumRange, PassivelySafeManoeuvre
from safe_inspect.rta.constraints.speeds import AlongTrackSpeed, CrossTrackSpeed, RadialSpeed, RelativeSpeedLimit
from safe_inspect.rta.constraints.sun_cone import SunKeepOut

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


def constraint_set(
    parameters: Mapping[str, Any] | ConstraintParameters,
    names: Iterable[str | Constraint] = NAMES,
    deputy_radius: float | None = None,
) -> dict[str, Constraint]:
    """Build the named constraints from a task's parameters, in the order of the names.

    Args:
        parameters: Parameters by name, as in safe-autonomy-sims; see `ConstraintParameters`.
        names: Registered names of constraints, dotted paths to their classes, or constraints. Fields of a constraint
            that are not given come from the parameters.
        deputy_radius: Default of the `deputy_radius` [m] of constraints between deputies.

    Raises:
        ValueError: A name is unknown or given twice, a parameter is unknown or impossible, or two limits contradict
            each other.
    """
    if isinstance(names, str):
        raise ValueError(f"expected a list of constraint names, got the text {names!r}; write [{names}]")
    known = ConstraintParameters.of(parameters)
    built: dict[str, Constraint] = {}
    for entry in names:
        cls, given = _class_of(entry), {}
        name = name_of(entry)
        fixed = cls.pair or cls in CERTIFIED  # which the filters look up by their registered names
        if fixed and name != cls.registered_name:
            raise ValueError(f"the constraint {cls.registered_name!r} cannot have another `name`; remove it")
        if name in built:
            remedy = "remove one" if fixed else "remove one, or give each a `name`"
            raise ValueError(f"the constraint {name!r} is given twice; {remedy}")
        if isinstance(entry, Constraint):
            given = {field: getattr(entry, field) for field in entry.model_fields_set}
        if cls.pair and deputy_radius is not None and "deputy_radius" in cls.model_fields:
            given = {"deputy_radius": deputy_radius, **given}
        built[name] = cls.from_parameters(known).model_copy(update=given)
    _check_room(built)
    return built


def _class_of(entry: str | Constraint) -> type[Constraint]:
    if isinstance(entry, Constraint):
        return type(entry)
    try:
        return cast("type[Constraint]", registry.get("constraint", entry))
    except RegistryError as error:
        raise ValueError(str(error)) from None


def _check_room(constraints: Mapping[str, Any]) -> None:
    """Check that the largest range exceeds the collision radius, if both are given.

    Raises:
        ValueError: It does not.
    """
    far = constraints["r_max"].r_max if "r_max" in constraints else math.inf
    for name in ("chief_collision", "PSM"):
        if name in constraints and far <= constraints[name].collision_radius:
            raise ValueError(
                f"r_max {far} m does not exceed the collision_radius {constraints[name].collision_radius} m of {name}: "
                "no position is safe; give a larger r_max"
            )


def name_of(entry: str | Constraint) -> str:
    """Return the name that identifies a constraint: its field `name` if it is given, otherwise its registered name."""
    if isinstance(entry, Constraint):
        return entry.name or entry.registered_name
    return entry if "." not in entry else _class_of(entry).registered_name


def _entry(value: Any) -> Any:
    if not isinstance(value, str):
        return build("constraint", value)
    _class_of(value)  # an unknown name is reported at its place in the list
    return value


def _plain(value: Any) -> Any:
    return value if isinstance(value, str) else describe(value)


#: Field type of a constraint in a list: its name, or a mapping with its name and fields.
ConstraintEntry = Annotated[
    Any,
    BeforeValidator(_entry),
    PlainSerializer(_plain),
    WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "object", SCHEMA_KIND: "constraint"}]}),
]
