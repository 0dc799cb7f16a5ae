"""What plugins are given cannot be written: a plugin that tries to is named, and the deputies stay where they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from safe_inspect.config.experiment import load_experiment
from safe_inspect.dones import DoneFunction, DoneStatus, SharedDoneFunction
from safe_inspect.environments import TeamEnvironment, load_spec, make
from safe_inspect.errors import PluginValueError
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.glues import ObservationGlue
from safe_inspect.metrics.base import Metric
from safe_inspect.platforms import Sensor
from safe_inspect.plugins.functor import Named
from safe_inspect.plugins.registry import registry
from safe_inspect.policies.base import SCRIPTED_POLICY, ScriptedPolicy
from safe_inspect.policies.open_loop import ZeroThrust
from safe_inspect.rewards import Reward
from safe_inspect.rta.constraints import Constraint, ConstraintValues
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.task_ids import TEAM_TASKS

TEAM = next(iter(TEAM_TASKS))
AGENT = "agent_config.0.config.config"


@pytest.fixture(autouse=True)
def registered() -> Iterator[None]:
    """Forget the plugins that a test defines."""
    before = {kind: dict(registry.items(kind)) for kind in registry.kinds()}
    yield
    for kind, classes in before.items():
        registry._classes[kind] = classes


def public(thing: Any) -> dict[str, Any]:
    """Return the values of the public attributes and properties of an object."""
    names = [name for name in dir(thing) if not name.startswith("_")]
    return {name: getattr(thing, name) for name in names if not name.startswith("writable")}


@pytest.mark.parametrize(("deputies", "num_envs"), [(1, 1), (1, 4), (3, 1), (3, 4)])
def test_no_array_that_plugins_are_given_can_be_written(deputies, num_envs):
    spec = load_spec(TEAM, [f"blue#_ctrl.count={deputies}"])
    environment = TeamEnvironment(spec, num_envs, seed=1)
    environment.reset()
    step = environment.step([np.full((num_envs, deputies, 3), 0.5)]).groups[0].step
    team = environment.team()
    kept = [environment.state, environment.simulation.before]
    memory = [array for state in kept for array in (state._block, *state.constants.values())]
    seen = 0
    for name in step.after.group.sensors:
        step.after.reading(name)
    given: dict[str, Any] = {"range": step.after.range_to(None), **step.after.readings}
    for thing in (step, step.before, step.after, step.after.points("chief"), team, team.state, step.after.state):
        given |= {f"{type(thing).__name__}.{name}": value for name, value in public(thing).items()}
    offers = step.after.world.offers
    given |= {f"View.{name}": getattr(step.after, name) for name in offers.view}
    given |= {f"TeamView.{name}": getattr(team, name) for name in offers.team}
    given |= {str(key): array for key, array in team.state.memory.items()}
    given |= dict(vars(step.after.state.points["chief"]))
    given |= {f"state {name}": array for name, array in step.after.state.arrays.items()}
    given |= {name: step.after.memory("Sensor_UninspectedPoints", name) for name in ("centres", "count")}
    given |= {body: step.after.entity_position(body) for body in step.after.world.bodies}
    for name, array in given.items():
        if isinstance(array, np.ndarray):
            shared = any(np.shares_memory(array, block) for block in memory)
            assert not (shared and array.flags.writeable), name
            seen += shared
    assert seen > 40
    for name in ("action", "control", "desired_control", "intervening", "first", "total_thrust"):
        assert not getattr(step, name).flags.writeable, name
    for name in ("own_index", "others_position", "others_velocity"):
        assert not getattr(step.after, name).flags.writeable, name


#: What a plugin writes into, called with a view.
WRITES: dict[str, Callable[[Any], Any]] = {
    "position": lambda view: view.position.__setitem__(slice(None), 0.0),
    "state": lambda view: view.state.velocity.__setitem__(slice(None), 0.0),
    "time": lambda view: np.add(view.time, 1.0, out=view.time),
    "points": lambda view: view.points("chief").count.fill(0),
    "reading": lambda view: view.reading("Sensor_Velocity").__setitem__(slice(None), 0.0),
    "another's memory": lambda view: view.memory("Sensor_UninspectedPoints", "count").fill(0),
    "mass": lambda view: view.mass.fill(1.0),
}


def spoiled(kind: str, write: Callable[[Any], Any]) -> list[str]:
    """Define a plugin that writes, and return the overrides that use it."""
    if kind == "reward":

        class SpoilingReward(Reward):
            """Writes."""

            def __call__(self, step):
                write(step.after)
                return np.zeros(step.after.num_rows)

        return [f"{AGENT}.rewards.1={{functor: SpoilingReward}}"]
    if kind == "done":

        class SpoilingDone(DoneFunction):
            """Writes."""

            status = DoneStatus.LOSE

            def __call__(self, step):
                write(step.before)
                return np.zeros(step.after.num_rows, dtype=bool)

        return [f"{AGENT}.dones.1={{functor: SpoilingDone}}"]
    if kind == "glue":

        class SpoilingGlue(ObservationGlue):
            """Writes."""

            def names(self, parts):
                return ("nothing",)

            def bounds(self, parts):
                return np.zeros(1), np.ones(1)

            def __call__(self, view):
                if (view.step > 0).any():
                    write(view)
                return np.zeros((view.num_rows, 1))

        return [f"{AGENT}.glues.5={{functor: SpoilingGlue}}"]

    class SpoilingSensor(Sensor):
        """Writes, when it is read or when it remembers."""

        elements = ("nothing",)
        when: str = "read"

        def memory(self, world):
            return {"own": ArraySpec(())}

        def remember(self, view, name):
            view.memory(name, "own")[:] = view.time  # its own memory is there to be written
            if self.when == "remember" and (view.step > 0).any():
                write(view)

        def __call__(self, view):
            if self.when == "read" and (view.step > 0).any():
                write(view)
            return view.memory(self.part_name, "own")[:, None]

    return [
        f"{AGENT}.parts.5={{part: SpoilingSensor, config: {{when: {kind}}}}}",
        f"{AGENT}.glues.5={{functor: ObserveSensor, config: {{sensor: SpoilingSensor}}}}",
    ]


@pytest.mark.parametrize("write", WRITES)
@pytest.mark.parametrize("kind", ["reward", "done", "glue", "read", "remember"])
def test_a_plugin_that_writes_is_named_and_changes_nothing(shipped, kind, write):
    overrides = spoiled(kind, WRITES[write])
    env, plain = make(shipped, overrides), make(shipped)
    env.reset(seed=3)
    plain.reset(seed=3)
    with pytest.raises(PluginValueError, match=r"Spoiling\w+ writes into an array that is read-only .*test_read_only"):
        env.step(np.full(3, 0.5))
    plain.step(np.full(3, 0.5))
    for name in ("position", "velocity", "time", "delta_v", "points/chief/team_count"):
        np.testing.assert_array_equal(env.core.state.arrays[name], plain.core.state.arrays[name])


def test_a_sensors_own_memory_is_written_in_remember(shipped):
    env = make(shipped, spoiled("never", lambda view: None))
    env.reset(seed=3)
    for step in range(1, 4):
        observation = env.step(np.zeros(3))[0]
        assert observation[-1] == 10.0 * step


def test_a_scripted_policy_writes_its_own_memory_alone():
    class CountingPolicy(ScriptedPolicy):
        """Counts its calls."""

        spoil: bool = False

        def memory(self, world):
            return {"calls": ArraySpec((), np.int64)}

        def __call__(self, view, limits):
            view.memory(SCRIPTED_POLICY, "calls")[:] += 1
            if self.spoil:
                limits.high[:] = 100.0
            return np.zeros((view.num_rows, 3))

    spec = load_spec(TEAM)
    for spoil in (False, True):
        agents = tuple(replace(agent, scripted_policy=CountingPolicy(spoil=spoil)) for agent in spec.agents)
        environment = TeamEnvironment(replace(spec, agents=agents), 2, seed=1)
        environment.reset()
        if spoil:
            with pytest.raises(PluginValueError, match="the policy CountingPolicy writes"):
                environment.step(())
            continue
        for _ in range(3):
            environment.step(())
        calls = environment.view().memory(SCRIPTED_POLICY, "calls")
        assert calls.tolist() == [3] * 6
        with pytest.raises(ValueError, match="read-only"):
            calls[:] = 0


def test_a_shared_done_function_and_a_metric_are_named():
    class SpoilingShared(SharedDoneFunction):
        """Lets everyone win."""

        def __call__(self, step):
            step.status[:] = DoneStatus.WIN
            return np.zeros(len(step.status), dtype=np.int8)

    class SpoilingMetric(Metric):
        """Stops the clock."""

        unit = "s"
        reduce = "last"

        def __call__(self, step):
            step.after.state.time[:] = 0.0
            return np.zeros(step.after.num_rows)

    spec = load_spec(TEAM)
    environment = TeamEnvironment(replace(spec, shared_dones=(Named("mine", SpoilingShared()),)), 2, seed=1)
    environment.reset()
    with pytest.raises(PluginValueError, match=r"the done SpoilingShared writes .*step.status\[:\]"):
        environment.step([np.zeros((2, 3, 3))])
    with pytest.raises(PluginValueError, match="the metric SpoilingMetric writes"):
        rollout(spec, {agent.policy: ZeroThrust() for agent in spec.agents}, 2, metrics=[SpoilingMetric()])


@pytest.mark.parametrize("num_envs", [1, 3])
def test_a_constraint_works_on_copies(shipped, num_envs):
    """Constraints hand their states to compiled kernels, so theirs are copies that they may spoil."""

    def speed_limit(state):
        """Return h = 100 m/s - v_z, which is met everywhere."""
        h = 100.0 - state.velocity[:, 2]
        return ConstraintValues(h, h, np.tile([0.0, 0.0, 0.0, 0.0, 0.0, -1.0], (len(h), 1)), np.zeros(len(h)))

    class HarmlessConstraint(Constraint):
        """The speed limit."""

        def evaluate(self, state):
            """Return h."""
            return speed_limit(state)

    class SpoilingConstraint(Constraint):
        """The same; puts the deputy at the origin."""

        def evaluate(self, state):
            """Return h, and write."""
            answer = speed_limit(state)
            state.position[:] = state.velocity[:] = 0.0
            return answer

    spec = load_experiment(shipped).spec
    agent = spec.agents[0]
    glue = agent.action_glues[0]
    flights = []
    for constraints in (("HarmlessConstraint",), ("SpoilingConstraint",)):
        chosen = type(glue)(enabled=True, method="continuous", constraints=constraints, wrapped=glue.wrapped)
        glues = tuple(chosen if one is glue else one for one in agent.glues)
        environment = TeamEnvironment(replace(spec, agents=(replace(agent, glues=glues),)), num_envs, seed=2)
        environment.reset()
        environment.step([np.full((num_envs, 1, 3), 0.2)])
        flights.append(environment.state.position.copy())
    np.testing.assert_array_equal(*flights)


def test_an_ordinary_value_error_stays_what_it_is(shipped):
    class BrokenReward(Reward):
        """Raises."""

        def __call__(self, step):
            raise ValueError("no such thing")

    env = make(shipped, [f"{AGENT}.rewards.1={{functor: BrokenReward}}"])
    env.reset(seed=0)
    with pytest.raises(ValueError, match="no such thing") as caught:
        env.step(np.zeros(3))
    assert not isinstance(caught.value, PluginValueError)
