"""The optimiser's plans win in the simulator, cost no more than the inspector, and rest on seed and slot alone."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments import load_spec
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation import rollout
from safe_inspect.evaluation.optimiser import EFFORTS, optimise
from safe_inspect.policies import NaturalMotionInspector
from safe_inspect.policies.open_loop import OpenLoopPlan
from safe_inspect.policies.plan_record import Entry

EPISODES, SEED = 6, 0
SINGLE = "safe_inspect/TranslationalInspectionSeed-v0"
AGENT = "agent_config.0.config.config"


@pytest.fixture(scope="module")
def entries(spec: EnvironmentSpec) -> list[Entry]:
    return optimise(spec, EPISODES, SEED, 0, EFFORTS["quick"])


@pytest.mark.slow
def test_plans_win_and_cost_no_more_than_the_inspector(spec: EnvironmentSpec, entries: list[Entry]) -> None:
    flown = rollout(spec, NaturalMotionInspector(), episodes=EPISODES, seed=SEED)
    spent = np.array([entry.delta_v for entry in entries])
    assert all(entry.success and entry.inspected == 100 and entry.own for entry in entries)
    np.testing.assert_allclose([entry.inspector for entry in entries], flown.delta_v, rtol=1e-12)
    assert (spent <= flown.delta_v).all()
    assert spent.mean() < 0.97 * flown.delta_v.mean()


@pytest.mark.slow
def test_a_plan_is_flown_as_it_was_planned_and_again_in_a_rollout(spec: EnvironmentSpec, entries: list[Entry]) -> None:
    policy = OpenLoopPlan.of((entry.key, entry.plan) for entry in entries)
    flown = rollout(spec, policy, episodes=EPISODES, seed=SEED, num_envs=4, record=2)
    np.testing.assert_array_equal(flown.delta_v, [entry.delta_v for entry in entries])
    np.testing.assert_array_equal(flown.length, [entry.steps for entry in entries])
    assert flown.success.all()
    for entry in entries:
        assert entry.delta_v == pytest.approx(entry.planned, rel=1e-9)
        assert 1 <= len(entry.plan) <= 8
    assert flown.trajectories[0].range.min() >= 10.0
    with pytest.raises(SafeInspectError, match="no plan for"):
        rollout(spec, policy, episodes=1, seed=SEED + 1)


@pytest.mark.slow
def test_plans_depend_neither_on_the_batch_nor_on_the_run(spec: EnvironmentSpec, entries: list[Entry]) -> None:
    parts = [optimise(spec, count, SEED, first, EFFORTS["quick"]) for first, count in ((0, 1), (1, 3))]
    assert [*parts[0], *parts[1]] == entries[:4]


@pytest.mark.slow
def test_light_costs_fuel_and_dark_is_never_cheaper(entries: list[Entry]) -> None:
    bright = load_spec(SINGLE, ["config.config.env_config.simulator.config.illumination_params=null"])
    freely = optimise(bright, 3, SEED, 0, EFFORTS["quick"])
    for lit, free in zip(entries, freely, strict=False):
        assert free.key == lit.key
        assert free.success
        assert free.delta_v <= lit.delta_v + 1e-6


@pytest.mark.slow
def test_weak_thrusters_burn_longer(entries: list[Entry]) -> None:
    weak = 0.02
    limits = f"{{name: thrust, low: -{weak}, high: {weak}}}"
    task = load_spec(SINGLE, [f"{AGENT}.parts.{axis}.config.properties={limits}" for axis in range(3)])
    found = optimise(task, 2, SEED, 0, EFFORTS["quick"])
    for entry, strong in zip(found, entries, strict=False):
        assert entry.success
        assert max(burn.steps for burn in entry.plan) > 1
        assert max(abs(part) for burn in entry.plan for part in burn.thrust) <= weak * (1.0 + 1e-9)
        assert entry.delta_v >= strong.delta_v - 1e-4


@pytest.mark.parametrize(
    ("cfg", "overrides", "shown"),
    [
        (configs_root() / "multiagent-translational-inspection" / "experiment.yml", [], "one deputy"),
        (SINGLE, [f"{AGENT}.glues.0.config.enabled=True"], "without a safety filter"),
        (SINGLE, [f"{AGENT}.dones.2.config={{weight_threshold: 0.95}}"], "all points"),
    ],
)
def test_tasks_that_it_cannot_plan_for_are_refused(cfg: object, overrides: list[str], shown: str) -> None:
    with pytest.raises(SafeInspectError, match=shown):
        optimise(load_spec(str(cfg), overrides), 1, 0, 0, EFFORTS["quick"])


def test_a_drift_that_sees_all_from_out_of_range_is_no_plan(spec: EnvironmentSpec) -> None:
    # The coast of this episode leaves the 800 m at step 320 and does not come back.
    (entry,) = optimise(spec, 1, SEED, 60, EFFORTS["quick"])
    assert entry.success
    assert entry.own
    assert entry.inspector is not None
    assert 0.0 < entry.delta_v < entry.inspector
