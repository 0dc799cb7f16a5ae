"""A filter keeps the constraints with the fields that they are given, or refuses the fields that it does not use."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.errors import ConfigError
from safe_inspect.rta.audit import Audit, fly_filtered, grazing_states
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import NAMES, DeputyCollision, DeputyPassiveSafety, constraint_set
from safe_inspect.rta.constraints.ranges import ChiefCollision, MaximumRange, PassivelySafeManoeuvre
from safe_inspect.rta.constraints.speeds import CrossTrackSpeed, RelativeSpeedLimit
from safe_inspect.rta.constraints.sun_cone import SunKeepOut
from safe_inspect.rta.team.safety_filter import TeamFilter

ON = "RTAGlueCWHInspection1v1.config.enabled=True"
AGENT = "agent_config.0.config.config"

#: A constraint with explicit fields, and the parameters of the task that give the same constraint.
SAME = {
    "chief_collision": (ChiefCollision(collision_radius=25.0), {"collision_radius": 25.0, "v0_distance": 10.0}),
    "rel_vel": (
        RelativeSpeedLimit(v0=0.1, v0_distance=20.0, v1=0.003081),
        {"v0": 0.1, "v0_distance": 20.0, "v1_coef": 3.0},
    ),
    "sun": (SunKeepOut(fov=2.0), {"fov": 2.0}),
    "r_max": (MaximumRange(r_max=200.0), {"r_max": 200.0}),
    "PSM": (PassivelySafeManoeuvre(horizon=1000.0), {"psm_horizon": 1000.0}),
    "z_vel": (CrossTrackSpeed(vel_limit=0.5), {"vel_limit": 0.5}),
}


def leaves(tables):
    """Return the numbers and arrays of a filter's tables."""
    return [np.asarray(value) for value in (*tables[:4], *(x for numbers in tables.constraints for x in numbers))] + [
        np.asarray(value) for value in tables[6:]
    ]


@pytest.mark.parametrize("name", SAME)
def test_a_field_that_is_given_is_worth_as_much_as_the_parameter(name):
    """The tables of the compiled filter are those of the parameters that say the same."""
    constraint, parameters = SAME[name]
    alone = name in ("chief_collision", "z_vel")  # their parameters are those of other constraints too
    given = BackupFilter({}, [constraint] if alone else [constraint, *(other for other in NAMES if other != name)])
    meant = BackupFilter(parameters, given.names)
    for one, other in zip(leaves(given._tables), leaves(meant._tables), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-14)


def test_what_is_given_for_passive_safety_is_its_own():
    tables = BackupFilter({}, ["chief_collision", PassivelySafeManoeuvre(collision_radius=20.0)])._tables
    assert (tables.constraints[0].near, tables.constraints[0].closed_near, tables.near_psm) == (10.0, 20.0, 20.0)


@pytest.mark.parametrize("name", SAME)
def test_what_is_given_is_kept(name):
    constraint = SAME[name][0]
    run = BackupFilter({}, [constraint if other == name else other for other in NAMES])
    rng, found = np.random.default_rng(3), Audit()
    fly_filtered(run, grazing_states(run, rng, 16), 12, rng, found)
    assert found.starts > 20
    assert (found.violations, found.infeasible) == (0, 0)
    assert found.least[name] >= 0.0
    assert run.constraints[name] == constraint_set({}, [constraint])[name]


def test_the_tube_is_that_of_the_given_speed_limit():
    bounds = DisturbanceBounds(velocity=1e-4, position_error=0.1)
    given = BackupFilter({}, [RelativeSpeedLimit(v1=0.01), "r_max"], disturbance=bounds)
    meant = BackupFilter({"v1_coef": 0.01 / 0.001027}, ["rel_vel", "r_max"], disturbance=bounds)
    np.testing.assert_allclose(given.tube, meant.tube, rtol=1e-12)
    with pytest.raises(ValueError, match="leave nothing of the 3 m between"):
        BackupFilter(
            {}, ["chief_collision", MaximumRange(r_max=13.0)], disturbance=DisturbanceBounds(position_error=4.0)
        )


def test_a_team_keeps_the_distances_that_are_given():
    run = TeamFilter({}, (*NAMES, DeputyCollision(deputy_radius=8.0), DeputyPassiveSafety(horizon=300.0)))
    pair = run._tables.pair
    assert (pair.constraints[0].near, pair.near_psm) == (16.0, 10.0)
    assert pair.coast_step * (len(pair.coast) - 1) == pytest.approx(300.0)
    assert run.pair_constraints["deputy_PSM"].deputy_radius == 5.0
    with pytest.raises(ValueError, match="of deputy_collision must be less than r_max"):
        TeamFilter({}, ("r_max", DeputyCollision(deputy_radius=900.0)))


@pytest.mark.parametrize(
    ("constraint", "field"),
    [
        ("{functor: sun, config: {bias: -0.05}}", "bias"),
        ("{functor: chief_collision, config: {alpha_linear: 0.5}}", "alpha_linear"),
        ("{functor: r_max, config: {alpha_cubic: 0.5}}", "alpha_cubic"),
        ("{functor: PSM, config: {mean_motion: 0.002}}", "mean_motion"),
    ],
)
def test_a_field_that_no_certificate_uses_is_refused(constraint, field):
    given = f"{AGENT}.reference_store.constraints=[rel_vel, {constraint}]"
    config = configs_root() / "translational-inspection/experiment-seed.yml"
    with pytest.raises(ConfigError) as caught:
        load_experiment(config, [ON, given]).spec  # noqa: B018
    assert f"sets `{field}`, which this filter does not use" in str(caught.value)
    assert "glues[0].config" in str(caught.value)
    load_experiment(config, [given]).spec  # noqa: B018 - the filter is off
    load_experiment(config, [ON, "RTAGlueCWHInspection1v1.config.method=continuous", given]).spec  # noqa: B018


def test_the_teams_filter_refuses_such_a_field_too():
    config = configs_root() / "multiagent-translational-inspection/experiment.yml"
    with pytest.raises(ConfigError, match="'sun' sets `bias`, which this filter does not use"):
        load_experiment(config, ["rta.config.constraints=[r_max, {functor: sun, config: {bias: -0.1}}]"]).spec  # noqa: B018


@pytest.mark.parametrize("name", ["chief_collision", "PSM"])
def test_limits_that_leave_no_position_are_refused(name):
    cls = {"chief_collision": ChiefCollision, "PSM": PassivelySafeManoeuvre}[name]
    with pytest.raises(ValueError, match=f"r_max 200.0 m does not exceed the collision_radius 300.0 m of {name}"):
        BackupFilter({}, [cls(collision_radius=300.0), MaximumRange(r_max=200.0)])


CRASH = f"{AGENT}.dones.1={{functor: CrashDoneFunction, config: {{crash_region_radius: 15}}}}"
FAR = f"{AGENT}.reference_store.constraints=[{{functor: r_max, config: {{r_max: 900}}}}]"


def test_done_functions_are_compared_with_what_is_given():
    config = configs_root() / "translational-inspection/experiment-seed.yml"
    wide = (
        f"{AGENT}.reference_store.constraints=[r_max, {{functor: chief_collision, config: {{collision_radius: 20}}}}]"
    )
    load_experiment(config, [ON, CRASH, wide]).spec  # noqa: B018
    with pytest.raises(ConfigError, match="loses beyond 800 m, but the filter allows up to 900 m"):
        load_experiment(config, [ON, FAR]).spec  # noqa: B018
    near = f"{AGENT}.reference_store.constraints=[{{functor: chief_collision, config: {{collision_radius: 5}}}}]"
    with pytest.raises(ConfigError, match="`collision_radius` is 5 m, inside the sphere of 'chief'"):
        load_experiment(config, [ON, near]).spec  # noqa: B018
