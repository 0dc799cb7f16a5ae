"""Sensors of the other deputies: by hand, and what must not change a reading."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.dynamics import Dynamics
from safe_inspect.dynamics.cwh import transition
from safe_inspect.glues.normalizers import LinearNormalizer, Normalization, StandardNormalNormalizer
from safe_inspect.glues.observations import ObserveSensor
from safe_inspect.platforms import Sensor
from safe_inspect.platforms.neighbour_sensors import (
    ClosestApproachPositionSensor,
    NearestDeputiesPositionSensor,
    NearestDeputiesVelocitySensor,
)
from safe_inspect.platforms.state_sensors import PositionSensor
from safe_inspect.simulators.offers import Offers
from safe_inspect.simulators.state import State, base_specs
from safe_inspect.simulators.view import Group, View
from safe_inspect.simulators.world import World


def view_of(position, velocity=None, first: int = 0, size: int | None = None) -> View:
    """Return a view of deputies at positions (N, D, 3) [m], the chief at the origin behind them."""
    position = np.asarray(position, dtype=np.float64)
    environments, deputies, _ = position.shape
    names = tuple(f"blue{index}" for index in range(deputies))
    world = World(names, {**dict(zip(names, range(deputies), strict=True)), "chief": deputies}, np.full(deputies, 12.0),
                  10.0, Offers(world={"mean_motion": 0.001027}))  # fmt: skip
    state = State(environments, base_specs(deputies + 1, deputies, 3, Dynamics.arrays))
    state.position[:, :deputies] = position
    if velocity is not None:
        state.velocity[:, :deputies] = velocity
    return View(state, world, Group("blue", first, deputies - first if size is None else size, {}))


def sensors(k: int = 3, max_range: float = 1000.0) -> tuple[Sensor, ...]:
    places = (NearestDeputiesPositionSensor, NearestDeputiesVelocitySensor)
    return tuple(made(k=k, max_range=max_range) for made in places)


def flight(seed: int, environments: int = 4, deputies: int = 5) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(0.0, 100.0, (environments, deputies, 3)), rng.normal(0.0, 0.3, (environments, deputies, 3))


class TestNearest:
    def test_by_hand(self) -> None:
        position = [[[100, 0, 0], [100, 50, 0], [100, 0, -20], [40, 0, 0]]]
        velocity = [[[1, 0, 0], [1, 2, 0], [0, 0, 3], [1, 0, 0.5]]]
        view = view_of(position, velocity)
        first, _, third, _ = NearestDeputiesPositionSensor(k=2)(view).tolist()
        assert first == [0, 0, -20, 0, 50, 0]
        assert third == [0, 0, 20, 0, 50, 20]
        first, _, third, _ = NearestDeputiesVelocitySensor(k=2)(view).tolist()
        assert first == [-1, 0, 3, 0, 2, 0]
        assert third == [1, 0, -3, 1, 2, -3]

    def test_the_lower_index_is_first_of_equals(self) -> None:
        position = [[[0, 0, 0], [0, 30, 0], [0, 0, 30], [30, 0, 0], [0, -10, 0]]]
        assert NearestDeputiesPositionSensor(k=3)(view_of(position))[0].tolist() == [0, -10, 0, 0, 30, 0, 0, 0, 30]

    def test_a_place_without_a_deputy_lies_far_out(self) -> None:
        view = view_of([[[0, 30, -40], [0, 30, 0]]], [[[1, 1, 1], [3, 1, 1]]])
        assert NearestDeputiesPositionSensor(k=3)(view)[0].tolist() == [0, 0, 40, 0, 600, -800, 0, 600, -800]
        assert NearestDeputiesVelocitySensor(k=3)(view)[0].tolist() == [2, 0, 0, 0, 0, 0, 0, 0, 0]

    def test_the_closest_approach_is_that_of_flights_without_thrust(self) -> None:
        position, velocity = flight(11)
        view = view_of(position, velocity)
        found = ClosestApproachPositionSensor(duration=1500.0)(view).reshape(position.shape)
        states = np.concatenate((position, velocity), axis=2)
        flown = np.stack([states @ transition(view.world.mean_motion, 12.0, t)[0][:3].T for t in np.arange(1501.0)])
        for row in range(position.shape[0]):
            for own in range(position.shape[1]):
                relative = np.delete(flown[:, row], own, axis=1) - flown[:, row, own, None]
                ranges = np.linalg.norm(relative, axis=2)
                nearest = np.unravel_index(ranges.argmin(), ranges.shape)
                np.testing.assert_allclose(found[row, own], relative[nearest], atol=0.5)  # within half a second
                assert np.linalg.norm(found[row, own]) <= ranges.min() + 1e-9

    def test_no_approach_lies_far_out(self) -> None:
        view = view_of([[[0, 30, -40], [0, 30, 40]]], [[[0, 0, -1], [0, 0, 1]]])
        found = ClosestApproachPositionSensor(duration=60.0, max_range=50.0)(view)
        np.testing.assert_allclose(found, [[0, 30, -40], [0, 30, 40]])

    def test_alone(self) -> None:
        view = view_of([[[0, 0, 60]], [[0, 0, 0]]])
        far = NearestDeputiesPositionSensor(k=1, max_range="0.5 km")(view)
        assert far.tolist() == [[0, 0, 500], [500, 0, 0]]
        assert not NearestDeputiesVelocitySensor()(view).any()

    def test_the_range_itself_is_within(self) -> None:
        view = view_of([[[0, 0, 0], [300, 0, 400], [0, 500.0001, 0]]])
        reading = NearestDeputiesPositionSensor(max_range=500.0)(view)[0]
        assert reading.tolist() == [300, 0, 400, 500, 0, 0]  # the second place has no deputy

    @given(seed=st.integers(0, 2**32 - 1), k=st.integers(1, 6))
    @settings(max_examples=25, deadline=None)
    def test_agrees_with_a_sort(self, seed: int, k: int) -> None:
        position, velocity = flight(seed)
        view = view_of(position, velocity)
        reading = [made(view).reshape(4, 5, k, -1) for made in sensors(k)]
        for env in range(4):
            for own in range(5):
                away = np.delete(position[env], own, axis=0) - position[env, own]
                speed = np.delete(velocity[env], own, axis=0) - velocity[env, own]
                order = np.argsort(np.linalg.norm(away, axis=1))[:k]
                places = len(order)
                np.testing.assert_array_equal(reading[0][env, own, :places], away[order])
                np.testing.assert_array_equal(reading[1][env, own, :places], speed[order])
                out = 1000.0 * position[env, own] / np.linalg.norm(position[env, own])
                np.testing.assert_allclose(reading[0][env, own, places:], np.tile(out, (k - places, 1)))

    @given(seed=st.integers(0, 2**32 - 1))
    @settings(max_examples=25, deadline=None)
    def test_turns_with_the_scene(self, seed: int) -> None:
        position, _ = flight(seed, deputies=3)
        turn = np.linalg.qr(np.random.default_rng(seed + 1).normal(size=(3, 3)))[0]
        sensor = NearestDeputiesPositionSensor(k=4, max_range=150.0)
        still = sensor(view_of(position)).reshape(-1, 4, 3)
        np.testing.assert_allclose(sensor(view_of(position @ turn)).reshape(-1, 4, 3), still @ turn, atol=1e-9)


class TestInvariance:
    @given(seed=st.integers(0, 2**32 - 1), deputies=st.integers(2, 6))
    @settings(max_examples=25, deadline=None)
    def test_the_order_of_the_others_does_not_matter(self, seed: int, deputies: int) -> None:
        position, velocity = flight(seed, deputies=deputies)
        order = np.concatenate(([0], 1 + np.random.default_rng(seed).permutation(deputies - 1)))
        one = view_of(position, velocity, size=1)
        another = view_of(position[:, order], velocity[:, order], size=1)
        for sensor in sensors():
            assert sensor(one).tobytes() == sensor(another).tobytes()

    @given(seed=st.integers(0, 2**32 - 1), more=st.integers(1, 5))
    @settings(max_examples=25, deadline=None)
    def test_deputies_out_of_range_do_not_matter(self, seed: int, more: int) -> None:
        position, velocity = flight(seed, deputies=3)
        far = np.random.default_rng(seed).normal(size=(4, more, 3))
        far *= 5000.0 / np.linalg.norm(far, axis=-1, keepdims=True)
        many = np.concatenate((position, far), axis=1)
        fast = np.concatenate((velocity, far), axis=1)
        for sensor in sensors():
            few = sensor(view_of(position, velocity))
            assert few.tobytes() == sensor(view_of(many, fast, size=3)).tobytes()
            assert few.shape == (12, sensor.size) == (12, len(sensor.element_names))

    @given(seed=st.integers(0, 2**32 - 1), first=st.integers(0, 4))
    @settings(max_examples=25, deadline=None)
    def test_a_row_alone_reads_the_same(self, seed: int, first: int) -> None:
        position, velocity = flight(seed)
        for sensor in sensors():
            together = sensor(view_of(position, velocity)).reshape(4, 5, -1)
            for env in range(4):
                row = slice(env, env + 1)
                alone = sensor(view_of(position[row], velocity[row], first=first, size=1))
                assert alone.tobytes() == together[env, first].tobytes()


def test_names_and_limits_follow_the_fields() -> None:
    position, velocity = sensors(k=2, max_range=400.0)
    assert position.element_names == ("x_0", "y_0", "z_0", "x_1", "y_1", "z_1")
    assert velocity.element_names[3:] == ("v_x_1", "v_y_1", "v_z_1")
    assert position.limits == (-400.0, 400.0)
    assert velocity.limits == (-np.inf, np.inf)
    assert PositionSensor().element_names == PositionSensor.elements


def observed(sensor: Sensor, **fields) -> tuple[ObserveSensor, dict[str, Sensor]]:
    return ObserveSensor(sensor=sensor.part_name, **fields), {sensor.part_name: sensor}


def test_observed_with_a_sigma_for_each_element() -> None:
    sigma = [1.0, 2.0, 5.0, 10.0, 10.0, 10.0]
    normal = Normalization(normalizer="StandardNormalNormalizer", config={"sigma": sigma})
    sensor = NearestDeputiesPositionSensor(k=2)
    glue, parts = observed(sensor, normalization=normal)
    assert glue.names(parts)[4] == "Sensor_NearestDeputiesPosition.y_1"
    low, high = glue.bounds(parts)
    np.testing.assert_allclose(high, 1000.0 / np.array(sigma))
    np.testing.assert_allclose(low, -high)
    view = view_of([[[0, 0, 0], [10, 20, 30]]], size=1)
    view.group = Group("blue", 0, 1, parts)
    assert glue(view)[0].tolist() == [10, 10, 6, 100, 0, 0]
    StandardNormalNormalizer(sigma=sigma).check(6, low, high)
    with pytest.raises(ValueError, match="6 elements for values of size 9"):
        observed(NearestDeputiesPositionSensor(k=3), normalization=normal)[0].bounds(
            {"Sensor_NearestDeputiesPosition": NearestDeputiesPositionSensor(k=3)}
        )


def test_observed_between_bounds() -> None:
    normal = Normalization(normalizer="LinearNormalizer", config={"minimum": 0.0})
    sensor = NearestDeputiesPositionSensor(k=1, max_range=50.0)
    glue, parts = observed(sensor, output_units="km", normalization=normal)
    low, high = glue.bounds(parts)
    assert low.tolist() == [0.0] * 3
    assert high.tolist() == [1.0] * 3
    view = view_of([[[0, 0, 0], [0, 0, 25]]], size=1)
    view.group = Group("blue", 0, 1, parts)
    assert glue(view)[0].tolist() == pytest.approx([0.5, 0.5, 0.75])
    assert isinstance(normal.active, LinearNormalizer)


@pytest.mark.parametrize("fields", [{"k": 0}, {"k": 101}, {"max_range": 0.0}, {"max_range": "3 s"}])
def test_fields_that_are_refused(fields) -> None:
    with pytest.raises(ValueError, match=next(iter(fields))):
        NearestDeputiesPositionSensor(**fields)


def test_the_observation_has_one_size_for_any_team() -> None:
    """What a policy has learned with three deputies it can fly with five."""
    from dataclasses import replace

    from safe_inspect.environments.team import TeamEnvironment
    from safe_inspect.testing import sample_spec

    layouts = set()
    for deputies in (1, 3, 5):
        spec = sample_spec(deputies=deputies)
        glues = tuple(ObserveSensor(sensor=sensor.part_name) for sensor in sensors(k=2))
        spec = replace(spec, agents=tuple(replace(agent, glues=(*agent.glues, *glues)) for agent in spec.agents))
        environment = TeamEnvironment(spec, 2, seed=1)
        (observation,) = environment.reset()
        layouts.add(environment.acting[0].observation_layout.names)
        assert observation.shape == (2, deputies, 11 + 6 + 6)
    assert len(layouts) == 1
