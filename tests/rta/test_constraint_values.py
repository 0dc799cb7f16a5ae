from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.rta.constraints import ConstraintParameters, RelativeState, constraint_set
from safe_inspect.rta.constraints.ranges import ChiefCollision, MaximumRange, PassivelySafeManoeuvre
from safe_inspect.rta.constraints.speeds import AlongTrackSpeed, RadialSpeed, RelativeSpeedLimit
from safe_inspect.rta.constraints.sun_cone import SunKeepOut


def one(position, velocity=(0.0, 0.0, 0.0), sun_angle=0.0):
    return RelativeState(np.array([position], float), np.array([velocity], float), np.array([sun_angle], float))


def test_the_promised_deceleration_is_thrust_less_tide_less_coriolis():
    # 1 N / 12 kg = 0.083333, 3 n^2 800 m = 0.0025313, 2 n 1 m/s = 0.002054 m/s^2
    assert ConstraintParameters().max_acceleration == pytest.approx(0.078748, abs=1e-6)
    # the speed limit at the largest range, 0.2 + 2 n 100 = 0.4054 m/s, is below 1 m/s
    assert ConstraintParameters(r_max=100.0).max_acceleration == pytest.approx(
        1.0 / 12.0 - 3.0 * 0.001027**2 * 100.0 - 2.0 * 0.001027 * 0.4054, rel=1e-14
    )


def test_chief_collision_by_hand():
    constraint = ChiefCollision(collision_radius=10.0, max_acceleration=0.05)
    outside = constraint.evaluate(one((20.0, 0.0, 0.0), (-0.3, 0.4, 0.0)))
    assert outside.phi[0] == pytest.approx(10.0)
    assert outside.h[0] == pytest.approx(math.sqrt(2 * 0.05 * 10) - 0.3)
    np.testing.assert_allclose(outside.gradient[0], [0.05, 0.4 / 20, 0, 1, 0, 0], atol=1e-15)
    inside = constraint.evaluate(one((0.0, 0.0, -5.0), (0.0, 0.0, -0.2)))
    assert inside.phi[0] == pytest.approx(-5.0)
    assert inside.h[0] == pytest.approx(-math.sqrt(2 * 0.05 * 5) + 0.2)


def test_maximum_range_by_hand():
    constraint = MaximumRange(r_max=800.0, max_acceleration=0.1)
    inside = constraint.evaluate(one((0.0, 780.0, 0.0), (1.0, 0.5, 0.0)))
    assert inside.phi[0] == pytest.approx(20.0)
    assert inside.h[0] == pytest.approx(2.0 - 0.5)
    np.testing.assert_allclose(inside.gradient[0], [-1 / 780, -0.1 / 2, 0, 0, -1, 0], atol=1e-15)
    beyond = constraint.evaluate(one((0.0, 820.0, 0.0), (0.0, -0.5, 0.0)))
    assert (beyond.phi[0], beyond.h[0]) == (pytest.approx(-20.0), pytest.approx(-2.0 + 0.5))


def test_relative_speed_limit_by_hand():
    constraint = RelativeSpeedLimit(v0=0.2, v0_distance=10.0, v1=0.002)
    found = constraint.evaluate(one((0.0, 0.0, 110.0), (0.3, 0.0, -0.4)))
    assert found.phi[0] == pytest.approx(0.2 + 0.002 * 100 - 0.5)
    assert found.h[0] == pytest.approx(-0.1 - 1e-5, abs=1e-8)  # sqrt(0.25 + 1e-5) = 0.5 + 1e-5
    np.testing.assert_allclose(found.gradient[0], [0, 0, 0.002, -0.6, 0, 0.8], atol=2e-5)


def test_axis_speed_by_hand():
    found = AlongTrackSpeed(vel_limit=1.0).evaluate(one((50.0, 0.0, 0.0), (3.0, -0.6, 3.0)))
    assert (found.phi[0], found.h[0]) == (pytest.approx(0.4), pytest.approx(0.64))
    np.testing.assert_allclose(found.gradient[0], [0, 0, 0, 0, 1.2, 0])
    assert RadialSpeed(vel_limit=1.0)(one((50.0, 0.0, 0.0), (-1.5, 0.0, 0.0)))[0] == pytest.approx(-0.5)


@pytest.mark.parametrize(
    ("name", "linear", "cubic", "bias"),
    [
        ("chief_collision", 0.01, 0.001, 0.0),
        ("rel_vel", 0.05, 0.005, -1e-3),
        ("sun", 0.001, 0.0001, -1e-3),
        ("r_max", 0.01, 0.001, -1e-3),
        ("PSM", 0.01, 0.001, 0.0),
        ("x_vel", 0.1, 0.01, -1e-3),
        ("y_vel", 0.1, 0.01, -1e-3),
        ("z_vel", 0.1, 0.01, -1e-3),
    ],
)
def test_alpha_and_bias_are_those_of_the_reference(name, linear, cubic, bias):
    constraint = constraint_set({})[name]
    assert constraint.bias == bias
    h = np.array([-2.0, 0.0, 3.0])
    np.testing.assert_allclose(constraint.alpha(h), linear * h + cubic * h**3, rtol=1e-14)


CENTRE = (0.0, 0.0, 0.0)
SINGULAR = {
    "at rest in the centre": one(CENTRE),
    "moving through the centre": one(CENTRE, (0.1, -0.2, 0.3)),
    "a denormal distance": one((1e-300, 0.0, 0.0), (0.1, 0.0, 0.0)),
    "just within the floor": one((0.0, 9e-7, 0.0), (0.1, 0.2, 0.3)),
    "at rest": one((50.0, 0.0, 0.0)),
    "on the collision radius": one((10.0, 0.0, 0.0), (0.1, 0.1, 0.0)),
    "on the largest range": one((0.0, 800.0, 0.0), (0.0, 0.1, 0.1)),
    "behind the chief, on the cone's axis": one((-50.0, 0.0, 0.0), (0.1, 0.1, 0.1)),
    "before the chief, on the cone's axis": one((50.0, 0.0, 0.0), (0.1, 0.1, 0.1)),
    "on the cone": one((-50.0 * math.cos(math.pi / 6), 25.0, 0.0), (0.1, 0.1, 0.1)),
    "coasting into the centre along z": one((0.0, 0.0, 50.0), (0.0, 0.0, -1.0)),
}


@pytest.mark.parametrize("case", SINGULAR)
@pytest.mark.parametrize("name", constraint_set({}))
def test_singular_places_give_finite_values(name, case):
    found = constraint_set({"psm_horizon": 7000.0})[name].evaluate(SINGULAR[case])
    for values in (found.phi, found.h, found.gradient, found.rate):
        assert np.isfinite(values).all()


def test_the_values_at_singular_places_are_the_documented_ones():
    centre = one(CENTRE, (0.1, -0.2, 0.3))
    collision = ChiefCollision(collision_radius=10.0, max_acceleration=0.05).evaluate(centre)
    assert collision.h[0] == pytest.approx(-1.0 + 0.1)
    np.testing.assert_allclose(collision.gradient[0], [0.05, 0, 0, 1, 0, 0], atol=1e-15)
    assert SunKeepOut(fov=1.0)(centre)[0] == -0.5
    edge = ChiefCollision(collision_radius=10.0, max_acceleration=0.05).gradient(one((10.0, 0.0, 0.0)))
    assert edge[0, 0] == pytest.approx(0.05 / math.sqrt(2 * 0.05 * 1e-6))
    rest = RelativeSpeedLimit(v0=0.2, v0_distance=10.0, v1=0.002).evaluate(one((10.0, 0.0, 0.0)))
    assert rest.phi[0] == pytest.approx(0.2, abs=1e-15)
    assert rest.h[0] == pytest.approx(0.2 - math.sqrt(1e-5), abs=1e-8)
    np.testing.assert_array_equal(rest.gradient[0, 3:], 0.0)
    axis = SunKeepOut(fov=math.pi / 3).gradient(one((-50.0, 0.0, 0.0)))
    np.testing.assert_allclose(axis[0, 3:], [0.5, 0.0, math.cos(math.pi / 6)], atol=1e-15)
    # a coast through the centre along z: pushing along x is a way to miss, z is none
    along = PassivelySafeManoeuvre().evaluate(one((0.0, 0.0, 50.0), (0.0, 0.0, -1.0)))
    assert along.h[0] == pytest.approx(-10.0, abs=1e-6)
    assert along.gradient[0, 3] == pytest.approx(50.0, rel=1e-2)
    assert along.gradient[0, 5] == pytest.approx(0.0, abs=1e-12)


numbers = st.floats(-1e6, 1e6, allow_subnormal=True)


@settings(max_examples=150, deadline=None)
@given(st.tuples(*[numbers] * 3), st.tuples(*[numbers] * 3), numbers)
def test_every_finite_state_has_finite_values(position, velocity, sun_angle):
    state = one(position, velocity, sun_angle)
    for constraint in constraint_set({"psm_horizon": 12236.0}).values():
        found = constraint.evaluate(state)
        for values in (found.phi, found.h, found.gradient, found.rate):
            assert np.isfinite(values).all()


def test_a_state_that_is_no_number_stays_none():
    for name, constraint in constraint_set({}).items():
        if not name.endswith("_vel") or name == "rel_vel":
            assert np.isnan(constraint.h(one((np.nan, 1.0, 1.0), (0.1, 0.1, 0.1))))[0], name
        assert np.isnan(constraint.h(one((50.0, 1.0, 1.0), (np.nan,) * 3)))[0], name


def test_a_row_does_not_depend_on_the_batch(draw):
    state = draw(5, 257)
    for constraint in constraint_set({"psm_horizon": 7000.0}).values():
        whole = constraint.evaluate(state)
        for rows in [slice(i, i + 1) for i in range(257)] + [slice(3, 40), slice(None, None, -2)]:
            part = constraint.evaluate(state[rows])
            for field in ("phi", "h", "gradient", "rate"):
                assert getattr(part, field).tobytes() == np.ascontiguousarray(getattr(whole, field)[rows]).tobytes()


def test_layout_and_write_protection_of_the_arrays_do_not_matter_and_nothing_is_changed(draw):
    state = draw(6, 20)
    other = RelativeState(np.asfortranarray(state.position), state.velocity[:], state.sun_angle)
    before = [array.copy() for array in (other.position, other.velocity, other.sun_angle)]
    for array in (other.position, other.velocity, other.sun_angle):
        array.setflags(write=False)
    for constraint in constraint_set({}).values():
        np.testing.assert_array_equal(constraint.h(other), constraint.h(state))
        np.testing.assert_array_equal(constraint(other), constraint.phi(state))
    for array, copy in zip((other.position, other.velocity, other.sun_angle), before, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_the_arrays_of_a_state_are_those_that_kernels_require(draw):
    state = draw(6, 20)
    position = np.asfortranarray(state.position)
    position.setflags(write=False)
    made = RelativeState(position, state.velocity.astype(np.float32), state.sun_angle[::-1])
    for array in (made.position, made.velocity, made.sun_angle):
        assert (array.dtype, array.flags.c_contiguous, array.flags.writeable) == (np.float64, True, True)
    np.testing.assert_array_equal(made.position, state.position)


def test_no_rows_give_no_rows():
    empty = RelativeState(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    for constraint in constraint_set({}).values():
        assert constraint.gradient(empty).shape == (0, 6)


@pytest.mark.parametrize("shapes", [((2, 3), (2, 2), (2,)), ((2, 3), (1, 3), (2,)), ((2, 3), (2, 3), (2, 1))])
def test_shapes_that_do_not_belong_together_are_refused(shapes):
    with pytest.raises(ValueError, match=r"position \(R, 3\)"):
        RelativeState(*(np.zeros(shape) for shape in shapes))
