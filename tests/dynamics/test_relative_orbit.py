"""Motion relative to an elliptic, J2-perturbed orbit, against inertial integrations by SciPy and published figures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from safe_inspect.dynamics import Drag, MotionLimits, RelativeOrbit
from safe_inspect.dynamics.base import advance_kernel
from safe_inspect.dynamics.cwh import transition
from safe_inspect.dynamics.orbit.relative_orbit_row import (
    in_hill_frame,
    in_inertial_axes,
    orbit_row,
    relative_orbit_row,
)
from safe_inspect.errors import InitialStateError
from safe_inspect.types import FloatArray

MU, RADIUS, J2 = 3.986004418e14, 6_378_136.3, 1.0826355e-3
N, STEP = 0.001027, 10.0
AXIS = (MU / N**2) ** (1.0 / 3.0)
PERIOD = 2.0 * math.pi / N


def fly(
    plugin: RelativeOrbit, state: FloatArray, steps: int, thrust: FloatArray | None = None, decimation: int = 1,
    values: Mapping[str, Any] | None = None, mass: float = 12.0,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return states in Hill's frame (T + 1, R, 6) and the chief's orbits (T + 1, R, 6)."""
    rows = len(state)
    orbit = np.array(plugin.reset_shared(values or {}, rows)["chief_orbit"])
    position, velocity = state[:, None, :3].copy(), state[:, None, 3:].copy()
    control = np.zeros((rows, 1, 3)) if thrust is None else np.ascontiguousarray(thrust[:, None])
    spent, time, step = np.zeros((rows, 1)), np.zeros(rows), np.zeros(rows, np.int64)
    advance = advance_kernel(plugin, STEP / decimation)
    found, orbits = [state.copy()], [orbit.copy()]
    for _ in range(steps):
        advance(
            *plugin(STEP / decimation), orbit, position, velocity, control, np.array([mass]), STEP / decimation,
            decimation, spent, time, step,
        )  # fmt: skip
        found.append(np.concatenate((position[:, 0], velocity[:, 0]), axis=1))
        orbits.append(orbit.copy())
    return np.array(found), np.array(orbits)


def gravity(x: FloatArray, oblate: bool) -> FloatArray:
    """Return the acceleration at inertial positions (3,), from the gradient of the potential in Cartesian form."""
    r = np.linalg.norm(x)
    found = -MU * x / r**3
    if oblate:
        ratio = 5.0 * x[2] ** 2 / r**2
        found = found - 1.5 * J2 * MU * RADIUS**2 / r**5 * x * (np.array([1.0, 1.0, 3.0]) - ratio)
    return np.asarray(found)


def elements(e: float, i: float, perigee: float, anomaly: float) -> tuple[FloatArray, FloatArray]:
    """Return inertial position and velocity of the chief, from the perifocal frame."""
    p = AXIS * (1.0 - e * e)
    r = p / (1.0 + e * math.cos(anomaly)) * np.array([math.cos(anomaly), math.sin(anomaly), 0.0])
    v = math.sqrt(MU / p) * np.array([-math.sin(anomaly), e + math.cos(anomaly), 0.0])
    c, s = math.cos(perigee), math.sin(perigee)
    tilt = np.array([[1, 0, 0], [0, math.cos(i), -math.sin(i)], [0, math.sin(i), math.cos(i)]])
    turn = tilt @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return turn @ r, turn @ v


def hill_axes(r: FloatArray, v: FloatArray) -> FloatArray:
    """Return Hill's axes as rows."""
    x, z = r / np.linalg.norm(r), np.cross(r, v)
    z = z / np.linalg.norm(z)
    return np.array([x, np.cross(z, x), z])


def frame_rate(r: FloatArray, v: FloatArray, oblate: bool) -> FloatArray:
    """Return the angular velocity of Hill's frame, inertial axes: h / r^2 about z, and r a_z / h about x."""
    h, axes = np.cross(r, v), hill_axes(r, v)
    about_x = np.linalg.norm(r) * (axes[2] @ gravity(r, oblate)) / np.linalg.norm(h)
    return np.asarray(h / (r @ r) + about_x * axes[0])


def drag(x: FloatArray, v: FloatArray, air: Drag | None, coefficient: float) -> FloatArray:
    """Return the acceleration by drag in an atmosphere at rest."""
    if air is None:
        return np.zeros(3)
    density = air.density * math.exp(-(np.linalg.norm(x) - AXIS) / air.scale_height)
    return np.asarray(-0.5 * density * coefficient * np.linalg.norm(v) * v)


def inertial(
    start: FloatArray, e: float, i: float, perigee: float, anomaly: float, oblate: bool, times: FloatArray,
    thrust: FloatArray, air: Drag | None = None,
) -> FloatArray:  # fmt: skip
    """Return the deputy's states in Hill's frame (T, 6) by an integration of both bodies in inertial axes."""
    r, v = elements(e, i, perigee, anomaly)
    axes = hill_axes(r, v)
    offset = axes.T @ start[:3]
    first = np.concatenate((r, v, r + offset, v + axes.T @ start[3:] + np.cross(frame_rate(r, v, oblate), offset)))

    def rates(_: float, x: FloatArray) -> FloatArray:
        push = hill_axes(x[:3], x[3:6]).T @ thrust
        slowed = drag(x[:3], x[3:6], air, air.chief if air else 0.0)
        push = push + drag(x[6:9], x[9:], air, air.deputy if air else 0.0)
        return np.concatenate((x[3:6], gravity(x[:3], oblate) + slowed, x[9:], gravity(x[6:9], oblate) + push))

    found = solve_ivp(rates, (0.0, times[-1]), first, "DOP853", times, rtol=1e-13, atol=1e-9).y.T
    states = []
    for x in found:
        axes, turn = hill_axes(x[:3], x[3:6]), frame_rate(x[:3], x[3:6], oblate)
        apart = x[6:9] - x[:3]
        states.append(np.concatenate((axes @ apart, axes @ (x[9:] - x[3:6] - np.cross(turn, apart)))))
    return np.array(states)


@pytest.mark.parametrize("oblate", [False, True])
@pytest.mark.parametrize("e", [0.0, 0.02, 0.1])
@pytest.mark.parametrize(("push", "air"), [(0.0, None), (2e-5, None), (0.0, Drag(density=2e-11, scale_height=3e5))])
def test_an_orbit_agrees_with_an_integration_in_inertial_axes(
    e: float, oblate: bool, push: float, air: Drag | None
) -> None:
    rng = np.random.default_rng(int(100 * e) + oblate)
    i, perigee, anomaly = rng.uniform(0.1, 3.0), rng.uniform(0.0, 6.2), rng.uniform(0.0, 6.2)
    start = np.concatenate((rng.normal(size=3) * 50.0, rng.normal(size=3) * 0.02))
    thrust = rng.normal(size=3) * push
    plugin = RelativeOrbit(eccentricity=max(e, 0.1), oblate=oblate, drag=air)
    values = {"eccentricity": e, "inclination": i, "argument_of_perigee": perigee, "true_anomaly": anomaly}
    steps = round(PERIOD / STEP)
    found, _ = fly(plugin, start[None], steps, 12.0 * thrust[None], values=values)
    exact = inertial(start, e, i, perigee, anomaly, oblate, STEP * np.arange(steps + 1), thrust, air)
    assert np.abs(found[:, 0, :3] - exact[:, :3]).max() < 1e-6
    assert np.abs(found[:, 0, 3:] - exact[:, 3:]).max() < 1e-9
    assert np.abs(exact[:, :3]).max() > 100.0


def random_orbits(rng: np.random.Generator, rows: int, e: float) -> dict[str, FloatArray]:
    return {
        "eccentricity": rng.uniform(0.0, e, rows),
        "inclination": rng.uniform(0.0, math.pi, rows),
        "argument_of_perigee": rng.uniform(0.0, 2.0 * math.pi, rows),
        "true_anomaly": rng.uniform(0.0, 2.0 * math.pi, rows),
    }


@pytest.mark.parametrize(
    ("e", "oblate", "air", "share"),
    [
        (0.0, False, None, 0.97), (0.0, True, None, 0.255), (0.01, False, None, 0.755), (0.01, True, None, 0.435),
        (0.1, False, None, 0.70), (0.1, True, None, 0.635),
        (0.0, False, Drag(density=1e-8, scale_height=6e4, deputy=0.02, chief=0.01), 0.945),
        (0.0, False, Drag(density=1e-8, scale_height=6e4, deputy=0.01, chief=0.01), 0.915),
        (0.01, False, Drag(density=1e-8, scale_height=6e4, deputy=0.01, chief=0.02), 0.935),
    ],
)  # fmt: skip
@pytest.mark.parametrize(("distance", "speed"), [(800.0, 2.0), (100.0, 0.2)])
def test_a_step_departs_from_clohessy_wiltshire_within_the_bounds(
    e: float, oblate: bool, air: Drag | None, share: float, distance: float, speed: float
) -> None:
    """`share` of the bound is reached; much more or less than that, and a term of the bound is missing or too large."""
    rng, rows = np.random.default_rng(7), 4000
    plugin = RelativeOrbit(eccentricity=e, oblate=oblate, drag=air)
    start = np.zeros((rows, 6))
    undamped = RelativeOrbit(eccentricity=e, oblate=oblate)  # the elements vary along an orbit, but do not decay
    _, orbits = fly(undamped, start, 200, values=random_orbits(rng, rows, e))
    place, way = rng.normal(size=(2, rows, 3))
    start[:, :3] = distance * place / np.linalg.norm(place, axis=1, keepdims=True)
    start[:, 3:] = speed * way / np.linalg.norm(way, axis=1, keepdims=True)
    phi, _ = transition(N, 12.0, STEP)
    bound = plugin.disturbance_bounds(MotionLimits(STEP, 12.0, 1.0, distance, speed)).velocity
    largest = 0.0
    for orbit in orbits[::40]:
        found, chief = start.copy(), orbit.copy()
        position, velocity = found[:, None, :3].copy(), found[:, None, 3:].copy()
        advance_kernel(plugin, STEP)(
            *plugin(STEP), chief, position, velocity, np.zeros((rows, 1, 3)), np.array([12.0]), STEP, 1,
            np.zeros((rows, 1)), np.zeros(rows), np.zeros(rows, np.int64),
        )  # fmt: skip
        apart = np.concatenate((position[:, 0], velocity[:, 0]), axis=1) - start @ phi.T
        largest = max(
            largest, np.linalg.norm(apart[:, 3:], axis=1).max(), np.linalg.norm(apart[:, :3], axis=1).max() / STEP
        )
    assert share * bound <= largest <= min(share + 0.02, 1.0) * bound


def test_the_elements_oscillate_within_what_the_bounds_assume() -> None:
    rng = np.random.default_rng(3)
    for e in (0.0, 0.05, 0.1):
        values = random_orbits(rng, 400, 0.0) | {"eccentricity": np.full(400, e)}
        states, orbits = fly(RelativeOrbit(eccentricity=e), np.zeros((400, 6)), 3 * 612, values=values)
        unit = J2 * (RADIUS / (AXIS * (1.0 - e))) ** 2
        distance, momentum = orbits[..., 0], math.sqrt(MU * AXIS * (1.0 - e * e))
        assert distance.min() > AXIS * (1.0 - e) * (1.0 - 4.1 * unit)
        assert distance.max() < AXIS * (1.0 + e) * (1.0 + 4.1 * unit)
        assert np.abs(orbits[..., 2] / momentum - 1.0).max() < 4.1 * unit
        assert not states.any(), "the chief remains at the origin"


def test_a_circular_orbit_about_a_sphere_is_nearly_clohessy_wiltshire() -> None:
    """The difference is of the second order: a tenth of the distance gives a hundredth of the difference."""
    start = np.array([[1.0, 2.0, 0.5, 0.0, -2.0 * N, 0.001]])
    differences = []
    for scale in (100.0, 10.0):
        found, _ = fly(RelativeOrbit(oblate=False), scale * start, 300)
        phi, _ = transition(N, 12.0, 300 * STEP)
        differences.append(np.abs(found[-1, 0, :3] - scale * (start @ phi.T)[0, :3]).max())
    assert differences[0] / differences[1] == pytest.approx(100.0, rel=0.02)


def test_physics_steps_and_thrust_agree_with_one_step() -> None:
    start, thrust = np.array([[80.0, -60.0, 20.0, 0.05, -0.1, 0.02]]), np.array([[0.3, -0.5, 0.2]])
    plugin = RelativeOrbit(eccentricity=0.1)
    whole, orbit = fly(plugin, start, 60, thrust)
    parts, same = fly(plugin, start, 60, thrust, decimation=5)
    np.testing.assert_allclose(parts, whole, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(same, orbit, rtol=1e-10, atol=1e-6)


def test_a_long_step_is_integrated_in_parts() -> None:
    plugin, start = RelativeOrbit(eccentricity=0.1), np.array([[80.0, -60.0, 20.0, 0.05, -0.1, 0.02]])
    (steps,) = plugin(60.0)
    assert steps.substeps == 4
    short, orbits = fly(plugin, start, 6)
    orbit = np.array(plugin.reset_shared({}, 1)["chief_orbit"])[0]
    position, velocity = start[0, :3].copy(), start[0, 3:].copy()
    relative_orbit_row(steps, orbit, position, velocity, np.zeros(3), 12.0)
    orbit_row(steps, orbit)
    np.testing.assert_allclose(position, short[-1, 0, :3], rtol=1e-7)
    np.testing.assert_allclose(velocity, short[-1, 0, 3:], rtol=1e-7)
    np.testing.assert_allclose(orbit, orbits[-1, 0], rtol=1e-9, atol=1e-12)


def test_axes_are_turned_as_by_rotation_matrices() -> None:
    rng = np.random.default_rng(2)
    orbits, vectors = np.zeros((50, 6)), rng.normal(size=(50, 3))
    orbits[:, 3:] = rng.uniform(0.0, 2.0 * math.pi, (50, 3))
    inertial = np.zeros((50, 3))
    in_inertial_axes(orbits, vectors, inertial)
    for orbit, hill, found in zip(orbits, vectors, inertial, strict=True):
        to_inertial = Rotation.from_euler("ZXZ", orbit[[5, 3, 4]])
        np.testing.assert_allclose(found, to_inertial.apply(hill), atol=1e-12)
        np.testing.assert_allclose(in_hill_frame(orbit, tuple(found)), hill, atol=1e-12)


def test_elements_that_are_impossible_are_refused() -> None:
    with pytest.raises(ValueError, match=r"perigee is inside of the Earth.*`eccentricity` must be less than 0\.117"):
        RelativeOrbit(eccentricity=0.2)
    with pytest.raises(ValueError, match="lower the `mean_motion`"):
        RelativeOrbit(mean_motion=0.0013)
    with pytest.raises(
        InitialStateError, match=r"`eccentricity` is 0\.05, but the field of RelativeOrbit allows 0 to 0.01"
    ):
        RelativeOrbit(eccentricity=0.01).reset_shared({"eccentricity": np.array([0.0, 0.05])}, 2)
    with pytest.raises(InitialStateError, match=r"`eccentricity` is -0\.1"):
        RelativeOrbit(eccentricity=0.01).reset_shared({"eccentricity": np.array([-0.1])}, 1)
    with pytest.raises(ValueError, match="no bound"):
        RelativeOrbit().disturbance_bounds(MotionLimits(STEP, 12.0, 1.0, 100.0))
    with pytest.raises(ValueError, match="no bound"):
        RelativeOrbit().disturbance_bounds(MotionLimits(STEP, 12.0, 1.0, speed=1.0))


def test_a_published_case_of_two_elliptic_orbits_to_its_printed_digits() -> None:
    """Curtis, "Orbital Mechanics for Engineering Students", example 7.1: two bodies that are 9,600 km apart."""
    mu = 398600e9

    def orbit(h: float, e: float, i: float, node: float, perigee: float, anomaly: float) -> tuple[FloatArray, ...]:
        angles = Rotation.from_euler("ZXZ", [node, i, perigee], degrees=True)
        nu = math.radians(anomaly)
        r = h * h / mu / (1.0 + e * math.cos(nu)) * np.array([math.cos(nu), math.sin(nu), 0.0])
        return angles.apply(r), angles.apply(mu / h * np.array([-math.sin(nu), e + math.cos(nu), 0.0]))

    (r_a, v_a), (r_b, v_b) = (
        orbit(52059e6, 0.025724, 60.0, 40.0, 30.0, 40.0), orbit(52362e6, 0.0072696, 50.0, 40.0, 120.0, 40.0)
    )  # fmt: skip
    axes, turn = hill_axes(r_a, v_a), np.cross(r_a, v_a) / (r_a @ r_a)
    position, velocity = axes @ (r_b - r_a), axes @ (v_b - v_a - np.cross(turn, r_b - r_a))
    np.testing.assert_allclose(position, [-6701.2e3, 6828.3e3, -406.26e3], rtol=1.2e-5)
    np.testing.assert_allclose(velocity, [316.67, 111.99, 1247.0], rtol=4e-5)

    axis = (52059e6) ** 2 / mu / (1.0 - 0.025724**2)
    plugin = RelativeOrbit(mean_motion=math.sqrt(MU / axis**3), eccentricity=0.025724, oblate=False)
    values = {"inclination": math.radians(60.0), "argument_of_perigee": math.radians(30.0)}
    chief = plugin.reset_shared(values | {"true_anomaly": math.radians(40.0)}, 1)["chief_orbit"][0]
    assert chief[2] == pytest.approx(52059e6, rel=1e-6)
    assert chief[:2] == pytest.approx([np.linalg.norm(r_a), r_a @ v_a / np.linalg.norm(r_a)], rel=1e-5)
    (steps,) = plugin(0.01)
    before, after = velocity.copy(), velocity.copy()
    relative_orbit_row(steps, chief, position, after, np.zeros(3), 1.0)
    np.testing.assert_allclose((after - before) / 0.01, [-0.2222, -0.1807, 0.5059], rtol=2.5e-4)


def test_the_elements_of_an_orbit_are_those_of_its_reset() -> None:
    rng = np.random.default_rng(8)
    plugin = RelativeOrbit(eccentricity=0.1)
    drawn = random_orbits(rng, 50, 0.1) | {"right_ascension": rng.uniform(0.0, 2.0 * math.pi, 50)}
    figures = plugin.initial_figures(plugin.reset_shared(drawn, 50))
    assert figures.keys() == plugin.parameters.keys()
    for name, values in figures.items():
        np.testing.assert_allclose(values, drawn[name], rtol=1e-9, atol=1e-9, err_msg=name)
