"""The keys that are permitted at each position of a configuration: of models, plugins, RLlib, Tune and Ray."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from safe_inspect.config.keys import old_keys, rllib_keys, run_keys
from safe_inspect.config.loading.located import LocatedDict, has, rewritten, value_at, with_value
from safe_inspect.errors import RegistryError
from safe_inspect.plugins.functor import name_key
from safe_inspect.plugins.registry import registry

_UNIONS = (typing.Union, types.UnionType)
_TASK = ("config", "config")
_MODEL = {**rllib_keys.MODEL_KEYS, **rllib_keys.FRESH_KEYS}
_RLLIB = {*rllib_keys.COMMON_KEYS, *rllib_keys.OWN_KEYS}.union(*rllib_keys.ALGORITHM_KEYS.values())
_STOP = (*run_keys.STOP_KEYS, *run_keys.STOP_RENAMED)
#: Keys of Tune and Ray by the path below the task.
_RUN: dict[tuple[Any, ...], Collection[str]] = {
    ("tune_config",): run_keys.TUNE_KEYS.keys() - {"stop"},
    ("tune_config", "stop"): _STOP,
    ("ray_config",): run_keys.RAY_KEYS,
}


def known_keys(tree: Any, path: Sequence[Any], model: type[BaseModel] | None = None) -> set[str]:
    """Return the keys that are permitted in a mapping of the tree; none if its model is unknown.

    Args:
        tree: The tree that was validated.
        path: The path of the mapping.
        model: The model of the whole tree, if there is one. Functors on the path contain the names of their models.
    """
    annotations: list[Any] = [] if model is None else [model]
    for key in path:
        plugin = _plugin_of(tree) if key == "config" else None
        below = [found for known in annotations for found in _below(known, key)]
        annotations = below if plugin is None else [plugin]
        tree = tree[key] if has(tree, key) else None
    variants = [variant for known in annotations for variant in _variants(known)]
    keys = {info.alias or name for model in variants if _is_model(model) for name, info in model.model_fields.items()}
    return keys | {
        field.name for data in variants if dataclasses.is_dataclass(data) for field in dataclasses.fields(data)
    }


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
    plugin = _plugin_of(value)
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


def _plugin_of(functor: Any) -> type[BaseModel] | None:
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


def with_empty_mappings(tree: Any) -> Any:
    """Return an experiment with empty mappings for RLlib, Tune and Ray where no file has them.

    A tree that is not an experiment is returned unchanged.
    """
    if not isinstance(value_at(tree, _TASK), Mapping):
        return tree
    places: list[tuple[str, ...]] = [("rllib_configs",), ("tune_config",), ("tune_config", "stop"), ("ray_config",)]
    has_model = _has_model(tree)
    for name in value_at(tree, (*_TASK, "rllib_configs")) or ("default",):
        places += [("rllib_configs", name), *([] if has_model else [("rllib_configs", name, "model_config")])]
    for place in places:
        path = (*_TASK, *place)
        if not value_at(tree, path) and isinstance(value_at(tree, path[:-1]), Mapping):
            tree = with_value(tree, path, LocatedDict(), None)
    return tree


def with_configs(node: Any) -> Any:
    """Return a tree with an empty `config` for each plugin that has none."""
    if isinstance(node, list):
        return rewritten(node, map(with_configs, node))
    if not isinstance(node, Mapping):
        return node
    filled = {key: with_configs(value) for key, value in node.items()}
    if filled.get("config") is None and _plugin_of(node) is not None:
        filled["config"] = LocatedDict()
    return rewritten(node, filled)


def may_have(tree: Any, path: tuple[Any, ...], key: str, model: type[BaseModel]) -> bool:
    """Return whether the mapping at a path of a configuration with that model may contain a key."""
    if path[:3] == (*_TASK, "rllib_configs") and len(path) == 4:
        return key in _RLLIB or key in old_keys.SPELLINGS
    if path[:2] == _TASK and path[2:] in _RUN:
        return key in _RUN[path[2:]]
    if path[-1:] in (("model_config",), ("model",)):
        return key in _MODEL
    return key in known_keys(tree, path, model)


def in_plugin(tree: Any, path: tuple[Any, ...]) -> bool:
    """Return whether a path of an experiment is inside the fields of a plugin."""
    for key in path:
        if key == "config" and _plugin_of(tree) is not None:
            return True
        tree = tree[key] if has(tree, key) else None
    return False


def learning_keys(tree: Any) -> set[str]:
    """Return the keys of RLlib, Tune and Ray that are permitted in an experiment, and their other names.

    Other trees than experiments have none.
    """
    if not isinstance(value_at(tree, _TASK), Mapping):
        return set()
    keys = {*_RLLIB, *_MODEL, *run_keys.TUNE_KEYS, *run_keys.RAY_KEYS, *_STOP}
    return {name for key in keys for name in spellings(key)}


def spellings(key: str) -> Iterator[str]:
    """Yield a key, then its other names for RLlib and Tune."""
    yield key
    current = old_keys.RENAMED.get(key, old_keys.SPELLINGS.get(key, key))
    for table in (old_keys.RENAMED, old_keys.SPELLINGS, old_keys.MODEL_RENAMED, run_keys.TUNE_RENAMED):
        if key in table and "." not in table[key]:
            yield table[key]
        yield from (old for old, new in table.items() if new == current and old != key)


def _has_model(tree: Any) -> bool:
    configs = [value_at(agent, ("policy", "config")) for agent in tree.get("agent_config") or ()]
    configs += (value_at(tree, (*_TASK, "rllib_configs")) or {}).values()
    return any("model_config" in config or "model" in config for config in configs if isinstance(config, Mapping))


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
