"""K-means of the candidates: against scikit-learn, by hand, and row by row."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scikit_clusters import Clusters, cluster_sklearn
from scipy.spatial.transform import Rotation

from safe_inspect.geometry.clusters import KMeansRule, RowDraws, cluster_candidates, max_clusters
from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.geometry.visibility import Surface

# The lattice's equal distances would leave it to rounding which of two points is the farther, so it is shaken.
POINTS = sphere_points("fibonacci", 100, 10.0) + np.random.default_rng(0).normal(0.0, 0.05, (100, 3))
POINTS *= 10.0 / np.linalg.norm(POINTS, axis=1, keepdims=True)
PER_CLUSTER = 10
K = 10


def cluster(points: np.ndarray, candidates: np.ndarray, clusters: Clusters, draws: RowDraws, rule: KMeansRule) -> None:
    """Cluster given candidates: those that no deputy has inspected, in a light in which every point is lit."""
    inspector, sun = np.where(candidates, -1, 0).astype(np.int8), np.tile([1.0, 0.0, 0.0], (len(candidates), 1))
    cluster_candidates(1, sun, Surface(points, 10.0, -math.inf), inspector, *clusters, draws, rule)


@dataclass
class Rows:
    """What a call reads and writes, for N rows."""

    candidates: np.ndarray
    centres: np.ndarray
    count: np.ndarray
    key: np.ndarray
    step: np.ndarray
    previous: np.ndarray
    settled: np.ndarray

    @classmethod
    def fresh(cls, candidates: np.ndarray, seed: int = 0) -> Rows:
        n, p = candidates.shape
        key = np.random.default_rng(seed).integers(0, 2**64, n, dtype=np.uint64)
        zeros = np.zeros(n, dtype=np.int64)
        unseen = np.zeros((n, p), dtype=bool)
        return cls(candidates, np.zeros((n, K, 3)), zeros, key, zeros.copy(), unseen, np.zeros(n, dtype=bool))

    def __getitem__(self, rows: object) -> Rows:
        return Rows(*(getattr(self, field.name)[rows].copy() for field in fields(self)))

    def run(
        self,
        method: Callable[..., None] = cluster,
        *,
        points: np.ndarray = POINTS,
        iterations: int = 50,
        candidates: np.ndarray | None = None,
    ) -> Rows:
        if candidates is not None:
            self.candidates = candidates
        clusters = Clusters(self.centres, self.count, self.previous, self.settled)
        draws, rule = RowDraws(self.key, self.step), KMeansRule(PER_CLUSTER, iterations)
        method(points, self.candidates, clusters, draws, rule)
        return self


def assert_same(one: Rows, other: Rows) -> None:
    for field in fields(Rows):
        assert np.array_equal(getattr(one, field.name), getattr(other, field.name)), field.name


def some(seed: int, rows: int = 6) -> np.ndarray:
    """Return random candidates: each row has its own share of the points, clumped on one side or scattered."""
    rng = np.random.default_rng(seed)
    side = rng.normal(size=(rows, 3))
    half = (side[:, :1] * POINTS[:, 0] + side[:, 1:2] * POINTS[:, 1] + side[:, 2:] * POINTS[:, 2]) > 0
    share = rng.random((rows, 1))
    return (rng.random((rows, 100)) < share) & (half | (rng.random((rows, 1)) < 0.5))


def test_number_of_clusters() -> None:
    assert [max_clusters(p, 10) for p in (0, 1, 10, 11, 99, 100, 101)] == [0, 1, 1, 2, 10, 10, 11]


def test_too_little_room_is_refused() -> None:
    rows = Rows.fresh(np.ones((1, 100), dtype=bool))
    rows.centres = rows.centres[:, :9].copy()
    with pytest.raises(ValueError, match="centres"):
        rows.run()


def start(rows: Rows) -> Rows:
    """Set the number of centres and draw those that are missing, without moving them."""
    return rows.run(iterations=0)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_start_grows_with_distinct_candidates(seed: int) -> None:
    candidates = some(seed)
    rows = start(Rows.fresh(candidates, seed))
    assert np.array_equal(rows.count, -(-candidates.sum(axis=1) // PER_CLUSTER))
    for row in range(6):
        own = rows.centres[row, : rows.count[row]]
        assert len(np.unique(own, axis=0)) == len(own)
        among = (own[:, None] == POINTS[candidates[row]][None]).all(-1)
        assert among.any(axis=1).all()
        assert not rows.centres[row, rows.count[row] :].any()


def test_start_keeps_and_truncates_the_previous_centres() -> None:
    candidates = np.zeros((2, 100), dtype=bool)
    candidates[0, :25], candidates[1, :45] = True, True
    rows = Rows.fresh(candidates)
    rows.centres[:] = np.arange(30.0).reshape(10, 3)
    rows.count[:] = [5, 2]
    before = rows.centres.copy()
    start(rows)
    assert rows.count.tolist() == [3, 5]
    assert np.array_equal(rows.centres[0, :3], before[0, :3])
    assert np.array_equal(rows.centres[1, :2], before[1, :2])
    assert not rows.centres[0, 3:].any()
    assert not rows.centres[1, 5:].any()
    assert np.isin(rows.centres[1, 2:5], POINTS[:45]).all()


def test_draws_depend_on_key_and_step_and_are_even() -> None:
    n = 4000
    candidates = np.zeros((n, 100), dtype=bool)
    candidates[:, 20:28] = True
    rows = start(Rows.fresh(candidates, 5))
    later = Rows.fresh(candidates, 5)
    later.step += 1
    start(later)
    # One centre each, among eight candidates: 500 each, within five standard deviations of sqrt(4000 7/64) = 21.
    for each in (rows, later):
        drawn = (each.centres[:, 0, None] == POINTS[20:28]).all(-1).sum(axis=0)
        assert drawn.sum() == n
        assert abs(drawn - 500).max() < 105
    same = (rows.centres[:, 0] == later.centres[:, 0]).all(-1).mean()
    assert same == pytest.approx(1 / 8, abs=0.03)
    again = start(Rows.fresh(candidates, 5))
    assert_same(again, rows)


@given(seed=st.integers(0, 2**32 - 1), iterations=st.sampled_from([1, 2, 3, 50]))
@settings(max_examples=15, deadline=None)
def test_agrees_with_scikit_learn(seed: int, iterations: int) -> None:
    candidates = some(seed)
    own = Rows.fresh(candidates, seed).run(iterations=iterations)
    theirs = Rows.fresh(candidates, seed).run(cluster_sklearn, iterations=iterations)
    assert np.array_equal(own.count, theirs.count)
    np.testing.assert_allclose(own.centres, theirs.centres, rtol=0, atol=1e-9)
    assert np.array_equal(own.previous, theirs.previous)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=5, deadline=None)
def test_agrees_with_scikit_learn_as_candidates_come_and_go(seed: int) -> None:
    rng = np.random.default_rng(seed)
    own, theirs = (Rows.fresh(some(seed), seed) for _ in range(2))
    side, angle = rng.normal(size=3), 0.0
    left = np.ones(100, dtype=bool)
    for step in range(12):
        angle += 0.2
        left &= rng.random(100) < 0.95
        sun = np.array([np.cos(angle), -np.sin(angle), 0.2 * side[0]])
        candidates = np.broadcast_to(left & ((POINTS * sun).sum(-1) > 0.0), (6, 100)).copy()
        for rows, method in ((own, cluster), (theirs, cluster_sklearn)):
            rows.step[:] = step
            rows.run(method, candidates=candidates)
        assert np.array_equal(own.count, theirs.count)
        np.testing.assert_allclose(own.centres, theirs.centres, rtol=0, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), empty=st.integers(1, 2))
@settings(max_examples=12, deadline=None)
def test_empty_clusters_move_as_scikit_learns(seed: int, empty: int) -> None:
    candidates = some(seed, 4)
    candidates[:, ::2] = True  # at least five clusters
    own, theirs = (start(Rows.fresh(candidates, seed)) for _ in range(2))
    for rows in (own, theirs):
        rows.centres[:, :empty] = 1e4 * (1.0 + np.arange(3 * empty).reshape(empty, 3))  # no point is near these
    first = own[:].run(iterations=1)
    for row in range(4):
        inside = np.linalg.norm(first.centres[row, : first.count[row]], axis=-1) < 10.0 + 1e-9
        assert inside.all()
    for iterations in (1, 50):
        a, b = own[:].run(iterations=iterations), theirs[:].run(cluster_sklearn, iterations=iterations)
        np.testing.assert_allclose(a.centres, b.centres, rtol=0, atol=1e-9)


def line(places: list[float], centres: list[float], iterations: int, settles: bool | None = None) -> np.ndarray:
    """Cluster points of the x axis, two or so to a cluster, and return the centres."""
    points = np.zeros((len(places), 3))
    points[:, 0] = places
    start_at = np.zeros((1, len(centres), 3))
    start_at[0, :, 0] = centres
    n = np.array([len(centres)])
    key, step = np.zeros(1, dtype=np.uint64), np.zeros(1, dtype=np.int64)
    candidates, previous = np.ones((1, len(places)), dtype=bool), np.zeros((1, len(places)), dtype=bool)
    settled = np.zeros(1, dtype=bool)
    per = -(-len(places) // len(centres))
    clusters = Clusters(start_at, n, previous, settled)
    cluster(points, candidates, clusters, RowDraws(key, step), KMeansRule(per, iterations))
    assert n[0] == len(centres)
    assert settles is None or settled[0] == settles
    return start_at[0, :, 0]


def test_by_hand() -> None:
    # 0 and 1 go to 0.2; 4 and 10 to 7.5: means 0.5 and 7; then 4 is nearer to 7 than to 0.5 still: a fixed point.
    assert line([0.0, 1.0, 4.0, 10.0], [0.2, 7.5], 50, settles=True).tolist() == [0.5, 7.0]
    # From 0.2 and 30: all of 0, 1, 4, 10 to the first; the second, empty, takes 10, the farthest; then 4 stays.
    assert line([0.0, 1.0, 4.0, 10.0], [0.2, 30.0], 1).tolist() == pytest.approx([5.0 / 3.0, 10.0], rel=1e-15)
    # One centre is the mean.
    assert line([0.0, 1.0, 4.0, 10.0], [-3.0], 50).tolist() == [3.75]


def test_two_empty_clusters_take_the_two_farthest() -> None:
    # All to the first; 10 and then -6 are farthest from it and go to the second and the third.
    assert line([-6.0, 0.0, 1.0, 2.0, 3.0, 10.0], [1.0, 500.0, 900.0], 1).tolist() == [1.5, 10.0, -6.0]


def test_a_cluster_of_one_that_gives_its_point_away() -> None:
    # 30 is alone with the second centre and the farthest of all; the third is empty and takes it. The second
    # waits at the mean of the largest cluster, 2.
    assert line([0.0, 1.0, 2.0, 3.0, 4.0, 30.0], [2.0, 50.0, 900.0], 1).tolist() == [2.0, 2.0, 30.0]
    final = line([0.0, 1.0, 2.0, 3.0, 4.0, 30.0], [2.0, 50.0, 900.0], 50)
    assert len(set(final.tolist())) == 3
    assert 30.0 in final


def test_more_clusters_than_places() -> None:
    # Four points at one place: nothing lies off its centre, so nothing is gained by moving one.
    # As long as a cluster is empty the row has not settled.
    assert line([5.0] * 4, [5.0, 70.0], 50, settles=False).tolist() == [5.0, 5.0]
    assert line([9.0, 5.0, 5.0, 5.0, 5.0], [9.0, 5.0, 70.0], 50, settles=False).tolist() == [9.0, 5.0, 5.0]


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_converged_centres_are_the_means_of_their_points(seed: int) -> None:
    rows = Rows.fresh(some(seed), seed).run()
    for row in np.flatnonzero(rows.settled):
        own, k = POINTS[rows.candidates[row]], rows.count[row]
        if k == 0:
            continue
        label = np.linalg.norm(own[:, None] - rows.centres[row, :k], axis=-1).argmin(axis=1)
        means = np.array([own[label == j].mean(axis=0) for j in range(k)])
        np.testing.assert_allclose(rows.centres[row, :k], means, atol=1e-12)
        assert not rows.centres[row, k:].any()
    assert rows.settled.any()


@given(seed=st.integers(0, 2**32 - 1), iterations=st.integers(1, 50))
@settings(max_examples=30, deadline=None)
def test_skipping_a_settled_row_changes_nothing(seed: int, iterations: int) -> None:
    rows = Rows.fresh(some(seed), seed).run(iterations=iterations)
    skipped, redone = rows[:].run(), rows[:]
    redone.settled[:] = False
    redone.run()
    fixed = rows.settled
    assert np.array_equal(skipped.centres[fixed], rows.centres[fixed])
    assert np.array_equal(redone.centres[fixed], rows.centres[fixed])
    assert_same(skipped, redone)


def test_a_settled_row_is_left_alone_until_its_candidates_change() -> None:
    rows = Rows.fresh(some(3)).run()
    assert rows.settled.all()
    marked = rows[:]
    marked.centres += 0.25  # not a fixed point, so that a run would show
    assert_same(marked[:].run(), marked)
    changed = marked.candidates.copy()
    changed[2] = ~changed[2]
    after = marked[:].run(candidates=changed)
    others = np.arange(6) != 2
    assert np.array_equal(after.centres[others], marked.centres[others])
    assert not np.array_equal(after.centres[2], marked.centres[2])
    assert np.array_equal(after.previous[2], changed[2])


def test_without_candidates_there_is_no_centre_and_later_there_is() -> None:
    rows = Rows.fresh(some(1)).run()
    rows.run(candidates=np.zeros((6, 100), dtype=bool))
    assert not rows.count.any()
    assert not rows.centres.any()
    assert rows.settled.all()
    rows.run(candidates=np.ones((6, 100), dtype=bool))
    assert (rows.count == 10).all()


def test_too_few_iterations_do_not_settle() -> None:
    rows = Rows.fresh(np.ones((6, 100), dtype=bool)).run(iterations=1)
    assert not rows.settled.any()


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_a_row_alone_is_the_same_to_the_bit(seed: int) -> None:
    rows = Rows.fresh(some(seed, 9), seed)
    singles = [rows[row : row + 1] for row in range(9)]
    order = np.random.default_rng(seed).permutation(9)
    shuffled = rows[order]
    for step in range(3):
        candidates = some(seed + step, 9)
        for each in (rows, shuffled, *singles):
            each.step[:] = step
        rows.run(candidates=candidates)
        shuffled.run(candidates=candidates[order])
        for row, single in enumerate(singles):
            single.run(candidates=candidates[row : row + 1])
            assert_same(single, rows[row : row + 1])
        assert_same(shuffled, rows[order])


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_centres_turn_with_the_points(seed: int) -> None:
    turn = Rotation.random(rng=np.random.default_rng(seed))
    rows = Rows.fresh(some(seed), seed)
    turned = rows[:].run(points=np.ascontiguousarray(turn.apply(POINTS)))
    rows.run()
    for row in range(6):
        np.testing.assert_allclose(turned.centres[row], turn.apply(rows.centres[row]), atol=1e-9)
