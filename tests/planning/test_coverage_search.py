"""The search for plans over a whole episode, kernel by kernel: by plain NumPy, or against a record.

A change that is meant to change plans has to update the record:

    RECORD_RESULTS=1 python -m pytest -n 0 tests/planning/test_coverage_search.py
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from safe_inspect.dynamics.step_maps import step_maps
from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.planning.coverage_problem import (
    CoverageProblem,
    control_authorities,
    impulse_responses,
    perturb_burns,
    random_burn,
    resample_sightings,
    write_positions,
)
from safe_inspect.planning.coverage_search import (
    MAX_BURNS,
    SearchEffort,
    burns_of,
    choose_sightings,
    descent_workspace,
    least_fuel,
    search_plan,
)
from safe_inspect.planning.linear_program import _invert

from ..golden.records import check_record

RECORD = Path(__file__).with_name("coverage.json")
N, DT, STEPS, RADIUS = 0.001027, 10.0, 320, 10.0
MAPS = step_maps(N, DT, STEPS)


def problem(seed: int, points: int = 12, hold: int = 1, near: float = RADIUS, far: float = 200.0) -> CoverageProblem:
    """Return an episode that begins at some 40 m, with points that are lit on the sun's side."""
    generator = np.random.default_rng(seed)
    state = np.concatenate((generator.normal(size=3) * 25.0, generator.normal(size=3) * 0.03))
    normals = sphere_points("fibonacci", points, 1.0)
    angle = generator.uniform(0.0, 2.0 * np.pi) - N * DT * np.arange(STEPS + 1)
    sun = np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=1)
    response = impulse_responses(MAPS, STEPS, hold)
    slopes = np.stack((np.linalg.norm(normals[:, :2], axis=1), np.abs(normals[:, 2])), axis=1)
    return CoverageProblem(
        response, hold, np.ascontiguousarray(MAPS.phi[:, :3] @ state), control_authorities(response), normals, slopes,
        sun @ normals.T > 0.0, RADIUS, near, far,
    )  # fmt: skip


@pytest.mark.parametrize("hold", [1, 3])
def test_the_response_to_a_burn_is_that_of_single_steps(hold: int) -> None:
    found = impulse_responses(MAPS, 40, hold)
    for axis in range(3):
        state = np.zeros(6)
        for step in range(41):
            np.testing.assert_allclose(found[step, :, axis], state[:3], rtol=1e-10, atol=1e-12)
            push = np.eye(3)[axis] / (hold * DT) if step < hold else np.zeros(3)
            state = MAPS.phi[1] @ state + MAPS.gamma[1] @ push
    plane = np.linalg.norm(found[:, :2, :2], axis=1).max(axis=1)
    authority = control_authorities(found)
    np.testing.assert_allclose(authority[:, 0], np.maximum.accumulate(plane))
    np.testing.assert_allclose(authority[:, 1], np.maximum.accumulate(np.abs(found[:, 2, 2])))


@pytest.mark.parametrize("stride", [1, 4])
@pytest.mark.parametrize("bounded", [True, False])
def test_sightings_are_where_a_point_is_farthest_in_view(stride: int, bounded: bool) -> None:
    ends = set()
    for seed in range(10):
        given = problem(seed, far=45.0 if seed % 2 else 200.0)
        position, points = given.coast, len(given.normals)
        score, sighting = np.full(points, np.nan), np.full(points, -9)
        end = choose_sightings(given, position, stride, score, sighting, bounded)
        steps = np.arange(stride, STEPS + 1, stride)
        r = np.linalg.norm(position[steps], axis=1)
        outside = (r < given.near) | (r > given.far)
        expected_end = int(steps[outside.argmax()]) if bounded and outside.any() else STEPS + 1
        reach = np.maximum(given.slopes * given.control_authority[steps][:, None], 1e-6).max(axis=-1)
        above = (position[steps] @ given.normals.T - RADIUS) / reach
        counted = given.lit[steps] & (steps < expected_end)[:, None] & (r >= given.near)[:, None]
        above = np.where(counted, above, -np.inf)
        assert end == expected_end
        np.testing.assert_allclose(score, above.max(axis=0), rtol=1e-9)
        np.testing.assert_array_equal(sighting, np.where(counted.any(axis=0), steps[above.argmax(axis=0)], -1))
        ends.add(end)
    assert len(ends) > (3 if bounded else 0)


def test_what_changes_at_random_is_recorded() -> None:
    """Burns by their sizes and times, paths that they lead along, and steps of sightings."""
    given, random = problem(1, hold=2), np.array([5], np.uint64)
    start, delta_v, position = np.zeros(MAX_BURNS, np.int64), np.zeros((MAX_BURNS, 3)), np.zeros((STEPS + 1, 3))
    for k in range(30):
        random_burn(given, random, -2.5, -0.8, start, delta_v, k)
    burns = [start[:30].copy(), delta_v[:30].sum(axis=1)]
    paths = []
    for count in (0, 1, 2, 3) * 25:
        perturb_burns(given, random, start, delta_v, count, 8, position)
        paths.append(position[::8].sum())
    sighting, steps = np.zeros(len(given.normals), np.int64), []
    for _ in range(60):
        resample_sightings(given, random, 4, np.array([1, 4, 7, 9]), 4, sighting)
        steps.append(sighting @ np.arange(12))
    check_record(RECORD, "at random", {"burns": np.concatenate(burns), "paths": paths, "sightings": steps})


@pytest.mark.slow
def test_the_fuel_for_sightings_keeps_the_path_within_the_limits_of_range() -> None:
    """Every point is in view at its step, and nothing is spent in excess of the recorded fuel."""
    costs, sizes = [], []
    for seed in range(12):
        given = problem(seed, near=12.0, far=60.0 if seed % 2 else 90.0)
        workspace = descent_workspace(given, np.arange(0, STEPS, 8), 4)
        score, sighting = np.zeros(12), np.zeros(12, np.int64)
        choose_sightings(given, given.coast, 4, score, sighting, False)
        cost, size = least_fuel(given, workspace, sighting, math.inf)
        costs.append(cost)
        sizes.append(size)
        if cost == math.inf:
            continue
        start, delta_v = np.zeros(MAX_BURNS, np.int64), np.zeros((MAX_BURNS, 3))
        count = burns_of(workspace.program, size, start, delta_v)
        assert (np.diff(start[:count]) > 0).all()
        assert np.abs(delta_v[:count]).sum() == pytest.approx(cost, rel=1e-12)
        position = np.zeros((STEPS + 1, 3))
        write_positions(given, start, delta_v, count, 1, position)
        height = (position[sighting] * given.normals).sum(axis=1)
        assert height.min() >= RADIUS + 0.9e-6
        r = np.linalg.norm(position[4 : sighting.max() + 1 : 4], axis=1)
        assert r.min() >= 12.0 - 1e-9
        assert r.max() <= (60.0 if seed % 2 else 90.0) + 1e-9
        assert least_fuel(given, workspace, sighting, 0.5 * cost) == (math.inf, 0) or cost == 0.0
        sighting[3] = -1
        assert least_fuel(given, workspace, sighting, math.inf) == (math.inf, 0)
    assert np.isfinite(costs).sum() >= 6
    check_record(RECORD, "fuel", {"costs": costs, "sizes": sizes})


def test_searches_find_the_recorded_plans() -> None:
    arrays: dict[str, list[Any]] = {"cost": [], "start": [], "delta_v": [], "seed": []}
    for seed in range(6):
        given = problem(seed, 10 + seed, 1 + seed % 2, near=11.0 + seed % 3, far=120.0)
        points = len(given.normals)
        score, sighting = np.zeros(points), np.zeros(points, np.int64)
        choose_sightings(given, given.coast, 4, score, sighting, False)
        first = sighting[None].copy() if seed % 2 else np.zeros((0, points), np.int64)
        random, start, burns = np.array([seed], np.uint64), np.zeros(MAX_BURNS, np.int64), np.zeros((MAX_BURNS, 3))
        cost, count = search_plan(given, first, random, SearchEffort(12, 2, 25, 0.01), start, burns)
        arrays["cost"] += [cost, count]
        arrays["start"] += start[:count].tolist()
        arrays["delta_v"] += burns[:count].sum(axis=1).tolist()
        arrays["seed"] += (random >> np.uint64(32)).tolist()
    check_record(RECORD, "searched", arrays)


@pytest.mark.parametrize("size", [1, 2, 5, 9])
def test_the_inverse_is_that_of_numpy(size: int) -> None:
    """Also where a pivot is zero, and none where a row is a sum of others."""
    for seed in range(20):
        matrix = np.random.default_rng(seed).integers(-3, 4, (size, size)).astype(np.float64)
        if seed % 5 == 0 and size > 2:
            matrix[-1] = matrix[0] + matrix[1]
        room, inverse = np.full((10, 10), np.nan), np.full((10, 10), np.nan)
        room[:size, :size] = matrix
        singular = abs(np.linalg.det(matrix)) < 0.5  # whole numbers
        assert _invert(room, inverse, size) != singular
        if not singular:
            np.testing.assert_allclose(inverse[:size, :size], np.linalg.inv(matrix), atol=1e-10)
    assert not _invert(np.array([[0.9e-9]]), np.empty((1, 1)), 1)
    assert _invert(np.array([[1.2e-9]]), np.empty((1, 1)), 1)
