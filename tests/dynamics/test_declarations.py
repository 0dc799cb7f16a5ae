"""What dynamics declare to simulations, plugins and safety filters, and the bounds of disturbances."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from safe_inspect.dynamics.attitude.clohessy_wiltshire_attitude import ClohessyWiltshireAttitude
from safe_inspect.dynamics.base import NO_DISTURBANCE, DisturbanceBounds, Dynamics, MotionLimits
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.dynamics.double_integrator import DoubleIntegrator
from safe_inspect.dynamics.free_flyer import FreeFlyer
from safe_inspect.dynamics.orbit.relative_orbit import RelativeOrbit

N = 0.0011
TURNING = ClohessyWiltshireAttitude(mean_motion=N)
#: Dynamics, and what they declare: traced, turns_thrust, initial values, offers, names of allowed reset parameters.
DECLARED: list[tuple[Dynamics, bool, bool, dict[str, Any], dict[str, Any], set[str]]] = [
    (ClohessyWiltshire(mean_motion=N), False, False, {}, {"mean_motion": N}, set()),
    (DoubleIntegrator(), False, False, {}, {}, set()),
    (
        TURNING, False, True,
        {"orientation": (0.0, 0.0, 0.0, 1.0), "angular_velocity": (0.0, 0.0, N)},
        {"mean_motion": N, "turning_body": TURNING}, set(),
    ),
    (
        ClohessyWiltshireAttitude(body_frame_thrust=False, rate_against="hill"), False, False,
        {"orientation": (0.0, 0.0, 0.0, 1.0), "angular_velocity": (0.0, 0.0, 0.0)}, {}, set(),
    ),
    (
        FreeFlyer(keeps_trace=True), True, True, {"orientation": (0.0, 0.0, 0.0, 1.0)}, {}, set(),
    ),
    (
        RelativeOrbit(mean_motion=N, eccentricity=0.02), False, False, {}, {"mean_motion": N, "orbit": "chief_orbit"},
        {"eccentricity", "inclination", "argument_of_perigee", "true_anomaly", "right_ascension"},
    ),
]  # fmt: skip


@pytest.mark.parametrize(
    ("dynamics", "traced", "turns", "initial", "offers", "allowed"), DECLARED, ids=lambda one: type(one).__name__
)
def test_dynamics_declare(
    dynamics: Dynamics, traced: bool, turns: bool, initial: dict[str, Any], offers: dict[str, Any], allowed: set[str]
) -> None:
    assert (dynamics.traced, dynamics.turns_thrust) == (traced, turns)
    assert dict(dynamics.initial()) == initial
    assert set(dynamics.allowed) == allowed
    found = dynamics.offers()
    assert {name: found[name] for name in offers} == offers
    assert ("mean_motion" in found) == (not isinstance(dynamics, (DoubleIntegrator, FreeFlyer)))
    if not isinstance(dynamics, RelativeOrbit):
        assert dynamics.reset_shared({}, 3) == dynamics.initial_figures({}) == {}


def test_only_motion_that_follows_clohessy_and_wiltshire_has_bounds() -> None:
    limits = MotionLimits(step_size=10.0, mass=12.0, thrust=1.0, distance=800.0, speed=2.0)
    assert ClohessyWiltshire().disturbance_bounds(limits) == NO_DISTURBANCE
    assert DoubleIntegrator().disturbance_bounds(limits) is None
    assert FreeFlyer().disturbance_bounds(limits) is None
    orbit = RelativeOrbit(eccentricity=0.01).disturbance_bounds(limits)
    assert orbit.velocity > 0.0
    assert orbit.bounds[1:] == (0.0, 0.0, 0.0, 0.0)


def test_the_reset_parameters_of_an_orbit_have_these_ranges() -> None:
    turn = 2.0 * math.pi
    assert RelativeOrbit(eccentricity=0.03).allowed == {
        "eccentricity": (0.0, 0.03), "inclination": (0.0, math.pi), "argument_of_perigee": (-turn, turn),
        "true_anomaly": (-turn, turn), "right_ascension": (-turn, turn),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "uniform"),
    [({"oblate": False}, True), ({}, False), ({"oblate": False, "eccentricity": 0.01}, False),
     ({"oblate": False, "drag": {}}, False)],
)  # fmt: skip
def test_hill_s_frame_turns_uniformly_on_an_undisturbed_circle_only(changes: dict[str, Any], uniform: bool) -> None:
    assert RelativeOrbit(**changes).uniform is uniform


def test_the_integration_of_an_orbit_has_steps_of_at_most_a_fiftieth_of_a_radian() -> None:
    """At the perigee the chief turns by n sqrt(1 + e) / (1 - e)^(3/2) a second."""
    for eccentricity, step in ((0.0, 10.0), (0.07, 10.0), (0.07, 60.0), (0.07, 1.0)):
        orbit = RelativeOrbit(mean_motion=N, eccentricity=eccentricity)
        substeps = orbit(step)[0].substeps
        turn = N * math.sqrt(1.0 + eccentricity) / (1.0 - eccentricity) ** 1.5 * step
        assert turn / substeps <= 0.02
        assert substeps == 1 or turn / (substeps - 1) > 0.02


def test_the_bounds_of_disturbances_are_ordered_compared_and_added_by_field() -> None:
    one = DisturbanceBounds(
        velocity=1e-3, position_error=0.2, velocity_error=3e-3, thrust_gain=0.1, thrust_direction=0.05
    )
    assert one.bounds == (1e-3, 0.2, 3e-3, 0.1, 0.05)
    assert one.exceeded(one) == []
    for name in DisturbanceBounds.model_fields:
        larger = one.model_copy(update={name: 1.01 * getattr(one, name)})
        assert one.exceeded(larger) == [name]
        assert larger.exceeded(one) == []
    both = one + DisturbanceBounds(velocity=2e-3, position_error=0.1, thrust_gain=0.2, thrust_direction=0.01)
    assert both.bounds == pytest.approx((3e-3, 0.3, 3e-3, 1.1 * 1.2 - 1.0, 0.06))


def test_the_error_of_a_thrust_is_the_largest_over_its_gains_and_directions() -> None:
    bounds = DisturbanceBounds(thrust_gain=0.2, thrust_direction=0.3)
    gains, angles = np.meshgrid(np.linspace(0.8, 1.2, 41), np.linspace(0.0, 0.3, 41))
    errors = np.hypot(gains * np.cos(angles) - 1.0, gains * np.sin(angles))
    assert bounds.thrust_error == pytest.approx(errors.max(), rel=1e-12)
    assert NO_DISTURBANCE.thrust_error == 0.0
