"""Data that the functors of an agent receive: `View` of one state, `Step` from one state to the next.

Agents whose parts, glues, rewards and dones are the same form a group and are computed together. A view has one row for
each environment and agent of the group, R = N * G rows, ordered by environment, then by agent.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, cast

import numpy as np

from safe_inspect.random.splitmix import draw_normals
from safe_inspect.simulators.arrays import Array, read_only
from safe_inspect.simulators.offers import offered
from safe_inspect.simulators.state import State
from safe_inspect.simulators.world import World
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class FilterResult:
    """Result of a filter for R desired controls.

    Attributes:
        control: The admissible control [N], Hill frame, shape (R, 3).
        intervening: True where |control - desired| > 0.01 N, shape (R,).
        infeasible: True where the filter cannot guarantee safety, shape (R,): no control meets all conditions of the
            continuous filter, or, for the other filters, no backup plan is known.
        backup: True where the control comes from a backup, shape (R,).
        active: Bits of the constraints that rejected the desired control, bit j for the j-th name, shape (R,).
        phi: The constraints' plain safety quantities before the hold, in the order of the names, shape (R, C).
        names: The names of the C constraints.
        memory: New values of the arrays that the filter's glue has declared, each of shape (R, ...).
    """

    control: FloatArray
    intervening: BoolArray
    infeasible: BoolArray
    backup: BoolArray
    active: IntArray
    phi: FloatArray
    names: tuple[str, ...]
    memory: Mapping[str, AnyArray] = field(default_factory=dict)

    def active_names(self, row: int) -> tuple[str, ...]:
        """Return the names of the constraints that rejected the desired control of a row."""
        return tuple(name for j, name in enumerate(self.names) if self.active[row] >> j & 1)


class DeclaresMemory(Protocol):
    """A safety filter, a scripted policy or a done function, which may declare arrays that are part of the state."""

    def memory(self, world: World, /) -> Mapping[str, ArraySpec]:
        """Declare the arrays in which the part stores data, each with its shape for one agent or one environment."""


class ReadsState(DeclaresMemory, Protocol):
    """A sensor."""

    @property
    def symbol(self) -> str:
        """SI unit of the reading, empty for a pure number."""

    @property
    def size(self) -> int:
        """Number of elements of a reading."""

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest possible value of a reading, SI."""

    def __call__(self, view: Any, /) -> FloatArray:
        """Return the reading, SI, shape (R, size)."""

    def remember(self, view: Any, name: str, /) -> None:
        """Update the declared arrays in place; called once for every new state."""


#: The name of a group's safety filter in place of the name of a part, in the keys of declared memory.
SAFETY_FILTER = "safety filter"
#: The name of a group's scripted policy in place of the name of a part, in the keys of declared memory.
SCRIPTED_POLICY = "scripted policy"
#: The names of part and array, in the keys of declared memory, of the control steps that are left of decisions.
DECISION, REMAINING = "decision", "remaining"


@dataclass(frozen=True)
class Group:
    """Group of agents with equal terms: consecutive deputies.

    Attributes:
        name: Name of the group; the agent's name if there is one agent.
        first: Index of the first deputy.
        size: Number of deputies, G.
        sensors: Sensors by part name.
        safety_filter: Safety filter of the group's thrust, which may declare memory, if there is one.
        scripted_policy: The scripted policy that controls the deputies, if there is one.
        dones: Done functions that declare memory, by the name of their memory.
        decides: Whether an action may hold for several control steps; the state then contains the number of steps left.
    """

    name: str
    first: int
    size: int
    sensors: Mapping[str, ReadsState]
    safety_filter: DeclaresMemory | None = None
    scripted_policy: DeclaresMemory | None = None
    dones: Mapping[str, DeclaresMemory] = field(default_factory=dict)
    decides: bool = False


class View:
    """One state as seen by a group of agents; every array has R = N * G rows. SI units, Hill's frame.

    The arrays are read-only, except for the declared memory of the plugin that may currently write it; see `memory`.

    Attributes:
        writable: The state itself with writable arrays, for the simulation and for compiled kernels.
        remembering: Name of the part whose declared arrays may currently be written; None if there is none.
        world: The constant data of the simulation.
        group: The agents.
        num_rows: Number of rows, R.
        derived: Cache of values computed from this state, for the code that computes them.
    """

    def __init__(self, state: State, world: World, group: Group) -> None:
        self.writable = state
        self.remembering: str | None = None
        self.world = world
        self.group = group
        self.num_rows = state.num_envs * group.size
        self._readings: dict[str, FloatArray] = {}
        self._ranges: dict[str | None, FloatArray] = {}
        self.derived: dict[Any, Any] = {}

    def __reduce__(self) -> Any:
        """Copy the view without cached values, which contain arrays of the current state."""
        return View, (self.writable, self.world, self.group)

    def __getattr__(self, name: str) -> Any:
        """Return a value that a component of the task provides, such as ``sun_direction``."""
        return offered("view", name, self)

    @property
    def state(self) -> State:
        """The state, with read-only arrays."""
        return self.writable.read_only

    def per_environment(self, array: Array) -> Array:
        """Return an array with the environment axis (N, ...) expanded to the rows of the view (R, ...)."""
        return array if self.group.size == 1 else cast(Array, array.repeat(self.group.size, axis=0))

    def per_agent(self, array: Array) -> Array:
        """Return each agent's own entry of an array with an axis of deputies or bodies (N, D, ...), shape (R, ...)."""
        first, size = self.group.first, self.group.size
        own = array[:, first] if size == 1 else array[:, first : first + size].reshape(-1, *array.shape[2:])
        return cast(Array, own)

    def normal(self, purpose: str, size: int = 1) -> FloatArray:
        """Return standard normal numbers, a function of the seed, slot, episode, step, deputy and purpose.

        Args:
            purpose: Name of the use; different names give independent numbers.
            size: Count of numbers for each row.

        Returns:
            The numbers, shape (R, size).
        """
        drawn = np.empty((self.num_rows, size))
        salt = np.uint64(zlib.crc32(purpose.encode()))
        draw_normals(self.writable.key, self.writable.step, salt, self.group.first, self.group.size, drawn)
        return drawn

    @property
    def time(self) -> FloatArray:
        """Time since the reset [s], shape (R,)."""
        return self.per_environment(self.state.time)

    @property
    def step(self) -> IntArray:
        """Steps since the reset, shape (R,)."""
        return self.per_environment(self.state.step)

    @property
    def position(self) -> FloatArray:
        """Own position [m], Hill frame, shape (R, 3)."""
        return self.per_agent(self.state.position)

    @property
    def velocity(self) -> FloatArray:
        """Own velocity [m/s], Hill frame, shape (R, 3)."""
        return self.per_agent(self.state.velocity)

    @property
    def control(self) -> FloatArray:
        """Own control commanded for the last step, thrust [N] first, in the frame of the dynamics, shape (R, C)."""
        return self.per_agent(self.state.control)

    @property
    def delta_v(self) -> FloatArray:
        """Own velocity change spent in the episode [m/s], shape (R,)."""
        return self.per_agent(self.state.delta_v)

    @property
    def interventions(self) -> IntArray:
        """Steps of the episode in which a safety filter changed the agent's own thrust, shape (R,)."""
        return self.per_agent(self.state.interventions)

    @property
    def finished(self) -> AnyArray:
        """`DoneStatus` with which the agent's own episode has ended, 0 while it is running, int8, shape (R,)."""
        return self.per_agent(self.state.finished)

    @cached_property
    def own_index(self) -> IntArray:
        """Index of the agent's own deputy among all deputies, in agent order, shape (R,)."""
        own = np.arange(self.group.first, self.group.first + self.group.size)
        return read_only(np.tile(own, self.writable.num_envs))

    @cached_property
    def others_position(self) -> FloatArray:
        """Position of every other deputy, in agent order [m], Hill frame, shape (R, D - 1, 3)."""
        return self._of_others(self.state.position)

    @cached_property
    def others_velocity(self) -> FloatArray:
        """Velocity of every other deputy, in agent order [m/s], Hill frame, shape (R, D - 1, 3)."""
        return self._of_others(self.state.velocity)

    @property
    def mass(self) -> FloatArray:
        """Own mass [kg], shape (R,)."""
        first, size = self.group.first, self.group.size
        return read_only(np.tile(self.world.masses[first : first + size], self.writable.num_envs))

    def _of_others(self, array: FloatArray) -> FloatArray:
        deputies = self.world.num_deputies
        first, size = self.group.first, self.group.size
        others = np.array(
            [[k for k in range(deputies) if k != own] for own in range(first, first + size)], dtype=np.intp
        )
        found: FloatArray = array[:, others.reshape(size, deputies - 1)].reshape(self.num_rows, deputies - 1, 3)
        return read_only(found)

    def entity_position(self, name: str) -> FloatArray:
        """Return the position of a body [m], Hill frame, shape (R, 3)."""
        return self.per_environment(self.state.position[:, self.world.bodies[name]])

    def entity_velocity(self, name: str) -> FloatArray:
        """Return the velocity of a body [m/s], Hill frame, shape (R, 3)."""
        return self.per_environment(self.state.velocity[:, self.world.bodies[name]])

    def reading(self, sensor: str) -> FloatArray:
        """Return the reading of a sensor of the agent in this state, shape (R, k); it is computed once and cached."""
        found = self._readings.get(sensor)
        if found is None:
            found = self._readings[sensor] = read_only(np.asarray(self.group.sensors[sensor](self)))
        return found

    @property
    def readings(self) -> Mapping[str, FloatArray]:
        """Readings of the agent's sensors that have been computed in this state so far, by name."""
        return self._readings

    def range_to(self, position_sensor: str | None) -> FloatArray:
        """Return the distance to the position that a sensor reads [m], shape (R,); None: to the origin."""
        found = self._ranges.get(position_sensor)
        if found is None:
            offset = self.position if position_sensor is None else self.position - self.reading(position_sensor)
            square = offset * offset
            found = np.sqrt(square[:, 0] + square[:, 1] + square[:, 2])
            found.setflags(write=False)
            self._ranges[position_sensor] = found
        return found

    def memory(self, part: str, array: str) -> AnyArray:
        """Return a declared array with the rows of the view, shape (R, ...).

        The array is writable only for the part that declared it: for a sensor or a done function within `remember`, and
        for a scripted policy within its call.

        Args:
            part: Name of the sensor, or `SAFETY_FILTER` or `SCRIPTED_POLICY`, or the key of a done function in
                ``group.dones``.
            array: Name of the array.
        """
        state = self.writable if part == self.remembering else self.state
        return state.memory[self.group.name, part, array]


class Step:
    """One step of a group of agents, from the state before to the state after. The arrays are read-only.

    Attributes:
        world: The constant data of the simulation.
        before: State at the start of the step.
        after: State at the end of the step, before any reset.
        writable_control: `control` as a writable array, for the environment and for compiled kernels.
        writable_intervening: `intervening` as a writable array, likewise.
        dt: Length of the step [s].
        filtered: Result of the safety filter, if one is enabled.
    """

    filtered: FilterResult | None = None

    def __init__(
        self,
        before: View,
        after: View,
        action: FloatArray,
        control: FloatArray,
        desired_control: FloatArray,
        intervening: BoolArray,
        dt: float,
    ) -> None:
        self.world = before.world
        self.before = before
        self.after = after
        self._action = action
        self.writable_control = control
        self._desired_control = desired_control
        self.writable_intervening = intervening
        self.dt = dt

    def __getattr__(self, name: str) -> Any:
        """Return a value that a component of the task provides, such as ``new_points``."""
        return offered("step", name, self)

    @property
    def action(self) -> FloatArray:
        """Actions of the policies, shape (R, A)."""
        return read_only(self._action)

    @property
    def control(self) -> FloatArray:
        """Control commanded for the step, the thrust [N] first, in the frame of the dynamics, shape (R, C)."""
        return read_only(self.writable_control)

    @property
    def desired_control(self) -> FloatArray:
        """Control that the policies commanded, before any safety filter, shape (R, C)."""
        return read_only(self._desired_control)

    @property
    def intervening(self) -> BoolArray:
        """Mask of the rows in which a safety filter changed the thrust, shape (R,)."""
        return read_only(self.writable_intervening)

    @cached_property
    def first(self) -> BoolArray:
        """Mask of the rows in which this is the first step of the episode, shape (R,)."""
        return read_only(np.asarray(self.before.step == 0))

    @cached_property
    def total_thrust(self) -> FloatArray:
        """Sum of abs(u_i) over the axes [N], shape (R,)."""
        size = np.abs(self.writable_control)
        return read_only(np.asarray(size[:, 0] + size[:, 1] + size[:, 2]))

    @property
    def delta_v(self) -> FloatArray:
        """Velocity change of this step, sum of abs(u_i) dt / m [m/s], shape (R,)."""
        return np.asarray(self.total_thrust * (self.dt / self.before.mass))
