"""References of an agent configuration: values that are written once, in its `reference_store`, and used by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from safe_inspect.config.loading.located import LocatedDict, LocatedList, locate, path_text
from safe_inspect.errors import ConfigError, Location, Problem, UnitError, did_you_mean
from safe_inspect.plugins.aliases import ALIASES
from safe_inspect.units import unit

STORE = "reference_store"
REFERENCES = "references"


def expand_references(tree: Any, problems: list[Problem] | None = None) -> Any:
    """Put the value of the store in place of every reference to it.

    A mapping with ``references: {field: key}`` gets ``config[field] = store[key]``
    and loses ``references``. The store is the ``reference_store`` of the nearest
    mapping around it. An error about such a value points at the reference.

    Args:
        tree: A loaded configuration.
        problems: Takes the mistakes, so that a caller can report them with others; they are raised unless given.

    Returns:
        A new tree; the given one is not changed. A wrong reference leaves its field out.

    Raises:
        ConfigError: With every reference to nothing, and every field that ``config`` gives as well.
    """
    found: list[Problem] = []
    expanded = _expand(tree, None, (), found, tree)
    if found and problems is None:
        raise ConfigError(found)
    if problems is not None:
        problems += found
    return expanded


def _expand(node: Any, store: Any, path: tuple[Any, ...], problems: list[Problem], root: Any) -> Any:
    if isinstance(node, list):
        items = [_expand(item, store, (*path, index), problems, root) for index, item in enumerate(node)]
        return LocatedList(items, getattr(node, "marks", None), getattr(node, "location", None))
    if not isinstance(node, Mapping):
        return node
    store = node.get(STORE, store)
    items_of = {
        key: value if key in (STORE, REFERENCES) else _expand(value, store, (*path, key), problems, root)
        for key, value in node.items()
    }
    expanded = LocatedDict(items_of, getattr(node, "marks", None), getattr(node, "location", None))
    if REFERENCES in node:
        _resolve(expanded, store, path, problems, root)
    return expanded


def _resolve(functor: LocatedDict, store: Any, path: tuple[Any, ...], problems: list[Problem], root: Any) -> None:
    """Move the references of one mapping into its `config`."""

    def wrong(where: tuple[Any, ...], message: str, hint: str = "") -> None:
        full = (*path, *where)
        problems.append(Problem(message, path_text(full), locate(root, full), hint))

    references = functor.pop(REFERENCES)
    mark = functor.marks.pop(REFERENCES, None)
    if references is None:
        return
    if not isinstance(references, Mapping):
        wrong((REFERENCES,), f"a mapping of fields to keys of the `{STORE}` is wanted here, got {references!r}")
        return
    if not isinstance(store, Mapping):
        wrong((REFERENCES,), f"there is no `{STORE}` to refer to", f"add a mapping `{STORE}` to the agent's `config`")
        return
    given = functor.get("config")
    if given is not None and not isinstance(given, Mapping):
        wrong(("config",), f"a mapping of fields is wanted here, got {given!r}")
        return
    if given is None:
        config = LocatedDict(location=mark)
    else:
        config = LocatedDict(given, getattr(given, "marks", None), getattr(given, "location", None))
    for field, key in references.items():
        where = (REFERENCES, field)
        if field in config:
            line = locate(root, (*path, "config", field))
            also = f"`{field}` is given in `config` too" + (f" ({line})" if line else "")
            wrong(where, also, "remove one of them")
        elif not isinstance(key, str):
            hint = f"give a value of its own in `config.{field}`"
            wrong(where, f"a key of the `{STORE}` is wanted here, got {key!r}", hint)
        elif key not in store:
            wrong(where, f"the `{STORE}` has no key `{key}`", did_you_mean(key, store))
        else:
            place = locate(root, (*path, *where))
            config[field] = _value(store[key], place)
            if place is not None:
                config.marks[field] = place
    functor["config"] = config
    if mark is not None:
        functor.marks.setdefault("config", mark)


def _value(stored: Any, place: Location | None) -> Any:
    """Return what a stored value means; a constant parameter of the peer's is its value, with any units."""
    if isinstance(stored, Mapping) and _is_constant(stored.get("type")):
        config = stored.get("config")
        if isinstance(config, Mapping) and "value" in config:
            value, units = config["value"], config.get("units")
            stored = value if _is_pure(value, units) else LocatedDict({"value": value, "units": units})
    if isinstance(stored, Mapping):
        return LocatedDict(stored, getattr(stored, "marks", None), place)
    if isinstance(stored, list):
        return LocatedList(stored, getattr(stored, "marks", None), place)
    return stored


def _is_constant(name: Any) -> bool:
    return isinstance(name, str) and ALIASES.get(name, name).rpartition(".")[2] == "ConstantParameter"


def _is_pure(value: Any, units: Any) -> bool:
    """Return whether a value stands for itself: it is no number, or one without a dimension."""
    if units is None or isinstance(value, bool) or not isinstance(value, (int, float)):
        return True
    try:
        return unit(str(units)).symbol == ""
    except UnitError:
        return False  # the field that takes the value names the nearest unit
