"""Filters of the run-time assurance: from a desired control to one that keeps the constraints."""

from safe_inspect.rta.filters.backup import BackupFilter
from safe_inspect.rta.filters.base import FilterResult, SafetyFilter
from safe_inspect.rta.filters.continuous import ContinuousFilter
from safe_inspect.rta.filters.decentralised import DecentralisedFilter
from safe_inspect.rta.filters.qp import QPSolution, solve_qp
from safe_inspect.rta.filters.simplex import SimplexFilter, SimplexMemory
from safe_inspect.rta.filters.team import TeamFilter, TeamResult, TeamState

__all__ = [
    "BackupFilter",
    "ContinuousFilter",
    "DecentralisedFilter",
    "FilterResult",
    "QPSolution",
    "SafetyFilter",
    "SimplexFilter",
    "SimplexMemory",
    "TeamFilter",
    "TeamResult",
    "TeamState",
    "solve_qp",
]
