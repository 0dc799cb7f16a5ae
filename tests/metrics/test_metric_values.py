"""The built-in metrics against recorded episodes, worked out in another way, and against steps by hand."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.environments import load_spec
from safe_inspect.errors import PluginValueError, SafeInspectError
from safe_inspect.evaluation import rollout
from safe_inspect.evaluation.task import default_metrics, read_metrics
from safe_inspect.metrics import (
    Decisions,
    DeltaVAfterLastPoint,
    DeltaVToCoverage,
    Interventions,
    InterventionShare,
    LargestRange,
    LargestSpeed,
    Metric,
    SmallestPhi,
    SmallestRange,
    TeamMetric,
    ThrustingSteps,
    TimeToCoverage,
)
from safe_inspect.plugins.registry import registry
from safe_inspect.policies import RandomThrust, ZeroThrust
from safe_inspect.rta.constraints import constraint_set

EVERY = [cls() for _, cls in registry.items("metric") if cls.__module__.startswith("safe_inspect.")]
TASKS = ("translational-inspection", "multiagent-translational-inspection")


@pytest.fixture
def forgetful():
    """Forget the metrics that a test defines."""
    known = dict(registry.items("metric"))
    yield
    registry._classes["metric"] = known


def spec_of(task, *overrides):
    return load_spec(configs_root() / task / "experiment.yml", overrides)


@pytest.fixture(scope="module", params=TASKS)
def flown(request):
    """Return rough episodes with every metric, all of them recorded."""
    return rollout(spec_of(request.param, "horizon=90"), RandomThrust(), episodes=8, seed=5, record=8, metrics=EVERY)


def of_agents(flown, label):
    return np.stack([agent.metrics[label] for agent in flown.agents.values()], axis=1)


def test_every_built_in_metric_is_measured(flown):
    labels = {metric.label for metric in EVERY}
    assert len(labels) == len(EVERY) == 13
    assert set(flown.metrics) == set(flown.units) == labels
    for metric in EVERY:
        for agent in flown.agents.values():
            assert (metric.label in agent.metrics) == isinstance(metric, Metric)


def test_metrics_agree_with_what_was_recorded(flown):
    """Agents that ended before their episode continue to coast; that part is not counted for them."""
    for row, one in enumerate(flown.trajectories):
        for deputy, agent in enumerate(flown.agents.values()):
            last = agent.length[row]
            ranges = np.linalg.norm(one.position[: last + 1, deputy], axis=-1)
            speeds = np.linalg.norm(one.velocity[: last + 1, deputy], axis=-1)
            burns = np.abs(one.control[:last, deputy]).sum(axis=-1)
            wanted = {
                SmallestRange().label: ranges.min(),
                LargestRange().label: ranges.max(),
                LargestSpeed().label: speeds.max(),
                SmallestPhi().label: ranges.min() - 10.0,
                ThrustingSteps().label: (burns > 1e-3).sum(),
            }
            for label, value in wanted.items():
                assert agent.metrics[label][row] == pytest.approx(value, rel=1e-9), label


def test_coverage_and_its_price_agree_with_what_was_recorded(flown):
    after = np.array([])
    for row, one in enumerate(flown.trajectories):
        for deputy, agent in enumerate(flown.agents.values()):
            end = one.time[agent.length[row]]
            seen = one.inspected_at[one.inspected_at <= end]
            then = np.searchsorted(one.time, seen.max()) if len(seen) else 0
            spent = one.delta_v[agent.length[row], deputy] - one.delta_v[max(then, 1), deputy]
            label = DeltaVAfterLastPoint().label
            assert agent.metrics[label][row] == pytest.approx(spent, rel=1e-9, abs=1e-12)
            after = np.append(after, spent)
    assert (after > 0.0).any()


@pytest.mark.parametrize("task", TASKS)
def test_the_time_to_coverage_is_that_of_the_recording(task):
    asked = [0.3, 0.7, 1.0]
    metrics = [*(TimeToCoverage(fraction=f) for f in asked), *(DeltaVToCoverage(fraction=f) for f in asked)]
    flown = rollout(spec_of(task, "horizon=80"), RandomThrust(), episodes=12, seed=1, record=12, metrics=metrics)
    found = np.stack([flown.metrics[f"time to {100 * share:g} %"] for share in asked], axis=1)
    assert np.isnan(found).any()
    assert np.isfinite(found).any()
    for row, one in enumerate(flown.trajectories):
        for place, share in enumerate(asked):
            reached = np.flatnonzero(one.coverage >= share - 1e-12)
            assert found[row, place] == (
                pytest.approx(one.time[reached[0]]) if len(reached) else pytest.approx(np.nan, nan_ok=True)
            )


def test_the_beginning_counts(fixed_start):
    """A deputy that only flies away is nearest at its beginning."""
    spec = fixed_start((60.0, 0.0, 0.0), (2.0, 0.0, 0.0), overrides=["horizon=10"])
    flown = rollout(
        spec, ZeroThrust(), episodes=1, metrics=[SmallestRange(), SmallestPhi(), TimeToCoverage(fraction=0.01)]
    )
    assert flown.metrics["smallest range"] == [60.0]
    assert flown.metrics["phi chief_collision"] == [50.0]
    assert flown.metrics["time to 1 %"] == [0.0]


@pytest.mark.parametrize("task", TASKS)
def test_metrics_do_not_depend_on_the_size_of_the_batch(task):
    def fly(num_envs):
        return rollout(spec_of(task, "horizon=25"), RandomThrust(), 9, 2, num_envs, metrics=EVERY)

    whole, parts = fly(9), fly(2)
    for label, values in whole.metrics.items():
        np.testing.assert_array_equal(values, parts.metrics[label], err_msg=label)
    for name, agent in whole.agents.items():
        for label, values in agent.metrics.items():
            np.testing.assert_array_equal(values, parts.agents[name].metrics[label], err_msg=label)


def test_a_team_is_its_agents():
    flown = rollout(spec_of(TASKS[1], "horizon=50"), RandomThrust(), episodes=6, seed=8, metrics=EVERY)
    for label, together in (
        ("smallest range", np.min), ("largest speed", np.max), ("decisions", np.mean), ("thrusting steps", np.sum),
        ("phi chief_collision", np.min),
    ):  # fmt: skip
        np.testing.assert_allclose(flown.metrics[label], together(of_agents(flown, label), axis=1), rtol=1e-12)


def test_interventions_are_counted_and_the_filters_constraints_are_kept():
    glue = "agent_config.0.config.config.glues.0.config.enabled=True"
    spec = spec_of(TASKS[0], glue, "horizon=60")
    flown = rollout(spec, RandomThrust(), 6, 0, metrics=[InterventionShare(), *default_metrics(spec)])
    count = flown.metrics[Interventions().label]
    assert (count > 0).all()
    np.testing.assert_allclose(flown.metrics["intervention share"], count / flown.length)
    phi = {label: values for label, values in flown.metrics.items() if label.startswith("phi ")}
    assert len(phi) == 8
    assert all((values >= 0.0).all() for values in phi.values())


def test_constraints_are_measured_with_the_tasks_own_parameters_and_without_a_filter():
    spec = spec_of(TASKS[0], "horizon=30")
    assert not spec.agents[0].action_glues[0].enabled
    flown = rollout(spec, RandomThrust(), 5, 0, record=5, metrics=default_metrics(spec))
    assert flown.units["phi sun"] == "rad"
    for row, one in enumerate(flown.trajectories):
        fastest = np.abs(one.velocity[:, 0]).max(axis=0)
        for axis, name in enumerate("xyz"):
            assert flown.metrics[f"phi {name}_vel"][row] == pytest.approx(1.0 - fastest[axis], rel=1e-9)
        assert flown.metrics["phi r_max"][row] == pytest.approx(800.0 - np.linalg.norm(one.position, axis=-1).max())


def test_constraints_between_deputies_look_at_the_nearest():
    spec = spec_of(TASKS[1], "horizon=30")
    (constraint,) = constraint_set({}, ("deputy_collision",)).values()
    metric = SmallestPhi(constraint=constraint, about="deputies")
    assert metric.label == "phi deputy_collision"
    flown = rollout(spec, RandomThrust(), 5, 0, metrics=[metric])
    np.testing.assert_allclose(flown.metrics[metric.label], flown.closest - 10.0, rtol=1e-9)
    assert "phi deputy_collision" in {item.label for item in default_metrics(spec)}
    alone = rollout(spec_of(TASKS[0], "horizon=3"), ZeroThrust(), 2, metrics=[metric])
    assert np.isnan(alone.metrics[metric.label]).all()


def test_a_users_metric_of_each_reduction(forgetful):
    made = []
    for reduce in ("sum", "max", "min", "last", "mean"):

        class Clock(Metric, name=f"Clock{reduce}"):
            """Time after every second step."""

            unit: ClassVar[str] = "s"

            def __call__(self, step):
                """Return the time [s], NaN in the others, shape (R,)."""
                return np.where(step.after.step % 2 == 0, step.after.time, np.nan)

        Clock.reduce = reduce
        made.append(Clock())
    flown = rollout(spec_of(TASKS[0], "horizon=7"), ZeroThrust(), 1, metrics=made)
    found = {name.removeprefix("clock"): values[0] for name, values in flown.metrics.items()}
    assert found == {"sum": 120.0, "max": 60.0, "min": 20.0, "last": 60.0, "mean": 40.0}


def test_what_a_metric_may_not_return_is_reported(forgetful):
    class Endless(Metric):
        """Infinity."""

        reduce: ClassVar = "sum"

        def __call__(self, step):
            """Return infinity, shape (R,)."""
            return np.full(step.after.num_rows, np.inf)

    class Wide(TeamMetric):
        """Too much."""

        reduce: ClassVar = "sum"

        def __call__(self, step):
            """Return two numbers of each row, shape (N, 2)."""
            return np.zeros((step.after.num_envs, 2))

    spec = spec_of(TASKS[0], "horizon=3")
    with pytest.raises(PluginValueError, match="Endless gave infinity; give NaN"):
        rollout(spec, ZeroThrust(), 2, metrics=[Endless()])
    with pytest.raises(PluginValueError, match=r"Wide gave the shape \(2, 2\); expected \(2,\)"):
        rollout(spec, ZeroThrust(), 2, metrics=[Wide()])


def test_metrics_that_do_not_fit_the_task_are_reported():
    spec = spec_of(TASKS[0])
    with pytest.raises(SafeInspectError, match="no entity is named 'cheif'; did you mean `chief`"):
        rollout(spec, ZeroThrust(), 1, metrics=[SmallestRange(entity_name="cheif")])
    with pytest.raises(SafeInspectError, match="two metrics have the label 'thrusting steps'"):
        rollout(spec, ZeroThrust(), 1, metrics=[ThrustingSteps(), ThrustingSteps()])


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("ThrustingStep", "did you mean `ThrustingSteps`"),
        ("ObservedPointsReward", "is a reward; expected a metric here"),
        ("nowhere.Metric", "no module 'nowhere'"),
        (
            "{functor: TimeToCoverage, config: {fraction: 2}}",
            "config.fraction: expected a number of 1 or less, got 2",
        ),
        ("{functor: TimeToCoverage", "not valid YAML"),
        ("{functor: TimeToCoverage, config: {fractoin: 1}}", "did you mean `fraction`"),
    ],
)
def test_metrics_are_read_by_name_and_mistakes_reported(text, shown):
    good = read_metrics(
        ["Decisions", "safe_inspect.metrics.Decisions", "{functor: TimeToCoverage, config: {fraction: 0.5}}"]
    )
    assert good == [Decisions(), Decisions(), TimeToCoverage(fraction=0.5)]
    with pytest.raises(SafeInspectError) as error:
        read_metrics([text])
    assert shown in str(error.value)
