"""What the sun cone's kernels certify, and half-spaces of controls, computed a second time from the motion itself."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from safe_inspect.dynamics.cwh import transition
from safe_inspect.rta.backup.closed_motion import _cell, _node
from safe_inspect.rta.backup.cuts import add
from safe_inspect.rta.backup.holds import arc_cell
from safe_inspect.rta.backup.model import HOLD_PIECES
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.backup.workspace import workspace
from safe_inspect.rta.constraints.rows import Margins, node
from safe_inspect.rta.constraints.sun_cone import SUN_KERNELS, SunNumbers
from safe_inspect.types import FloatArray

from .plain import plain, strict

#: A fast orbit, on which every term counts [rad/s], and the steps of differences [s], [rad].
N, STEP, SPAN, ANGLE = 0.05, 0.05, 6.0, 0.3
CONE = SunNumbers(True, math.cos(0.5), math.sin(0.5), N)
CASES = 12


def sun_at(angle: float) -> tuple[float, float]:
    return math.cos(angle), math.sin(angle)


def turned_with_the_sun(position: FloatArray, angle: float) -> FloatArray:
    """Return a position along the axis away from the sun, across it in the orbital plane, and along z."""
    cos, sin = sun_at(angle)
    return np.array([[-cos, sin, 0.0], [-sin, -cos, 0.0], [0.0, 0.0, 1.0]]) @ position


def bent(path: Any, at: float, step: float) -> FloatArray:
    """Return the second derivative of a path."""
    return np.asarray((path(at + step) - 2.0 * path(at) + path(at - step)) / step**2)


def least_of_chord(fa: float, fb: float, dip: float) -> float:
    x = np.linspace(0.0, 1.0, 2001)
    return float((fa + x * (fb - fa) - dip * 4.0 * x * (1.0 - x)).min())


def outward(first: FloatArray, last: FloatArray) -> FloatArray:
    """Return the normal of the cone near the middle of two positions in the axes that turn with the sun."""
    across, z = first[1] + last[1], first[2] + last[2]
    return np.array([-CONE.sin_b, CONE.cos_b * across / np.hypot(across, z), CONE.cos_b * z / np.hypot(across, z)])


@pytest.mark.parametrize("seed", range(CASES))
def test_an_arc_is_certified_by_the_second_derivatives_at_both_ends(seed: int) -> None:
    generator = np.random.default_rng(seed)
    while not arc_is_certified_by_its_ends(generator):  # until the lowest point is between the ends
        pass


def arc_is_certified_by_its_ends(generator: np.random.Generator) -> bool:
    start = np.concatenate((generator.normal(size=3) * 40.0, generator.normal(size=3) * 3.0))
    push, angle = generator.normal(size=3) * 0.3, generator.uniform(0.0, 2.0 * np.pi)

    def state(time: float) -> Any:
        phi, gamma = transition(N, 1.0, time)
        return phi @ start + gamma @ push

    def path(time: float) -> FloatArray:
        return turned_with_the_sun(state(time)[:3], angle + N * time)

    ends = [plain(node)(tuple(state(t).tolist()), sun_at(angle + N * t)) for t in (0.0, SPAN)]
    cell = plain(arc_cell)(N, *ends, tuple(push.tolist()), SPAN)
    normal = outward(path(0.0), path(SPAN))
    curve = max(normal @ bent(path, 0.0, STEP), normal @ bent(path, SPAN, STEP))
    k = (N * SPAN) ** 2 / 8.0
    dip = max(0.0, SPAN**2 / 8.0 * curve + k * k * (24.0 * cell.reach / N + cell.farthest))
    low = normal @ path(0.0), normal @ path(SPAN)
    least = least_of_chord(*low, dip)
    uncertain = plain(SUN_KERNELS.uncertain)
    assert not uncertain(CONE, cell, Margins(least - 1e-3, 0.0, 0.0))
    assert uncertain(CONE, cell, Margins(least + 1e-3, 0.0, 0.0))
    assert not uncertain(CONE._replace(on=False), cell, Margins(1e9, 0.0, 0.0))

    return bool(least < min(low) - 0.05)


@pytest.mark.parametrize("seed", range(CASES))
def test_a_closed_motion_is_certified_by_the_second_derivatives_at_both_ends(seed: int) -> None:
    generator = np.random.default_rng(seed)
    while not closed_motion_is_certified_by_its_ends(generator):
        pass


def closed_motion_is_certified_by_its_ends(generator: np.random.Generator) -> bool:
    x, y, z, u, w = (generator.normal(size=5) * (12.0, 200.0, 40.0, 12.0, 40.0)).tolist()
    angle, begin = generator.uniform(0.0, 2.0 * np.pi, 2)

    def position(tau: float) -> FloatArray:
        cos, sin = sun_at(tau)
        return np.array([cos * x + sin * u, y - 2.0 * (1.0 - cos) * u - 2.0 * sin * x, cos * z + sin * w])

    def path(tau: float) -> FloatArray:
        return turned_with_the_sun(position(tau), angle + tau)

    end, initial = begin + ANGLE, (x, y, z, N * u, -2.0 * N * x, N * w)
    centre, rho = y - 2.0 * u, math.sqrt(4.0 * (x * x + u * u) + z * z + w * w)
    ends = [plain(_node)(N, initial, sun_at(angle), *sun_at(tau)) for tau in (begin, end)]
    for at, tau in zip(ends, (begin, end), strict=True):
        np.testing.assert_allclose(at.state, position(tau))
        np.testing.assert_allclose((at.along, at.across), path(tau)[:2])
        speed = np.linalg.norm(position(tau + 1e-5) - position(tau - 1e-5)) / 2e-5
        np.testing.assert_allclose((at.range, at.speed), (np.linalg.norm(position(tau)), N * speed), rtol=1e-6)
    cell = plain(_cell)(N, *ends, centre, rho, ANGLE)
    normal = outward(path(begin), path(end))
    curve = max(normal @ bent(path, begin, 1e-3), normal @ bent(path, end, 1e-3))
    k, low = ANGLE**2 / 8.0, (normal @ path(begin), normal @ path(end))
    least = least_of_chord(*low, max(0.0, k * curve + k * k * (15.0 * rho + cell.farthest)))
    least = max(least, min(low) - k * (3.0 * rho + cell.farthest))
    uncertain: Any = plain(SUN_KERNELS.closed_uncertain)
    assert not uncertain(CONE, cell, Margins(least - 1e-3, 0.0, 0.0))
    assert uncertain(CONE, cell, Margins(least + 1e-3, 0.0, 0.0))
    assert not uncertain(CONE._replace(on=False), cell, Margins(1e9, 0.0, 0.0))
    crude = min(low) - k * (3.0 * rho + cell.farthest)
    assert not uncertain(CONE, cell, Margins(min(crude, least) - 1e-3, 0.0, 0.0))
    return bool(crude < least < min(low) - 0.05)


def test_where_the_middle_of_a_cell_is_on_the_axis_the_normal_towards_z_is_used() -> None:
    mirrored = [plain(node)((50.0, side, 0.0, 0.0, 0.0, 0.0), (-1.0, 0.0)) for side in (1.0, -1.0)]
    cell = plain(arc_cell)(N, *mirrored, (0.0, 0.0, 0.0), 1e-3)
    gap = -50.0 * CONE.sin_b
    assert not plain(SUN_KERNELS.uncertain)(CONE, cell, Margins(gap - 1e-3, 0.0, 0.0))
    assert plain(SUN_KERNELS.uncertain)(CONE, cell, Margins(gap + 1e-3, 0.0, 0.0))


def test_a_half_space_of_controls_is_that_of_the_states_that_they_lead_to() -> None:
    """And none is written behind the end of the arrays."""
    model = BackupFilter(several_holds=False)._model
    generator, s = np.random.default_rng(1), plain(workspace)(2)
    x, phi, gamma = generator.normal(size=6), model.hold_phi[-1], model.hold_gamma[-1]
    count = 0
    for _ in range(2):
        u, d, need = generator.normal(size=3), generator.normal(size=6), generator.normal()
        s.d[:] = d
        b = tuple((phi @ x + gamma @ u).tolist())
        count = plain(add)(strict(model), need, b, u, HOLD_PIECES, s, count)
        v = generator.normal(size=3)
        left = s.rows[count - 1] @ v - s.bounds[count - 1]
        np.testing.assert_allclose(left, d @ (phi @ x + gamma @ v) - need, atol=1e-12)
    assert count == 2
    assert plain(add)(strict(model), 0.0, b, u, HOLD_PIECES, s, count) == 2


def test_the_half_space_of_the_sun_cone_touches_it_beside_the_nearest_point() -> None:
    """The outward normal of the cone at the state's own azimuth about the axis, also where one component is zero."""
    generator = np.random.default_rng(4)
    axes = [(0.0, -3.0), (0.0, 3.0), (-2.0, 0.0), (2.0, 0.0), *generator.normal(size=(20, 2)).tolist()]
    for across, z in axes:
        angle = generator.uniform(0.0, 2.0 * np.pi)
        cos, sin = sun_at(angle)
        along = generator.normal()
        x, y = -cos * along - sin * across, sin * along - cos * across
        at = plain(node)((x, y, z, 0.0, 0.0, 0.0), (cos, sin))
        assert (at.along, at.across) == pytest.approx((along, across))
        at = at._replace(across=across)  # an exact zero
        found = np.zeros(6)
        assert plain(SUN_KERNELS.support)(CONE, at, Margins(0.25, 0.0, 0.0), found) == 0.25
        size = math.hypot(across, z)
        normal = np.array([-CONE.sin_b, CONE.cos_b * across / size, CONE.cos_b * z / size])
        np.testing.assert_allclose(turned_with_the_sun(found[:3], angle), normal, atol=1e-9)
        assert not found[3:].any()
    found = np.zeros(6)
    plain(SUN_KERNELS.support)(CONE, plain(node)((5.0, 0.0, 0.0, 0.0, 0.0, 0.0), (1.0, 0.0)), Margins(0, 0, 0), found)
    np.testing.assert_allclose(found[:3], [CONE.sin_b, 0.0, CONE.cos_b], atol=1e-12)
