"""Safety filters: each changes a desired control to one that satisfies the constraints."""

from safe_inspect.rta.filters.backup.safety_filter import BackupFilter
from safe_inspect.rta.filters.base import SafetyFilter
from safe_inspect.rta.filters.continuous import ContinuousFilter
from safe_inspect.rta.filters.simplex import SimplexFilter, SimplexMemory
from safe_inspect.rta.filters.team.decentralised import DecentralisedFilter
from safe_inspect.rta.filters.team.safety_filter import TeamFilter, TeamResult, TeamState
from safe_inspect.rta.filters.tube.safety_filter import TubeFilter
from safe_inspect.rta.numerics.qp import QPSolution, solve_qp

__all__ = [
    "BackupFilter",
    "ContinuousFilter",
    "DecentralisedFilter",
    "QPSolution",
    "SafetyFilter",
    "SimplexFilter",
    "SimplexMemory",
    "TeamFilter",
    "TeamResult",
    "TeamState",
    "TubeFilter",
    "solve_qp",
]
