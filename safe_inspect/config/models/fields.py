"""Which model checks a place of a configuration, and so which keys are known there."""

from __future__ import annotations

import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from safe_inspect.config.loading.located import has
from safe_inspect.errors import RegistryError
from safe_inspect.plugins.functor import name_key
from safe_inspect.plugins.registry import registry


def known_keys(tree: Any, path: Sequence[Any], model: type[BaseModel] | None = None) -> set[str]:
    """Return the keys that a mapping of the tree may have; none when no model is known for it.

    Args:
        tree: The tree that was validated.
        path: The path of the mapping.
        model: The model of the whole tree, when there is one. Functors on the path name their own.
    """
    annotations: list[Any] = [] if model is None else [model]
    for key in path:
        plugin = _plugin(tree) if key == "config" else None
        below = [found for known in annotations for found in _below(known, key)]
        annotations = below if plugin is None else [plugin]
        tree = tree[key] if has(tree, key) else None
    return {name for known in annotations for variant in _models(known) for name in _keys(variant)}


def _plugin(functor: Any) -> type[BaseModel] | None:
    """Return the class that a functor's mapping names."""
    if not isinstance(functor, Mapping):
        return None
    for kind in registry.kinds():
        name = functor.get(name_key(kind))
        if isinstance(name, str):
            try:
                return registry.get(kind, name)
            except RegistryError:
                continue
    return None


def _keys(model: type[BaseModel]) -> set[str]:
    return {info.alias or name for name, info in model.model_fields.items()}


def _below(annotation: Any, key: Any) -> Iterator[Any]:
    """Yield the annotations of what a key or an index holds."""
    for variant in _variants(annotation):
        if isinstance(variant, type) and issubclass(variant, BaseModel):
            yield from (info.annotation for name, info in variant.model_fields.items() if key in (name, info.alias))
        else:
            # The items of a list or a tuple[X, ...], the values of a dict.
            yield from [found for found in typing.get_args(variant) if found is not Ellipsis][-1:]


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    yield from (v for v in _variants(annotation) if isinstance(v, type) and issubclass(v, BaseModel))


def _variants(annotation: Any) -> Iterator[Any]:
    """Yield what an annotation consists of: the members of unions, without ``Annotated``."""
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        yield from _variants(typing.get_args(annotation)[0])
    elif origin in (typing.Union, types.UnionType):
        for member in typing.get_args(annotation):
            yield from _variants(member)
    else:
        yield annotation
