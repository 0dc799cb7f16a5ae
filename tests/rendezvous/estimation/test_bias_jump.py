"""Jumps of the biases are found by the expected motion, with a covariance, and nothing else is taken for one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from safe_inspect.rendezvous.estimation.change import ActuatorResponse, BiasJumps, ExpectedMotion
from safe_inspect.rendezvous.estimation.factors import BiasJump, ImuBuffer
from safe_inspect.rendezvous.estimation.graph import ISAM2BackEnd, PoseGraph
from safe_inspect.rendezvous.estimation.states import CentrePrior, ChaserStart, GraphEstimate
from safe_inspect.rendezvous.inertial_unit import ImuNoise, InertialSample
from safe_inspect.rendezvous.models import ActuatorConfig, ChaserConfig
from safe_inspect.rendezvous.readings import Command

_STEP, _TICK = 0.2, 0.008
_BIAS = np.array([1e-3, -1e-3, 0.0, 5e-5, 0.0, -5e-5])
_JUMP = np.repeat([0.02, 5e-4], 3)


def _steps(count: int, jumped: range, seed: int = 0) -> Iterator[tuple[list[InertialSample], ExpectedMotion]]:
    """Give samples and expected motion of a chaser that thrusts and turns, with an error of 3 mN of 10 kg.

    A sample falls on every second tick, and a step has 25 of them: their mean time is the middle of a step plus half a
    tick, with 12 samples or with 13.
    """
    generator, rate = np.random.default_rng(seed), np.zeros(3)
    for k in range(count):
        commanded = generator.uniform(-1.0, 1.0, 6) * np.repeat([0.02, 0.15], 3)
        acceleration = commanded[:3] + generator.uniform(-3e-4, 3e-4, 3)
        samples = []
        for tick in range(1 + (k % 2 == 0), 26, 2):
            noise = generator.standard_normal(6) * np.repeat([2e-3, 1.5e-4], 3)
            motion = np.concatenate([acceleration, rate + tick * _TICK * commanded[3:]])
            value = motion + _BIAS + noise + _JUMP * (k in jumped)
            samples.append(InertialSample(tick * _TICK, value[:3], value[3:]))
        rate = rate + _STEP * commanded[3:]
        yield samples, ExpectedMotion(commanded, np.array([2e-4, 1e-4]))


def test_without_a_jump_none_is_suspected():
    """With torques at their limit, and samples whose mean time is not the middle of a step."""
    jumps = BiasJumps(ImuNoise())
    assert all(jumps.check(*step, np.zeros(3), _STEP) is None for step in _steps(2_000, range(0)))


def test_a_jump_and_its_end_are_found_with_their_covariance():
    normalised = []
    for seed in range(20):
        jumps = BiasJumps(ImuNoise())
        for k, step in enumerate(_steps(60, range(20, 40), seed)):
            found = jumps.check(*step, np.zeros(3), _STEP)
            assert (found is None) == (k < 20)
            if found is not None:
                error = (found.offset - _JUMP * (k < 40)).reshape(2, 3) / found.sigma[:, None]
                assert (np.abs(error) < 4.5).all()
                normalised.append(error.ravel())
    assert 0.1 < np.mean(np.square(normalised)) < 1.5


def test_after_a_frame_nothing_is_corrected_further():
    """The graph then counts the jump as part of the bias, and the end of the jump is a separate jump."""
    jumps, bias = BiasJumps(ImuNoise()), np.zeros(3)
    for k, step in enumerate(_steps(60, range(20, 40))):
        found = jumps.check(*step, bias, _STEP)
        assert (found is None) == (k not in (*range(20, 25), *range(40, 45)))
        if k % 5 == 4:
            jumps.settle()
            bias = bias if found is None else bias + found.offset[:3]


def test_a_silent_unit_is_no_jump_of_the_gyroscopes():
    """It has turned meanwhile, as nobody has measured."""
    jumps = BiasJumps(ImuNoise())
    for k, (samples, expected) in enumerate(_steps(30, range(0))):
        if k == 10:
            assert jumps.check((), expected, np.zeros(3), _STEP) is None
        turned = [one._replace(rate=one.rate + np.array([0.01, 0.0, 0.0]) * (k >= 10)) for one in samples]
        assert jumps.check(turned, expected, np.zeros(3), _STEP) is None


@pytest.mark.parametrize("lag", [0.0, 0.4])
def test_the_expected_motion_is_that_of_the_actuators(lag: float):
    """A force and a torque that are reversed are followed by the lag, and the uncertainty covers the scale error."""
    config = ChaserConfig(actuator=ActuatorConfig(lag=lag, scale_error=0.05))
    response, acts, moments = ActuatorResponse(config, _STEP), np.zeros(6), np.array(config.inertia)
    for sign in (1.0, 1.0, -1.0, -1.0):
        command = sign * np.repeat([0.1, 0.02], 3)
        times = (np.arange(1000) + 0.5) / 1000.0 * _STEP
        left = np.exp(-times / lag)[:, None] if lag else np.zeros((1000, 1))
        true = 1.05 * (command + left * (acts - command)).mean(axis=0)
        acts = command + (np.exp(-_STEP / lag) * (acts - command) if lag else 0.0)
        expected = response.step(np.zeros(3), Command(command[:3], command[3:]))
        error = expected.mean - true / np.concatenate([np.full(3, config.mass), moments])
        assert np.linalg.norm(error[:3]) < expected.sigma[0]
        assert np.linalg.norm(error[3:]) < expected.sigma[1]


def _watched(jump: np.ndarray, corrected: BiasJump | None) -> GraphEstimate:
    """Return the graph of a chaser whose biases jump between two frames, one second apart, that show nothing."""
    start, centre = ChaserStart(np.eye(4), np.zeros(3)), CentrePrior(np.array([1.5, 0.0, 0.0]), 0.1)
    graph = PoseGraph(ImuBuffer(ImuNoise(), 0.1), start, centre, ISAM2BackEnd(largest=600, memory=0.0))
    for frame in range(1, 21):
        for _ in range(10):
            if frame == 5 and corrected is not None:
                graph.imu.correct(corrected)
            graph.imu.add(jump[:3] * (frame >= 5), jump[3:] * (frame >= 5), 0.1)
        graph.update(frame, [])
    return graph.estimate()


def test_the_graph_takes_a_jump_with_its_covariance():
    sigma = np.array([1e-3, 1e-4])
    usual, found = _watched(np.zeros(6), None), _watched(_JUMP, BiasJump(_JUMP, sigma, 0.2))
    np.testing.assert_allclose(found.bias, _JUMP, atol=1e-9)
    np.testing.assert_allclose(found.chaser[:3, :3], np.eye(3), atol=1e-4)
    np.testing.assert_allclose(found.chaser[:3, 3], 0.0, atol=0.02)  # half a period passes until the first sample
    # A jump that is not there turns the chaser, and the covariance covers it.
    wrong = _watched(np.zeros(6), BiasJump(np.repeat([2e-3, 2e-4], 3), sigma, 0.2))
    turned = np.sqrt(np.trace(wrong.chaser_covariance[:3, :3] - usual.chaser_covariance[:3, :3]) / 3.0)
    assert turned == pytest.approx(sigma[1] * 15.5, rel=0.1)
    angle = np.arccos((np.trace(wrong.chaser[:3, :3]) - 1.0) / 2.0)
    assert 1.5 * turned < angle < 4.0 * turned
