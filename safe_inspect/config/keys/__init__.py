"""The keys of RLlib, Tune and Ray that are permitted in an experiment, with the types of their values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

Shared = TypeVar("Shared")


def by_name(groups: Mapping[Shared, str]) -> dict[str, Shared]:
    """Return a table of values by name from the names, separated by spaces, that share each value."""
    return {name: value for value, names in groups.items() for name in names.split()}
