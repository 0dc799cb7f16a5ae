"""A row of a batch is bit-identical to the environment alone, for any batch, split and order of resets."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import BatchedEnvironment

SEED = 20231029
#: Short episodes and a delta-v scale that moves, so that 500 steps hold many resets and every kind of memory.
LIVELY = (
    "horizon=90",
    "env_config.simulator.config.steps_until_update=60",
    "env_config.simulator.config.delta_v_scale_step=-0.01",
    "env_config.simulator.config.inspected_points_update_bounds=[0.2, 0.3]",
)


def actions(steps: int, num_envs: int) -> np.ndarray:
    """Thrusts that make some environments drift and others leave the range, shape (steps, num_envs, 1, 3)."""
    generator = np.random.default_rng(1)
    strength = generator.choice([0.02, 0.2, 1.0], size=(1, num_envs, 1, 1))
    steady = generator.uniform(-1, 1, (1, num_envs, 1, 3))
    return strength * np.clip(steady + generator.normal(0.0, 0.5, (steps, num_envs, 1, 3)), -1, 1)


def fly(env: BatchedEnvironment, thrusts: np.ndarray, rows: list[int] | None = None) -> dict[str, np.ndarray]:
    """Return what chosen rows show in each step, ended environments being reset at once; "final/..." is their state."""
    rows = list(range(env.num_envs)) if rows is None else rows
    seen: dict[str, list[np.ndarray]] = {"reset": [env.reset()[rows]]}
    for thrust in thrusts:
        transition = env.step(thrust)
        told = {
            name: getattr(transition, name) for name in ("observation", "reward", "terminated", "truncated", "status")
        }
        told |= transition.terms | {"scale": env.state.delta_v_scale, "delta_v": env.state.delta_v}
        ended = np.flatnonzero(transition.done[:, 0])
        if len(ended):
            env.reset(ended)
        told["begun"] = env.state.position
        for name, array in told.items():
            seen.setdefault(name, []).append(array[rows].copy())
    flown = {name: np.stack(arrays) for name, arrays in seen.items()}
    return flown | {f"final/{name}": array[rows].copy()[None] for name, array in env.state.arrays.items()}


def equal(first: dict[str, np.ndarray], second: dict[str, np.ndarray]) -> None:
    assert first.keys() == second.keys()
    for name, array in first.items():
        assert array.dtype == second[name].dtype
        assert array.tobytes() == second[name].tobytes(), name


def test_a_row_of_a_thousand_is_the_environment_alone(shipped):
    spec = load_experiment(shipped, LIVELY).spec
    thrusts = actions(500, 1000)
    rows = [0, 1, 2, 499, 777, 999]
    batch = fly(BatchedEnvironment(spec, 1000, seed=SEED), thrusts, rows)
    resets = (batch["terminated"] | batch["truncated"]).sum(axis=0)[:, 0]
    assert (resets >= 5).all()
    assert batch["terminated"].any()
    assert batch["truncated"].any()
    assert len(np.unique(batch["scale"])) > 2
    for index, row in enumerate(rows):
        alone = fly(BatchedEnvironment(spec, 1, seed=SEED, first_slot=row), thrusts[:, row : row + 1])
        equal({name: array[:, index : index + 1] for name, array in batch.items()}, alone)


def test_the_split_into_workers_changes_nothing(shipped):
    spec = load_experiment(shipped, LIVELY).spec
    thrusts = actions(200, 12)
    whole = fly(BatchedEnvironment(spec, 12, seed=SEED), thrusts)
    first = fly(BatchedEnvironment(spec, 5, seed=SEED), thrusts[:, :5])
    second = fly(BatchedEnvironment(spec, 7, seed=SEED, first_slot=5), thrusts[:, 5:])
    equal(whole, {name: np.concatenate((first[name], second[name]), axis=1) for name in first})


def test_a_narrow_field_is_row_wise_too(shipped):
    overrides = ("config.config.env_config.simulator.config.field_of_view=0.2", "horizon=40")
    spec = load_experiment(shipped, overrides).spec
    thrusts = actions(100, 64)
    batch = fly(BatchedEnvironment(spec, 64, seed=SEED), thrusts, [0, 63])
    assert batch["ObservedPointsReward"].max() > 0
    for index, row in enumerate((0, 63)):
        alone = fly(BatchedEnvironment(spec, 1, seed=SEED, first_slot=row), thrusts[:, row : row + 1])
        equal({name: array[:, index : index + 1] for name, array in batch.items()}, alone)


def test_the_order_of_resets_changes_nothing(shipped):
    """Rows that are reset one by one begin the episodes of rows that are reset together."""
    spec = load_experiment(shipped).spec
    together, apart = (BatchedEnvironment(spec, 4, seed=SEED) for _ in range(2))
    together.reset()
    begun = together.reset()
    for row in (2, 0, 3, 1):
        apart.reset([row])
    for row in (3, 1, 0, 2):
        np.testing.assert_array_equal(apart.reset([row])[0], begun[row])


def test_a_seed_begins_the_run_again(shipped):
    """What happened under another seed, the delta-v scale included, leaves no trace."""
    spec = load_experiment(shipped, LIVELY).spec
    thrusts = actions(150, 3)
    fresh = BatchedEnvironment(spec, 3, seed=SEED)
    used = BatchedEnvironment(spec, 3, seed=1)
    fly(used, thrusts[:95])
    used.reset(seed=SEED)
    used.simulation.seed(SEED)
    equal(fly(fresh, thrusts), fly(used, thrusts))


def test_slots_episodes_and_seeds_differ(shipped):
    spec = load_experiment(shipped).spec
    env = BatchedEnvironment(spec, 50, seed=SEED)
    starts = np.concatenate([env.reset(), env.reset(), BatchedEnvironment(spec, 50, seed=SEED + 1).reset()])
    assert len(np.unique(starts[:, 0, :3], axis=0)) == 150


def test_a_seed_for_some_rows_is_refused(shipped):
    env = BatchedEnvironment(load_experiment(shipped).spec, 2)
    with pytest.raises(ValueError, match="reset all of them"):
        env.reset([1], seed=3)
