"""The filter of one deputy among others that are assumed to coast: what it keeps, and what it cannot."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError
from team_flight import TeamFlight
from team_safety import draw_teams, team_report

from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.rta import RTAGlueCWHInspection1v1
from safe_inspect.rta.constraints import NAMES, RelativeState
from safe_inspect.rta.filters.backup.safety_filter import BackupFilter
from safe_inspect.rta.filters.team.safety_filter import TeamFilter, TeamState

N, MASS, DT = 0.001027, 12.0, 10.0


@pytest.fixture(scope="module")
def team():
    return TeamFilter()


@pytest.fixture(scope="module")
def run():
    return TeamFilter(None, (*NAMES, "deputy_collision"))


class Seen:
    """What the glue reads of a view."""

    def __init__(self, state, own):
        others = [i for i in range(state.position.shape[1]) if i != own]
        self.position, self.velocity = state.position[:, own], state.velocity[:, own]
        self.others_position, self.others_velocity = state.position[:, others], state.velocity[:, others]
        self.sun_angle = state.sun_angle
        offers = SimpleNamespace(view={"sun_angle": None})
        self.world = SimpleNamespace(num_deputies=state.position.shape[1], offers=offers)


def flown(state, control, time=DT):
    p, v = state.position.copy(), state.velocity.copy()
    propagate(p, v, np.ascontiguousarray(control), *transition(N, MASS, time), p, v)
    return RelativeState(p, v, state.sun_angle + N * time)


def test_it_keeps_clear_of_others_that_coast(run, team):
    """The assumption holds: the first deputy is driven at its nearest other, and the others do coast."""
    start = draw_teams(team, 20, 3, seed=3)
    own = start.alone(0)
    others = [RelativeState(start.position[:, i], start.velocity[:, i], start.sun_angle) for i in (1, 2)]
    promised = run.recoverable(TeamState.beside(own, start.position[:, 1:], start.velocity[:, 1:]))
    assert promised.mean() > 0.6
    near = np.inf
    for _ in range(40):
        p = np.stack([other.position for other in others], axis=1)
        v = np.stack([other.velocity for other in others], axis=1)
        to = p - own.position[:, None]
        first = np.linalg.norm(to, axis=-1).argmin(axis=1)
        result = run.decentralised(own, np.sign(to[np.arange(20), first]), p, v)
        assert not (result.infeasible & promised).any()
        for time in (2.5, 5.0, 7.5, 10.0):
            later, moved = flown(own, result.control, time), [flown(x, np.zeros((20, 3)), time) for x in others]
            p, v = (np.stack([getattr(x, name) for x in moved], axis=1) for name in ("position", "velocity"))
            phi = run.phi(TeamState.beside(later, p, v), 1)
            assert all((value[promised] >= 0.0).all() for value in phi.values()), time
            near = min(near, phi["deputy_collision"][promised].min())
        own, others = later, moved
    assert near < 0.5


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


def test_without_the_constraint_or_the_others_the_glue_is_unchanged(team):
    start = draw_teams(team, 30, 3, seed=6)
    desired = np.random.default_rng(6).uniform(-1.0, 1.0, (30, 3))
    plain = BackupFilter()(start.alone(0), desired)
    without = RTAGlueCWHInspection1v1(enabled=True).filter(desired, Seen(start, 0)).result
    named = RTAGlueCWHInspection1v1(enabled=True, constraints=(*NAMES, "deputy_collision"))
    single = TeamState(start.position[:, :1], start.velocity[:, :1], start.sun_angle)
    alone = named.filter(desired, Seen(single, 0)).result
    for result in (without, alone):
        np.testing.assert_array_equal(result.control, plain.control)
        np.testing.assert_array_equal(result.active, plain.active)
        np.testing.assert_array_equal(result.phi, plain.phi)
        assert result.names == plain.names
    together = named.filter(desired, Seen(start, 0)).result
    assert together.names == (*NAMES, "deputy_collision")
    assert together.phi.shape == (30, 9)


def test_the_glue_keeps_the_radius_that_it_is_given(team):
    state, towards = head_on()
    for radius, safe in ((3.0, True), (6.9, True), (7.1, False)):
        glue = RTAGlueCWHInspection1v1(
            enabled=True, constraints=(*NAMES, "deputy_collision"), deputy_radius=radius
        )  # fmt: skip
        result = glue.filter(0.0 * towards[:, 0], Seen(state, 0)).result
        assert bool(result.infeasible[0]) is not safe
        assert result.phi[0, -1] == pytest.approx(14.0 - 2.0 * radius)


def test_a_row_does_not_depend_on_its_batch(run, team):
    start = draw_teams(team, 12, 3, seed=8)
    desired = np.random.default_rng(8).uniform(-1.0, 1.0, (12, 3))
    whole = run.decentralised(start.alone(0), desired, start.position[:, 1:], start.velocity[:, 1:])
    for i in range(12):
        part = start[i : i + 1]
        one = run.decentralised(part.alone(0), desired[i : i + 1], part.position[:, 1:], part.velocity[:, 1:])
        np.testing.assert_array_equal(one.control[0], whole.control[i])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"method": "continuous", "enabled": True}, "does not enforce 'deputy_collision'; use the method 'backup'"),
        ({"deputy_radius": 0.0}, "greater than 0"),
        ({"constraints": ("deputy_collision", "deputy_collision")}, "contain a duplicate"),
        ({"deputy_radius": 800.0, "enabled": True}, "must be less than r_max"),
        ({"constraints": (), "enabled": True}, "is empty, so the filter enforces nothing"),
        ({"disturbance": {}}, "the constraint 'deputy_collision' does not support `disturbance`"),
        (
            {"disturbance": {}, "constraints": NAMES, "method": "continuous"},
            "method 'continuous' does not support `dist",
        ),
        ({"intervention": "backup"}, "the constraint 'deputy_collision' does not support `intervention` 'backup'"),
        ({"intervention": "backup", "constraints": NAMES, "method": "continuous"}, "does not support `intervention`"),
    ],
)
def test_bad_parameters_are_named(values, message):
    with pytest.raises(ValidationError, match=message):
        RTAGlueCWHInspection1v1(**({"constraints": (*NAMES, "deputy_collision")} | values))


@pytest.mark.parametrize(
    "values",
    [{"constraints": ()}, {"constraints": NAMES, "disturbance": {}}, {"constraints": NAMES, "intervention": "backup"}],
)
def test_what_one_filter_supports_is_accepted(values):
    RTAGlueCWHInspection1v1(**values)
