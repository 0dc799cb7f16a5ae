"""Jumps of the biases are taken out of the samples, and nothing else is."""

from __future__ import annotations

import numpy as np

from safe_inspect.rendezvous.estimation.bias_jump import BiasJumps

_STEP, _SAMPLES, _BIAS = 0.2, 12, np.array([1e-3, -1e-3, 0.0, 5e-5, 0.0, -5e-5])
_JUMP = np.repeat([0.02, 5e-4], 3)


def _steps(count: int, jumped: range, gain: float = 1.0, seed: int = 0):
    """Return samples and commands of a chaser that thrusts and turns, with an error of 3 mN of 10 kg."""
    generator, rate = np.random.default_rng(seed), np.zeros(3)
    times = (np.arange(_SAMPLES) + 1.0) / _SAMPLES * _STEP
    for k in range(count):
        commanded = generator.uniform(-1.0, 1.0, 6) * np.repeat([0.02, 0.05], 3)
        acceleration = gain * commanded[:3] + generator.uniform(-3e-4, 3e-4, 3)
        noise = generator.standard_normal((_SAMPLES, 6)) * np.repeat([2e-3, 1.5e-4], 3)
        true = np.hstack([np.tile(acceleration, (_SAMPLES, 1)), rate + times[:, None] * commanded[3:]])
        rate = rate + _STEP * commanded[3:]
        measured = true + _BIAS + noise + _JUMP * (k in jumped)
        yield [(row[:3], row[3:]) for row in measured], true + _BIAS + noise, commanded


def test_samples_without_a_jump_stay_as_they_are():
    jumps = BiasJumps()
    for samples, _, commanded in _steps(2_000, range(0)):
        corrected = jumps.corrected(samples, commanded, _BIAS, _STEP)
        assert all(one is other for one, other in zip(corrected, samples, strict=True))


def test_a_jump_and_its_end_are_taken_out():
    for seed in range(5):
        jumps, errors = BiasJumps(), []
        for samples, without, commanded in _steps(120, range(20, 60), seed=seed):
            corrected = jumps.corrected(samples, commanded, _BIAS, _STEP)
            errors.append(np.mean([np.hstack(row) for row in corrected], axis=0) - without.mean(axis=0))
        errors = np.abs(errors)
        assert errors[:20].max() == 0.0
        assert errors[20:, :3].max() < 3e-3  # at the first step, by one mean of twelve samples
        assert errors[[59, 119], :3].max() < 5e-4
        assert errors[20:, 3:].max() < 3e-4
        assert errors[[59, 119], 3:].max() < 1.5e-4


def test_after_frames_have_disagreed_nothing_is_corrected_further():
    """Thrusters that give nothing look like a jump at every command."""
    jumps, offsets = BiasJumps(), []
    for k, (samples, _, commanded) in enumerate(_steps(40, range(0), gain=0.0)):
        if k == 20:
            jumps.distrust()
        offsets.append(samples[0][0] - jumps.corrected(samples, commanded, _BIAS, _STEP)[0][0])
    assert np.ptp(offsets[:20], axis=0).min() > 5e-3
    np.testing.assert_allclose(offsets[20:], np.tile(offsets[20], (20, 1)), atol=1e-15)


def test_a_silent_unit_is_no_jump_of_the_gyroscopes():
    """It has turned meanwhile, as nobody has measured."""
    jumps = BiasJumps()
    silent = np.concatenate([np.zeros(3), [0.01, 0.0, 0.0]])
    for k, (samples, _, commanded) in enumerate(_steps(30, range(0))):
        if k == 10:
            jumps.interrupt()
        moved = [(one + silent[:3], other + silent[3:] * (k >= 10)) for one, other in samples]
        corrected = jumps.corrected(moved, commanded, _BIAS, _STEP)
        np.testing.assert_array_equal(corrected[0][1], moved[0][1])
