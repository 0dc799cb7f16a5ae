"""Objects that an experiment names by dotted paths, such as `{functor: module.Class, config: {...}}`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar, cast

from safe_inspect.errors import ConfigError, Problem, RegistryError
from safe_inspect.plugins.registry import import_user_module

_Kind = TypeVar("_Kind")


def _built(value: Any, where: str) -> Any:
    """Return a configuration value in which every `{functor: ..., config: {...}}` is replaced by the object it names.

    Args:
        value: The value; mappings and lists are searched at any depth.
        where: Path of the key, for error messages.

    Raises:
        ConfigError: A class does not exist, or it rejects its `config`.
    """
    if isinstance(value, list):
        return [_built(item, where) for item in value]
    if not isinstance(value, Mapping):
        return value
    if "functor" not in value or set(value) - {"functor", "config"}:
        return {key: _built(item, where) for key, item in value.items()}
    maker = _named(str(value["functor"]), where)
    config = _built(value.get("config") or {}, where)
    try:
        return maker(**config)
    except Exception as error:  # code of the user or of Ray, which may raise any error
        raise ConfigError(Problem(f"{value['functor']} rejects its `config`: {error}", where)) from error


def built_as(kind: type[_Kind], what: str, entry: Mapping[str, Any], where: str) -> _Kind:
    """Return the object that `{functor: ..., config: {...}}` names, in whose `config` such mappings are objects too.

    Args:
        kind: The class of which it must be an instance.
        what: What it must be, for error messages.
        entry: The mapping.
        where: Path of the key, for error messages.

    Raises:
        ConfigError: The class does not exist, rejects its `config`, or is not of the kind.
    """
    made = _built(entry, where)
    if not isinstance(made, kind):
        raise ConfigError(Problem(f"{entry['functor']!r} is not {what}", where))
    return made


def _named(path: str, where: str) -> Callable[..., Any]:
    """Return the class or function that a dotted path names.

    Raises:
        ConfigError: There is no such class or function.
    """
    module, _, attribute = path.rpartition(".")
    try:
        maker = getattr(import_user_module(module), attribute, None)
    except RegistryError as error:
        raise ConfigError(Problem(str(error), where)) from error
    if not callable(maker):
        raise ConfigError(Problem(f"module {module!r} has no {attribute!r}", where))
    return cast(Callable[..., Any], maker)


def class_of(kind: type, what: str, path: str, where: str) -> type[Any]:
    """Return the subclass of a class that a dotted path names, see `built_as`.

    Raises:
        ConfigError: There is no such class, or it is not a subclass.
    """
    found = _named(path, where)
    if not isinstance(found, type) or not issubclass(found, kind):
        raise ConfigError(Problem(f"{path!r} is not {what}", where))
    return found
