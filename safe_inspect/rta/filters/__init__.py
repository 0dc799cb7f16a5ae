"""Filters of the run-time assurance: from a desired control to one that keeps the constraints."""

from safe_inspect.rta.filters.backup import BackupFilter
from safe_inspect.rta.filters.base import FilterResult, SafetyFilter
from safe_inspect.rta.filters.continuous import ContinuousFilter
from safe_inspect.rta.filters.qp import QPSolution, solve_qp
from safe_inspect.rta.filters.simplex import SimplexFilter, SimplexMemory

__all__ = [
    "BackupFilter",
    "ContinuousFilter",
    "FilterResult",
    "QPSolution",
    "SafetyFilter",
    "SimplexFilter",
    "SimplexMemory",
    "solve_qp",
]
