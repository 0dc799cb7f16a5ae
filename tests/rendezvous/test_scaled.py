"""A scenario of sixteen times the length: sixteen is a power of two, so that no number is rounded differently."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.missions.mission import Mission
from safe_inspect.missions.truth import estimator_context
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.control.design import lqr_gain
from safe_inspect.rendezvous.control.tracker import LinearFeedback
from safe_inspect.rendezvous.control.tube import no_tube
from safe_inspect.rendezvous.estimate import JointErrors, StateEstimate
from safe_inspect.rendezvous.estimation.change import ActuatorResponse
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.inertial_unit import ImuNoise
from safe_inspect.rendezvous.readings import Command

_FOLDER = configs_root() / "tumbling-rendezvous"
_SCALE = 16.0


def _flown(overrides: list[str], seconds: float) -> list[tuple[StateEstimate, np.ndarray]]:
    """Return the estimate of each control step, and the force that was commanded before it."""
    mission = Mission(load_rendezvous(_FOLDER / "experiment.yml", overrides).config)
    found = []
    for readings, _, _ in mission.steps():
        if readings.command is not None:
            context = mission.pilot.context
            axis, force = context.axis, context.tracking_limits.force
            tracker = LinearFeedback(axis, no_tube(1, lqr_gain(axis, 0.3)), force)
            context.holding = tracker  # the same gain for any length
            found.append((context.estimate, readings.command.force))
        if readings.time >= seconds:
            break
    return found


def _lengths(scale: float) -> list[str]:
    """Return the overrides that multiply all lengths of the experiment."""
    lengths = {
        "mission.length": (1.0, "m"), "mission.hold_position": (0.03, "m"), "mission.hold_speed": (0.01, "m/s"),
        "mission.departure_speed": (0.02, "m/s"), "chaser.radius": (0.28, "m"),
        "chaser.actuator.force_noise": (3e-3, "N"), "chaser.limits.planned_force": (0.168, "N"),
        "chaser.limits.force": (0.3, "N"), "chaser.limits.speed": (0.115, "m/s"),
        "chaser.limits.tracking_speed": (0.2, "m/s"), "target.config.scale": (0.05, ""),
        "sensors.camera.scale": (1.0, ""), "sensors.camera.least_range": (0.2, "m"),
        "sensors.camera.largest_range": (4.0, "m"), "sensors.poses.translation_sigma": (3e-3, "m"),
        "sensors.poses.view_translation": (5e-3, "m"), "sensors.poses.model_translation": (5e-3, "m"),
        **{f"sensors.imu.{name}": (getattr(ImuNoise(), name), "")
           for name in ("acceleration", "acceleration_bias", "acceleration_walk")},
    }  # fmt: skip
    points = {
        "chaser.position": (0.0, -1.5, 0.0),
        "chaser.camera_position": (0.13, 0.0, 0.0),
        "chaser.limits.keep_in": (0.8, 3.0, 0.8),
        "target.config.mating_point": (0.25, 0.0, 0.42),
    }
    return [
        *(f"{key}={scale * value!r} {unit}".strip() for key, (value, unit) in lengths.items()),
        *(f"{key}=[{', '.join(f'{scale * value!r} m' for value in point)}]" for key, point in points.items()),
    ]


@pytest.mark.parametrize(("front_end", "seconds"), [("ModelFrontEnd", 6.0), ("MeasuredPoses", 45.0)])
def test_a_larger_scenario_is_estimated_like_a_small_one(front_end: str, seconds: float) -> None:
    options = [f"estimator.config.front_end={front_end}", "tumble.config.rate=8 deg/s"]
    small, large = (_flown([*options, *_lengths(scale)], seconds) for scale in (1.0, _SCALE))
    assert len(small) == len(large) > 25
    for (one, force), (other, larger_force) in zip(small, large, strict=True):
        np.testing.assert_allclose(larger_force, _SCALE * force, rtol=1e-9, atol=1e-12)
        for mine, theirs in ((one.chaser, other.chaser), (one.target, other.target)):
            for name, factor in (
                ("position", _SCALE),
                ("velocity", _SCALE),
                ("orientation", 1),
                ("angular_velocity", 1),
            ):
                expected = factor * getattr(mine, name)
                np.testing.assert_allclose(getattr(theirs, name), expected, rtol=1e-9, atol=1e-8)
        for name, factor in (("attitude", 1.0), ("rate", 1.0), ("centre", _SCALE), ("velocity", _SCALE)):
            assert getattr(other.errors, name) == pytest.approx(factor * getattr(one.errors, name), rel=1e-6)
        assert other.mismatch == pytest.approx(_SCALE * one.mismatch, rel=1e-6)
        if isinstance(one.errors, JointErrors):
            assert isinstance(other.errors, JointErrors)
            factors = np.repeat([1.0, _SCALE], [8, 6])
            joint = one.errors.joint * np.outer(factors, factors)
            np.testing.assert_allclose(other.errors.joint, joint, rtol=1e-6, atol=1e-15)
    assert isinstance(small[-1][0].errors, JointErrors) == (front_end == "MeasuredPoses")


def test_the_motion_that_is_expected_of_the_actuators_is_in_units_of_the_scenario() -> None:
    config = load_rendezvous(_FOLDER / "experiment.yml", _lengths(_SCALE)).config
    context = estimator_context(config, config.target(), Streams(0, np.zeros(1, np.int64), np.zeros(1, np.int64)))
    force, torque, rate = np.array([4.0, -1.0, 2.0]), np.array([0.01, 0.0, 0.02]), np.array([0.1, 0.2, -0.1])
    large = ActuatorResponse(context.chaser, 0.2).step(rate, Command(force, torque))
    own = ActuatorResponse(context.in_units_of(_SCALE).chaser, 0.2).step(rate, Command(force / _SCALE, torque))
    np.testing.assert_allclose(own.mean, large.mean / np.repeat([_SCALE, 1.0], 3), rtol=1e-12)
    np.testing.assert_allclose(own.sigma, large.sigma / [_SCALE, 1.0], rtol=1e-12)
