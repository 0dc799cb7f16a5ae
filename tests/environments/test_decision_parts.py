"""Environments whose decisions continue are stepped without those that wait, with no effect on the results."""

from __future__ import annotations

import numpy as np
import pytest

import safe_inspect
from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import TeamEnvironment
from safe_inspect.environments.decisions import decide
from safe_inspect.errors import PluginValueError
from safe_inspect.simulators.simulator import Simulation

ONE = configs_root() / "translational-inspection" / "experiment-burn-and-coast.yml"
TEAM = configs_root() / "multiagent-translational-inspection" / "experiment-burn-and-coast.yml"
#: Episodes end soon, by a limit of time or as a deputy leaves, and the price of fuel moves now and then.
SOON = (
    "horizon=150",
    "X Thrust.config.properties={low: -2 N, high: 2 N}",
    "simulator.config={delta_v_scale_bounds: [-2.0, -0.02], delta_v_scale_step: -0.1, steps_until_update: 40, "
    "inspected_points_update_bounds: [0.1, 0.2]}",
)
NO_FILTER = "env_config.rta.config.enabled=False"


def actions_of(rng, count):
    durations = rng.choice(6, (count, 1), p=(0.5, 0.15, 0.1, 0.1, 0.05, 0.1))
    return np.concatenate((rng.uniform(-1, 1, (count, 3)) * (rng.random((count, 1)) < 0.3), durations), axis=-1)


def flown(path, overrides, divisible, monkeypatch, steps=40, count=70):
    """Return all that some decisions of a batch gave, and the sizes of the batches that were stepped for them."""
    core, found, sizes = TeamEnvironment(load_experiment(path, overrides).spec, count, seed=5), [], set()
    rng = np.random.default_rng(1)
    step = TeamEnvironment.step
    with monkeypatch.context() as patch:
        patch.setattr(TeamEnvironment, "step", lambda self, actions: sizes.add(self.num_envs) or step(self, actions))
        if not divisible:
            patch.setattr(Simulation, "divisible", property(lambda self: False))
        core.reset()
        for _ in range(steps):
            given = [np.stack([actions_of(rng, count) for _ in group.agents], axis=1) for group in core.acting]
            resting = rng.random(count) < 0.1
            decided = decide(core, given, 0.99, resting)
            acted = {name: array for group in decided.groups for name, array in group.terms.items()}
            for group, info in zip(decided.groups, decided.infos, strict=True):
                for name in ("observation", "reward", "terminated", "truncated", "status"):
                    acted[name] = getattr(group, name)[~resting]
                acted |= {name: array.reshape(count, -1)[~resting] for name, array in info.items()}
            moved = {name: array.copy() for name, array in core.state.arrays.items()}
            kept = core.simulation.state_dict().get("FuelPriceSchedule", {})
            found.append(acted | moved | kept | {"running": core.simulation.running.copy(), "over": decided.over})
            core.reset(np.flatnonzero(decided.over & ~resting))
    return found, sizes


@pytest.mark.parametrize(
    ("path", "overrides"), [(ONE, SOON), (TEAM, (*SOON[:2], NO_FILTER))], ids=["one deputy", "three deputies"]
)
def test_a_batch_in_parts_is_the_whole_batch_bit_for_bit(path, overrides, monkeypatch):
    whole, sizes = flown(path, overrides, False, monkeypatch)
    assert sizes == {70}
    parts, sizes = flown(path, overrides, True, monkeypatch)
    assert sizes >= {70, 64, 32, 16}
    for wanted, found in zip(whole, parts, strict=True):
        assert wanted.keys() == found.keys()
        for name, array in wanted.items():
            np.testing.assert_array_equal(found[name], array, err_msg=name)
    assert sum(np.count_nonzero(each["terminated"]) for each in whole) > 10
    if path is ONE:
        assert len(np.unique(whole[-1]["scale"])) > 1
        assert np.isfinite(np.concatenate([each["observation"] for each in whole])).all()


def test_a_row_of_a_vector_is_the_environment_alone():
    many, one = safe_inspect.make_vec(ONE, 40, autoreset_mode="SameStep"), safe_inspect.make(ONE)
    seen, _ = many.reset(seed=3)
    alone, _ = one.reset(seed=3)
    rng = np.random.default_rng(2)
    for _ in range(25):
        np.testing.assert_array_equal(seen[0], alone)
        actions = actions_of(rng, 40).astype(np.float32)
        seen, rewards, *_, infos = many.step(actions)
        alone, reward, terminated, truncated, info = one.step(actions[0])
        assert not terminated
        assert not truncated
        assert rewards[0] == reward
        assert infos["elapsed_steps"][0] == info["elapsed_steps"]
    assert many.core.team.observes_coasting


def test_an_error_names_the_environment_of_the_whole_batch(monkeypatch):
    core = TeamEnvironment(load_experiment(ONE).spec, 40, seed=5)
    core.reset()
    reward = core.groups[0].agent.rewards[0].functor
    core.groups[0].fused = None  # plugins are called one by one

    def fails(self, step):
        return np.where((step.after.state.key == core.state.key[37]) & (step.after.step > 10), np.nan, 0.0)

    monkeypatch.setattr(type(reward), "__call__", fails)
    actions = np.zeros((40, 1, 4))
    actions[35:, 0, 3] = 5.0
    with pytest.raises(PluginValueError, match=r"in environment 37, step 11 \(1 of 16 environments\)"):
        decide(core, [actions])
