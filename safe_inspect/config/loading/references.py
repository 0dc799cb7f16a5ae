"""References of an agent's configuration: named values that are written once, in its `reference_store`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from safe_inspect.config.loading.located import LocatedDict, Place, locate, rewritten
from safe_inspect.errors import Location, Problem, UnitError, did_you_mean
from safe_inspect.units import unit

STORE = "reference_store"
_REFERENCES = "references"


def expand_references(tree: Any, problems: list[Problem]) -> Any:
    """Replace every reference by its value in the store.

    A mapping with ``references: {field: key}`` gets ``config[field] = store[key]``, and its
    ``references`` are removed. The store is the ``reference_store`` of the nearest
    mapping around it. An error about such a value has the location of the value in the store.

    Args:
        tree: A loaded configuration.
        problems: List to which mistakes are added: references without a target, and fields that are also in ``config``.

    Returns:
        A new tree; the given one is not changed. A field with a wrong reference is left out.
    """
    return _expand(tree, None, Place(tree, problems))


def _expand(node: Any, store: Any, place: Place) -> Any:
    if isinstance(node, list):
        return rewritten(node, [_expand(item, store, place.at(index)) for index, item in enumerate(node)])
    if not isinstance(node, Mapping):
        return node
    store = node.get(STORE, store)
    items = {
        key: value if key in (STORE, _REFERENCES) else _expand(value, store, place.at(key))
        for key, value in node.items()
    }
    expanded: LocatedDict = rewritten(node, items)
    if _REFERENCES in node:
        _resolve(expanded, store, place)
    return expanded


def _resolve(functor: LocatedDict, store: Any, place: Place) -> None:
    """Move the references of one mapping into its `config`."""
    own = place.at(_REFERENCES)
    references = functor.pop(_REFERENCES)
    mark = functor.marks.pop(_REFERENCES, None)
    if references is None:
        return
    if not isinstance(references, Mapping):
        own.report(f"expected a mapping of fields to keys of the `{STORE}`, got {references!r}")
        return
    if not isinstance(store, Mapping):
        own.report(f"there is no `{STORE}` to refer to", hint=f"add a mapping `{STORE}` to the agent's `config`")
        return
    given = functor.get("config")
    if given is not None and not isinstance(given, Mapping):
        place.report(f"expected a mapping of fields, got {given!r}", "config")
        return
    config = LocatedDict(location=mark) if given is None else rewritten(given)
    for field, key in references.items():
        if field in config:
            line = locate(place.tree, place.at("config", field).path)
            also = f"`{field}` is also in `config`" + (f" ({line})" if line else "")
            own.report(also, field, hint=f"remove it there, and set `{STORE}.{key}` instead")
        elif not isinstance(key, str):
            hint = f"put the value itself into `config.{field}`"
            own.report(f"expected a key of the `{STORE}`, got {key!r}", field, hint=hint)
        elif key not in store:
            own.report(f"the `{STORE}` has no key `{key}`", field, hint=did_you_mean(key, store))
        else:
            where = getattr(store, "marks", {}).get(key) or locate(own.tree, own.at(field).path)
            config[field] = _value(store[key], where)
            if where is not None:
                config.marks[field] = where
    functor["config"] = config
    if mark is not None:
        functor.marks.setdefault("config", mark)


def _value(stored: Any, place: Location | None) -> Any:
    """Return the meaning of a stored value; a constant parameter of safe-autonomy-sims becomes its value with units."""
    if isinstance(stored, Mapping) and str(stored.get("type")).rpartition(".")[2] == "ConstantParameter":
        config = stored.get("config")
        if isinstance(config, Mapping) and "value" in config:
            value, units = config["value"], config.get("units")
            stored = value if _is_pure(value, units) else LocatedDict({"value": value, "units": units})
    if isinstance(stored, Mapping | list) and getattr(stored, "location", None) is None:
        stored = rewritten(stored)
        stored.location = place
    return stored


def _is_pure(value: Any, units: Any) -> bool:
    """Return whether a value has no unit: it is not a number, or a dimensionless one."""
    if units is None or isinstance(value, bool) or not isinstance(value, (int, float)):
        return True
    try:
        return unit(str(units)).symbol == ""
    except UnitError:
        return False  # the field that takes the value names the nearest unit
