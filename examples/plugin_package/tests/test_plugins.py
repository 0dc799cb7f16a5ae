import numpy as np
import pytest
from safe_inspect_example import FuelSpentDone, RangeRateSensor, SpeedLimitReward, Wall

from safe_inspect.rta.constraints import RelativeState
from safe_inspect.testing import check_plugin, sample_steps


@pytest.mark.parametrize("plugin", [SpeedLimitReward, FuelSpentDone, RangeRateSensor, Wall])
def test_the_plugin_keeps_the_contract(plugin):
    check_plugin(plugin)


def test_only_speed_above_the_limit_costs():
    step = sample_steps(rows=3)
    step.after.writable.velocity[:, 0] = [[0.3, 0.0, 0.4], [0.0, -3.0, 4.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(SpeedLimitReward(limit="50 cm/s", scale=-0.1)(step), [0.0, -0.45, 0.0], atol=1e-15)


def test_the_episode_ends_when_more_than_the_budget_is_spent():
    step = sample_steps(rows=3)
    step.after.writable.delta_v[:, 0] = [24.9, 25.0, 25.1]
    np.testing.assert_array_equal(FuelSpentDone(budget=25.0)(step), [False, False, True])


def test_the_range_rate_is_the_radial_part_of_the_velocity():
    view = sample_steps(rows=4).after
    view.writable.position[:, 0] = [[100.0, 0.0, 0.0], [0.0, -50.0, 0.0], [3.0, 0.0, 4.0], [0.0, 0.0, 0.0]]
    view.writable.velocity[:, 0] = [[1.0, 5.0, 5.0], [0.0, 0.2, 9.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]
    np.testing.assert_allclose(RangeRateSensor()(view)[:, 0], [1.0, -0.2, 1.4, 0.0], atol=1e-15)


def test_the_half_space_of_the_wall_is_its_phi():
    wall = Wall(normal=(0.6, 0.0, -0.8), offset="20 m")
    state = RelativeState(np.array([[10.0, 5.0, 10.0], [90.0, 0.0, 10.0]]), np.ones((2, 3)), np.zeros(2))
    np.testing.assert_allclose(wall.phi(state), [22.0, -26.0])
    for position, phi in zip(state.position, wall.phi(state), strict=True):
        d = np.zeros(6)
        need = Wall.half_space(wall.half_space_parameters(), np.append(position, [1.0, 1.0, 1.0]), d)
        np.testing.assert_allclose(d[:3] @ position - need, phi)
