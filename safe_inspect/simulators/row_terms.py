"""`RowTerm`: a plugin that is defined by one kernel for one agent in one environment, and the inputs of such kernels.

The memory location of an input is found once, as an offset and two strides in bytes, between environments and between
agents. With it, a kernel can read the input for every row of every state of that size.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from safe_inspect.compiling import Kernel, compiled_function
from safe_inspect.errors import PluginValueError
from safe_inspect.simulators.offers import missing
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import Group, View
from safe_inspect.simulators.world import World
from safe_inspect.types import AnyArray


class MemoryBase(IntEnum):
    """The block of memory that contains an input."""

    ABSOLUTE = 0
    AFTER = 1
    BEFORE = 2
    READINGS = 3
    INTERVENING = 4
    ASKED = 5  # mask of the requested readings, one byte per row; address 0: all are requested


@dataclass(frozen=True)
class Scene:
    """Arrays of a simulation, from which the memory locations of a row kernel's inputs are determined.

    Attributes:
        world: The constant data of the simulation.
        group: The agents.
        state: A state with the required number of environments.
        columns: Columns of each sensor in the matrix of readings, which has a row for each environment and agent.
        width: Number of columns of that matrix.
    """

    world: World
    group: Group
    state: State
    columns: Mapping[str, slice]
    width: int

    @property
    def rows(self) -> tuple[int, int]:
        """Number of environments and number of agents, N and G."""
        return self.state.num_envs, self.group.size


class InputPlace(NamedTuple):
    """Memory location of an input.

    Attributes:
        base: The block of memory.
        offset: Offset in the block [byte].
        dtype: Type of the elements.
        shape: (environments, agents, ...); each of the first two is the full number or 1.
        strides: Strides along these axes [byte].
        keeps: The array of a parameter, referenced so that its memory stays valid.
    """

    base: MemoryBase
    offset: int
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    keeps: AnyArray | None = None


@dataclass(frozen=True)
class OwnArray:
    """The agent's own entry of an array of the state with an axis of deputies or bodies.

    Attributes:
        name: Name of the array, such as ``position``.
        before: Whether to read the state before the step.
    """

    name: str
    before: bool = False

    def place(self, scene: Scene) -> InputPlace:
        """Return the memory location of the input."""
        first = scene.group.first
        return _in_state(scene, self.name, slice(first, first + scene.group.size), self.before)


@dataclass(frozen=True)
class BodyArray:
    """A body's entry of an array of the state with an axis of deputies or bodies.

    Attributes:
        name: Name of the array, such as ``position``.
        body: Name of the body.
        before: Whether to read the state before the step.
    """

    name: str
    body: str
    before: bool = False

    def place(self, scene: Scene) -> InputPlace:
        """Return the memory location of the input."""
        index = scene.world.bodies[self.body]
        return _in_state(scene, self.name, slice(index, index + 1), self.before)


@dataclass(frozen=True)
class EnvironmentArray:
    """An environment's row of an array of the state, such as ``sun_angle``, or ``position`` of all its bodies.

    Attributes:
        name: Name of the array.
        before: Whether to read the state before the step.
    """

    name: str
    before: bool = False

    def place(self, scene: Scene) -> InputPlace:
        """Return the memory location of the input."""
        return _in_state(scene, self.name, None, self.before)


@dataclass(frozen=True)
class SensorMemory:
    """The agent's own entry of an array in which a sensor stores data.

    Attributes:
        part: Name of the sensor.
        name: Name of the array.
    """

    part: str
    name: str

    def place(self, scene: Scene) -> InputPlace:
        """Return the memory location of the input."""
        return _in_state(scene, f"memory/{scene.group.name}/{self.part}/{self.name}", slice(None), False)


@dataclass(frozen=True)
class SensorReading:
    """Reading of a sensor of the agent after the step, shape (k,).

    Attributes:
        sensor: Name of the sensor.
    """

    sensor: str

    @property
    def key(self) -> str:
        """Key of its columns."""
        return self.sensor

    def place(self, scene: Scene) -> InputPlace:
        """Return the memory location of the input."""
        return _in_readings(scene, self.key)

    def size_of(self, group: Group) -> int:
        """Return the number of elements."""
        return group.sensors[self.sensor].size

    def read(self, view: View) -> AnyArray:
        """Return the reading for all rows, shape (R, k)."""
        return view.reading(self.sensor)


@dataclass(frozen=True, eq=False)
class GlueReading:
    """Observation of a glue of the agent after the step, shape (k,).

    Attributes:
        glue: The glue, called with a `View`.
        size: Number of elements, k.
    """

    glue: Any
    size: int

    @property
    def key(self) -> str:
        """Key of its columns, the same for equal glues."""
        return repr(self.glue)

    def place(self, scene: Scene) -> InputPlace:
        """Return the memory location of the input."""
        return _in_readings(scene, self.key)

    def size_of(self, group: Group) -> int:
        """Return the number of elements."""
        return self.size

    def read(self, view: View) -> AnyArray:
        """Return the reading for all rows, shape (R, k)."""
        return np.asarray(self.glue(view))


@dataclass(frozen=True)
class Intervening:
    """Whether a safety filter changed the agent's thrust in the step."""

    def place(self, scene: Scene) -> InputPlace:
        """Return the memory location of the input."""
        return InputPlace(MemoryBase.INTERVENING, 0, np.dtype(np.bool_), scene.rows, (scene.group.size, 1))


@dataclass(frozen=True)
class AgentParameter:
    """A parameter with one value for each agent of the group.

    Attributes:
        values: The values, shape (G, ...).
    """

    values: AnyArray

    def place(self, scene: Scene) -> InputPlace:
        """Return the memory location of the input."""
        return _absolute(np.ascontiguousarray(self.values[None]))


StateInput = OwnArray | BodyArray | EnvironmentArray | SensorMemory
TermReading = SensorReading | GlueReading
RowInput = StateInput | TermReading | Intervening | AgentParameter | AnyArray | float


@dataclass(frozen=True, eq=False)
class RowTerm:
    """A row kernel and its inputs.

    Attributes:
        kernel: Function of the inputs of one agent in one environment, in order: numbers and arrays. It returns a
            number or a bool; the kernel of a sensor instead writes the reading into an additional last argument, an
            array of shape (size,).
        inputs: Inputs of the kernel. Numbers and arrays are parameters.
    """

    kernel: Kernel[..., Any]
    inputs: Sequence[RowInput]

    def __post_init__(self) -> None:
        """Check that the kernel is a compiled function.

        Raises:
            PluginValueError: It is a plain function.
        """
        if compiled_function(self.kernel) is None:
            name = getattr(self.kernel, "__qualname__", repr(self.kernel))
            raise PluginValueError(
                f"the kernel {name} of a RowTerm is not compiled; decorate it with safe_inspect.compiling.njit"
            )

    @property
    def read(self) -> tuple[TermReading, ...]:
        """The readings of sensors and glues among the inputs, each once."""
        return tuple({given.key: given for given in self.inputs if isinstance(given, TermReading)}.values())


def place_of(given: RowInput, scene: Scene) -> InputPlace:
    """Return the memory location of an input; a number or an array is a parameter that is the same for all rows.

    Raises:
        ValueError: An array of the state is not in the state's memory, or is constant during an episode.
    """
    if isinstance(given, (bool, int, float, np.ndarray)):
        return _absolute(np.ascontiguousarray(np.asarray(given)[None, None]))
    return given.place(scene)


def _absolute(array: AnyArray) -> InputPlace:
    return InputPlace(MemoryBase.ABSOLUTE, array.ctypes.data, array.dtype, array.shape, array.strides, array)


def _in_readings(scene: Scene, key: str) -> InputPlace:
    """Return the location of the columns with a given key."""
    columns = scene.columns[key]
    shape = (*scene.rows, columns.stop - columns.start)
    strides = (8 * scene.width * scene.group.size, 8 * scene.width, 8)
    return InputPlace(MemoryBase.READINGS, 8 * columns.start, np.dtype(np.float64), shape, strides)


def _in_state(scene: Scene, name: str, agents: slice | None, before: bool) -> InputPlace:
    """Return the location of an array of the state: some entries of its second axis, or each environment's row."""
    if name not in scene.state.arrays:
        raise missing("state", name, scene.state.arrays)
    whole: Any = scene.state.arrays[name]
    start = scene.state.start(name)
    part = whole[:, None] if agents is None else whole[:, agents]
    offset = start + part.ctypes.data - whole.ctypes.data if part.size else start
    return InputPlace(MemoryBase.BEFORE if before else MemoryBase.AFTER, offset, part.dtype, part.shape, part.strides)


def own_estimate(name: str, world: World) -> OwnArray:
    """Return the agent's estimate of its ``position`` or ``velocity``, or the array itself if nothing disturbs it."""
    estimate = f"estimated_{name}"
    return OwnArray(estimate if estimate in world.offers.view else name)


def range_inputs(sensor: str | None) -> tuple[RowInput, RowInput]:
    """Return the agent's own position and the reading of a position sensor, from which the range follows.

    Args:
        sensor: Name of the sensor; None: the origin of Hill's frame.
    """
    return OwnArray("position"), np.zeros(3) if sensor is None else SensorReading(sensor)
