"""`episode_reports`: the values of ended episodes that a training logs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.episodes import INFO, OWN, EpisodeAccumulator
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.types import AnyArray, IntArray

#: Values of an episode by name; a path such as ``agents/blue0/delta_v`` denotes nested names.
EpisodeReport = dict[str, float]


def episode_reports(
    environment: TeamEnvironment,
    sums: EpisodeAccumulator,
    rows: Sequence[int] | IntArray,
    transition: TeamTransition,
) -> list[EpisodeReport]:
    """Return the reports of the episodes of some rows; must be called before these rows are reset.

    ``return`` and ``reward/NAME`` are sums over the controlled agents, ``delta_v`` and ``interventions`` are means over
    the deputies. With several agents ``agents/NAME/...`` contains the same values for each agent.

    Args:
        environment: The environments.
        sums: The accumulated values of their episodes.
        rows: The rows whose episodes have ended.
        transition: The last step.
    """
    rows = np.asarray(rows, dtype=np.int64)
    state, outcome = environment.state, transition.outcome[rows]
    acting = [group.first + member for group in environment.acting for member in range(group.size)]
    columns: dict[str, AnyArray] = {
        "return": sums.returns[rows][:, acting].sum(axis=1),
        "length": sums.lengths[rows].max(axis=1),
        "success_rate": outcome == DoneStatus.WIN,
        "lost_rate": outcome == DoneStatus.LOSE,
        "delta_v": state.delta_v[rows].mean(axis=1),
    }
    columns |= sums.info(rows)
    if sums.filtered:
        columns["interventions"] = state.interventions[rows].mean(axis=1)
    columns |= sums.terms(rows)
    if sums.returns.shape[1] > 1:
        for agent, figures in sums.agents(rows).items():
            columns |= {f"agents/{agent}/{name}": value for name, value in _of_agent(figures).items()}
    values = zip(*(column.astype(np.float64).tolist() for column in columns.values()), strict=True)
    return [dict(zip(columns, row, strict=True)) for row in values]


def _of_agent(figures: dict[str, AnyArray]) -> dict[str, AnyArray]:
    """Return the values of an agent by the names under which the training logs them."""
    columns: dict[str, AnyArray] = {}
    for name, value in figures.items():
        if name == "status":
            columns |= {"success": value == DoneStatus.WIN, "lost": value == DoneStatus.LOSE}
        else:
            columns[name.removeprefix(INFO).removeprefix(OWN)] = value
    return columns
