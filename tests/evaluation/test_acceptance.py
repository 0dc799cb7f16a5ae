"""Acceptance rates: shares of first draws, by constraint."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import BatchedEnvironment
from safe_inspect.errors import ConfigError
from safe_inspect.evaluation.safety_report import acceptance

ON = "RTAGlueCWHInspection1v1.config.enabled=True"


@pytest.fixture(scope="module")
def found(shipped):
    return acceptance(load_experiment(shipped).spec, 20_000)


def test_the_shipped_task_accepts_nineteen_of_twenty(found):
    assert found.parameter == "init_state"
    assert len(found.accepted) == 20_000
    assert 0.94 < found.accepted.mean() < 0.96
    # at 50 to 100 m, at most 0.3 m/s: only the speed limit and the sun can refuse
    assert {name for name, rows in found.refused.items() if rows.any()} == {"rel_vel", "sun"}
    np.testing.assert_array_equal(found.accepted, ~np.any(list(found.refused.values()), axis=0))


def test_the_sun_refuses_the_share_of_its_cone(found):
    """The camera must not look into the sun: closed form of the keep-out at rest, drawn by the same distributions.

    phi of the sun is the angle off the cone's axis less its half angle; where that is negative the draw is refused.
    """
    position, sun = found.states["position"], found.states["sun_angle"]
    direction = np.stack((np.cos(sun), -np.sin(sun), np.zeros_like(sun)), axis=1)
    cosine = -(position * direction).sum(axis=1) / np.linalg.norm(position, axis=1)
    inside = np.arccos(np.clip(cosine, -1.0, 1.0)) < np.pi / 6.0
    refused = found.refused["sun"]
    assert refused[inside].all()
    assert inside.sum() <= refused.sum()
    away = np.arccos(np.clip(cosine, -1.0, 1.0)) > np.pi / 3.0
    assert not refused[away].any()


def test_the_speed_limit_refuses_what_is_too_fast(found):
    distance = np.linalg.norm(found.states["position"], axis=1)
    speed = np.linalg.norm(found.states["velocity"], axis=1)
    too_fast = speed > 0.2 + 2.0 * 0.001027 * (distance - 10.0)
    np.testing.assert_array_equal(found.refused["rel_vel"], too_fast)


def test_what_refuses_alone_is_no_more_than_what_refuses(found):
    rows = {line.split()[0]: line for line in str(found).splitlines()[2:]}
    assert set(rows) == set(found.refused)
    total = np.sum(list(found.refused.values()), axis=0)
    for name, line in rows.items():
        refuses, alone = float(line.split()[1]), float(line.split()[3])
        assert alone <= refuses
        assert refuses == pytest.approx(100.0 * found.refused[name].mean(), abs=0.0051)
        assert alone == pytest.approx(100.0 * (found.refused[name] & (total == 1)).mean(), abs=0.0051)
    assert f"{100.0 * found.accepted.mean():.2f} % of 20,000 draws" in str(found)


def test_the_filter_refuses_a_little_more(shipped, found):
    on = acceptance(load_experiment(shipped, [ON]).spec, 20_000)
    np.testing.assert_array_equal(on.states["position"], found.states["position"])
    assert "recoverable" in on.refused
    assert not (on.accepted & ~found.accepted).any()
    assert 0.0 < found.accepted.mean() - on.accepted.mean() < 0.01


@pytest.mark.parametrize(("name", "on"), [("", False), ("", True), ("-filtered", True)])
def test_its_accepted_draws_are_the_starts_of_the_environment(name, on):
    """Whichever filter is enabled: none, the deputy's own, or that of the team, with thrusters of 0.1 N."""
    file = configs_root() / f"translational-inspection/experiment-burn-and-coast{name}.yml"
    spec = load_experiment(file, [ON] if on and not name else []).spec
    first = acceptance(spec, 300, seed=9)
    env = BatchedEnvironment(spec, 300, seed=9)
    env.reset()
    same = (env.state.position[:, 0] == first.states["position"]).all(axis=1)
    np.testing.assert_array_equal(same, first.accepted)
    assert 0 < first.accepted.sum() < 300
    assert ("recoverable" in first.refused) == on


def test_a_task_without_a_sampler_is_refused(fixed_start):
    with pytest.raises(ConfigError, match="RejectionSampler"):
        acceptance(fixed_start((50.0, 0.0, 0.0)), 10)


def test_no_draws_are_refused(shipped):
    with pytest.raises(ValueError, match="at least 1"):
        acceptance(load_experiment(shipped).spec, 0)
