"""What the optimiser changes at random: sizes and times of burns, and the steps at which points are seen."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.evaluation.optimiser import coverage_problem, coverage_task
from safe_inspect.planning.coverage_problem import CoverageProblem, perturb_burns, resample_sightings, write_positions

DRAWS, STRIDE = 4000, 10


@pytest.fixture(scope="module")
def problem(spec: EnvironmentSpec) -> CoverageProblem:
    environment = TeamEnvironment(spec, 1, seed=3)
    environment.reset()
    return coverage_problem(environment, 0, coverage_task(spec), 1)[0]


def test_a_further_burn_is_of_half_a_millimetre_to_ten_centimetres_per_second(problem: CoverageProblem) -> None:
    seed, steps = np.array([7], np.uint64), len(problem.coast)
    start, delta_v, position = np.zeros(1, np.int64), np.zeros((1, 3)), np.zeros((steps, 3))
    sizes, starts = [], []
    for _ in range(DRAWS):
        perturb_burns(problem, seed, start, delta_v, 0, steps, position)
        sizes.append(np.abs(delta_v).max())
        starts.append(start[0])
    shares = np.array([0.3, 0.5, 0.9])
    # Each axis takes part with 0.6, and a share of the size, which is drawn by powers of ten.
    assert (np.array(sizes) == 0.0).mean() == pytest.approx(0.4**3, abs=0.015)
    assert 0.09 < max(sizes) <= 0.1
    numbers = np.random.default_rng(1)
    scale = 10.0 ** numbers.uniform(-3.3, -1.0, 200_000)
    drawn = np.where(numbers.random((200_000, 3)) < 0.6, numbers.uniform(-1.0, 1.0, (200_000, 3)), 0.0)
    expected = scale * np.abs(drawn).max(axis=1)
    np.testing.assert_allclose(np.quantile(sizes, shares), np.quantile(expected, shares), rtol=0.15)
    assert (np.array(starts) == 0).mean() == pytest.approx(0.4, abs=0.03)
    assert 0.68 * steps < max(starts) < 0.7 * steps


def test_a_burn_is_lessened_or_moved_within_the_episode_and_stays_itself(problem: CoverageProblem) -> None:
    seed, steps = np.array([8], np.uint64), len(problem.coast)
    begin, burn = 5, np.array([0.02, -0.01, 0.03])
    start, delta_v, position = np.array([begin, 0]), np.array([burn, np.zeros(3)]), np.zeros((steps, 3))
    paths = {name: position.copy() for name in ("as it was", "from the first step", "from the last step")}
    for at, path in zip((begin, 0, steps - 2), paths.values(), strict=True):
        write_positions(problem, np.array([at]), burn[None], 1, STRIDE, path)
    met = dict.fromkeys(paths, 0)
    for _ in range(DRAWS):
        perturb_burns(problem, seed, start, delta_v, 1, STRIDE, position)
        assert start[0] == begin
        np.testing.assert_array_equal(delta_v[0], burn)
        for name, path in paths.items():
            met[name] += np.array_equal(position, path)
    assert met["from the first step"] > 0.03 * DRAWS  # earlier than the episode is at its beginning
    assert met["as it was"] > 0


def test_sightings_move_to_any_lit_step_at_one_or_two_points(problem: CoverageProblem) -> None:
    seed, lit = np.array([9], np.uint64), problem.lit
    often = np.flatnonzero(lit[STRIDE::STRIDE].mean(axis=0) > 0.3)[:3]
    counts, steps = [], set()
    for _ in range(DRAWS):
        sighting = np.zeros(lit.shape[1], np.int64)
        resample_sightings(problem, seed, STRIDE, often, len(often), sighting)
        moved = np.flatnonzero(sighting)
        assert set(moved) <= set(often)
        assert lit[sighting[moved], moved].all()
        counts.append(len(moved))
        steps |= set(sighting[moved].tolist())
    assert set(counts) == {1, 2}
    assert np.mean(counts) == pytest.approx(0.5 + 0.5 * (1 / 3 + 2 * 2 / 3), abs=0.05)
    wanted = np.flatnonzero(lit[:, often].any(axis=1))
    wanted = wanted[(wanted % STRIDE == 0) & (wanted > 0)]
    assert len(steps & set(wanted.tolist())) > 0.95 * len(wanted)
    assert max(steps) >= wanted.max() - 3 * STRIDE
