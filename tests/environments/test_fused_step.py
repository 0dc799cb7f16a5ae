"""The fused step is bit-identical to the plugins themselves: every number, every name, every memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones import DoneFunction, DoneStatus
from safe_inspect.environments import TeamEnvironment
from safe_inspect.environments.layout import Layout
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.platforms import Sensor
from safe_inspect.plugins.registry import registry
from safe_inspect.rewards import Reward
from safe_inspect.types import FloatArray

SINGLE = configs_root() / "translational-inspection" / "experiment-seed.yml"
TEAM = configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml"
#: A delta-v scale that moves, and short episodes, so that every kind of end is met.
LIVELY = (
    "env_config.simulator.config.steps_until_update=60",
    "env_config.simulator.config.delta_v_scale_step=-0.01",
    "env_config.simulator.config.inspected_points_update_bounds=[0.2, 0.3]",
    "horizon=120",
)
AGENT = "agent_config.0.config.config"
TASKS = {
    "one deputy": (SINGLE, LIVELY),
    "one deputy that chooses levels": (SINGLE.with_name("experiment.yml"), LIVELY),
    "what lies ahead": (SINGLE.with_name("experiment-outlook.yml"), LIVELY),
    "its own filter": (SINGLE, (*LIVELY, f"{AGENT}.glues.0.config.enabled=True")),
    "linear normaliser, other units": (
        SINGLE,
        (
            *LIVELY,
            f"{AGENT}.glues.1.config.output_units=km",
            f"{AGENT}.glues.5.config.output_units=degrees",
            f"{AGENT}.glues.5.config.normalization={{enabled: True}}",
        ),
    ),
    "weights": (
        SINGLE,
        (*LIVELY, f"{AGENT}.dones.2.config={{weight_threshold: 0.4}}"),
    ),
    "one constant price": (SINGLE, (*LIVELY, f"{AGENT}.rewards.3.config={{mode: constant, scale: -0.3}}")),
    "three deputies": (TEAM, (*LIVELY, "blue#_ctrl.count=3")),
    "see others": (TEAM.with_name("experiment-see-others.yml"), (*LIVELY, "blue#_ctrl.count=4")),
    "mixed": (TEAM.with_name("experiment-mixed.yml"), LIVELY),
    "the team's filter": (TEAM, (*LIVELY, "blue#_ctrl.count=2", "env_config.rta.config.enabled=True")),
}


def told(transition: TeamTransition) -> dict[str, np.ndarray]:
    """Return every array of a step by name."""
    found = {"over": transition.over, "outcome": transition.outcome}
    for index, group in enumerate(transition.groups):
        for name in ("observation", "reward", "active", "terminated", "truncated", "status"):
            found[f"{index}/{name}"] = getattr(group, name)
        for name in ("action", "control", "desired_control", "intervening", "total_thrust", "first"):
            found[f"{index}/step/{name}"] = getattr(group.step, name)
        found |= {f"{index}/terms/{name}": value for name, value in group.terms.items()}
    return found


def some_action(generator: np.random.Generator, strength: FloatArray, agents: int, layout: Layout) -> FloatArray:
    """Return thrusts as strong as their row, some out of bounds, or levels other than the middle one as often."""
    thrust = generator.uniform(-1.2, 1.2, (len(strength), agents, layout.size))
    if not layout.choices:
        return strength * thrust
    levels = (layout.low + layout.high) / 2.0 + (generator.random(thrust.shape) < strength) * 1.5 * thrust
    return np.clip(np.rint(levels), layout.low, layout.high)


def fly_both(spec: EnvironmentSpec, num_envs: int, steps: int) -> tuple[set[int], int]:
    """Step both ways and compare; return the statuses that were met and the number of resets."""
    fused, plain = (TeamEnvironment(spec, num_envs, seed=7, _fused=fused) for fused in (True, False))
    generator = np.random.default_rng(3)
    strength = generator.choice([0.02, 0.2, 1.0], size=(num_envs, 1, 1))
    for one, other in zip(fused.reset(), plain.reset(), strict=True):
        assert one.dtype == other.dtype == np.float32
        assert one.tobytes() == other.tobytes()
    met, resets = set(), 0
    for _ in range(steps):
        actions = [some_action(generator, strength, group.size, group.action_layout) for group in fused.acting]
        first, second = fused.step(actions), plain.step(actions)
        one, other = told(first), told(second)
        assert one.keys() == other.keys()
        for name, array in one.items():
            assert array.dtype == other[name].dtype, name
            assert array.shape == other[name].shape, name
            assert array.tobytes() == other[name].tobytes(), name
        for name, array in fused.state.arrays.items():
            assert array.tobytes() == plain.state.arrays[name].tobytes(), name
        for group in first.groups:
            met |= set(np.unique(group.status).tolist())
        rows = np.flatnonzero(first.over)
        if len(rows):
            resets += len(rows)
            for one, other in zip(fused.reset(rows), plain.reset(rows), strict=True):
                assert one.tobytes() == other.tobytes()
    return met, resets


@pytest.mark.parametrize("num_envs", [1, 5, 64])
@pytest.mark.parametrize("task", TASKS)
def test_every_number_is_the_same(task, num_envs):
    spec = load_experiment(*TASKS[task]).spec
    met, resets = fly_both(spec, num_envs, 300 if num_envs < 64 else 130)
    assert resets > 0
    assert num_envs < 64 or "filter" in task or len(met) > 2


@pytest.mark.usefixtures("registered")
def test_plugins_without_a_translation_are_called_among_the_others():
    class NoisyReward(Reward):
        """A number that does not add up without rounding, in the middle of the terms."""

        def __call__(self, step):
            """Return a third of the distance."""
            return step.after.range_to(None) / 3.0

    class EastDone(DoneFunction):
        """Ends on one side."""

        status = DoneStatus.LOSE

        def __call__(self, step):
            """Return the rows on that side."""
            return step.after.position[:, 1] > 60.0

    class SpeedSensor(Sensor):
        """The own speed."""

        elements = ("speed",)

        def __call__(self, view):
            """Return the speed."""
            return np.sqrt((view.velocity**2).sum(axis=1, keepdims=True))

    mixed = (
        *LIVELY,
        f"{AGENT}.parts.6={{part: SpeedSensor}}",
        f"{AGENT}.glues.3={{functor: ObserveSensor, config: {{sensor: SpeedSensor}}}}",
        f"{AGENT}.rewards.1={{name: mine, functor: NoisyReward}}",
        f"{AGENT}.dones.1={{functor: EastDone}}",
    )
    met, resets = fly_both(load_experiment(SINGLE, mixed).spec, 16, 200)
    assert resets > 0
    assert DoneStatus.LOSE in met


@pytest.fixture
def registered() -> Iterator[None]:
    """Forget the plugins that the test defines."""
    before = {kind: dict(registry.items(kind)) for kind in registry.kinds()}
    yield
    for kind, classes in before.items():
        registry._classes[kind] = classes
