"""Random numbers and draws of actions against the published generators, written in whole numbers of Python."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator

import numpy as np
import pytest

from safe_inspect.random.action_draws import (
    Categorical,
    DrawRows,
    Gaussian,
    Greedy,
    Hurdle,
    SquashedGaussian,
    draw_choices,
    draw_in_rollout,
    log_logistic,
)
from safe_inspect.random.splitmix import draw_in_ball, mix, next_uniform, pick_below, uniform_at

WORD, WORDS = 2**32, 2**64
WEYL = 0x9E3779B97F4A7C15


def split_mix(word: int) -> int:
    """Return the output function of SplitMix64."""
    word = (word ^ word >> 30) * 0xBF58476D1CE4E5B9 % WORDS
    word = (word ^ word >> 27) * 0x94D049BB133111EB % WORDS
    return word ^ word >> 31


def philox(counter: list[int], key: list[int]) -> list[int]:
    """Return the four words of Philox4x32-10."""
    for _ in range(10):
        high, low = divmod(0xD2511F53 * counter[0], WORD)
        other_high, other_low = divmod(0xCD9E8D57 * counter[2], WORD)
        counter = [other_high ^ counter[1] ^ key[0], other_low, high ^ counter[3] ^ key[1], low]
        key = [(key[0] + 0x9E3779B9) % WORD, (key[1] + 0xBB67AE85) % WORD]
    return counter


@pytest.mark.parametrize("seed", [0, 1, 12345, 2**63 + 7, 2**64 - 1])
def test_split_mix_and_what_is_picked_with_it(seed: int) -> None:
    assert int(mix(np.uint64(seed))) == split_mix(seed)
    state, word = np.array([seed], np.uint64), seed
    for _ in range(5):
        word = (word + WEYL) % WORDS
        assert next_uniform(state) == (split_mix(word) >> 11) / 2**53
        assert int(state[0]) == word
    for step, pick in ((0, 0), (3, 5), (1000, 4001)):
        first = split_mix((seed + WEYL * (step + 1)) % WORDS)
        word = split_mix((first + WEYL * (pick + 1)) % WORDS)
        for below in (1, 7, 1000):
            assert pick_below(np.uint64(seed), step, pick, below) == word % below


def uniform(key: int, step: int, pick: int) -> float:
    first = split_mix(((key ^ 0xD1B54A32D192ED03) + WEYL * (step + 1)) % WORDS)
    return (split_mix((first + WEYL * (pick + 1)) % WORDS) >> 11) / 2**53


@pytest.mark.parametrize("key", [3, 2**64 - 9])
def test_vectors_in_a_ball_and_on_its_surface(key: int) -> None:
    for step, pick in ((0, 0), (7, 2), (500, 31)):
        u, v, w = (uniform(key, step, 4 * pick + k) for k in range(3))
        assert uniform_at(np.uint64(key), step, 4 * pick) == u
        height, angle = 2.0 * u - 1.0, 2.0 * math.pi * v
        flat = math.sqrt(1.0 - height**2)
        direction = np.array([flat * math.cos(angle), flat * math.sin(angle), height])
        for on_surface, size in ((True, 2.5), (False, 2.5 * w ** (1.0 / 3.0))):
            found = draw_in_ball(np.uint64(key), step, pick, 2.5, on_surface)
            np.testing.assert_allclose(found, size * direction, rtol=1e-13, atol=1e-15)


ROWS = 40
SEED = 0x1234567890ABCDEF
SLOT = np.arange(ROWS, dtype=np.uint64) + np.uint64(2**32 - 5)
EPISODE, STEP, AGENT = np.arange(ROWS) % 7 + 2**32, np.arange(ROWS) * 13, np.arange(ROWS) % 3


def words(row: int, block: int, blocks: int) -> list[int]:
    counter = [int(AGENT[row]) * blocks + block + (int(STEP[row]) << 12), zlib.crc32(b"action")]
    return philox([*counter, int(EPISODE[row]) % WORD, int(SLOT[row]) % WORD], [SEED % WORD, SEED >> 32])


def uniforms(row: int, block: int, blocks: int) -> list[float]:
    return [(word + 0.5) / WORD for word in words(row, block, blocks)]


def normals(row: int, block: int, blocks: int) -> Iterator[float]:
    given = words(row, block, blocks)
    for first, second in ((0, 1), (2, 3)):
        radius = math.sqrt(-2.0 * math.log((given[first] + 0.5) / WORD))
        angle = 2.0 * math.pi * given[second] / WORD
        yield radius * math.cos(angle)
        yield radius * math.sin(angle)


def choice(logits: np.ndarray, number: float) -> tuple[int, float]:
    """Return the index at which the sum of probabilities passes a number, and the logarithm of its probability."""
    share = np.exp(logits.astype(np.float64) - float(logits.max()))
    share /= share.sum()
    index = int((np.cumsum(share)[:-1] < number).sum())
    return index, math.log(share[index])


def drawn(distribution: object, inputs: np.ndarray, explore: bool) -> tuple[np.ndarray, np.ndarray]:
    rows = DrawRows(np.uint64(SEED), SLOT, EPISODE, STEP, AGENT)
    action, log = np.full((ROWS, distribution.width), np.nan, np.float32), np.full(ROWS, np.nan, np.float32)
    distribution.draw(inputs, explore, rows, action, log)
    return action, log


def density(action: np.ndarray, mean: np.ndarray, log_std: np.ndarray) -> float:
    z = (action.astype(np.float64) - mean) / np.exp(log_std)
    return float(-(0.5 * z**2 + log_std + 0.5 * math.log(2.0 * math.pi)).sum())


@pytest.mark.parametrize("width", [1, 4, 5, 9])
def test_gaussian_actions(width: int) -> None:
    inputs = np.random.default_rng(width).normal(size=(ROWS, 2 * width)).astype(np.float32)
    mean, log_std = inputs[:, :width].astype(np.float64), inputs[:, width:].astype(np.float64)
    blocks = (width + 3) // 4
    action, log = drawn(Gaussian(width), inputs, True)
    for row in range(ROWS):
        z = np.array([value for block in range(blocks) for value in normals(row, block, blocks)])[:width]
        np.testing.assert_allclose(action[row], mean[row] + np.exp(log_std[row]) * z, rtol=1e-6, atol=1e-6)
        assert log[row] == pytest.approx(density(action[row], mean[row], log_std[row]), rel=1e-5, abs=1e-5)
    squashed, same = drawn(SquashedGaussian(width), inputs, True)
    np.testing.assert_array_equal(squashed, np.tanh(action))
    np.testing.assert_array_equal(same, log)
    quiet, log = drawn(Gaussian(width), inputs, False)
    np.testing.assert_array_equal(quiet, inputs[:, :width])
    np.testing.assert_allclose(log, [density(q, m, s) for q, m, s in zip(quiet, mean, log_std, strict=True)], rtol=1e-5)


def test_choices_of_several_elements() -> None:
    sizes = (2, 5, 1, 3, 4, 2)
    inputs = (1.5 * np.random.default_rng(0).normal(size=(ROWS, sum(sizes)))).astype(np.float32)
    ends = np.cumsum(sizes)
    assert Categorical(sizes).inputs == 17
    action, log = drawn(Categorical(sizes), inputs, True)
    best, best_log = drawn(Categorical(sizes), inputs, False)
    np.testing.assert_array_equal(drawn(Greedy(sizes), inputs, True)[0], best)
    for row in range(ROWS):
        total = best_total = 0.0
        for j, (size, end) in enumerate(zip(sizes, ends, strict=True)):
            logits = inputs[row, end - size : end]
            index, share = choice(logits, uniforms(row, j // 4, 2)[j % 4])
            assert action[row, j] == index
            total += share
            assert best[row, j] == logits.argmax()
            best_total += float(logits.max()) - math.log(np.exp(logits.astype(np.float64)).sum())
        assert log[row] == pytest.approx(total, rel=1e-5)
        assert best_log[row] == pytest.approx(best_total, rel=1e-5)
    equal = np.zeros((ROWS, 17), np.float32)
    assert not drawn(Categorical(sizes), equal, False)[0].any()


@pytest.mark.parametrize(("numbers", "choices"), [(1, 0), (3, 4), (4, 2), (5, 3), (9, 0)])
def test_hurdle_actions(numbers: int, choices: int) -> None:
    hurdle = Hurdle(numbers, choices)
    assert (hurdle.inputs, hurdle.width) == (1 + 2 * numbers + choices, numbers + (choices > 0))
    inputs = np.random.default_rng(numbers).normal(size=(ROWS, hurdle.inputs)).astype(np.float32)
    blocks = (numbers + 3) // 4
    for explore in (True, False):
        action, log = drawn(hurdle, inputs, explore)
        burning = 0
        for row in range(ROWS):
            logit, given = float(inputs[row, 0]), inputs[row, 1:].astype(np.float64)
            mean, log_std = given[:numbers], given[numbers : 2 * numbers]
            first, second = uniforms(row, blocks, blocks + 1)[:2]
            share = 1.0 / (1.0 + math.exp(-logit))
            burns = first < share if explore else share > 0.5
            burning += burns
            expected = math.log(share if burns else 1.0 - share)
            z = np.array([value for block in range(blocks) for value in normals(row, block, blocks + 1)])[:numbers]
            wanted = (mean + np.exp(log_std) * z * explore) * burns
            np.testing.assert_allclose(action[row, :numbers], wanted, rtol=1e-6, atol=1e-6)
            expected += density(action[row, :numbers], mean, log_std) if burns else 0.0
            if choices:
                logits = inputs[row, 1 + 2 * numbers :]
                index, part = choice(logits, second) if explore else (int(logits.argmax()), 0.0)
                assert action[row, numbers] == index
                whole = np.exp(logits.astype(np.float64)).sum()
                expected += part if explore else float(logits.max()) - math.log(whole)
            assert log[row] == pytest.approx(expected, rel=1e-5, abs=1e-5)
        assert 5 < burning < 35
    quiet = hurdle.without_noise(inputs)
    assert (quiet[:, 1 + numbers : 1 + 2 * numbers] == -20.0).all()
    quiet[:, 1 + numbers : 1 + 2 * numbers] = inputs[:, 1 + numbers : 1 + 2 * numbers]
    np.testing.assert_array_equal(quiet, inputs)
    rows, none = np.arange(ROWS), np.zeros(ROWS, np.int64)
    expected_choices = draw_in_rollout(hurdle, hurdle.without_noise(inputs), True, 9, rows, none, 0)
    np.testing.assert_array_equal(draw_choices(hurdle, inputs, 9), expected_choices)


@pytest.mark.parametrize("logit", [-800.0, -30.0, -1.0, 0.0, 1e-9, 2.0, 30.0, 800.0])
def test_the_logarithm_of_the_logistic_function(logit: float) -> None:
    expected = -math.log1p(math.exp(-logit)) if logit > -700.0 else logit
    assert log_logistic(logit) == pytest.approx(expected, rel=1e-12, abs=1e-300)
