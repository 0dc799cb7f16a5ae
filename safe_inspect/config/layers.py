"""Layers of an experiment: merges an experiment and the differences from it into one tree with every key in place."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Set
from typing import Any

from safe_inspect.config.loading.loader import load_if_path
from safe_inspect.config.loading.located import LocatedDict, LocatedList, locate, with_value
from safe_inspect.config.loading.merge import APPEND, merge, names_of
from safe_inspect.config.models import AgentBody, ExperimentConfig, TaskBody
from safe_inspect.errors import ConfigError, Problem

#: The keys of a task whose lists of mappings are merged from left to right.
_MERGED = ("ray_config", "env_config", "tune_config")
#: The keys of the entries of a list that may be lists themselves.
_ENTRIES = {"platform_config": ("name", "config"), "agent_config": ("name", "platforms", "config", "policy")}
#: Path of the body of a task or an agent, and the keys of both.
_BODY = ("config", "config")
_TASK_KEYS, _AGENT_KEYS = frozenset(TaskBody.model_fields), frozenset(AgentBody.model_fields)


def experiment_tree(tree: Any, path: str) -> LocatedDict:
    """Return a loaded experiment as one mapping: files given by plain paths are read, lists of mappings are merged.

    Args:
        tree: The experiment, or a list of layers: an experiment, then mappings with differences from it.
        path: Path of its file, for messages.

    Raises:
        ConfigError: It is not an experiment, or a layer does not match the layers below.
    """
    whole: Any = None
    for layer in _layers(tree):
        spelled = _spelled_out(layer, layer if whole is None else whole)
        whole = _merged(spelled if whole is None else merge([whole, spelled]), path)
    return whole if isinstance(whole, LocatedDict) else _merged(tree, path)


def _layers(tree: Any) -> Iterator[Any]:
    """Yield the layers of nested lists; anything other than a list is one layer."""
    if isinstance(tree, list) and all(isinstance(layer, (dict, list)) for layer in tree):
        for layer in tree:
            yield from _layers(layer)
    else:
        yield tree


def _merged(tree: Any, path: str) -> LocatedDict:
    """Read the files that are given by plain paths, and merge lists of mappings; any file may contain such a list."""
    if not isinstance(tree, LocatedDict) or not {"platform_config", "agent_config"} & set(tree):
        text = "not an experiment: an experiment has the keys `config`, `platform_config` and `agent_config`"
        hint = f"give the experiment file, not {os.path.basename(path)!r}"
        raise ConfigError(Problem(text, location=locate(tree, ()), hint=hint))

    def read(holder: Any, key: Any) -> None:
        if isinstance(holder, (dict, list)) and (isinstance(holder, list) or key in holder):
            value = load_if_path(holder[key], locate(holder, (key,)))
            holder[key] = merge(value) if isinstance(value, list) else value

    read(tree, "config")
    for entries, keys in _ENTRIES.items():
        items = tree[entries] if isinstance(tree.get(entries), list) else []
        for index, item in enumerate(items):
            items[index] = _entry(item, keys)
            for key in keys:
                if key in ("config", "policy"):
                    read(items[index], key)
    body = tree["config"].get("config") if isinstance(tree.get("config"), dict) else None
    if isinstance(body, LocatedDict):
        for key in _MERGED:
            if key in body:
                body[key] = merge(body[key])
        configs = body.get("rllib_configs")
        if isinstance(configs, dict):
            for key in configs:
                configs[key] = merge(configs[key])
    return tree


def _spelled_out(layer: Any, whole: Any) -> Any:
    """Return a layer of an experiment with its short keys moved to their full paths.

    A key of the task's body may be at the root, as may the name of an agent; a key of an agent's body may be in its
    entry.

    Args:
        layer: A layer; it is not changed.
        whole: The experiment below the layer, with the names of the agents.
    """
    if not isinstance(layer, LocatedDict):
        return layer
    entries = whole.get("agent_config")
    names = {name for entry in entries for name in names_of(entry)} if isinstance(entries, list) else set()
    layer = _moved(_moved(layer, _TASK_KEYS, _BODY), names - set(ExperimentConfig.model_fields), ("agent_config",))
    agents = layer.get("agent_config")
    if isinstance(agents, dict | list):
        for key in list(agents) if isinstance(agents, dict) else range(len(agents)):
            layer = with_value(layer, ("agent_config", key), _moved(agents[key], _AGENT_KEYS, _BODY), None)
    return layer


def _moved(mapping: Any, keys: Set[str], place: tuple[str, ...]) -> Any:
    """Return a mapping with some of its keys, with or without ``+``, moved to a path inside it."""
    if not isinstance(mapping, LocatedDict):
        return mapping
    moved = [key for key in mapping if str(key).removesuffix(APPEND) in keys]
    if not moved:
        return mapping
    inner, rest = (
        LocatedDict({key: mapping[key] for key in found}, mapping.marks, mapping.location)
        for found in (moved, [key for key in mapping if key not in moved])
    )
    for key in reversed(place[1:]):
        inner = LocatedDict({key: inner}, location=mapping.location)
    head, mark = place[0], locate(mapping, moved[:1])
    if head == "config" and not isinstance(rest.get(head), Mapping | None):  # a file, or a list of mappings
        own = load_if_path(rest[head], locate(rest, (head,)))
        rest[head] = LocatedList([*(own if isinstance(own, list) else [own]), inner], getattr(own, "marks", None), mark)
        return rest
    return merge([rest, LocatedDict({head: inner}, {head: mark} if mark else None, mapping.location)])


def _entry(item: Any, keys: tuple[str, ...]) -> Any:
    """Return an entry that is written as a list as a mapping with these keys."""
    if not isinstance(item, LocatedList) or len(item) > len(keys):
        return item
    marks = {key: locate(item, (index,)) for index, key in enumerate(keys[: len(item)])}
    return LocatedDict(dict(zip(keys, item, strict=False)), marks, item.location)  # type: ignore[arg-type]
