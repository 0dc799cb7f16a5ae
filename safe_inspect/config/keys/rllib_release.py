"""`keys_of_release`: the names of all keys of RLlib's algorithms, to find wrong names without loading Ray."""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

#: File that is written by ``scripts/rllib_keys.py`` from the pinned release of Ray.
RELEASE = Path(__file__).with_name("rllib_release.json")


def keys_of_release(algorithm: str) -> frozenset[str] | None:
    """Return the names of the keys of an algorithm.

    The result is None if another release of Ray than that of the list is installed: its names are known only when it is
    loaded.

    Args:
        algorithm: Name of the algorithm.
    """
    listed, installed = _listed(), _installed()
    if installed not in (None, listed["ray"]):
        return None
    return frozenset(listed["every algorithm"]) | frozenset(listed[algorithm])


@lru_cache
def _listed() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(RELEASE.read_text(encoding="utf-8"))
    return found


@lru_cache
def _installed() -> str | None:
    try:
        return version("ray")
    except PackageNotFoundError:
        return None
