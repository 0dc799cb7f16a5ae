"""The compiled rows of tasks by plain formulas: limits at exact values, and the draws that each error depends on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.geometry.visibility import Credit, Scores, Surface
from safe_inspect.random.splitmix import draw_in_ball, uniform_at
from safe_inspect.tasks.bounded_disturbance import add_velocity, turn_thrust, write_estimates
from safe_inspect.tasks.docking.mating import docking_error, is_docked, is_in_contact
from safe_inspect.tasks.docking.speed_limit import (
    DOCKED,
    OUTSIDE,
    TOO_FAST,
    docking_outcome,
    entry_speed,
    is_too_fast,
    speed_excess,
    speed_limit,
)
from safe_inspect.tasks.inspection.points import ConeCamera, in_cone, inspect_by_camera
from safe_inspect.tasks.thruster_model import Actuators

ROWS, DEPUTIES = 5, 3
KEYS, STEPS = np.random.default_rng(0).integers(0, 2**63, ROWS).astype(np.uint64), np.arange(3, 3 + ROWS)
ZERO = np.zeros(3)


def each() -> Any:
    return ((n, d, KEYS[n], int(STEPS[n])) for n in range(ROWS) for d in range(DEPUTIES))


def uniforms(key: np.uint64, step: int, first: int, count: int) -> np.ndarray:
    return np.array([uniform_at(key, step, first + k) for k in range(count)])


@pytest.mark.parametrize("size", [3, 6])
def test_actuators_clip_scale_and_add_noise(size: int) -> None:
    plugin = Actuators(force=0.5, torque=0.02, scale_error=-0.25, force_noise=0.1, torque_noise=0.003)
    control = np.random.default_rng(1).uniform(-1.0, 1.0, (ROWS, DEPUTIES, size))
    state: Any = {"key": KEYS, "step": STEPS}
    flown = plugin(None, ROWS).actuate(state, control)
    limits, noise = np.repeat((0.5, 0.02), 3)[:size], np.repeat((0.1, 0.003), 3)[:size]
    for n, d, key, step in each():
        error = 2.0 * uniforms(key, step, 1000 + size * d, size) - 1.0
        expected = 0.75 * np.clip(control[n, d], -limits, limits) + noise * error
        np.testing.assert_allclose(flown[n, d], expected, rtol=1e-14)
    exact = Actuators()(None, ROWS).actuate(state, control)
    bounds = np.repeat((0.30, 0.025), 3)[:size]
    np.testing.assert_array_equal(exact, np.clip(control, -bounds, bounds))


@pytest.mark.parametrize("scale", [-1.0, 1.0])
def test_a_relative_error_of_one_is_refused(scale: float) -> None:
    with pytest.raises(ValidationError):
        Actuators(scale_error=scale)


@pytest.mark.parametrize("extreme", [False, True])
def test_a_disturbance_takes_four_draws_of_a_deputy(extreme: bool) -> None:
    velocity, place = np.random.default_rng(2).normal(size=(2, ROWS, DEPUTIES, 3))
    disturbed, estimates = velocity.copy(), (np.empty_like(place), np.empty_like(place))
    add_velocity(KEYS, STEPS, 0.3, extreme, disturbed)
    write_estimates(KEYS, STEPS, (2.0, 0.5), extreme, (place, velocity), estimates)
    for n, d, key, step in each():
        errors = [draw_in_ball(key, step, 4 * d + k, bound, extreme) for k, bound in enumerate((0.3, 2.0, 0.5))]
        np.testing.assert_allclose(disturbed[n, d] - velocity[n, d], errors[0], atol=1e-15)
        np.testing.assert_allclose(estimates[0][n, d] - place[n, d], errors[1], atol=1e-15)
        np.testing.assert_allclose(estimates[1][n, d] - velocity[n, d], errors[2], atol=1e-15)


@pytest.mark.parametrize("extreme", [False, True])
def test_a_thrust_is_turned_about_itself_and_scaled(extreme: bool) -> None:
    """Also one along an axis or a diagonal; none stays none, and moments stay as they are."""
    control = np.random.default_rng(3).normal(size=(ROWS, DEPUTIES, 4))
    control[:, 0, :3] = np.array([[1, 0, 0], [0, -2, 0], [0, 0, 3], [0, 0, 0], [1, 1, 1]])
    control[:3, 1, :3] = np.array([[0.1, 2, 3], [2, 0.1, 3], [2, 3, 0.1]])
    flown = control.copy()
    turn_thrust(KEYS, STEPS, 0.2, 0.3, extreme, flown)
    np.testing.assert_array_equal(flown[..., 3], control[..., 3])
    for n, d, key, step in each():
        u = control[n, d, :3]
        size = np.linalg.norm(u)
        if size == 0.0:
            np.testing.assert_array_equal(flown[n, d], control[n, d])
            continue
        share, angle, around = uniforms(key, step, 4 * (4 * d + 3), 3)
        share, angle = 2.0 * share - 1.0, 0.3 * (1.0 if extreme else angle)
        share = np.sign(share) if extreme else share
        along = u / size
        aside = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        aside /= np.linalg.norm(aside)
        third, turn = np.cross(along, aside), 2.0 * np.pi * around
        expected = np.cos(angle) * along + np.sin(angle) * (np.cos(turn) * aside + np.sin(turn) * third)
        np.testing.assert_allclose(flown[n, d, :3], size * (1.0 + 0.2 * share) * expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(("reach", "speed", "docked"), [(5.0, 0.5, True), (4.99, 0.5, False), (5.0, 0.49, False)])
def test_a_chaser_at_the_limits_is_docked(reach: float, speed: float, docked: bool) -> None:
    place, motion = np.array([4.0, 4.0, 1.0]), np.array([0.3, 0.0, 0.4])
    assert is_docked(reach, speed, place, motion, np.array([1.0, 0.0, 1.0]), ZERO) == docked
    error = docking_error(2.0, place, motion, np.array([1.0, 0.0, 1.0]), ZERO)
    assert error == pytest.approx(np.hypot(5.0, 2.0 * 0.5), rel=1e-14)


def test_a_chaser_is_in_contact_below_its_radius() -> None:
    assert not is_in_contact(0.5, 0.5)
    assert is_in_contact(0.5, 0.5 - 1e-12)


@pytest.mark.parametrize(("side", "inside"), [(4.0, True), (4.0 + 1e-9, False), (3.0, True)])
def test_a_direction_at_the_edge_is_within_a_cone(side: float, inside: bool) -> None:
    assert in_cone((1.0, 0.0, 0.0), 0.6, 3.0, side, 0.0) == inside
    assert in_cone((0.0, 1.0, 0.0), 0.6, 0.0, 3.0, -side) == inside
    assert in_cone((0.0, 0.0, -1.0), 0.6, -side, 0.0, -3.0) == inside


@pytest.mark.parametrize("half_angle", [0.02, 0.1, 0.3, 1.2, 3.0, 4.0])
def test_cameras_see_what_is_lit_above_the_horizon_in_their_cones(half_angle: float) -> None:
    """With deputies far away, near, on the surface and inside, and some whose sensor does not work."""
    generator, radius, rows = np.random.default_rng(4), 5.0, 40
    points = sphere_points("fibonacci", 60, radius)
    position = generator.normal(size=(rows, DEPUTIES + 1, 3))
    position /= np.linalg.norm(position, axis=-1, keepdims=True)
    position *= generator.choice([4.9, 5.0 + 1e-9, 6.0, 12.0, 60.0], (rows, DEPUTIES + 1, 1))
    body = position[:, DEPUTIES].copy()
    position[:, :DEPUTIES] += body[:, None]
    orientation = generator.normal(size=(rows, DEPUTIES + 1, 4))
    orientation /= np.linalg.norm(orientation, axis=-1, keepdims=True)
    sun = generator.normal(size=(rows, 3))
    sun /= np.linalg.norm(sun, axis=-1, keepdims=True)
    axis = (2 / 3, -1 / 3, 2 / 3)
    for n in range(0, rows, 2):  # half of the cameras look nearly at the body
        for d in range(DEPUTIES):
            to = body[n] - position[n, d] + generator.normal(size=3) * 2.0
            a, b = np.array(axis), to / np.linalg.norm(to)
            orientation[n, d] = [*np.cross(a, b), 1.0 + a @ b]
            orientation[n, d] /= np.linalg.norm(orientation[n, d])
    active, weights = generator.random((rows, DEPUTIES)) < 0.8, generator.random((rows, 60))
    inspector = np.where(generator.random((rows, 60)) < 0.2, 1, -1).astype(np.int8)
    expected = inspector.copy()
    for d in range(DEPUTIES):
        p = position[:, d] - body
        look = to_matrix(orientation[:, d]) @ np.array(axis)
        ways = points - p[:, None]
        cosine = np.einsum("npk,nk->np", ways, look) / np.linalg.norm(ways, axis=-1)
        sees = (p @ points.T >= radius**2) & ((p**2).sum(axis=1) >= radius**2)[:, None] & (sun @ points.T > 0.0)
        sees &= (np.arccos(np.clip(cosine, -1.0, 1.0)) <= half_angle) & active[:, d, None]
        expected[(expected < 0) & sees] = d
    credit = Credit(inspector.copy(), np.full(rows, -5), np.full((rows, DEPUTIES), -5))
    scores = Scores(weights, np.full(rows, -5.0), np.full((rows, DEPUTIES), -5.0))
    camera, surface = ConeCamera(axis, half_angle), Surface(points, radius, 0.0)
    inspect_by_camera(position, orientation, DEPUTIES, camera, sun, surface, active, credit, scores)
    np.testing.assert_array_equal(credit.inspector, expected)
    changed = (expected != inspector).any(axis=1)
    own = np.stack([(expected == d).sum(axis=1) for d in range(DEPUTIES)], axis=1)
    weight = np.stack([(weights * (expected == d)).sum(axis=1) for d in range(DEPUTIES)], axis=1)
    np.testing.assert_array_equal(credit.own_count, np.where(changed[:, None], own, -5))
    np.testing.assert_array_equal(credit.team_count, np.where(changed, own.sum(axis=1), -5))
    np.testing.assert_allclose(scores.own, np.where(changed[:, None], weight, -5.0))
    np.testing.assert_allclose(scores.team, np.where(changed, weight.sum(axis=1), -5.0))
    assert changed.any()
    assert not changed.all() or half_angle > 1.0


def test_the_speed_limit_is_a_line_beyond_its_threshold() -> None:
    line, lower = np.array([0.2, 0.5, 0.01, 1.0]), np.array([0.2, 0.5, 0.01, -1.0])
    for distance, limit in ((0.0, 0.2), (0.5, 0.2), (10.5, 0.3)):
        assert speed_limit(line, distance) == pytest.approx(limit, rel=1e-14)
        assert speed_excess(line, distance, 1.0) == pytest.approx(1.0 - limit, rel=1e-14)
        assert speed_excess(lower, distance, 1.0) == pytest.approx(limit - 1.0, rel=1e-14)


@pytest.mark.parametrize(
    ("x", "y", "found"),
    [(-10.0, 0.0, True), (-10.0, 2.0, True), (-10.0, 2.00009, True), (-10.0, 2.00012, False), (-25.0, 0.0, False),
     (1.0, 0.0, True), (3.0, 0.0, False), (-22.0, 0.0, True), (-22.00015, 0.0, False)],
)  # fmt: skip
def test_a_straight_path_reaches_a_ball_that_it_meets(x: float, y: float, found: bool) -> None:
    """At 2 m/s for 10 s, past a ball of 2 m that moves across; the end of the step alone counts where the step is 0."""
    drift = np.array([0.0, 0.0, 0.3])
    before, end = np.array([x, y, 5.0]), np.array([x + 20.0, y, 5.0 + 3.0])
    motion, centre = np.array([2.0, 0.0, 0.3]), np.array([0.0, 0.0, 8.0])
    speed = entry_speed(2.0, 10.0, before, motion, end, motion, centre, drift)
    assert speed == pytest.approx(2.0 if found else -1.0, rel=1e-9)
    at_end = np.hypot(x + 20.0, y) <= 2.0
    assert entry_speed(2.0, 0.0, before, motion, end, motion, centre, drift) == pytest.approx(2.0 if at_end else -1.0)
    for limit, outcome in ((2.1, DOCKED), (1.9, TOO_FAST)):
        rule = np.array([limit, 5.0, 0.0, 1.0, 2.0, 10.0])
        expected = outcome if found else OUTSIDE
        assert docking_outcome(rule, before, motion, end, motion, centre, drift) == expected
        assert is_too_fast(rule, before, motion, end, motion, centre, drift) == (expected == TOO_FAST)


def test_the_end_of_a_step_on_the_region_is_within_and_the_limit_itself_is_kept() -> None:
    place, motion = np.array([3.0, 4.0, 0.0]), np.array([0.0, 0.3, 0.4])
    assert entry_speed(5.0, 0.0, ZERO, ZERO, place, motion, ZERO, ZERO) == 0.5
    assert entry_speed(5.0 - 1e-9, 0.0, ZERO, ZERO, place, motion, ZERO, ZERO) == -1.0
    assert docking_outcome(np.array([0.5, 9.0, 0.0, 1.0, 5.0, 0.0]), ZERO, ZERO, place, motion, ZERO, ZERO) == DOCKED
