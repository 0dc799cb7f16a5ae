"""The part of the configuration that decides the result of a training, its hash, and differences between two."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from safe_inspect.config.keys.rllib_keys import PLACE_KEYS
from safe_inspect.config.spec import PolicySpec

_MISSING = "nothing"

#: Keys of an experiment that do not affect what is learnt, or that are compared separately.
_APART = frozenset({"rllib_configs", "tune_config", "ray_config", "output_path", "TrialName"})


def learning_configuration(
    experiment: Mapping[str, Any], rllib: Mapping[str, Any], policies: Mapping[str, PolicySpec] | None = None
) -> dict[str, Any]:
    """Return the configuration that decides the result of a training.

    It contains the experiment, the settings of the algorithm and the policies. Keys that only affect where, how fast
    and how long the run computes are omitted, so that a resumed run may change them. The experiment's own
    `rllib_configs` are omitted too, because `rllib` contains their translation.

    Args:
        experiment: The resolved experiment.
        rllib: The translated settings of the algorithm.
        policies: The policies by name if there are several agents.
    """
    settings = {key: value for key, value in rllib.items() if key not in PLACE_KEYS}
    learning = {"experiment": without(experiment, _APART), "rllib_configs": settings}
    if policies:
        learning["policies"] = {
            name: {
                "name": name,
                "agents": policy.agents,
                "settings": policy.config,
                "checkpoint": policy.checkpoint,
                "source_policy": policy.source_policy,
            }
            for name, policy in policies.items()
        }
    plain: dict[str, Any] = json.loads(json.dumps(learning, default=str))
    return plain


def digest(configuration: Mapping[str, Any]) -> str:
    """Return a short hash of a configuration that does not depend on the order of its keys."""
    text = json.dumps(configuration, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def policy_agents(configuration: Mapping[str, Any]) -> str:
    """Return the names of the policies of a configuration with those of their agents, as text."""
    policies = configuration.get("policies") or {}
    if not policies:
        return "default_policy (one agent)"
    return ", ".join(f"{name} ({', '.join(policy['agents'])})" for name, policy in policies.items())


def changed_values(old: Any, new: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield the paths at which two configurations differ, with both values."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in sorted({*old, *new}):
            where = f"{path}.{key}" if path else str(key)
            yield from changed_values(old.get(key, _MISSING), new.get(key, _MISSING), where)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (left, right) in enumerate(zip(old, new, strict=True)):
            yield from changed_values(left, right, f"{path}[{index}]")
    elif old != new:
        yield path, old, new


def without(value: Any, names: Collection[str]) -> Any:
    """Return a configuration without the keys of the given names, at any depth."""
    if isinstance(value, Mapping):
        return {key: without(item, names) for key, item in value.items() if key not in names}
    return [without(item, names) for item in value] if isinstance(value, list) else value


def short_text(value: Any) -> str:
    """Return a value as text of at most 60 characters."""
    text = value if value == _MISSING else json.dumps(value, default=str)
    return text if len(text) <= 60 else f"{text[:57]}..."
