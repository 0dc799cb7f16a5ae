from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from safe_inspect.random.streams import Streams, draw_bits, philox4x32
from safe_inspect.simulators import Draw
from safe_inspect.simulators.resets.parameters import TruncatedNormalParameter

_ONES = 0xFFFFFFFF


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        # Known answers of Random123's kat_vectors, philox4x32 with 10 rounds.
        ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((_ONES,) * 4, (_ONES, _ONES), (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_philox_known_answers(counter: tuple[int, ...], key: tuple[int, int], words: tuple[int, ...]) -> None:
    whole = key[0] | key[1] << 32
    assert tuple(int(word) for word in philox4x32(*map(np.uint64, (*counter, whole)))) == words


def test_philox_gives_every_counter_its_own_words() -> None:
    words = {tuple(map(int, philox4x32(*map(np.uint64, (counter, 0, 0, 0, 1 | 2 << 32))))) for counter in range(4096)}
    assert len(words) == 4096
    assert max(map(max, words)) < 2**32


def test_a_stream_is_the_counter_of_block_name_episode_and_slot() -> None:
    rows = np.array([7, 2**32 - 1], dtype=np.uint64)
    seed, name, index = 0x0123456789ABCDEF, 0xCAFE, 3
    drawn = draw_bits(np.uint64(seed), rows, rows + np.uint64(1), np.uint64(name), np.uint64(index), 3)
    for row, slot in zip(drawn, (7, 2**32 - 1), strict=True):
        words = []
        for block in (0, 1):
            counter = (block + (index << 12), name, (slot + 1) % 2**32, slot, seed)
            words += [int(word) for word in philox4x32(*map(np.uint64, counter))]
        pairs = [(high << 32) | low for high, low in zip(words[::2], words[1::2], strict=True)]
        assert [int(word) for word in row] == pairs[:3]


def streams(seed: int, rows: int, first_slot: int = 0, episode: int = 0) -> Streams:
    return Streams(seed, first_slot + np.arange(rows), np.full(rows, episode))


class TestStreams:
    def test_shapes_and_range(self) -> None:
        drawn = streams(1, 10)
        assert len(drawn) == 10
        assert drawn.bits("x").shape == (10, 1)
        assert drawn.bits("x", 5).shape == (10, 5)
        assert drawn.bits("x", 5).dtype == np.uint64
        assert drawn.uniform("x", 3).shape == (10, 3)
        assert drawn.normal("x", 3).shape == (10, 3)
        assert len(drawn[2:5]) == 3
        assert streams(1, 0).uniform("x").shape == (0, 1)

    def test_more_words_begin_with_the_fewer(self) -> None:
        drawn = streams(1, 10)
        np.testing.assert_array_equal(drawn.bits("x", 7)[:, :3], drawn.bits("x", 3))

    @given(
        st.integers(0, 2**64 - 1),
        st.lists(st.integers(0, 60), min_size=1, max_size=20),
        st.integers(0, 2**31),
        st.integers(0, 2**20 - 1),
    )
    @settings(max_examples=40, deadline=None)
    def test_a_row_does_not_depend_on_the_batch(self, seed: int, rows: list[int], first: int, index: int) -> None:
        chosen = np.array(rows)
        whole = Streams(seed, first + np.arange(61), 7 * np.arange(61))
        expected = whole.uniform("init_state.radius", 3, index)[chosen]
        np.testing.assert_array_equal(whole[chosen].uniform("init_state.radius", 3, index), expected)
        for row, values in zip(rows, expected, strict=True):
            alone = Streams(seed, np.array([first + row]), np.array([7 * row]))
            np.testing.assert_array_equal(alone.uniform("init_state.radius", 3, index)[0], values)

    def test_masks_choose_rows_too(self) -> None:
        whole = streams(3, 20)
        mask = np.arange(20) % 3 == 0
        np.testing.assert_array_equal(whole[mask].bits("x", 2), whole.bits("x", 2)[mask])

    def test_what_a_draw_depends_on(self) -> None:
        base = streams(1, 50).bits("x", 2)
        others = {
            "seed": streams(2, 50).bits("x", 2),
            "high word of the seed": streams(1 + 2**32, 50).bits("x", 2),
            "slot": streams(1, 50, first_slot=50).bits("x", 2),
            "episode": streams(1, 50, episode=1).bits("x", 2),
            "purpose": streams(1, 50).bits("y", 2),
            "index": streams(1, 50).bits("x", 2, index=1),
        }
        for name, words in others.items():
            assert not np.intersect1d(base, words).size, name

    def test_slot_and_episode_are_not_interchanged(self) -> None:
        first = Streams(1, np.array([3]), np.array([5])).bits("x")
        assert first != Streams(1, np.array([5]), np.array([3])).bits("x")

    def test_draws_of_one_purpose_do_not_overlap(self) -> None:
        words = np.concatenate([streams(9, 1).bits("x", 100, index).ravel() for index in range(50)])
        assert len(np.unique(words)) == words.size

    def test_large_slots_and_episodes(self) -> None:
        drawn = Streams(2**64 - 1, np.array([2**32 - 1, 2**31]), np.array([2**31, 2**32 - 1]))
        assert len(np.unique(drawn.bits("x", 4))) == 8


class TestStatistics:
    def test_uniform_over_slots_and_over_episodes(self) -> None:
        slots = streams(4900, 20_000).uniform("init_state.radius")[:, 0]
        episodes = Streams(4900, np.zeros(20_000, dtype=np.int64), np.arange(20_000)).uniform("init_state.radius")[:, 0]
        words = streams(4900, 1).uniform("x", 8000)[0]
        for sample in (slots, episodes, words):
            assert 0.0 <= sample.min() <= sample.max() < 1.0
            assert stats.kstest(sample, "uniform").pvalue > 1e-3

    def test_every_bit_is_fair(self) -> None:
        words = streams(7, 20_000).bits("x")[:, 0]
        ones = ((words[:, None] >> np.arange(64, dtype=np.uint64)) & np.uint64(1)).mean(axis=0)
        assert np.abs(ones - 0.5).max() < 5.0 * 0.5 / np.sqrt(20_000)

    def test_neighbours_are_independent(self) -> None:
        rows = 20_000
        base = streams(11, rows)
        x = base.uniform("a")[:, 0]
        pairs = {
            "next slot": np.roll(x, 1),
            "next episode": streams(11, rows, episode=1).uniform("a")[:, 0],
            "next seed": streams(12, rows).uniform("a")[:, 0],
            "another purpose": base.uniform("b")[:, 0],
            "next word": base.uniform("a", 2)[:, 1],
            "next draw": base.uniform("a", index=1)[:, 0],
        }
        for name, y in pairs.items():
            assert abs(np.corrcoef(x, y)[0, 1]) < 5.0 / np.sqrt(rows), name
            counts = np.histogram2d(x, y, bins=8, range=((0, 1), (0, 1)))[0]
            assert stats.chisquare(counts.ravel()).pvalue > 1e-4, name

    def test_normal(self) -> None:
        sample = streams(21, 20_000).normal("x", 2)
        assert np.isfinite(sample).all()
        assert stats.kstest(sample[:, 0], "norm").pvalue > 1e-3
        assert abs(np.corrcoef(sample.T)[0, 1]) < 5.0 / np.sqrt(20_000)
        uniform = streams(21, 20_000).uniform("x", 2)
        np.testing.assert_allclose(stats.norm.cdf(sample), uniform, atol=1e-12)

    def test_the_rarest_draws_are_finite(self, monkeypatch: pytest.MonkeyPatch) -> None:
        ends = np.array([[0.0], [1.0 - 2.0**-53]])
        monkeypatch.setattr(Streams, "uniform", lambda self, purpose, count=1, index=0: ends)
        drawn = streams(1, 2)
        interior = drawn.interior("x")
        assert (interior > 0.0).all()
        assert (interior < 1.0).all()
        np.testing.assert_allclose(drawn.normal("x")[:, 0], [-8.2924, 8.2095], atol=1e-3)
        assert np.isfinite(TruncatedNormalParameter()(Draw(drawn, "x"))).all()
