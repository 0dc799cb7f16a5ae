"""The filter of docking: the speed limit at every moment, a plan from every state within it, and the nearest thrust."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.dynamics.cwh import transition
from safe_inspect.environments import load_spec
from safe_inspect.errors import ConfigError
from safe_inspect.evaluation.safety_report import safety_report
from safe_inspect.rta import RTAGlueCWHDocking3d
from safe_inspect.rta.docking import SpeedLimitFilter

N, MASS = 0.001027, 12.0
EXPERIMENT = configs_root() / "docking" / "experiment.yml"
ENABLED = "RTAGlueCWHDocking3d.config.enabled=True"


def limit(position):
    beyond = np.maximum(np.linalg.norm(position, axis=-1) - 0.5, 0.0)
    return np.minimum(0.2 + 2.0 * N * beyond, 10.0)


def directions(rng, rows):
    found = rng.normal(size=(rows, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def draw(seed, rows):
    """Return states on the edge of what the filter promises for, at 0.01 m to 9.9 km, half of them flying inwards."""
    rng, run = np.random.default_rng(seed), SpeedLimitFilter(RTAGlueCWHDocking3d())
    position = directions(rng, rows) * 10.0 ** rng.uniform(-2.0, 3.99, (rows, 1))
    inwards = rng.random((rows, 1)) < 0.5
    heading = np.where(inwards, -position / np.linalg.norm(position, axis=1, keepdims=True), directions(rng, rows))
    velocity = heading * (limit(position) * rng.uniform(0.99, 1.0, rows))[:, None]
    safe = run.is_safe(position, velocity)
    assert 0.5 < safe.mean() < 1.0
    return run, position[safe], velocity[safe], rng


def moved(position, velocity, control, time):
    phi, gamma = transition(N, MASS, time)
    after = np.concatenate((position, velocity), axis=1) @ phi.T + control @ gamma.T
    return after[:, :3], after[:, 3:]


def test_whatever_is_asked_for_the_limit_is_kept_at_every_moment():
    run, position, velocity, rng = draw(0, 20_000)
    desired = np.sign(rng.normal(size=position.shape)) * rng.choice([0.0, 1.0, 5.0], (len(position), 1))
    found = run(position, velocity, desired)
    assert not found.infeasible.any()
    assert np.abs(found.control).max() <= 1.0
    for time in np.linspace(0.05, 1.0, 20):
        place, speed = moved(position, velocity, found.control, time)
        assert (np.linalg.norm(speed, axis=1) <= limit(place)).all()
    assert run.is_safe(place, speed).all()
    assert 0.2 < found.intervening.mean() < 1.0


def test_a_thrust_that_keeps_the_limit_is_flown():
    run, position, velocity, _ = draw(1, 2_000)
    brake = -np.sign(velocity) * np.minimum(np.abs(velocity) * MASS, 1.0)
    found = run(position, velocity, brake)
    np.testing.assert_array_equal(found.control, brake)
    assert not found.backup.any()


def test_no_thrust_of_a_fine_search_is_nearer():
    run, position, velocity, rng = draw(2, 40)
    desired = rng.uniform(-1.0, 1.0, position.shape)
    found = run(position, velocity, desired)
    grid = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 21)] * 3), axis=-1).reshape(-1, 3)
    assert found.backup.sum() > 5
    for row in np.flatnonzero(found.backup):
        places, speeds = moved(
            *(np.repeat(a[row : row + 1], len(grid), axis=0) for a in (position, velocity)), grid, 1.0
        )
        allowed = grid[run.is_safe(places, speeds)]
        nearest = np.linalg.norm(allowed - desired[row], axis=1).min()
        assert np.linalg.norm(found.control[row] - desired[row]) <= nearest + 1e-3


def test_a_row_of_a_batch_is_that_row_alone():
    run, position, velocity, rng = draw(3, 50)
    desired = rng.uniform(-1.0, 1.0, position.shape)
    whole = run(position, velocity, desired)
    for row in range(0, len(position), 7):
        alone = run(position[row : row + 1], velocity[row : row + 1], desired[row : row + 1])
        np.testing.assert_array_equal(alone.control[0], whole.control[row])


def test_adversaries_break_nothing_in_the_task():
    report = safety_report(load_spec(EXPERIMENT, [ENABLED]), steps=20_000, num_envs=256, substeps=5)
    assert (report.violations, report.infeasible, report.starts_refused) == (0, 0, 0)
    assert report.names == ("speed_limit",)
    assert (report.interventions[:3] > 0).all()
    assert safety_report(load_spec(EXPERIMENT), steps=5_000, num_envs=100, substeps=2).violations > 0


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("reference_store.max_distance=20 km", "the thrusters give 0.0833 m/s"),
        ("frame_rate=0.1", "use shorter steps"),
    ],
)
def test_what_cannot_be_promised_is_refused(override, message):
    with pytest.raises(ConfigError, match=message):
        load_spec(EXPERIMENT, [ENABLED, override])


BOUNDS = DisturbanceBounds(
    velocity=1e-4, position_error=0.01, velocity_error=1e-4, thrust_gain=0.01, thrust_direction=0.01
)


def test_the_limit_is_kept_whatever_disturbs_within_the_bounds():
    """From the edge of what is promised for, errors and pushes on the bounds, along the velocity or at random."""
    rng, run = np.random.default_rng(4), SpeedLimitFilter(RTAGlueCWHDocking3d(), BOUNDS)
    exact = SpeedLimitFilter(RTAGlueCWHDocking3d())
    _, position, velocity, _ = draw(4, 4_000)
    velocity = velocity * 0.995
    safe = run.is_safe(position, velocity)
    assert safe.mean() > 0.9
    position, velocity = position[safe], velocity[safe]
    rows, broken = len(position), 0
    for hold in range(12):
        along = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
        out = position / np.linalg.norm(position, axis=1, keepdims=True)
        push = np.where(rng.random((rows, 1)) < 0.7, along, directions(rng, rows))
        seen = position + 0.01 * out, velocity - 1e-4 * push  # nothing seems wrong: farther out, and slower
        desired = np.where(rng.random((rows, 1)) < 0.8, 5.0 * along, rng.normal(size=(rows, 3)))
        found = run(*seen, desired)
        assert not found.infeasible.any(), hold
        without = exact(*seen, desired)
        real = found.control * (1.0 + 0.01 * np.sign((found.control * push).sum(axis=1, keepdims=True)))
        time = rng.uniform(0.0, 1.0)
        for part in (0.2, 0.4, 0.6, 0.8, 1.0):
            place, speed = moved(position, velocity, real, part)
            if part >= time:
                place, speed = place + 1e-4 * push * (part - time), speed + 1e-4 * push
            assert (np.linalg.norm(speed, axis=1) <= limit(place)).all(), (hold, part)
        undefended = without.control * (1.0 + 0.01 * np.sign((without.control * push).sum(axis=1, keepdims=True)))
        _, fast = moved(position, velocity, undefended, 1.0)
        broken += int((np.linalg.norm(fast + 1e-4 * push, axis=1) > limit(place)).sum())
        position, velocity = place, speed
    assert broken > 100  # the same disturbances break what knows nothing of them


def test_without_a_disturbance_the_thrusts_are_the_same_bit_for_bit():
    run, position, velocity, rng = draw(5, 500)
    desired = rng.normal(size=position.shape)
    none = SpeedLimitFilter(RTAGlueCWHDocking3d(), DisturbanceBounds())
    np.testing.assert_array_equal(run(position, velocity, desired).control, none(position, velocity, desired).control)


def test_a_disturbed_docking_is_filtered_by_its_estimates():
    fields = "{velocity: 1e-4, position_error: 1 cm, velocity_error: 1e-4, thrust_gain: 0.01, thrust_direction: 0.01}"
    disturbance = f"{{functor: BoundedDisturbance, config: {fields[:-1]}, distribution: extreme}}}}"
    disturbed = [ENABLED, f"config.config.env_config.simulator.config={{disturbance: {disturbance}}}"]
    with pytest.raises(ConfigError, match=r"give the filter `disturbance: \{velocity: 0\.0001, position_error: 0\.01"):
        load_spec(EXPERIMENT, disturbed)
    withstood = load_spec(EXPERIMENT, [*disturbed, f"RTAGlueCWHDocking3d.config.disturbance={fields}"])
    report = safety_report(withstood, steps=10_000, num_envs=256, substeps=5)
    assert (report.violations, report.infeasible, report.starts_refused) == (0, 0, 0)


@pytest.mark.parametrize("bounds", [{"velocity": 0.02}, {"velocity_error": 0.03}, {"thrust_gain": 0.5}])
def test_bounds_that_leave_nothing_are_refused(bounds):
    with pytest.raises(
        ValueError, match="the bounds of `disturbance` exceed the margin of the speed limit or of braking"
    ):
        RTAGlueCWHDocking3d(enabled=True, disturbance=bounds)
