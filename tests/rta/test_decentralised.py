"""Filters of single deputies, each of which assumes that the others coast, do not keep these apart."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from team_flight import TeamFlight
from team_safety import draw_teams, team_report

from safe_inspect.rta import RTAGlueCWHInspection1v1
from safe_inspect.rta.constraints import NAMES
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState


@pytest.fixture(scope="module")
def team():
    return TeamFilter()


def head_on():
    """Return two deputies 14 m apart along the track that are driven at each other."""
    position = np.array([[[0.0, 67.0, 0.0], [0.0, 53.0, 0.0]]])
    state = TeamState(position, np.zeros((1, 2, 3)), np.zeros(1))
    return state, np.array([[[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]]])


def test_head_on_the_decentralised_breaks_and_the_centralised_does_not(team):
    state, towards = head_on()
    assert team.recoverable(state).all()
    least = {}
    for kind in ("decentralised", "centralised"):
        flight = TeamFlight(kind, team, state, 10)
        for _ in range(6):
            flight.fly(flight.filtered(towards)[0])
        least[kind] = flight.closest[0]
    assert least["decentralised"] < 10.0
    assert least["centralised"] >= 10.0


def test_under_adversaries_runs_collide(team):
    start = draw_teams(team, 14, 3, seed=4)
    report = team_report("decentralised", team, start, 14 * 25, seed=4, substeps=2)
    assert report.broken_runs[report.names.index("deputy_collision")] >= 2
    alone = [j for j, name in enumerate(report.names) if name != "deputy_collision"]
    assert report.violations_at_steps[alone].sum() == 0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"constraints": ("r_max", "r_max")}, "is given twice"),
        ({"constraints": (*NAMES, "deputy_collision")}, "'deputy_collision' is about two deputies; remove it, and use"),
        ({"constraints": (), "enabled": True}, "is empty, so the filter enforces nothing"),
        ({"disturbance": {}, "method": "continuous"}, "method 'continuous' does not support `disturbance`"),
        ({"intervention": "backup", "method": "continuous"}, "does not support `intervention`"),
    ],
)
def test_bad_parameters_are_named(values, message):
    with pytest.raises(ValidationError, match=message):
        RTAGlueCWHInspection1v1(**values)


@pytest.mark.parametrize(
    "values",
    [{"constraints": ()}, {"constraints": NAMES, "disturbance": {}}, {"constraints": NAMES, "intervention": "backup"}],
)
def test_what_one_filter_supports_is_accepted(values):
    RTAGlueCWHInspection1v1(**values)
