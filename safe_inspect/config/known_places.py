"""Positions at which a key is permitted, even if no file has it: from models, fields of plugins and RLlib's tables."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from safe_inspect.config.fields import known_keys, plugin_of
from safe_inspect.config.keys import old_keys, rllib_keys, run_keys
from safe_inspect.config.loading.located import LocatedDict, has, rewritten, value_at, with_value

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
    if filled.get("config") is None and plugin_of(node) is not None:
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
        if key == "config" and plugin_of(tree) is not None:
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
