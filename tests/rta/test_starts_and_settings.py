"""Initial states that are not finite are refused, in each of their numbers; settings of audits fill their ranges."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from safe_inspect.rta import RTACWHInspectionTeam, RTAGlueCWHInspection1v1
from safe_inspect.rta.audit import settings
from safe_inspect.rta.constraints import NAMES
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState

N = 0.001027
#: A deputy that rests on the day side.
POSITION, VELOCITY, SUN = np.array([0.0, 60.0, 0.0]), np.zeros(3), -0.5 * np.pi


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
@pytest.mark.parametrize("field", ["position", "velocity", "sun_angle"])
def test_one_number_that_is_not_finite_refuses_its_row_only(field: str, wrong: float) -> None:
    states = {
        "position": np.tile(POSITION, (4, 1)), "velocity": np.tile(VELOCITY, (4, 1)), "sun_angle": np.full(4, SUN)
    }  # fmt: skip
    states[field][2] = wrong
    refused = RTAGlueCWHInspection1v1(enabled=True).for_starts().refusals(states)
    np.testing.assert_array_equal(refused["recoverable"], [False, False, True, False])


@pytest.mark.parametrize("field", ["position", "velocity", "sun_angle"])
def test_one_number_that_is_not_finite_refuses_its_team_only(field: str) -> None:
    places = np.stack((POSITION, -POSITION, 2.0 * POSITION))
    states = {"position": np.tile(places, (3, 1, 1)), "velocity": np.zeros((3, 3, 3)), "sun_angle": np.full(3, SUN)}
    plugin = RTACWHInspectionTeam(constraints=("chief_collision", "r_max", "deputy_collision"))
    np.testing.assert_array_equal(plugin.refusals(states)["recoverable"], False)
    (states[field][1, 2] if field != "sun_angle" else states[field])[1] = np.nan
    np.testing.assert_array_equal(plugin.refusals(states)["recoverable"], [False, True, False])
    team = TeamState(states["position"], states["velocity"], states["sun_angle"])
    np.testing.assert_array_equal(team.finite, [True, False, True])
    with pytest.raises(ValueError, match="the state of environment 1 is not finite"):
        TeamFilter(names=("r_max", "deputy_collision"))(team, np.zeros((3, 3, 3)))


def test_a_team_names_the_pairs_and_deputies_that_refuse() -> None:
    """Each pair, and each deputy, in turn is the one that is too near or too far."""
    plugin = RTACWHInspectionTeam(constraints=("r_max", "deputy_collision"))
    places = np.array([[0.0, 60.0, 0.0], [0.0, -60.0, 0.0], [0.0, 0.0, 60.0]])
    for i, j in ((0, 1), (0, 2), (1, 2)):
        near, far = places.copy(), places.copy()
        near[j] = near[i] + [4.0, 0.0, 0.0]
        far[j] *= 20.0
        states = {"position": np.stack((places, near, far)), "velocity": np.zeros((3, 3, 3)), "sun_angle": np.zeros(3)}
        refused, phi = plugin.refusals(states), plugin.safety(states)
        np.testing.assert_array_equal(refused["deputy_collision"], [False, True, False])
        np.testing.assert_array_equal(refused["r_max"], [False, False, True])
        np.testing.assert_allclose(phi["deputy_collision"][1], 4.0 - 10.0)
        np.testing.assert_allclose(phi["r_max"][2], 800.0 - 1200.0)


def test_the_settings_of_audits_fill_their_ranges() -> None:
    found = list(islice(settings(3), 600))
    ranges = {"m": (5.0, 150.0), "r_max": (200.0, 1500.0), "collision_radius": (5.0, 20.0)}
    for name, (low, high) in ranges.items():
        drawn = np.array([values[name] for values, _ in found])
        assert low <= drawn.min() < low + 0.03 * (high - low)
        assert high >= drawn.max() > high - 0.03 * (high - low)
    fov = np.rad2deg([values["fov"] for values, _ in found])
    assert 20.0 <= fov.min() < 23.0
    assert 137.0 < fov.max() <= 140.0
    chosen = {
        "u_max": {0.2, 0.5, 1.0, 2.0}, "step_size": {1.0, 5.0, 10.0, 20.0, 60.0}, "n": {5e-4, 0.001027, 1.5e-3},
        "v0": {0.1, 0.2, 0.5, 1.0}, "psm_horizon": {50.0, 100.0, 1000.0},
    }  # fmt: skip
    for name, among in chosen.items():
        assert {values[name] for values, _ in found} == among
    assert all(values["vel_limit"] == 5.0 * values["v0"] for values, _ in found)
    assert 0.4 < np.mean([names == NAMES for _, names in found]) < 0.6
    assert all(names for _, names in found)
