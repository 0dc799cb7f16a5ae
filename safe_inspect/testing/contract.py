"""`check_plugin`: the contract that every plugin must satisfy, whether it is part of this package or not.

This module also checks a plugin's declaration: its fields, its documentation, and whether it can be written to YAML and
read; `safe_inspect.testing.kinds` checks its results.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.errors import did_you_mean
from safe_inspect.platforms.base import Part
from safe_inspect.plugins.functor import build, describe, errors_of
from safe_inspect.plugins.plugin import Plugin, documented_fields
from safe_inspect.plugins.registry import registry
from safe_inspect.testing.kinds import CHECKS
from safe_inspect.testing.report import ContractError, Report
from safe_inspect.testing.samples import DEPUTIES, sample_spec

_UNKNOWN = "no_such_field"
#: Other notations of a unit in a docstring.
_SAME = {"Hz": ("1/s",), "m/s^2": ("m/s2", "m/s**2"), "rad/s": ("1/s",)}


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
    done         bool (R,); the class has a `status`; for all agents, a `DoneStatus` or 0, int (N,)
    part         sensor: float (R, size) within its limits; controller: thrust [N] (R, 3)
    glue         names and bounds; an observation float (R, size) within them, or thrust [N] (R, 3)
    parameter    float (R,), or named states; an attitude and angular velocity must be those of a tumble
    initializer  named states, position and velocity (R, 3)
    normalizer   float (R, k); `inverse` restores the values
    constraint   phi, h and rate float (R,), gradient float (R, 6), the derivative of h; a `half_space` agrees with phi
    component    a motion within its `disturbance_bounds`
    dynamics     a motion within its `disturbance_bounds` about the Clohessy-Wiltshire motion
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
        _check_strictness(cls, report)
        _check_documentation(cls, report)
        _check_values(made, report)
        _check_yaml(made, report)
        if _check_names(made, sample_spec(made, parts=parts, deputies=DEPUTIES), report):
            with report.attempt("the check"):
                if made.kind in CHECKS:  # there is no check for a kind that is not part of this package
                    CHECKS[made.kind](made, parts, report)
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


def _check_names(plugin: Plugin, spec: EnvironmentSpec, report: Report) -> bool:
    """Check that what the plugin's fields refer to exists in the sample world; return whether it does."""
    known = spec.names(spec.agents[0])
    sound = True
    for field, kind in plugin.references().items():
        value = getattr(plugin, field)
        if value is not None:
            sound &= report.expect(
                value in known[kind],
                "names",
                f"`{field}` names the {kind} {value!r}, which the sample world does not have",
                f"{did_you_mean(value, known[kind])}; or check an instance that names one, or give further `parts`",
            )
    return sound


def _check_strictness(cls: type[Plugin], report: Report) -> None:
    report.expect(
        cls.model_config.get("frozen"),
        "frozen",
        f"{cls.__name__} can be changed after it is built",
        "leave `frozen=True` in model_config; what must be remembered is a declared array of the state",
    )
    for field, model in _models(cls, set()):
        report.expect(
            model.model_config.get("frozen") and model.model_config.get("extra") == "forbid",
            "strict",
            f"the model {model.__name__} of the field `{field}` can be changed, or accepts keys that it does not have",
            'give it model_config = ConfigDict(frozen=True, extra="forbid")',
        )


def _models(cls: type[BaseModel], seen: set[type]) -> Iterator[tuple[str, type[BaseModel]]]:
    """Yield the models in a model's fields, at any depth, except plugins."""
    for field, info in cls.model_fields.items():
        for part in _annotations(info.annotation):
            if not (isinstance(part, type) and issubclass(part, BaseModel)) or issubclass(part, Plugin) or part in seen:
                continue
            seen.add(part)
            yield field, part
            yield from _models(part, seen)


def _annotations(annotation: Any) -> Iterator[Any]:
    yield annotation
    for argument in getattr(annotation, "__args__", ()):
        yield from _annotations(argument)


def _unit(info: Any) -> str:
    """Return the SI unit of a field, or an empty text if it has none."""
    found = [info, *(mark for part in _annotations(info.annotation) for mark in getattr(part, "__metadata__", ()))]
    for mark in found:
        extra = getattr(mark, "json_schema_extra", None)
        if isinstance(extra, dict) and extra.get("units"):
            return str(extra["units"])
    return ""


def _check_documentation(cls: type[Plugin], report: Report) -> None:
    summary = inspect.cleandoc(vars(cls).get("__doc__") or "").partition("\n\n")[0]
    report.expect(
        summary.endswith((".", ":")),
        "documented",
        f"{cls.__name__} has no docstring" if not summary else f"the docstring begins with {summary!r}, not a sentence",
        "start with a sentence that says what it computes and ends in a full stop; `safe-inspect list` shows it",
    )
    documented = documented_fields(cls)
    for field, info in cls.model_fields.items():
        if not report.expect(
            documented.get(field),
            "documented",
            f"the docstring does not say what the field `{field}` is",
            f'add "{field}: ..." to the section "Attributes:"',
        ):
            continue
        unit = _unit(info)
        report.expect(
            not unit or any(f"[{name}]" in documented[field] for name in (unit, *_SAME.get(unit, ()))),
            "units",
            f"the docstring does not name the unit of the field `{field}`",
            f"end its sentence with [{unit}]",
        )
    for field in documented:
        report.expect(
            field in cls.model_fields or hasattr(cls, field),
            "documented",
            f"the docstring documents a field `{field}` that {cls.__name__} does not have",
            did_you_mean(field, cls.model_fields),
        )


def _check_values(plugin: Plugin, report: Report) -> None:
    cls = type(plugin)
    fields = {name: getattr(plugin, name) for name in cls.model_fields}
    if _accepts(cls, {**fields, _UNKNOWN: 1}):
        report.add(
            "strict",
            f"{cls.__name__} accepts the key `{_UNKNOWN}`, so a misspelt key goes unnoticed",
            'leave `extra="forbid"` in model_config, and let no validator drop keys',
        )
    for name in fields:
        if _accepts(cls, {**fields, name: object()}):
            report.add("strict", f"the field `{name}` accepts any object", "annotate it with its type")


def _accepts(cls: type[Plugin], fields: dict[str, Any]) -> bool:
    try:
        cls.model_validate(fields)
    except Exception:  # This rule only requires a rejection, whatever the exception.
        return False
    return True


def _check_yaml(plugin: Plugin, report: Report) -> None:
    remedy = "let every field hold plain values (numbers, texts, lists, mappings) or further plugins"
    try:
        text = yaml.safe_dump(describe(plugin), sort_keys=False)
    except Exception as error:
        report.add("yaml", f"it cannot be written as YAML ({error})", remedy)
        return
    try:
        again = build(plugin.kind, yaml.safe_load(text))
    except Exception as error:
        errors = (getattr(error, "context", None) or {}).get("errors", [{"msg": str(error)}])
        problems = "; ".join(f"{'.'.join(map(str, item.get('loc', ())))}: {item['msg']}" for item in errors)
        report.add("yaml", f"what it writes as YAML cannot be read again ({problems})", remedy)
        return
    report.expect(again == plugin, "yaml", f"it comes back from YAML changed: {again!r} from {plugin!r}", remedy)
