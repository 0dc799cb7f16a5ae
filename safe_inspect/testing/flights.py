"""Flights with random and extreme actions: episodes of the sample world that provide steps to call plugins with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar, cast

import numpy as np

from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.geometry.distance import lengths
from safe_inspect.rta.constraints.base import RelativeState
from safe_inspect.simulators.state import State
from safe_inspect.simulators.team import TeamStep, TeamView
from safe_inspect.simulators.view import Step, View
from safe_inspect.types import AnyArray, BoolArray, FloatArray

#: Steps of a flight.
LENGTH = 40
#: A flight starts a new episode after this many steps, so that all phases of an episode occur.
HORIZON = 24
#: Speed change of a scripted deputy towards or away from the chief [m/s].
_SHOVE = 5.0
#: One in this many environments has two deputies at exactly the same position.
_TOGETHER = 16

Given = TypeVar("Given")


@dataclass(frozen=True, eq=False)
class Flown:
    """Step of a flight.

    Attributes:
        step: The step, of the first group of agents.
        status: `DoneStatus` of each agent after the step, int8, shape (N, D).
        over: Environments whose episode ended with the step, shape (N,).
    """

    step: Step
    status: AnyArray
    over: BoolArray


def fly(environment: TeamEnvironment, first_slot: int = 0, length: int = LENGTH) -> list[Flown]:
    """Run episodes with random and extreme actions, and return each step.

    An environment depends only on its slot and its state, not on the other environments.

    Args:
        environment: The environments, newly created.
        first_slot: Index of their first slot.
        length: Number of steps.
    """
    simulation = environment.simulation
    environment.reset()
    flown = []
    everything = np.arange(environment.num_envs)
    slots = first_slot + everything
    for time in range(length):
        state = simulation.state
        _finish_inspection(state, (slots % 8 == 7) & (state.step == 2))
        _crowd(state, slots, np.flatnonzero((slots % 4 == 1) & (state.step % 3 == 1)))
        if not environment.acting:
            _shove(state, slots, np.flatnonzero(state.step == 1))
        actions = (_rough_action(environment, slots, time),) if environment.acting else ()
        transition = environment.step(actions)
        over = transition.over | (simulation.state.step >= HORIZON)
        status = np.concatenate([group.status for group in transition.groups], axis=1)
        flown.append(Flown(take_rows(transition.groups[0].step, everything), status.copy(), over))
        if over.any():
            environment.reset(np.flatnonzero(over))
    return flown


def take_rows(given: Given, rows: AnyArray, agent: int | None = None) -> Given:
    """Return copies of the rows of some environments, with nothing computed yet; other objects stay as they are.

    Args:
        given: A step, view or array of N environments, or a mapping of them.
        rows: Indices of the environments, shape (M,); with one deputy they are the rows of the step.
        agent: Index of the agent that becomes a group of one; by default, all agents.
    """
    taken: Any = given
    if isinstance(given, np.ndarray | RelativeState):
        taken = given[rows]
    elif isinstance(given, Mapping):
        taken = {name: take_rows(value, rows, agent) for name, value in given.items()}
    elif isinstance(given, Step):
        size = given.after.group.size
        agents = np.arange(size) if agent is None else np.array([agent])
        own = (np.asarray(rows)[:, None] * size + agents).reshape(-1)
        before, after = (_take(view, rows, agent) for view in (given.before, given.after))
        action, control, desired = given.action[own], given.control[own], given.desired_control[own]
        taken = Step(before, after, action, control, desired, given.intervening[own], given.dt)
    elif isinstance(given, View):
        taken = _take(given, rows, agent)
    elif isinstance(given, TeamView):
        taken = TeamView(given.state.take(rows), given.world)
    elif isinstance(given, TeamStep):
        fields = {name: take_rows(value, rows) for name, value in vars(given).items() if name != "has"}
        taken = TeamStep(**fields, has={name: array.copy() for name, array in given.has.items()})
    return cast(Given, taken)


def _take(view: View, rows: AnyArray, agent: int | None) -> View:
    state, group = view.state.take(rows), view.group
    if agent is None:
        return View(state, view.world, group)
    mine = f"memory/{group.name}/"
    specs = {
        name: replace(spec, shape=(1, *spec.shape[1:])) if name.startswith(mine) else spec
        for name, spec in state.specs.items()
    }
    alone = State(len(rows), specs)
    for name, array in alone.arrays.items():
        array[...] = state[name][:, agent : agent + 1] if name.startswith(mine) else state[name]
    return View(alone, view.world, replace(group, first=group.first + agent, size=1))


def _rough_action(environment: TeamEnvironment, slots: AnyArray, time: int) -> FloatArray:
    """Return actions, shape (N, G, A): noise and, by slot and agent, a push towards the chief or away, or none."""
    group, state = environment.acting[0], environment.state
    shape = group.size, group.action_layout.size
    noise = np.stack([np.random.default_rng((int(slot), time)).normal(0.0, 0.4, shape) for slot in slots])
    agents = np.arange(group.first, group.first + group.size)
    noise[..., :3] += (_sense(slots, agents) * _outwards(state.position[:, agents]))[..., : shape[1]]
    noise[slots % _TOGETHER == 5, 1:2] = noise[slots % _TOGETHER == 5, :1]
    return noise


def _sense(slots: AnyArray, agents: AnyArray) -> FloatArray:
    return np.asarray((slots[:, None] + agents) % 3 - 1.0)[..., None]


def _outwards(position: FloatArray) -> FloatArray:
    return np.asarray(position / lengths(position)[..., None])


def _shove(state: State, slots: AnyArray, rows: AnyArray) -> None:
    """Change the velocity of scripted deputies towards the chief, not at all, or away from it."""
    agents = np.arange(state.control.shape[1])
    state.velocity[rows[:, None], agents] += (
        _SHOVE * _sense(slots[rows], agents) * _outwards(state.position[rows[:, None], agents])
    )


def _crowd(state: State, slots: AnyArray, rows: AnyArray) -> None:
    """Move the second deputy, if any, near the first, or to exactly the same position, where it stays."""
    if state.control.shape[1] < 2:
        return
    for row in rows:
        away = np.random.default_rng(int(slots[row])).normal(0.0, 6.0, 3)
        state.position[row, 1] = state.position[row, 0] + (0.0 if slots[row] % _TOGETHER == 5 else away)
        state.velocity[row, 1] = state.velocity[row, 0]


def _finish_inspection(state: State, rows: BoolArray) -> None:
    """Mark every point as inspected by the first deputy, so that successes occur."""
    for points in state.owned.get("points", {}).values():
        points.inspector[rows] = 0
        points.team_count[rows] = points.inspector.shape[1]
        points.own_count[rows] = 0
        points.own_count[rows, 0] = points.inspector.shape[1]
