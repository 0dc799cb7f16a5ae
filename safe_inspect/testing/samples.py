"""The sample world: steps of the shipped task under rough handling, to call a plugin with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.core import BatchedEnvironment
from safe_inspect.environments.registration import load_spec
from safe_inspect.platforms.base import Part, Sensor
from safe_inspect.platforms.controllers import RateController
from safe_inspect.platforms.entity_sensors import EntityPositionSensor, EntityVelocitySensor
from safe_inspect.plugin import Plugin
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import Step, View
from safe_inspect.tasks import TASKS
from safe_inspect.types import AnyArray, BoolArray, FloatArray

#: Environments and steps of a flight.
ENVIRONMENTS, LENGTH = 32, 40
#: A flight begins a new episode after this many steps, so that all phases of an episode occur.
HORIZON = 24


def sample_spec(plugin: Plugin | None = None, *, parts: Sequence[Part] = ()) -> EnvironmentSpec:
    """Return the environment of the sample world: the shipped task with one deputy and further parts.

    Every shipped part stands in it under its default name too, so that plugins build from their defaults find it.

    Args:
        plugin: The plugin under test; a part is added to the deputy.
        parts: Further parts, for a plugin that names them.
    """
    spec = load_spec(next(iter(TASKS)))
    agent = spec.agents[0]
    own = (plugin,) if isinstance(plugin, Part) else ()
    further = (RateController(), EntityPositionSensor(), EntityVelocitySensor(), *parts, *own)
    named = {**agent.parts, **{part.part_name: part for part in further}}
    return replace(spec, agents=(replace(agent, parts=named),))


def sample_steps(
    plugin: Plugin | None = None, rows: int = 64, seed: int = 0, *, parts: Sequence[Part] = ()
) -> Step:  # fmt: skip
    """Return steps of many episodes as one `Step`: each row is one step of one environment.

    Deputies fly at random, at the chief and away from it. Among the rows are first steps, ends of every kind (crash,
    out of range, all points inspected), lit and dark points, and interventions of a safety filter.

    Args:
        plugin: The plugin under test; a sensor is read, and remembers, in these steps.
        rows: Number of rows, R.
        seed: Seed of the flight and of the choice of rows.
        parts: Further parts of the deputy, for a plugin that names them.
    """
    if rows < 1:
        raise ValueError(f"a sample has at least 1 row, not {rows}")
    if isinstance(plugin, Sensor) or parts:
        flown = fly(BatchedEnvironment(sample_spec(plugin, parts=parts), ENVIRONMENTS, seed=seed))
    else:
        flown = _shipped_flight(seed)
    generator = np.random.default_rng(seed)
    ended = np.concatenate([done for _, done in flown])
    first = np.concatenate([step.first for step, _ in flown])
    chosen = np.concatenate(
        [
            generator.permutation(np.flatnonzero(kind))[: -(-rows // 4)]
            for kind in (ended, first & ~ended, np.ones(len(ended), dtype=np.bool_))
        ]
    )
    others = np.setdiff1d(generator.permutation(len(ended)), chosen)
    chosen = np.resize(np.concatenate((chosen, generator.permutation(others))), rows)
    return _gather([step for step, _ in flown], generator.permutation(chosen), seed)


def take_rows(step: Step, rows: AnyArray) -> Step:
    """Return some rows of a step as a step of its own: copies of the states, with nothing computed yet.

    Args:
        step: A step of agents that are alone in their environment, so that a row is an environment.
        rows: Indices of the rows, shape (R,).
    """
    world, group = step.after.world, step.after.group
    before, after = (View(view.state.take(rows), world, group) for view in (step.before, step.after))
    action, control, desired = (step.action[rows], step.control[rows], step.desired_control[rows])
    return Step(before, after, action.copy(), control.copy(), desired.copy(), step.intervening[rows].copy(), step.dt)


def fly(environment: BatchedEnvironment, first_slot: int = 0, length: int = LENGTH) -> list[tuple[Step, BoolArray]]:
    """Fly rough episodes, and return each step with the rows that ended in it.

    What an environment does depends on its slot and its own state alone, not on those beside it.

    Args:
        environment: The environments, freshly made.
        first_slot: Index of their first slot.
        length: Number of steps.
    """
    simulation = environment.simulation
    environment.reset()
    flown = []
    everything = np.arange(environment.num_envs)
    slots = first_slot + everything
    for time in range(length):
        _finish_inspection(simulation.state, (slots % 8 == 7) & (simulation.state.step == 2))
        action = _rough_action(environment, slots, time)
        transition = environment.step(action)
        done = transition.done[:, 0] | (simulation.state.step >= HORIZON)
        flown.append((take_rows(transition.step, everything), done))
        if done.any():
            environment.reset(np.flatnonzero(done))
    return flown


def _rough_action(environment: BatchedEnvironment, slots: AnyArray, time: int) -> FloatArray:
    """Return actions, shape (N, 1, A): noise and, by slot, a push towards the chief, none, or one away from it."""
    size = environment.action_layout.size
    noise = np.stack([np.random.default_rng((int(slot), time)).normal(0.0, 0.4, size) for slot in slots])
    position = environment.view().position
    push = (slots % 3 - 1.0)[:, None] * position / environment.view().range_to(None)[:, None]
    noise[:, :3] += push[:, :size]
    return noise[:, None, :]


def _finish_inspection(state: State, rows: BoolArray) -> None:
    """Mark every point as inspected by the first deputy, so that successes occur."""
    for points in state.points.values():
        points.inspector[rows] = 0
        points.team_count[rows] = points.inspector.shape[1]
        points.own_count[rows, 0] = points.inspector.shape[1]


def _gather(steps: Sequence[Step], chosen: AnyArray, seed: int) -> Step:
    """Return the chosen rows of all steps, numbered on from step to step, as one step."""
    size, model = len(steps[0].action), steps[0].after
    rows = len(chosen)
    before, after = State(rows, model.state.specs), State(rows, model.state.specs)
    action, control = np.zeros((rows, steps[0].action.shape[1])), np.zeros((rows, 3))
    for number in np.unique(chosen // size):
        step, here = steps[number], np.flatnonzero(chosen // size == number)
        there = chosen[here] % size
        before.put(here, step.before.state.take(there))
        after.put(here, step.after.state.take(there))
        action[here], control[here] = step.action[there], step.control[there]
    generator = np.random.default_rng((seed, 1))
    intervening = generator.random(rows) < 0.25
    desired = control + np.where(intervening, generator.uniform(-0.5, 0.5, rows), 0.0)[:, None]
    first, last = (View(state, model.world, model.group) for state in (before, after))
    return Step(first, last, action, control, desired, intervening, steps[0].dt)


@lru_cache(maxsize=4)
def _shipped_flight(seed: int) -> list[tuple[Step, BoolArray]]:
    return fly(BatchedEnvironment(sample_spec(), ENVIRONMENTS, seed=seed))
