"""Where the sun's cone lies, by positions made by hand and by what a camera at the deputy sees."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from safe_inspect.rta.constraints import RelativeState
from safe_inspect.rta.constraints.sun_cone import SunKeepOut

N = 0.001027


def one(position, velocity=(0.0, 0.0, 0.0), sun_angle=0.0):
    return RelativeState(np.array([position], float), np.array([velocity], float), np.array([sun_angle], float))


@pytest.mark.parametrize(
    ("sun_angle", "day_side"),
    [
        (0.0, (1.0, 0.0, 0.0)),  # (cos theta, -sin theta, 0): the sun is at +x
        (math.pi / 2, (0.0, -1.0, 0.0)),  # at -y; a mirrored sun would be at +y
        (math.pi, (-1.0, 0.0, 0.0)),
        (1.5 * math.pi, (0.0, 1.0, 0.0)),
    ],
)
def test_the_night_side_is_forbidden_and_the_day_side_allowed(sun_angle, day_side):
    constraint = SunKeepOut(fov=math.radians(60.0))
    day = np.array(day_side)
    assert constraint(one(100.0 * day, sun_angle=sun_angle))[0] == pytest.approx(math.radians(150.0))
    assert constraint(one(-100.0 * day, sun_angle=sun_angle))[0] == pytest.approx(math.radians(-30.0))
    assert constraint(one((0.0, 0.0, 100.0), sun_angle=sun_angle))[0] == pytest.approx(math.radians(60.0))
    assert constraint.h(one(100.0 * day, sun_angle=sun_angle))[0] > 0.0
    assert constraint.h(one(-100.0 * day, sun_angle=sun_angle))[0] < 0.0


@pytest.mark.parametrize("towards", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, -0.6, 0.8)])
def test_the_cone_opens_by_half_the_field_of_view_to_every_side(towards):
    constraint = SunKeepOut(fov=math.radians(60.0))
    for degrees, sign in ((29.0, -1.0), (31.0, 1.0)):
        angle = math.radians(degrees)
        position = 100.0 * (math.cos(angle) * np.array([-1.0, 0, 0]) + math.sin(angle) * np.array(towards))
        found = constraint.evaluate(one(position))
        assert math.degrees(found.phi[0]) == pytest.approx(sign)
        assert math.copysign(1.0, found.h[0]) == sign


def test_a_position_is_forbidden_exactly_where_the_sun_is_in_the_camera(draw):
    state = draw(7, 10_000)
    toward_sun = np.stack((np.cos(state.sun_angle), -np.sin(state.sun_angle), 0 * state.sun_angle), axis=1)
    looking = -state.position / np.linalg.norm(state.position, axis=1)[:, None]
    for fov in (20.0, 60.0, 150.0):
        in_view = np.einsum("ij,ij->i", looking, toward_sun) > math.cos(math.radians(fov / 2))
        np.testing.assert_array_equal(SunKeepOut(fov=math.radians(fov))(state) < 0.0, in_view)
        assert in_view.any()


def test_the_turning_cone_sweeps_up_what_stands_before_it():
    # theta grows, so the sun goes from +x towards -y, and the cone from -x towards +y
    constraint = SunKeepOut(fov=math.radians(60.0), max_acceleration=0.08, mean_motion=N)
    angle = math.radians(35.0)
    ahead, behind = (one((-100 * math.cos(angle), side * 100 * math.sin(angle), 0.0)) for side in (1.0, -1.0))
    root = math.sqrt(2 * 0.08 * 100 * math.sin(math.radians(5.0)))
    sweep = N * 100 * math.cos(math.radians(5.0))
    assert constraint.h(ahead)[0] == pytest.approx(root - sweep, rel=1e-12)
    assert constraint.h(behind)[0] == pytest.approx(root + sweep, rel=1e-12)
    later = RelativeState(ahead.position, ahead.velocity, np.array([math.radians(6.0)]))
    assert constraint(ahead)[0] > 0.0 > constraint(later)[0]


def test_mirrored_in_the_orbital_plane_nothing_changes(draw):
    state = draw(8, 1000)
    flip = np.array([1.0, 1.0, -1.0])
    mirrored = RelativeState(state.position * flip, state.velocity * flip, state.sun_angle)
    np.testing.assert_array_equal(SunKeepOut().h(state), SunKeepOut().h(mirrored))


def test_gradient_and_rate_give_the_change_along_a_thrusting_flight(draw):
    constraint, thrust = SunKeepOut(), np.array([0.03, -0.05, 0.02])
    state = draw(9, 20, nearest=50.0, farthest=200.0, fastest=0.3)

    def motion(_time, x):
        tide = [3 * N**2 * x[0] + 2 * N * x[4], -2 * N * x[3], -(N**2) * x[2]]
        return np.concatenate((x[3:6], np.array(tide) + thrust, [N]))

    for row in range(len(state)):
        start = np.concatenate((state.position[row], state.velocity[row], state.sun_angle[row : row + 1]))
        times = np.linspace(0.0, 60.0, 1201)
        flown = solve_ivp(motion, (0.0, 60.0), start, t_eval=times, rtol=1e-11, atol=1e-11).y.T
        along = RelativeState(flown[:, :3], flown[:, 3:6], flown[:, 6])
        found = constraint.evaluate(along)
        flow = np.array([motion(0.0, x)[:6] for x in flown])
        slope = np.einsum("ij,ij->i", found.gradient, flow) + found.rate
        numeric = np.gradient(found.h, times)
        smooth = (np.abs(found.phi) > 0.05)[1:-1] & (np.abs(np.diff(slope, 2)) < 1e-5)
        assert smooth.mean() > 0.5
        np.testing.assert_allclose(numeric[1:-1][smooth], slope[1:-1][smooth], atol=1e-5)
