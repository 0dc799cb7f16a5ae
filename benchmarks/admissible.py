"""Which controls a filter applies unchanged, by the exact test of the filter."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh import row_state
from safe_inspect.rta.backup.model import PLANS
from safe_inspect.rta.backup.plans import NO_PLAN
from safe_inspect.rta.backup.search import MARGINS, verified
from safe_inspect.rta.backup.workspace import MAX_HALF_SPACES, as_int, workspace
from safe_inspect.rta.team.motions import enter
from safe_inspect.rta.team.plans import PASSED, tested
from safe_inspect.rta.team.safety_filter import TeamFilter
from safe_inspect.rta.team.workspace import team_workspace


def admissible(run: Any, state: Any, control: np.ndarray) -> np.ndarray:
    """Return the rows, or the environments of a team, whose controls are within the limits and safe, shape (R,)."""
    arrays, control = (state.position, state.velocity, state.sun_angle), np.array(control, order="C")
    alone = run.alone if isinstance(run, TeamFilter) else run
    within = (np.abs(control) <= alone.parameters.u_max).reshape(len(state), -1).all(axis=1)
    found = np.empty(len(state), np.bool_)
    if isinstance(run, TeamFilter):
        control[state.fixed] = 0.0
        _of_teams(run._model, *arrays, control, state.fixed, found)
    else:
        _of_one(run._model, *arrays, control, found)
    return found & within


@njit(error_model="numpy")
def _of_one(m: Any, position: Any, velocity: Any, sun_angle: Any, control: Any, found: Any) -> None:
    s = workspace(as_int(1))
    for i in range(position.shape[0]):
        x, sun = row_state(position[i], velocity[i]), (math.cos(sun_angle[i]), math.sin(sun_angle[i]))
        found[i] = verified(m, x, sun, control[i], as_int(NO_PLAN), s)[1] != NO_PLAN


@njit(error_model="numpy")
def _of_teams(
    g: Any, position: Any, velocity: Any, sun_angle: Any, control: Any, fixed: Any, found: Any
) -> None:  # fmt: skip
    s, t = workspace(as_int(MAX_HALF_SPACES)), team_workspace(position.shape[1])
    none, plans = np.zeros(position.shape[1], np.int64), np.zeros((position.shape[1], 10))
    for row in range(position.shape[0]):
        enter(g.one, position[row], velocity[row], control[row], fixed[row], none, plans, t)
        sun = (math.cos(sun_angle[row]), math.sin(sun_angle[row]))
        found[row] = tested(g, sun, t.desired, MARGINS, as_int(PLANS), False, t, s)[0] == PASSED
