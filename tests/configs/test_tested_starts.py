"""Which initial states the filters of a team test at a reset, which they only warn of, and how far apart they are."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.errors import UnsafeInitialStateWarning
from safe_inspect.rta.rejection_sampler import RejectionSampler

ONE, TEAM, MIXED = (
    "translational-inspection/experiment.yml",
    "multiagent-translational-inspection/experiment.yml",
    "multiagent-translational-inspection/experiment-mixed.yml",
)
_OWN = "agent_config.{}.config.config.glues.0.config.enabled=True"
_FIXED = (
    "agent_config.{}.config.config.simulator_reset_parameters={{initializer: {{functor: PositionVelocityInitializer}}, "
    "config: {{x: 60, y: 0, z: 0, x_dot: 0, y_dot: 0, z_dot: 0}}}}"
)
_RTA = "config.config.env_config.rta.config.enabled"


def loaded(file: str, *overrides: str) -> EnvironmentSpec:
    return load_experiment(configs_root() / file, overrides).spec


def sampler(spec: EnvironmentSpec) -> RejectionSampler:
    found = spec.reset.parameters["init_state"]
    assert isinstance(found, RejectionSampler)
    return found


@pytest.mark.parametrize(
    ("file", "overrides", "tests", "watched"),
    [
        (ONE, [], 0, []),
        (ONE, [_OWN.format(0)], 0, []),
        (ONE, [_OWN.format(0), _FIXED.format(0)], 0, ["blue0"]),
        (ONE, [_FIXED.format(0)], 0, []),
        (TEAM, [], 1, []),
        (TEAM, [f"{_RTA}=False"], 0, []),
        (TEAM, [_FIXED.format(0)], 1, ["blue0, blue1, blue2"]),
        (TEAM, [f"{_RTA}=False", _OWN.format(0)], 0, []),
        (MIXED, [_OWN.format(0)], 0, []),
        (MIXED, [_OWN.format(1)], 1, []),
        (MIXED, [_OWN.format(0), _OWN.format(2)], 0, []),  # the sampler's own test is that of equal filters
        (MIXED, [_OWN.format(0), _FIXED.format(1)], 0, []),
        (MIXED, [_OWN.format(1), _FIXED.format(1), _OWN.format(2)], 1, ["red"]),
        (MIXED, [f"{_RTA}=True", _FIXED.format(2)], 1, ["blue0, red, drifter"]),
    ],
)
def test_a_sampler_tests_what_it_draws_and_other_starts_are_watched(
    file: str, overrides: list[str], tests: int, watched: list[str]
) -> None:
    plan = loaded(file, *overrides).reset
    assert len(plan.tests) == tests
    assert [", ".join(watch.args[0]) for watch in plan.watches] == watched


@pytest.mark.parametrize(("distances", "apart"), [([], 0.0), ([7.0], 7.0), ([5.0, 9.0, 6.0], 9.0)])
def test_deputies_start_as_far_apart_as_no_done_function_calls_a_collision(
    distances: list[float], apart: float
) -> None:
    dones = ", ".join(
        f"{{functor: CollisionDoneFunction, name: c{index}, config: {{safety_constraint: {distance}}}}}"
        for index, distance in enumerate(distances)
    )
    assert loaded(TEAM, f"config.config.env_config.dones.shared=[{dones}]").reset.separation == apart


def test_the_sampler_of_the_first_deputy_tests_by_its_filter_too() -> None:
    plain, filtered = sampler(loaded(ONE)), sampler(loaded(ONE, _OWN.format(0)))
    states = {"position": np.array([[10.3, 0.0, 0.0]]), "velocity": np.array([[-0.19, 0.0, 0.0]])}
    states["sun_angle"] = np.zeros(1)
    assert plain.rta is not None
    assert filtered.rta is not None
    assert "recoverable" not in plain.rta.refusals(states)
    assert filtered.rta.refusals(states)["recoverable"].all()


def _states(*rows: tuple[float, float]) -> dict[str, Any]:
    """Return deputies at rest on the y axis, of which two coordinates are given."""
    position = np.array([[0.0, y, z] for y, z in rows])
    return {"position": position, "velocity": np.zeros_like(position), "sun_angle": np.zeros(len(rows))}


def test_a_further_deputy_is_tested_by_its_own_filter_alone() -> None:
    spec = loaded(MIXED, _OWN.format(1))
    (test,) = spec.reset.tests
    states = _states((60.0, 0.0), (5.0, 0.0))
    assert test(states, 0, {}) == {}
    assert test(states, 2, {}) == {}
    found = test(states, 1, {})
    assert found["chief_collision"].tolist() == [False, True]
    assert "recoverable" in found


def test_the_team_is_tested_with_the_deputies_before() -> None:
    (test,) = loaded(TEAM).reset.tests
    states = _states((60.0, 0.0), (60.0, 8.0))
    assert not any(rows.any() for rows in test(states, 0, {}).values())
    before = {name: value[:1, None].repeat(2, axis=0) for name, value in states.items() if name != "sun_angle"}
    refused = test(states, 1, before)
    assert refused["deputy_collision"].tolist() == [True, True]
    far = {"position": before["position"] + [[[0.0, 0.0, -40.0]]], "velocity": before["velocity"]}
    assert not any(rows.any() for rows in test(states, 1, far).values())


@pytest.mark.parametrize(("y", "shown"), [(60.0, ""), (5.0, "blue0: initial states are rejected by chief_collision")])
def test_a_watch_warns_of_starts_that_the_filter_does_not_keep(y: float, shown: str) -> None:
    (watch,) = loaded(ONE, _OWN.format(0), _FIXED.format(0)).reset.watches
    states = _states((y, 0.0), (80.0, 0.0))
    angle = states.pop("sun_angle")
    bodies = {"blue0": states, "chief": _states((0.0, 0.0), (0.0, 0.0))}
    if not shown:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            watch(bodies, {"sun_angle": angle, "init_state": {}})
        return
    with pytest.warns(UnsafeInitialStateWarning) as caught:
        watch(bodies, {"sun_angle": angle, "init_state": {}})
    (text,) = [str(one.message) for one in caught]
    assert text.startswith(shown)
    assert text.endswith(
        "; the safety filter gives no guarantee for such episodes; sample them with a RejectionSampler that has "
        "an `rta`, or choose others"
    )


def test_a_watch_of_a_team_sees_all_its_deputies() -> None:
    (watch,) = loaded(TEAM, _FIXED.format(0)).reset.watches
    states = [_states((60.0, z)) for z in (0.0, 40.0, 8.0)]
    bodies = {f"blue{index}": state for index, state in enumerate(states)}
    with pytest.warns(
        UnsafeInitialStateWarning, match="^blue0, blue1, blue2: initial states are rejected by deputy_coll"
    ):
        watch(bodies, {"sun_angle": states[0]["sun_angle"]})
