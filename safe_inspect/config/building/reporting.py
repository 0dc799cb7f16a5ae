"""How the builders say where a mistake is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

#: Keys and indices that lead to a place of the configuration.
KeyTuple = tuple[Any, ...]
#: Takes the place and the text of a problem.
ReportProblem = Callable[[KeyTuple, str], None]
