"""The keys of RLlib, Tune and Ray that are permitted in an experiment, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

T = TypeVar("T")


def by_name(groups: Mapping[T, str]) -> dict[str, T]:
    """Return a table of values by name from the names, separated by spaces, that share each value."""
    return {name: value for value, names in groups.items() for name in names.split()}
