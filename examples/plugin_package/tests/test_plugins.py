import numpy as np
import pytest
import safe_inspect_example
from safe_inspect_example import (
    BrakingPolicy,
    CoastWhenClose,
    CubeSat,
    DirectionGlue,
    FuelSpentDone,
    LogUniformParameter,
    OnOffGlue,
    PathLength,
    RangeRateSensor,
    RingInitializer,
    ScatteredDone,
    SchweighartSedwick,
    SpeedLimitReward,
    TanhNormalizer,
    TeamSpread,
    ThrustNoise,
    ThrustUnit,
    Wall,
)

from safe_inspect.dones import DoneStatus
from safe_inspect.platforms.state_sensors import PositionSensor
from safe_inspect.policies import ThrustLimits
from safe_inspect.random.streams import Streams
from safe_inspect.rta.constraints import RelativeState
from safe_inspect.simulators import Draw
from safe_inspect.testing import check_plugin, sample_steps, sample_team_steps


@pytest.mark.parametrize("name", safe_inspect_example.__all__)
def test_the_plugin_keeps_the_contract(name):
    check_plugin(getattr(safe_inspect_example, name), parts=[ThrustUnit()] if name == "OnOffGlue" else [])


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


def test_the_normalizer_bends_and_comes_back():
    values, none = np.array([[0.0, 100.0, -250.0]]), np.zeros(3)
    bent = TanhNormalizer(scale=100.0)(values, none, none)
    np.testing.assert_allclose(bent, np.tanh([[0.0, 1.0, -2.5]]))
    np.testing.assert_allclose(TanhNormalizer(scale=100.0).inverse(bent, none, none), values)


def test_every_decade_is_as_likely():
    episodes = Streams(1, np.arange(20_000), np.zeros(20_000, dtype=np.int64))
    drawn = LogUniformParameter(low=0.1, high=10.0, units="km")(Draw(episodes, "range"))
    assert drawn.min() >= 100.0
    assert drawn.max() < 10_000.0
    np.testing.assert_allclose(np.mean(drawn < 1_000.0), 0.5, atol=0.015)
    with pytest.raises(ValueError, match="swap them"):
        LogUniformParameter(low=2.0, high=1.0)


def test_a_ring_lies_in_the_plane_and_rests():
    states = RingInitializer()({"radius": np.array([2.0, 3.0]), "phase": np.array([0.0, np.pi / 2])})
    np.testing.assert_allclose(states["position"], [[2.0, 0.0, 0.0], [0.0, 3.0, 0.0]], atol=1e-15)
    assert not states["velocity"].any()


def test_a_cubesat_has_room_for_some_sensors():
    sensors = tuple(PositionSensor(name=f"sensor {k}") for k in range(3))
    assert CubeSat(sensors=3)(sensors) == ("sensor 0", "sensor 1", "sensor 2")
    with pytest.raises(ValueError, match="3 sensors and room for 2"):
        CubeSat(sensors=2)(sensors)


def test_thrusts_are_limited():
    commands = np.array([[0.3, -2.0, 0.0]])
    np.testing.assert_allclose(ThrustUnit(largest="500 mN")(commands), [[0.3, -0.5, 0.0]])
    glue = OnOffGlue(thrust=0.1)
    assert glue.choices({}) == (3, 3, 3)
    np.testing.assert_allclose(glue(np.array([[0.0, 1.0, 2.0]]), {"ThrustUnit": ThrustUnit()}), [[-0.1, 0.0, 0.1]])


def test_a_direction_has_the_length_one():
    view = sample_steps(rows=2).after
    view.writable.position[:, 0] = [[3.0, 0.0, -4.0], [0.0, 0.0, 0.0]]
    np.testing.assert_allclose(DirectionGlue()(view), [[0.6, 0.0, -0.8], [0.0, 0.0, 0.0]])


def test_braking_takes_the_velocity_in_some_steps():
    view = sample_steps(rows=2).after
    view.writable.velocity[:, 0] = [[1.0, -2.0, 0.0], [0.0, 0.0, 100.0]]
    limits = ThrustLimits(np.full(3, -1.0), np.ones(3))
    thrust = BrakingPolicy(steps=6)(view, limits)
    size = view.mass[0] / (6 * view.world.step_size)
    np.testing.assert_allclose(thrust, [[-size, 2.0 * size, 0.0], [0.0, 0.0, -1.0]])


def test_the_metrics_measure_ways_and_distances():
    step = sample_steps(rows=1)
    step.before.writable.position[:, 0], step.after.writable.position[:, 0] = [[1.0, 2.0, 3.0]], [[1.0, 5.0, -1.0]]
    np.testing.assert_allclose(PathLength()(step), [5.0])
    team = sample_team_steps(rows=1)
    team.after.writable.position[0, :3] = [[0.0, 0.0, 0.0], [30.0, 0.0, 0.0], [0.0, 40.0, 0.0]]
    np.testing.assert_allclose(TeamSpread()(team), [50.0])
    assert ScatteredDone(distance=49.0)(team).tolist() == [DoneStatus.LOSE]
    assert ScatteredDone(distance=51.0)(team).tolist() == [DoneStatus.RUNNING]


def test_close_deputies_coast():
    team = sample_team_steps(rows=1).after
    team.writable.position[0, :3] = [[0.0, 0.0, 0.0], [30.0, 0.0, 0.0], [0.0, 40.0, 0.0]]
    done = CoastWhenClose(distance=35.0)(np.ones((1, 3, 3)), team)
    np.testing.assert_array_equal(done.control[0, :, 0], [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(done.intervening, [[True, True, False]])
    states = {"position": np.array(team.position)}
    assert CoastWhenClose(distance=35.0).refusals(states) == {"distance": [True]}
    np.testing.assert_allclose(CoastWhenClose(distance=20.0).safety(states)["distance"], [10.0])


def test_the_orbit_drifts_as_the_solution_of_its_equations():
    """Closed form of the motion in the plane: x'' = -(2 - c^2) n^2 x, if y' = -2 n c x at the start."""
    orbit, n, start = SchweighartSedwick(inclination=0.3), 0.001027, 40.0
    radius = (3.986004418e14 / n**2) ** (1.0 / 3.0)
    c = np.sqrt(1.0 + 3.0 * 1.0826e-3 / 8.0 * (6.378e6 / radius) ** 2 * (1.0 + 3.0 * np.cos(0.6)))
    position, velocity = np.array([start, 0.0, 0.0]), np.array([0.0, -2.0 * n * c * start, 0.0])
    phi, gamma = orbit(10.0)
    for _ in range(500):
        SchweighartSedwick.row(phi, gamma, position, velocity, np.zeros(3), 12.0)
    assert position[0] == pytest.approx(start * np.cos(n * np.sqrt(2.0 - c * c) * 5000.0), abs=1e-8)


def test_the_noise_has_its_deviation_and_is_reproducible():
    world, state = None, {"key": np.arange(4000, dtype=np.uint64), "step": np.full(4000, 3)}
    running = ThrustNoise(sigma="20 mN")(world, 4000)
    commanded = np.full((4000, 1, 3), 0.5)
    flown = running.actuate(state, commanded)
    np.testing.assert_array_equal(flown, running.actuate(state, commanded))
    assert np.all(commanded == 0.5)
    assert (flown - 0.5).std(axis=(0, 1)) == pytest.approx([0.02] * 3, rel=0.05)
    assert abs((flown - 0.5).mean()) < 1e-3
