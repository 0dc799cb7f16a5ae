"""`check_plugin`: the contract that every plugin must satisfy, whether it is part of this package or not."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import ValidationError

from safe_inspect.platforms.base import Part
from safe_inspect.plugins.functor import errors_of
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.plugins.registry import registry
from safe_inspect.testing.declaration import check_declaration, check_names
from safe_inspect.testing.kinds import check_behaviour
from safe_inspect.testing.report import ContractError, Report
from safe_inspect.testing.samples import DEPUTIES, sample_spec


def check_plugin(plugin: type[Plugin] | Plugin, *, parts: Sequence[Part] = ()) -> None:
    """Check a plugin against the contract.

    A plugin can be built from its defaults, is frozen, rejects unknown keys and values of another type, is unchanged
    after being written to YAML and read again, and documents itself and each of its fields, with units. Its results
    have the shape and type of its kind and are finite. Each row depends only on its own inputs and is bit-identical in
    every batch. A plugin changes none of its inputs, and its results do not depend on earlier calls:

    ===========  ================================================================================
    kind         result
    ===========  ================================================================================
    reward       float (R,)
    done         bool (R,); the class has a `status`
    part         sensor: float (R, size) within its limits; controller: thrust [N] (R, 3)
    glue         names and bounds; an observation float (R, size) within them, or thrust [N] (R, 3)
    parameter    float (R,), or named states
    initializer  named states, position and velocity (R, 3)
    normalizer   float (R, k); `inverse` restores the values
    constraint   phi, h and rate float (R,), gradient float (R, 6), the derivative of h; a `half_space` agrees with phi
    component    a motion within its `disturbance_bounds`
    dynamics     a motion within its `disturbance_bounds` about the Clohessy-Wiltshire motion
    shared_done  a `DoneStatus` or 0, int (N,)
    metric       float (R,), of a `TeamMetric` (N,), NaN where there is no value; it has `unit` and `reduce`
    policy       thrust [N] (R, 3)
    rta          a `TeamFiltered`, thrusts [N] (N, D, 3); the initial states that it rejects
    simulator    the same results for an environment alone and in a batch
    rendezvous   targets, cameras, estimators, planners, bounds and trackers: finite results of the shape of
                 their kind, the same for the same inputs
    ===========  ================================================================================

    The rows come from the sample world, with one deputy and with several; see `safe_inspect.testing.sample_steps`. An
    agent that is computed together with others must get the same result as on its own.

    Args:
        plugin: A plugin class, which is built from its defaults; or a plugin, if the defaults are not suitable.
        parts: Further parts of the sample world's deputy, for a plugin that refers to them.

    Raises:
        ContractError: The plugin breaks the contract; the message lists every breach with its remedy.
        TypeError: `plugin` is not a plugin.
    """
    cls = plugin if isinstance(plugin, type) else type(plugin)
    if not issubclass(cls, Plugin):
        raise TypeError(
            f"{plugin!r} is not a plugin: expected a subclass of safe_inspect.plugins.plugin.Plugin, or an instance"
        )
    name = cls.registered_name or cls.__name__
    report = Report()
    made = _build(cls, report) if isinstance(plugin, type) else plugin
    if made is not None and _check_registration(cls, report):
        check_declaration(made, report)
        if check_names(made, sample_spec(made, parts=parts, deputies=DEPUTIES), report):
            with report.attempt("the check"):
                check_behaviour(made, parts, report)
    if report.breaches:
        raise ContractError(name, report.breaches)


def _build(cls: type[Plugin], report: Report) -> Plugin | None:
    try:
        return cls()
    except ValidationError as error:
        problems = "; ".join(f"`{'.'.join(map(str, item['loc']))}`: {item['msg']}" for item in errors_of(error))
        remedy = "give every field a default that is valid, or check an object instead of the class"
        report.add("defaults", f"it does not build from its defaults ({problems})", remedy)
    except TypeError as error:
        lacks = ", ".join(f"`{method}`" for method in sorted(cls.__abstractmethods__))
        problem = f"it is abstract, without {lacks}" if lacks else str(error)
        report.add("defaults", f"it does not build from its defaults ({problem})", "define what is abstract")
    return None


def _check_registration(cls: type[Plugin], report: Report) -> bool:
    known = dict(registry.items(cls.kind)).get(cls.registered_name) if cls.registered_name else None
    return report.expect(
        known is cls,
        "registered",
        f"{cls.__name__} is not registered as a plugin",
        "extend the base of its kind, such as Reward, and define `__call__`",
    )
