"""The speed limit's margins, its refusals and its search against the formulas in plain NumPy."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.dynamics.cwh import transition
from safe_inspect.rta.docking import SpeedLimitFilter

NONE = DisturbanceBounds()
BOUNDS = DisturbanceBounds(
    velocity=2e-4, position_error=0.03, velocity_error=3e-4, thrust_gain=0.02, thrust_direction=0.01
)


def task(**changes: Any) -> Any:
    """Return a task with a short step, an orbit that is not negligible, and a limit that both parts of it make."""
    values = {
        "step_size": 0.5, "n": 0.004, "m": 8.0, "u_max": 1.5, "v0": 0.3, "v0_distance": 2.0, "v1_coef": 2.0,
        "vel_limit": 5.0, "r_max": 900.0,
    }  # fmt: skip
    return SimpleNamespace(**{**values, **changes})


def limit(p: Any, position: np.ndarray) -> np.ndarray:
    beyond = np.maximum(np.linalg.norm(position, axis=-1) - (p.v0_distance or 0.0), 0.0)
    return np.minimum(p.v0 + p.v1_coef * p.n * beyond, p.vel_limit)


def fixed_margin(p: Any, b: DisturbanceBounds) -> float:
    """Return the part of e(r) that does not depend on r, without what is added between the steps [m/s]."""
    acceleration = np.sqrt(3.0) * p.u_max * (1.0 + b.thrust_error) / p.m + 2.0 * p.n * p.vel_limit
    acceleration += 3.0 * p.n**2 * p.r_max
    return float(p.step_size**2 / 8.0 * (2.0 * p.n * acceleration + 3.0 * p.n**2 * p.vel_limit))


def missed(p: Any, b: DisturbanceBounds) -> float:
    """Return by how much the limit may be missed after a hold, as position and velocity are not those predicted."""
    phi, gamma = transition(p.n, p.m, p.step_size)
    size = lambda matrix: np.linalg.svd(matrix)[1][0]  # noqa: E731
    error, added = np.sqrt(3.0) * p.u_max * b.thrust_error, 1.01 * b.velocity
    velocity = size(phi[3:, :3]) * b.position_error + size(phi[3:, 3:]) * b.velocity_error + size(gamma[3:]) * error
    place = size(phi[:3, :3]) * b.position_error + size(phi[:3, 3:]) * b.velocity_error + size(gamma[:3]) * error
    return float(velocity + added + p.v1_coef * p.n * (place + added * p.step_size))


def allowed(p: Any, b: DisturbanceBounds, position: np.ndarray) -> np.ndarray:
    """Return the largest speed L(r) - e(r) from which the filter promises."""
    share = 0.51 * p.v1_coef * p.n * p.step_size
    return (1.0 - share) * limit(p, position) - fixed_margin(p, b) - 2.02 * b.velocity


def directions(rng: np.random.Generator, rows: int) -> np.ndarray:
    found = rng.normal(size=(rows, 3))
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


@pytest.mark.parametrize("bounds", [NONE, BOUNDS], ids=["exact", "disturbed"])
@pytest.mark.parametrize("distance", [2.0, None])
def test_safe_is_what_is_slower_than_the_limit_by_the_margin(bounds: DisturbanceBounds, distance: float | None) -> None:
    p, rng = task(v0_distance=distance), np.random.default_rng(0)
    run = SpeedLimitFilter(p, bounds)
    position, heading = directions(rng, 400) * rng.uniform(0.0, 900.0, (400, 1)), directions(rng, 400)
    position[:40] *= 0.005  # within the distance up to which the limit is v0
    speed = allowed(p, bounds, position)[:, None]
    assert run.is_safe(position, heading * speed * (1.0 - 1e-9)).all()
    assert not run.is_safe(position, heading * speed * (1.0 + 1e-9)).any()
    np.testing.assert_allclose(run.phi(position, 0.7 * heading), limit(p, position) - 0.7, atol=1e-12)
    assert (limit(p, position) == p.vel_limit).any()
    assert (limit(p, position) == p.v0).any() == (distance is not None)


@pytest.mark.parametrize("bounds", [NONE, BOUNDS], ids=["exact", "disturbed"])
def test_a_thrust_is_flown_whose_prediction_is_safe_by_what_may_be_missed(bounds: DisturbanceBounds) -> None:
    p, rng = task(), np.random.default_rng(1)
    run = SpeedLimitFilter(p, bounds)
    phi, gamma = transition(p.n, p.m, p.step_size)
    inverse = np.linalg.inv(phi)
    thrust = rng.uniform(-p.u_max, p.u_max, (300, 3))
    place, heading = directions(rng, 300) * rng.uniform(1.0, 890.0, (300, 1)), directions(rng, 300)
    speed = allowed(p, bounds, place)[:, None] - missed(p, bounds)
    for factor, refused in ((1.0 - 1e-9, False), (1.0 + 1e-9, True)):
        after = np.concatenate((place, heading * speed * factor), axis=1)
        before = (after - thrust @ gamma.T) @ inverse.T
        found = run(before[:, :3], before[:, 3:], thrust)
        assert (found.backup == refused).all()
        assert (found.active == int(refused)).all()
        np.testing.assert_allclose(found.phi[:, 0], limit(p, before[:, :3]) - np.linalg.norm(before[:, 3:], axis=1))
        if not refused:
            np.testing.assert_array_equal(found.control, thrust)
    assert missed(p, BOUNDS) > 5e-4
    assert missed(p, NONE) == 0.0


@pytest.mark.parametrize("bounds", [NONE, BOUNDS], ids=["exact", "disturbed"])
def test_the_search_goes_as_far_towards_the_desired_thrust_as_the_limit_lets_it(bounds: DisturbanceBounds) -> None:
    p, rng = task(), np.random.default_rng(2)
    run = SpeedLimitFilter(p, bounds)
    phi, gamma = transition(p.n, p.m, p.step_size)
    position, heading = directions(rng, 300) * rng.uniform(1.0, 890.0, (300, 1)), directions(rng, 300)
    velocity = heading * (allowed(p, bounds, position)[:, None] - missed(p, bounds)) * rng.uniform(0.97, 1.0, (300, 1))
    desired = p.u_max * rng.uniform(-1.0, 1.0, (300, 3))
    found = run(position, velocity, desired)
    rows = np.flatnonzero(found.backup)
    assert len(rows) > 30
    assert not found.infeasible.any()
    coasted = np.concatenate((position, velocity), axis=1)[rows] @ phi.T
    brake = -coasted[:, 3:] / np.diag(gamma[3:])  # takes each axis to rest

    def keeps(share: np.ndarray) -> np.ndarray:
        thrust = np.clip(share * desired[rows] + (1.0 - share) * brake, -p.u_max, p.u_max)
        after = coasted + thrust @ gamma.T
        room = allowed(p, bounds, after[:, :3]) - missed(p, bounds)
        return np.asarray(np.linalg.norm(after[:, 3:], axis=1) <= room)

    low, high = np.zeros((len(rows), 1)), np.ones((len(rows), 1))
    for _ in range(60):
        good = keeps(0.5 * (low + high))[:, None]
        low, high = np.where(good, 0.5 * (low + high), low), np.where(good, high, 0.5 * (low + high))
    wanted = np.clip(low * desired[rows] + (1.0 - low) * brake, -p.u_max, p.u_max)
    np.testing.assert_allclose(found.control[rows], wanted, atol=1e-9)
    assert (np.abs(wanted - desired[rows]).max(axis=1) > 1e-6).all()
    assert found.names == ("speed_limit",)


def test_where_nothing_keeps_the_limit_it_brakes_and_says_so() -> None:
    p = task()
    position, velocity = np.array([[0.0, 3.0, 0.0]]), np.array([[4.0, -4.0, 0.0]])
    found = SpeedLimitFilter(p)(position, velocity, np.array([[1.5, 1.5, 0.0]]))
    assert (found.infeasible[0], found.backup[0], found.intervening[0]) == (True, True, True)
    np.testing.assert_array_equal(found.control[0, :2], [-1.5, 1.5])
    assert abs(found.control[0, 2]) < 1e-12


@pytest.mark.parametrize(("beyond", "intervening"), [(0.009, False), (0.011, True)])
def test_a_change_of_a_hundredth_of_a_newton_is_an_intervention(beyond: float, intervening: bool) -> None:
    still = np.zeros((1, 3))
    found = SpeedLimitFilter(task())(np.array([[30.0, 0.0, 0.0]]), still, np.array([[1.5 + beyond, 0.0, 0.0]]))
    assert (found.intervening[0], found.backup[0], found.infeasible[0]) == (intervening, False, False)
    np.testing.assert_array_equal(found.control, [[1.5, 0.0, 0.0]])


def refuses(p: Any, bounds: DisturbanceBounds | None = None) -> bool:
    try:
        SpeedLimitFilter(p, bounds)
    except ValueError:
        return True
    return False


def needed(p: Any) -> float:
    """Return the acceleration that braking takes [m/s^2]."""
    return float(1.05 * (3.0 * p.n**2 * p.r_max + p.v1_coef * p.n * p.vel_limit))


@pytest.mark.parametrize("bounds", [NONE, BOUNDS.model_copy(update={"thrust_gain": 0.0, "thrust_direction": 0.0})])
def test_thrusters_must_brake_faster_than_the_limit_falls(bounds: DisturbanceBounds) -> None:
    p = task()
    lost = (bounds.velocity_error + p.v1_coef * p.n * bounds.position_error + missed(p, bounds)) / p.step_size
    least = p.m * (needed(p) + lost)
    assert not refuses(task(u_max=least * (1.0 + 1e-9)), bounds)
    assert refuses(task(u_max=least * (1.0 - 1e-9)), bounds)
    if bounds is not NONE:
        with pytest.raises(ValueError, match="`disturbance`"):
            SpeedLimitFilter(task(u_max=least * (1.0 - 1e-9)), bounds)
    with pytest.raises(ValueError, match="`vel_limit`"):
        SpeedLimitFilter(task(u_max=p.m * needed(p) * (1.0 - 1e-9)), bounds)


def test_the_limit_must_change_little_within_a_step() -> None:
    slow = {"n": 1e-4, "v1_coef": 4.0, "r_max": 300.0}
    assert not refuses(task(**slow, step_size=24.9))
    assert refuses(task(**slow, step_size=25.1))


@pytest.mark.parametrize("bounds", [NONE, BOUNDS], ids=["exact", "disturbed"])
@pytest.mark.parametrize("top", [True, False], ids=["limit at the chief", "largest speed"])
def test_the_margin_must_leave_nine_tenths_of_the_limit(bounds: DisturbanceBounds, top: bool) -> None:
    """Of the smaller one of the limit at the chief and of the largest speed."""
    p = task()
    for _ in range(60):  # the margin depends on the largest speed
        taken = fixed_margin(p, bounds) + 2.02 * bounds.velocity + missed(p, bounds)
        least = 10.0 * taken
        p = task(v0=least) if top else task(v0=9.0, vel_limit=least)
    others = {} if top else {"v0": 9.0}
    name = "v0" if top else "vel_limit"
    assert not refuses(task(**others, **{name: least * (1.0 + 1e-7)}), bounds)
    assert refuses(task(**others, **{name: least * (1.0 - 1e-7)}), bounds)
