"""The running simulation of N environments, and `Simulator`, its configuration by dynamics and components.

Rows are reset separately, all environments step together.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field, field_validator

from safe_inspect.dynamics.base import Dynamics, advance_kernel
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.plugins.functor import functor_field, functors_field
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.random.streams import Streams
from safe_inspect.simulators.component import Component, RunningComponent, require_different
from safe_inspect.simulators.offers import Offers
from safe_inspect.simulators.prefetch import MIN_PREFETCH, InitialStatePrefetcher
from safe_inspect.simulators.resets.plan import ResetPlan
from safe_inspect.simulators.state import State, base_specs
from safe_inspect.simulators.team import TEAM, TEAM_FILTER
from safe_inspect.simulators.view import (
    DECISION,
    REMAINING,
    SAFETY_FILTER,
    SCRIPTED_POLICY,
    DeclaresMemory,
    Group,
    View,
)
from safe_inspect.simulators.world import World
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray, IntArray


class Paused(NamedTuple):
    """Environments that are waiting.

    Attributes:
        rows: Their indices, shape (R,).
        state: Their states.
        running: Mask of those whose episode is running, shape (R,).
    """

    rows: IntArray
    state: State
    running: BoolArray


class Simulation:
    """N environments with D deputies: the dynamics define the motion, and the components define the task. SI units.

    Args:
        dynamics: Dynamics of the bodies.
        components: Components of the task, in the order in which they are called after a step.
        masses: Mass of each deputy [kg], by platform, in agent order.
        groups: Groups of agents.
        reset: Plan of the initial states.
        step_size: Length of a step [s].
        decimation: Number of physics steps in a step.
        num_envs: Number of environments, N.
        seed: Seed of the run.
        first_slot: Global index of the first environment slot.
        team_filter: Safety filter of all deputies together, which may declare memory, if there is one.

    Attributes:
        world: The constant data of the simulation.
        components: The running components, by name.
        before: State at the start of the last step.
        state: The current state.
        views: The current state as seen by each group of agents.
        episodes: Index of the current episode of each slot, shape (N,).
        turns_thrust: Whether the thrust is given in body axes.
        reset_info: Statistics of the draws of the current episodes' initial states, each of shape (N,).
        running: Mask of the environments whose episode is running, shape (N,); see `end`.
        flown: The control that was applied in the last step, which may differ from the commanded one, shape (N, D, C).
        trace: The arrays of the bodies after each physics step of the last step, shape (N, B, decimation, ...), by
            name; empty unless the dynamics are traced.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        components: Sequence[Component],
        *,
        masses: Mapping[str, float],
        groups: Sequence[Group],
        reset: ResetPlan,
        step_size: float,
        decimation: int = 1,
        num_envs: int,
        seed: int,
        first_slot: int,
        team_filter: DeclaresMemory | None = None,
    ) -> None:
        self._reset_plan = reset
        self._groups = tuple(groups)
        self._team_filter = team_filter
        self._seed = seed
        self._slots = first_slot + np.arange(num_envs, dtype=np.int64)
        self.episodes = np.full(num_envs, -1, dtype=np.int64)
        bodies = {name: index for index, name in enumerate((*masses, *reset.entities))}
        offers = Offers(world=dict(dynamics.offers()))
        self.world = World(tuple(masses), bodies, np.array(list(masses.values()), dtype=np.float64), step_size, offers)
        self.components: dict[str, RunningComponent] = {}
        for component in components:
            running = self.components[component.registered_name] = component(self.world, num_envs)
            offers.add(running)
        require_different(components)
        self._actuating = [one for one in self.components.values() if type(one).actuate is not RunningComponent.actuate]
        physics_step = step_size / decimation
        self._of_body, self._shared = tuple(dynamics.arrays), tuple(dynamics.shared)
        self._dynamics, self.turns_thrust = dynamics, dynamics.turns_thrust
        self._advance = advance_kernel(dynamics, physics_step, traced=dynamics.traced)
        self._parameters = dynamics(physics_step)
        shape = (num_envs, len(bodies), decimation)
        self.trace: Mapping[str, FloatArray] = {
            name: np.zeros((*shape, *spec.shape)) for name, spec in dynamics.arrays.items() if dynamics.traced
        }
        self._physics = (physics_step, decimation)
        self._remembering = [
            [(name, sensor) for name, sensor in group.sensors.items() if sensor.memory(self.world)]
            for group in self._groups
        ]
        self._specs = self._declare(dynamics)
        self.state = State(num_envs, self._specs)
        self.before = State(num_envs, self._specs, self.state)
        self._prefetcher = InitialStatePrefetcher(num_envs, self._specs, self._draw_initial_states)
        self.reset_info: dict[str, IntArray] = {}
        self.running = np.zeros(num_envs, dtype=np.bool_)
        self._whole_rows = np.arange(num_envs)
        self.flown = self.state["control"]
        self.views = self._views(self.state)

    @property
    def num_envs(self) -> int:
        """Number of environments, N."""
        return len(self._slots)

    @property
    def attitude(self) -> tuple[str, ...]:
        """Names of the arrays of a body other than its position and velocity, such as ``orientation``."""
        return self._of_body[2:]

    @property
    def drawn(self) -> tuple[str, ...]:
        """Names of the arrays that a reset draws."""
        own = (item.name for item in self._reset_plan.environment)
        return (*self._of_body, *(name for name in own if name in self._specs))

    def seed(self, seed: int) -> None:
        """Restart with another seed: the next reset starts the first episode of every slot."""
        self._seed = seed
        self.episodes[:] = -1
        self._prefetcher.forget()
        for component in self.components.values():
            component.restart()

    def state_dict(self) -> dict[str, dict[str, AnyArray]]:
        """Return the data that persist across resets, for a checkpoint, by component."""
        kept = {name: component.state_dict() for name, component in self.components.items()}
        return {name: arrays for name, arrays in kept.items() if arrays}

    def load_state_dict(self, state: Mapping[str, Mapping[str, AnyArray]]) -> None:
        """Restore the data that `state_dict` returned; call it before a reset."""
        for name, arrays in state.items():
            self.components[name].load_state_dict(arrays)

    def reset(self, rows: IntArray) -> State:
        """Start a new episode in some rows.

        Args:
            rows: Indices of the environments, shape (R,).

        Returns:
            The initial state of these rows alone, R environments.
        """
        if len(rows) == self.num_envs and (self.num_envs > MIN_PREFETCH or self.episodes.min() < 0):
            self.episodes[rows] += 1
            fresh, info = self._draw_initial_states(rows, self.episodes[rows])
            self._prefetcher.forget()
        else:
            fresh, info = self._prefetcher.take(rows, self.episodes)
        for component in self.components.values():
            component.resume(fresh, rows)
        self.state.put(rows, fresh)
        for name, array in info.items():
            self.reset_info.setdefault(name, np.zeros(self.num_envs, dtype=np.int64))[rows] = array
        self.running[rows] = True
        self.views = self._views(self.state)  # values cached in the old views are out of date
        return fresh

    def initial_figures(self) -> dict[str, FloatArray]:
        """Return the figures of the environments that the dynamics define, for episodes that have just started."""
        return dict(self._dynamics.initial_figures({name: self.state[name] for name in self._shared}))

    def _draw_initial_states(self, rows: IntArray, episodes: IntArray) -> tuple[State, dict[str, AnyArray]]:
        """Return an initial state for each of the given rows, and the statistics of its draw."""
        streams = Streams(self._seed, self._slots[rows], episodes)
        fresh = State(len(rows), self._specs)
        states, values = self._reset_plan.draw(streams)
        still = self._dynamics.initial()
        for name, index in self.world.bodies.items():
            for array in self._of_body:
                given = states[name] if array in states[name] else still
                if array in given:
                    fresh[array][:, index] = given[array]
        for array, initial in self._dynamics.reset_shared(values, len(rows)).items():
            fresh[array][:] = initial
        fresh.key[:] = streams.bits("step")[:, 0]
        for component in self.components.values():
            component.reset(fresh, values)
        self._remember(fresh)
        drawn = [value for value in values.values() if isinstance(value, dict)]
        statistics = {name: array for named in drawn for name, array in named.items() if "/" in name}
        return fresh, statistics

    def step(self, control: FloatArray) -> None:
        """Hold a control for one step.

        Args:
            control: Control of each deputy, in the unit of the dynamics, shape (N, D, C).
        """
        self.before, self.state = self.state, self.before
        after = self.state
        after.copy_from(self.before)
        flown = control
        for component in self._actuating:
            flown = component.actuate(self.before, flown)
        state, counters = after.bound.get("advance") or self._bind(after)
        self._advance(*state, flown, *counters)
        after.control[...] = control
        self.flown = flown
        for component in self.components.values():
            component.step(after, self.running)
        self.views = self._remember(after)

    def _bind(self, state: State) -> tuple[Any, tuple[Any, ...]]:
        """Return the arguments of the kernel that advances a state, before and after the control."""
        arrays = [state.arrays[name] for name in (*self._shared, *self._of_body)]
        counters = (self.world.masses, *self._physics, state.delta_v, state.time, state.step)
        found = state.bound["advance"] = (*self._parameters, *arrays, *self.trace.values()), counters
        return found

    def end(self, ended: BoolArray) -> None:
        """End the episodes of a mask of environments, shape (N,), and notify the components.

        An environment that has ended may still be stepped until it is reset; these steps have no effect on the results.
        """
        rows = np.flatnonzero(ended & self.running)
        self.running[rows] = False
        if len(rows):
            for component in self.components.values():
                component.end(self.state, rows)

    def pause(self, rows: IntArray) -> Paused:
        """Let some environments, shape (R,), wait: steps until `unpause` have no effect on them."""
        paused = Paused(rows, self.state.take(rows), self.running[rows].copy())
        self.running[rows] = False
        return paused

    def unpause(self, paused: Paused) -> None:
        """Continue in environments that have waited."""
        self.state.put(paused.rows, paused.state)
        self.running[paused.rows] = paused.running
        self.views = self._views(self.state)

    @property
    def divisible(self) -> bool:
        """Whether some environments can be stepped separately: each component with persistent data overrides `part`."""
        kept = self.state_dict()
        components = self.components.items()
        return all(name not in kept or type(one).part is not RunningComponent.part for name, one in components)

    def part(self, size: int) -> Simulation:
        """Return a simulation of fewer environments, for some of these; see `enter`. It cannot be reset."""
        part = copy(self)
        part._slots, part.episodes = self._slots[:size], self.episodes[:size]
        part._whole_rows = np.arange(size)
        part.state = State(size, self._specs)
        part.before = State(size, self._specs, part.state)
        part.state.whole_rows = part.before.whole_rows = part._whole_rows
        part.running = np.zeros(size, dtype=np.bool_)
        return part

    def enter(self, whole: Simulation, paused: Paused, rows: IntArray) -> None:
        """Continue some waiting environments of a whole simulation in this part of it.

        Args:
            whole: The whole simulation.
            paused: The environments, one for each row of this simulation.
            rows: Their indices in the whole, shape (R,).
        """
        self.components = {name: component.part(rows) for name, component in whole.components.items()}
        self._actuating = [one for one in self.components.values() if type(one).actuate is not RunningComponent.actuate]
        self.unpause(paused._replace(rows=np.arange(len(rows))))
        self._whole_rows[...] = rows

    def leave(self, whole: Simulation, rows: IntArray) -> None:
        """Copy the components' persistent data of the environments in the first rows of this part back to the whole."""
        for name, component in whole.components.items():
            component.join(self.components[name], rows)

    def _views(self, state: State) -> tuple[View, ...]:
        return tuple([View(state, self.world, group) for group in self._groups])

    def _remember(self, state: State) -> tuple[View, ...]:
        """Let the sensors update their memory; return the views of the state."""
        views = self._views(state)
        for view, remembering in zip(views, self._remembering, strict=True):
            for name, sensor in remembering:
                view.remembering = name
                sensor.remember(view, name)
            view.remembering = None
        return views

    def _declare(self, dynamics: Dynamics) -> dict[str, ArraySpec]:
        world = self.world
        specs = base_specs(len(world.bodies), world.num_deputies, dynamics.control_size, dynamics.arrays)
        specs |= dynamics.shared
        for component in self.components.values():
            specs |= component.arrays
        for group in self._groups:
            single = {SAFETY_FILTER: group.safety_filter, SCRIPTED_POLICY: group.scripted_policy}
            parts: Mapping[str, DeclaresMemory | None] = {**group.sensors, **group.dones, **single}
            declared = {name: part.memory(world) for name, part in parts.items() if part is not None}
            if group.decides:
                declared[DECISION] = {REMAINING: ArraySpec((), np.int64)}
            for name, arrays in declared.items():
                for array, spec in arrays.items():
                    specs[f"memory/{group.name}/{name}/{array}"] = ArraySpec(
                        (group.size, *spec.shape), spec.dtype, spec.fill
                    )
        for array, spec in (self._team_filter.memory(world) if self._team_filter is not None else {}).items():
            specs[f"memory/{TEAM}/{TEAM_FILTER}/{array}"] = ArraySpec((1, *spec.shape), spec.dtype, spec.fill)
        return specs


class Simulator(Plugin):
    """Composition of dynamics and the components of a task; `Simulation` runs it.

    Attributes:
        decimation: Number of physics steps in a step of the agents.
        disturbance: A component, or a list of components, that disturb the motion, the thrust or the estimated states,
            such as `BoundedDisturbance` and `ThrusterModel`; they are called before those of the task, in this order.
            None: the motion is exactly that of the dynamics.
    """

    kind: ClassVar[str] = "simulator"

    decimation: int = Field(default=1, ge=1)
    disturbance: functors_field("component") = ()  # type: ignore[valid-type]

    @field_validator("disturbance")
    @classmethod
    def _different(cls, components: tuple[Component, ...]) -> tuple[Component, ...]:
        require_different(components)
        return components

    @abstractmethod
    def compose(self) -> tuple[Dynamics, Sequence[Component]]:
        """Return the dynamics, and the task's components in the order in which they are called after a step."""

    def with_attitude(self) -> Simulator:
        """Return the simulator for platforms that turn.

        Raises:
            ValueError: There is no such simulator.
        """
        raise ValueError(f"{self.registered_name} simulates point masses; platforms that turn need another simulator")

    @property
    def attitude_field(self) -> str:
        """Name of a field that is set but only has a meaning for platforms that turn; empty if there is none."""
        return ""

    @property
    def turns(self) -> bool:
        """Whether the deputies have an attitude."""
        return "orientation" in self.compose()[0].arrays

    def __call__(self) -> tuple[Dynamics, tuple[Component, ...]]:
        """Return the dynamics, and all components in the order in which they are called after a step."""
        dynamics, components = self.compose()
        return dynamics, (*self.disturbance, *components)


class ComposedSimulator(Simulator):
    """Simulator with dynamics and components that the configuration selects.

    Attributes:
        dynamics: Dynamics of the bodies.
        components: Components of the task, in the order in which they are called after a step.
    """

    dynamics: functor_field("dynamics") = ClohessyWiltshire()  # type: ignore[valid-type]
    components: tuple[functor_field("component"), ...] = ()  # type: ignore[valid-type]

    def compose(self) -> tuple[Dynamics, Sequence[Component]]:
        """Return the dynamics and the components."""
        return self.dynamics, self.components
