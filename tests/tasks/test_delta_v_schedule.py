from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.environments import BatchedEnvironment
from safe_inspect.tasks.inspection.fuel_price import FuelPriceSchedule, _RunningSchedule

SCHEDULE = FuelPriceSchedule(delta_v_scale_step=-0.03, steps_until_update=4)


def interval(scale: _RunningSchedule, *ends: tuple[int, float]) -> np.ndarray:
    """Run the four steps of an interval, in which episodes end: slot and inspected fraction."""
    for slot, fraction in ends:
        scale.end_episodes(np.array([slot]), np.array([fraction]))
    for _ in range(4):
        scale.advance(np.ones(len(scale.scale), dtype=bool))
    return scale.scale.copy()


def test_the_cost_rises_while_the_inspection_works_and_falls_when_it_does_not():
    scale = _RunningSchedule(SCHEDULE, 1)
    np.testing.assert_allclose(interval(scale, (0, 0.95)), [-0.031])
    np.testing.assert_allclose(interval(scale, (0, 0.9)), [-0.061])  # both bounds count
    np.testing.assert_allclose(interval(scale, (0, 0.85)), [-0.061])  # between them nothing moves
    np.testing.assert_allclose(interval(scale, (0, 0.8)), [-0.031])
    np.testing.assert_allclose(interval(scale, (0, 0.1)), [-0.001])


def test_the_scale_stays_within_its_bounds():
    scale = _RunningSchedule(SCHEDULE, 1)
    np.testing.assert_allclose(interval(scale, (0, 0.0)), [-0.001])
    for _ in range(5):
        interval(scale, (0, 1.0))
    np.testing.assert_allclose(scale.scale, [-0.1])


def test_the_mean_over_the_episodes_of_an_interval_counts():
    scale = _RunningSchedule(SCHEDULE, 2)
    moved = interval(scale, (0, 1.0), (0, 0.7), (1, 1.0), (1, 0.82))  # means 0.85 and 0.91
    np.testing.assert_allclose(moved, [-0.001, -0.031])
    np.testing.assert_allclose(interval(scale, (1, 0.5)), [-0.001, -0.001])  # what is past does not count again


def test_an_interval_without_an_end_changes_nothing():
    scale = _RunningSchedule(SCHEDULE, 1)
    interval(scale, (0, 1.0))
    np.testing.assert_allclose(interval(scale), [-0.031])


def test_every_slot_counts_its_own_steps():
    scale = _RunningSchedule(SCHEDULE, 2)
    scale.end_episodes(np.array([0, 1]), np.array([1.0, 1.0]))
    for step in range(4):
        scale.advance(np.array([True, step > 0]))
    np.testing.assert_allclose(scale.scale, [-0.031, -0.001])
    scale.advance(np.array([True, True]))
    np.testing.assert_allclose(scale.scale, [-0.031, -0.031])


FAST = (
    "env_config.simulator.config.inspection_points_map.chief.num_points=1",  # at +x, inspected at once
    "env_config.simulator.config.steps_until_update=3",
    "env_config.simulator.config.delta_v_scale_step=-0.01",
)


def test_the_reward_uses_the_scale_at_the_beginning_of_the_step(fixed_start):
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0), overrides=FAST))
    prices = []
    for _ in range(7):
        env.reset()
        prices.append(env.step(np.array([[[0.0, 1.2, 0.0]]])).terms["InspectionDeltaVReward"][0, 0])
    # 1.2 N on 12 kg for 10 s is 1 m/s, but the thruster gives 1 N; every episode is a win of one step.
    expected = np.array([-0.001] * 3 + [-0.011] * 3 + [-0.021]) * (1.0 / 12.0 * 10.0)
    np.testing.assert_allclose(prices, expected)


def test_an_abandoned_episode_and_steps_after_the_end_do_not_count(fixed_start):
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0), sun_angle=3.0, overrides=[*FAST, "horizon=2"]))
    env.reset()
    env.step(np.zeros((1, 1, 3)))
    env.reset()  # abandoned
    for _ in range(10):
        env.step(np.zeros((1, 1, 3)))  # over after two
    assert env.simulation.state.step[0] == 10
    assert env.simulation.components["FuelPriceSchedule"]._steps[0] == 0  # 1 + 2 steps: an interval, just over
    env.reset()
    assert env.state.delta_v_scale[0] == -0.001


@pytest.mark.parametrize("first_slot", [0, 3])
def test_a_batch_keeps_one_scale_for_each_slot(shipped, first_slot):
    from safe_inspect.config.experiment import load_experiment

    overrides = [*FAST[1:], "horizon=4", "env_config.simulator.config.inspected_points_update_bounds=[0.1, 0.12]"]
    env = BatchedEnvironment(load_experiment(shipped, overrides).spec, 30, seed=3, first_slot=first_slot)
    env.reset()
    fractions = []
    for step in range(12):
        transition = env.step(np.zeros((30, 1, 3)))
        if step % 4 == 3:
            assert transition.truncated.all()
            fractions.append(env.state.points["chief"].team_count / 100.0)
            env.reset()
    # Updates after the steps 3, 6, 9 and 12; episodes end after the steps 4, 8 and 12.
    moves = [np.zeros(30)] + [np.where(f >= 0.12, -0.01, np.where(f <= 0.1, 0.01, 0.0)) for f in fractions[:2]]
    scale = np.full(30, -0.001)
    for move in moves:
        scale = np.clip(scale + move, -0.1, -0.001)
    assert len(np.unique(scale)) > 1
    np.testing.assert_allclose(env.state.delta_v_scale, scale, rtol=1e-12)


def test_a_restored_scale_continues_as_if_nothing_had_happened():
    rng = np.random.default_rng(2)
    running = np.ones(3, dtype=np.bool_)
    whole, first = _RunningSchedule(SCHEDULE, 3), _RunningSchedule(SCHEDULE, 3)
    for step in range(400):
        if step == 237:
            second = _RunningSchedule(SCHEDULE, 3)
            second.load_state_dict(first.state_dict())
            first = second
        ended = np.flatnonzero(rng.random(3) < 0.1)
        fraction = rng.uniform(0.5, 1.0, len(ended))
        for scale in (whole, first):
            scale.end_episodes(ended, fraction)
            scale.advance(running)
        np.testing.assert_array_equal(first.scale, whole.scale)
    assert np.ptp(whole.scale) > 0.0 or whole.scale[0] != -0.001
    other = _RunningSchedule(SCHEDULE, 5)
    other.load_state_dict(whole.state_dict())
    np.testing.assert_allclose(other.scale, whole.scale.mean())


@pytest.mark.parametrize("rows", [[0], [3, 1], [4, 0, 2]])
def test_slots_that_continue_apart_count_as_if_they_had_stayed(rows):
    """Some slots are taken out, continue alone, and are put back; the others wait meanwhile."""
    rng, rows = np.random.default_rng(5), np.array(rows)
    whole, reference = _RunningSchedule(SCHEDULE, 5), _RunningSchedule(SCHEDULE, 5)
    for _ in range(60):
        for scale in (whole, reference):
            scale.advance(np.ones(5, dtype=np.bool_))
        part, alone = whole.part(rows), np.isin(np.arange(5), rows)
        for _ in range(int(rng.integers(1, 6))):
            ended, fraction = np.flatnonzero(rng.random(len(rows)) < 0.4), rng.uniform(0.7, 1.0)
            part.end_episodes(ended, np.full(len(ended), fraction))
            reference.end_episodes(rows[ended], np.full(len(ended), fraction))
            part.advance(np.ones(len(rows), dtype=np.bool_))
            reference.advance(alone)
        whole.join(part, rows)
        for name, array in reference.state_dict().items():
            np.testing.assert_array_equal(whole.state_dict()[name], array, err_msg=name)
    assert (np.delete(whole.scale, rows) == -0.001).all()
    assert np.ptp(whole.scale[rows]) >= 0.0
    assert (whole.scale[rows] != -0.001).any()


def test_a_restored_scale_keeps_to_its_bounds():
    scale = _RunningSchedule(SCHEDULE, 2)
    kept = {**scale.state_dict(), "scale": np.array([-5.0, 3.0])}
    scale.load_state_dict(kept)
    np.testing.assert_array_equal(scale.scale, [-0.1, -0.001])
    other = _RunningSchedule(SCHEDULE, 3)
    other.load_state_dict({name: array[:1] for name, array in kept.items()})
    np.testing.assert_array_equal(other.scale, [-0.1] * 3)
    assert not other.state_dict()["steps"].any()


def test_what_is_kept_of_a_schedule_is_restored_and_forgotten_with_the_seed(fixed_start):
    def flown(env, steps):
        for _ in range(steps):
            env.reset()
            env.step(np.array([[[0.0, 1.0, 0.0]]]))
        return env.simulation.state_dict()

    spec = fixed_start((60.0, 0.0, 0.0), overrides=FAST)
    env, other = BatchedEnvironment(spec), BatchedEnvironment(spec)
    kept = flown(env, 4)
    assert kept["FuelPriceSchedule"]["scale"].tolist() == [pytest.approx(-0.011)]
    other.simulation.load_state_dict(kept)
    for name, array in flown(other, 3)["FuelPriceSchedule"].items():
        np.testing.assert_array_equal(array, flown(env, 3)["FuelPriceSchedule"][name] if name == "scale" else array)
    env.simulation.seed(7)
    assert env.simulation.state_dict()["FuelPriceSchedule"]["scale"].tolist() == [-0.001]
    assert env.simulation.episodes.tolist() == [-1]
