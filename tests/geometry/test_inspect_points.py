"""Who is credited with which point, and that it is for good."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.geometry import visibility
from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.geometry.visibility import Scores, Surface, inspect_body, lit, terminator_height

from .sight import visible

R = 10.0
POINTS = sphere_points("cmu", 100, R)
P = len(POINTS)
TERMINATORS = [terminator_height(R), terminator_height(R, 1e-5), -math.inf]
FIELDS = [-1.0, math.cos(0.12)]


@dataclass
class Credit:
    inspector: np.ndarray
    team: np.ndarray
    own: np.ndarray


def inspect(
    viewer: np.ndarray,
    sun: np.ndarray,
    terminator: float,
    cos_half_fov: float = -1.0,
    active: np.ndarray | None = None,
    inspector: np.ndarray | None = None,
) -> Credit:
    rows, count = viewer.shape[:2]
    active = np.ones((rows, count), dtype=bool) if active is None else active
    inspector = np.full((rows, P), -1, dtype=np.int8) if inspector is None else inspector.copy()
    credit = Credit(inspector, np.full(rows, -9), np.full((rows, count), -9))
    written = visibility.Credit(inspector, credit.team, credit.own)
    position = np.concatenate((viewer, np.zeros((rows, 1, 3))), axis=1)
    scores = Scores(np.full((rows, P), 1.0 / P), np.zeros(rows), np.zeros((rows, count)))
    inspect_body(position, count, sun, Surface(POINTS, R, terminator), cos_half_fov, active, written, scores)
    np.testing.assert_allclose(scores.team, np.maximum(credit.team, 0) / P)
    np.testing.assert_allclose(scores.own, np.maximum(credit.own, 0) / P)
    return credit


def scene(seed: int, rows: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    viewer = rng.normal(size=(rows, count, 3))
    viewer *= rng.uniform(8.0, 100.0, (rows, count, 1)) / np.linalg.norm(viewer, axis=-1, keepdims=True)
    angle = rng.uniform(0.0, 2.0 * math.pi, rows)
    return viewer, np.stack([np.cos(angle), -np.sin(angle), np.zeros(rows)], axis=-1)


def expected_inspector(
    viewer: np.ndarray, sun: np.ndarray, terminator: float, field: float, active: np.ndarray, before: np.ndarray
) -> np.ndarray:
    result = before.copy()
    for d in reversed(range(viewer.shape[1])):  # the first viewer writes last
        own = np.ascontiguousarray(viewer[:, d])
        seen = visible(own, POINTS, R, field) & lit(sun, POINTS, terminator) & active[:, d, None]
        result[seen & (before < 0)] = d
    return result


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 4),
    terminator=st.sampled_from(TERMINATORS),
    field=st.sampled_from(FIELDS),
)
@settings(max_examples=60, deadline=None)
def test_first_viewer_that_sees_a_lit_point_has_it(seed: int, count: int, terminator: float, field: float) -> None:
    viewer, sun = scene(seed, 5, count)
    rng = np.random.default_rng(seed)
    active = rng.random((5, count)) < 0.8
    before = np.where(rng.random((5, P)) < 0.3, rng.integers(0, count, (5, P)), -1).astype(np.int8)
    credit = inspect(viewer, sun, terminator, field, active, before)
    assert np.array_equal(credit.inspector, expected_inspector(viewer, sun, terminator, field, active, before))
    assert np.array_equal(credit.team, (credit.inspector >= 0).sum(axis=1))
    assert np.array_equal(credit.own, (credit.inspector[:, :, None] == np.arange(count)).sum(axis=1))


def test_two_at_one_place_the_first_is_credited() -> None:
    viewer, sun = np.array([[[60.0, 0.0, 0.0], [60.0, 0.0, 0.0]]]), np.array([[1.0, 0.0, 0.0]])
    credit = inspect(viewer, sun, TERMINATORS[0])
    assert credit.own[0, 0] == credit.team[0] > 30
    assert credit.own[0, 1] == 0
    second = inspect(viewer, sun, TERMINATORS[0], active=np.array([[False, True]]))
    assert second.own.tolist() == [[0, credit.team[0]]]


@pytest.mark.parametrize(("degrees", "part"), [(0.0, 0.5), (60.0, 1.0 / 3.0), (90.0, 0.25), (180.0, 0.0)])
def test_lune_between_sun_and_viewer(degrees: float, part: float) -> None:
    # From far away at an angle a to the sun, the lune that is lit and in sight is (180 - a)/360 of the sphere.
    rng = np.random.default_rng(0)
    sun, side = rng.normal(size=(2, 200, 3))
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    side -= (side * sun).sum(axis=1, keepdims=True) * sun
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    angle = math.radians(degrees)
    counts = inspect(1e6 * (math.cos(angle) * sun + math.sin(angle) * side)[:, None], sun, TERMINATORS[0]).team
    assert counts.mean() == pytest.approx(part * P, abs=0.4)
    assert abs(counts - part * P).max() <= 5


@pytest.mark.parametrize("terminator", TERMINATORS[:2])
@pytest.mark.parametrize("field", [-1.0, math.cos(0.15)])
def test_horizon_and_terminator_to_the_edge(terminator: float, field: float) -> None:
    point = POINTS[40]
    normal = point / R
    side = np.cross(normal, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)

    def has(at_sun: float, at_viewer: float) -> bool:
        """Inspect with the sun and the viewer at these cosines from the point's normal."""
        sun = at_sun * normal + math.sqrt(1.0 - at_sun**2) * side
        viewer = 80.0 * (at_viewer * normal - math.sqrt(1.0 - at_viewer**2) * side)
        return bool(inspect(viewer[None, None], sun[None], terminator, field).inspector[0, 40] == 0)

    edge, horizon = terminator / R, R / 80.0
    assert has(edge + 1e-9, 0.5)
    assert not has(edge - 1e-9, 0.5)
    assert has(edge + 1e-9, horizon + 1e-9)
    assert not has(0.5, horizon - 1e-9)


def test_inspected_is_for_good() -> None:
    viewer, sun = scene(1, 3, 2)
    first = inspect(viewer, sun, TERMINATORS[0])
    later = inspect(-viewer[:, ::-1].copy(), -sun, TERMINATORS[0], inspector=first.inspector)
    kept = first.inspector >= 0
    assert np.array_equal(later.inspector[kept], first.inspector[kept])
    assert (later.team >= first.team).all()
    assert later.team.sum() > first.team.sum()


@pytest.mark.parametrize("terminator", TERMINATORS)
@pytest.mark.parametrize("field", FIELDS)
def test_a_row_alone_is_the_same_to_the_bit(terminator: float, field: float) -> None:
    viewer, sun = scene(7, 40, 3)
    whole = inspect(viewer, sun, terminator, field)
    for row in range(40):
        one = slice(row, row + 1)
        alone = inspect(viewer[one], sun[one], terminator, field)
        assert np.array_equal(alone.inspector[0], whole.inspector[row])
        assert np.array_equal(alone.own[0], whole.own[row])
        assert alone.team[0] == whole.team[row]


@pytest.mark.parametrize("terminator", TERMINATORS)
@pytest.mark.parametrize("field", FIELDS)
def test_no_credit_from_inside_or_from_nowhere(terminator: float, field: float) -> None:
    viewer = np.array([[[0.0, 0.0, 0.0], [9.9, 0.0, 0.0], [np.nan, np.nan, np.nan]]])
    credit = inspect(viewer, np.array([[1.0, 0.0, 0.0]]), terminator, field)
    assert (credit.inspector == -1).all()
    assert credit.team.tolist() == [0]
    assert credit.own.tolist() == [[0, 0, 0]]
