"""The bounds of a cell of an arc, on which the certificate of every hold rests, against samples of the exact motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from safe_inspect.compiling import njit
from safe_inspect.rta.backup.holds import arc_cell
from safe_inspect.rta.constraints.rows import lowest, node

SUN = (1.0, 0.0)
SAMPLES = 64


@njit
def _write_cell(n, a, b, w, span, out):
    cell = arc_cell(n, node(a, SUN), node(b, SUN), w, span)
    for axis in range(3):
        out[axis], out[3 + axis] = cell.acceleration_a[axis], cell.acceleration_b[axis]
    out[6], out[7], out[8], out[9], out[10] = cell.eighth, cell.k, cell.reach, cell.bend, cell.slack
    out[11], out[12], out[13], out[14], out[15] = cell.farthest, cell.size, cell.near_a, cell.near_b, cell.dip


@njit
def _lowest(fa, fb, dip):
    return lowest(fa, fb, dip)


class Cell(NamedTuple):
    acceleration_a: np.ndarray
    acceleration_b: np.ndarray
    eighth: float
    k: float
    reach: float
    bend: float
    slack: float
    farthest: float
    size: float
    near_a: float
    near_b: float
    dip: float


def cell_of(n, motion, w, span):
    out = np.empty(16)
    first, last = (tuple(map(float, state)) for state in (motion[0], motion[-1]))
    _write_cell(n, first, last, tuple(map(float, w)), span, out)
    return Cell(out[:3], out[3:6], *map(float, out[6:]))


def equations(n):
    """Return the matrix of the Clohessy-Wiltshire equations of position and velocity."""
    a = np.zeros((6, 6))
    a[:3, 3:] = np.eye(3)
    a[3, 0], a[3, 4], a[4, 3], a[5, 2] = 3.0 * n**2, 2.0 * n, -2.0 * n, -(n**2)
    return a


def flown(n, x, w, span):
    """Return the exact states at equal times of a constant acceleration w, shape (SAMPLES + 1, 6)."""
    whole = np.zeros((9, 9))
    whole[:6, :6], whole[3:6, 6:] = equations(n), np.eye(3)
    step = expm(whole * (span / SAMPLES))
    states = [np.concatenate((x, w))]
    for _ in range(SAMPLES):
        states.append(step @ states[-1])
    return np.array(states)[:, :6]


def norm(vectors):
    return np.linalg.norm(vectors, axis=-1)


def check(n, x, w, span):
    """Hold every number of a cell against the sampled motion: it bounds it, and from near."""
    motion = flown(n, x, w, span)
    cell = cell_of(n, motion, w, span)
    p, v = motion[:, :3], motion[:, 3:]
    a = (motion @ equations(n).T)[:, 3:] + w
    scale = norm(p).max() + norm(v).max() / n + norm(a).max() / n**2
    tiny = 1e-12 * scale  # [m]

    np.testing.assert_allclose(cell.acceleration_a, a[0], rtol=1e-9, atol=tiny * n**2)
    np.testing.assert_allclose(cell.acceleration_b, a[-1], rtol=1e-9, atol=tiny * n**2)
    assert cell.eighth == pytest.approx(span**2 / 8.0)
    assert cell.k == pytest.approx((n * span) ** 2 / 8.0)

    share = np.linspace(0.0, 1.0, SAMPLES + 1)
    chord = motion[0] + share[:, None] * (motion[-1] - motion[0])
    bend, slack = norm(p - chord[:, :3]), norm(v - chord[:, 3:])
    shape = 4.0 * share * (1.0 - share)
    assert (norm(v) + norm(a) / n <= cell.reach + n * tiny).all()
    assert (bend <= cell.bend * shape + tiny).all()
    assert (slack <= cell.slack * shape + n * tiny).all()
    assert (norm(p) <= cell.farthest + tiny).all()

    along = p[0] + p[-1]
    assert cell.size == pytest.approx(norm(along), rel=1e-9)
    component = p @ (along / norm(along))
    assert (cell.near_a, cell.near_b) == pytest.approx((component[0], component[-1]), rel=1e-9, abs=tiny)
    below = component[0] + share * (component[-1] - component[0]) - component
    assert (below <= cell.dip * shape + tiny).all()
    assert (norm(p) >= _lowest(cell.near_a, cell.near_b, cell.dip) - tiny).all()

    # from near: each departs from what it bounds by no more than the acceleration can change within the cell
    assert cell.reach * (1.0 - 9.0 * cell.k) <= norm(v).max() + norm(a).max() / n + n * tiny
    change = 3.0 * n**2 * cell.reach * span  # the jerk is at most 3 n^2 reach
    assert cell.bend <= bend.max() + 2.0 * cell.eighth * change + tiny
    assert cell.farthest <= norm(p).max() + cell.bend + tiny
    assert 0.0 <= cell.dip <= max(below.max(), 0.0) + 2.0 * cell.eighth * change + tiny


numbers = st.floats(-1.0, 1.0)
vectors = st.tuples(numbers, numbers, numbers)


@settings(max_examples=300, deadline=None)
@given(
    n=st.floats(1e-4, 5e-3),
    angle=st.floats(1e-3, 0.9),
    position=vectors.filter(lambda vector: norm(vector) > 1e-2),
    velocity=vectors,
    thrust=vectors,
    sizes=st.tuples(st.sampled_from((10.0, 100.0, 800.0)), st.sampled_from((0.0, 0.01, 1.0)), st.floats(0.0, 0.2)),
)
def test_a_cell_bounds_the_motion_from_near(n, angle, position, velocity, thrust, sizes):
    """For cells of any size for which the bounds are made, 9 k < 1, which are much longer than those of a hold."""
    x = np.concatenate((np.multiply(sizes[0], position), np.multiply(sizes[1], velocity)))
    check(n, x, np.multiply(sizes[2], thrust), angle / n)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_acceleration_that_grows_along_the_cell_or_falls(axis, sign):
    """At one end it is zero: the bounds are those of the other end, whichever that is."""
    n, span = 1e-3, 800.0
    x = np.zeros(6)
    x[axis], x[3 + (axis + 1) % 3] = 200.0, 0.3 * sign
    w = -(equations(n) @ x)[3:]
    check(n, x, w, span)
    check(n, flown(n, x, w, -span)[-1], w, span)


def test_a_body_that_is_pushed_from_rest_far_below_the_rate_of_the_orbit():
    """p = p0 + w t^2 / 2: it departs from its chord by w D^2 / 8 at the middle, towards the origin or away from it."""
    n, span, push = 1e-7, 100.0, 0.02
    for direction in (1.0, -1.0):
        w = np.array([direction * push, 0.0, 0.0])
        cell = cell_of(n, flown(n, np.array([200.0, 0.0, 0.0, 0.0, 0.0, 0.0]), w, span), w, span)
        arrow = push * span**2 / 8.0
        assert cell.bend == pytest.approx(arrow, rel=1e-4)
        assert cell.dip == pytest.approx(arrow if direction > 0.0 else 0.0, rel=1e-4)
        assert (cell.near_a, cell.near_b) == pytest.approx((200.0, 200.0 + direction * 4.0 * arrow), rel=1e-4)
