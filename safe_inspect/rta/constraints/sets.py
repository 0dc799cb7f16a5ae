"""The constraints of a task, by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, cast

from safe_inspect.errors import RegistryError
from safe_inspect.registry import registry
from safe_inspect.rta.constraints.base import Constraint
from safe_inspect.rta.constraints.parameters import ConstraintParameters

#: The constraints of the inspection task with one deputy.
NAMES = ("chief_collision", "rel_vel", "sun", "r_max", "PSM", "x_vel", "y_vel", "z_vel")


def constraint_set(
    parameters: Mapping[str, Any] | ConstraintParameters, names: Iterable[str] = NAMES
) -> dict[str, Constraint]:  # fmt: skip
    """Return the named constraints, built from a task's parameters, in the order of the names.

    Args:
        parameters: The peer's argument names and their values; see `ConstraintParameters`.
        names: Registered names of constraints, or dotted paths to their classes.

    Raises:
        ValueError: A name is unknown or stands twice, a parameter is unknown or impossible, or two
            parameters contradict each other.
    """
    if isinstance(names, str):
        raise ValueError(f"the names of the constraints are a list, not the text {names!r}; write [{names}]")
    known = ConstraintParameters.of(parameters)
    built: dict[str, Constraint] = {}
    for name in names:
        if name in built:
            raise ValueError(f"the constraint {name!r} stands twice; remove one")
        try:
            cls = cast("type[Constraint]", registry.get("constraint", name))
        except RegistryError as error:
            raise ValueError(str(error)) from None
        built[name] = cls.from_parameters(known)
    return built
