"""The models that validate each position of a configuration, and the keys that are permitted there."""

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

_UNIONS = (typing.Union, types.UnionType)


def known_keys(tree: Any, path: Sequence[Any], model: type[BaseModel] | None = None) -> set[str]:
    """Return the keys that are permitted in a mapping of the tree; none if its model is unknown.

    Args:
        tree: The tree that was validated.
        path: The path of the mapping.
        model: The model of the whole tree, if there is one. Functors on the path contain the names of their models.
    """
    annotations: list[Any] = [] if model is None else [model]
    for key in path:
        plugin = plugin_of(tree) if key == "config" else None
        below = [found for known in annotations for found in _below(known, key)]
        annotations = below if plugin is None else [plugin]
        tree = tree[key] if has(tree, key) else None
    models = [model for known in annotations for model in _variants(known) if _is_model(model)]
    return {info.alias or name for model in models for name, info in model.model_fields.items()}


def written_values(
    mark: str, tree: Mapping[Any, Any], model: type[BaseModel], path: tuple[Any, ...] = ()
) -> Iterator[tuple[tuple[Any, ...], Any, Any]]:
    """Yield the values of a tree whose fields have a mark in their JSON schema: path, value and value of the mark.

    Args:
        mark: The key of `json_schema_extra`, such as ``units``.
        tree: A tree that is valid for the model. Functors contain the names of the models of their fields.
        model: The model.
        path: The path of the tree.
    """
    for name, info in model.model_fields.items():
        key = info.alias if info.alias in tree else name
        if key in tree:
            yield from _marked(mark, tree[key], info.annotation, [info], (*path, key))


def _marked(
    mark: str, value: Any, annotation: Any, metadata: Sequence[Any], path: tuple[Any, ...]
) -> Iterator[tuple[tuple[Any, ...], Any, Any]]:
    if typing.get_origin(annotation) is typing.Annotated:
        annotation, *metadata = typing.get_args(annotation)
    plugin = plugin_of(value)
    if plugin is not None:
        if isinstance(value.get("config"), Mapping):
            yield from written_values(mark, value["config"], plugin, (*path, "config"))
        return
    extras = [getattr(item, "json_schema_extra", None) for item in metadata]
    said = next((extra[mark] for extra in extras if isinstance(extra, Mapping) and mark in extra), None)
    if said is not None and not isinstance(value, (list, Mapping)):
        yield path, value, said
    if typing.get_origin(annotation) in _UNIONS:
        for variant in typing.get_args(annotation):
            yield from _marked(mark, value, variant, metadata, path)
    elif isinstance(value, Mapping) and _is_model(annotation):
        yield from written_values(mark, value, annotation, path)
    elif isinstance(value, list):
        items = [item for item in typing.get_args(annotation) if item is not Ellipsis]
        for index, item in enumerate(value if items else ()):
            yield from _marked(mark, item, items[min(index, len(items) - 1)], (), (*path, index))


def plugin_of(functor: Any) -> type[BaseModel] | None:
    """Return the class that a functor's mapping names, or None for any other value."""
    if not isinstance(functor, Mapping):
        return None
    for kind in registry.kinds():
        name = functor.get(name_key(kind, functor))
        if isinstance(name, str):
            try:
                return registry.get(kind, name)
            except RegistryError:
                continue
    return None


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _below(annotation: Any, key: Any) -> Iterator[Any]:
    """Yield the annotations of the values of a key or an index."""
    for variant in _variants(annotation):
        if _is_model(variant):
            yield from (info.annotation for name, info in variant.model_fields.items() if key in (name, info.alias))
        else:
            # This is the type of items of a list or a tuple[X, ...], or of values of a dict.
            yield from [found for found in typing.get_args(variant) if found is not Ellipsis][-1:]


def _variants(annotation: Any) -> Iterator[Any]:
    """Yield the parts of an annotation: the members of unions, without ``Annotated``."""
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        yield from _variants(typing.get_args(annotation)[0])
    elif origin in _UNIONS:
        for member in typing.get_args(annotation):
            yield from _variants(member)
    else:
        yield annotation
