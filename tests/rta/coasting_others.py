"""One deputy under the filter of a team whose other deputies coast."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from safe_inspect.rta.constraints import RelativeState
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState


def among_coasting(state: RelativeState, position: np.ndarray, velocity: np.ndarray) -> TeamState:
    """Return the motion of one deputy, which becomes the first, and of others that coast, shape (R, D - 1, 3)."""
    coasting = np.ones((len(state), position.shape[1] + 1), np.bool_)
    coasting[:, 0] = False
    p, v = ((state.position, position), (state.velocity, velocity))
    both = (np.concatenate((own[:, None], others), axis=1) for own, others in (p, v))
    return TeamState(*both, state.sun_angle, coasting)


def filtered_first(
    run: TeamFilter, state: RelativeState, desired: np.ndarray, position: np.ndarray, velocity: np.ndarray
) -> Any:
    """Return what the filter of the team decides for the first deputy."""
    team = among_coasting(state, position, velocity)
    wanted = np.zeros(team.position.shape)
    wanted[:, 0] = desired
    found = run(team, wanted)
    return SimpleNamespace(
        control=np.ascontiguousarray(found.control[:, 0]), active=np.ascontiguousarray(found.active[:, 0]),
        infeasible=found.infeasible, backup=found.backup,
    )  # fmt: skip
