"""The state of N environments as arrays, with functions that copy and replace rows of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.simulators.arrays import read_only
from safe_inspect.simulators.offers import missing
from safe_inspect.types import AnyArray, FloatArray, IntArray
from safe_inspect.types import ArraySpec as ArraySpec


@njit
def copy_rows(
    target: AnyArray,
    target_starts: IntArray,
    target_rows: IntArray,
    source: AnyArray,
    source_starts: IntArray,
    source_rows: IntArray,
    widths: IntArray,
) -> None:
    """Copy rows of all arrays in a block of memory.

    Args:
        target: The memory to write, bytes.
        target_starts: Start of each array in it, shape (A,).
        target_rows: The rows to write, shape (R,).
        source: The memory to read, bytes.
        source_starts: Start of each array in it, shape (A,).
        source_rows: The rows to read, shape (R,).
        widths: Bytes per row of each array, shape (A,).
    """
    for a in range(len(widths)):
        width = widths[a]
        for r in range(len(target_rows)):
            to, at = target_starts[a] + target_rows[r] * width, source_starts[a] + source_rows[r] * width
            for byte in range(width):
                target[to + byte] = source[at + byte]


#: Every array of a state starts at a multiple of this many bytes.
_ALIGNMENT = 64


class State:
    """The state of N environments with D deputies and B bodies (the deputies first).

    All arrays are created once, in one block of memory, and written in place. SI units, Hill's frame. The arrays of the
    dynamics and of the task's components are attributes by their names, such as ``state.sun_angle``; an array named
    ``kind/owner/array`` is ``state.kind[owner].array``. Every array is also available as ``state[name]``.

    Args:
        num_envs: Number of environments, N.
        specs: The arrays, by name.
        constants: A state of the same size with which to share the arrays that are constant during an episode.

    Attributes:
        time: Time since the reset [s], shape (N,).
        step: Steps since the reset [-], shape (N,).
        key: Random key of the episode for draws within a step, shape (N,), uint64.
        position: Position of the bodies [m], shape (N, B, 3).
        velocity: Velocity of the bodies [m/s], shape (N, B, 3).
        control: Control commanded for the last step, after the safety filter, in the unit of the dynamics, shape
            (N, D, C). The flown control u may differ, see `Simulation.flown`.
        delta_v: Velocity change spent in the episode, sum of abs(u_i) dt / m [m/s], shape (N, D).
        interventions: Steps of the episode in which a safety filter changed the thrust, shape (N, D).
        finished: `DoneStatus` with which each deputy's agent has ended, 0 while it is running, int8, shape (N, D).
        arrays: All arrays by name, in the order of `specs`.
        constants: The arrays that are constant during an episode.
        owned: The arrays that are named ``kind/owner/array``, by kind and owner.
        floats: The memory of all arrays that are not constant, as float64; see `start`.
        bound: Kernels with their arguments, a cache for code that calls them in every step; it is not copied.
        memory: Declared arrays of the sensors by (agent group, part, array), one row for each environment and agent.
        whole_rows: Indices of these environments in the larger batch of which they are a part, shape (N,); None if they
            are not a part.
    """

    def __init__(self, num_envs: int, specs: Mapping[str, ArraySpec], constants: State | None = None) -> None:
        block = np.zeros(sum(_padded(num_envs, spec) for spec in specs.values() if not spec.constant), dtype=np.uint8)
        if constants is None:
            own = {name: spec for name, spec in specs.items() if spec.constant}
            fixed = {name: np.full((num_envs, *spec.shape), spec.fill, spec.dtype) for name, spec in own.items()}
        else:
            fixed = constants.constants
        self._attach(num_envs, specs, block, fixed)
        for name, spec in specs.items():
            if not spec.constant:
                self.arrays[name][...] = spec.fill

    def __getstate__(self) -> dict[str, Any]:
        """Return the data for a copy: the common memory, and the constant arrays, which states may share."""
        return {"num_envs": self.num_envs, "specs": self.specs, "block": self._block, "constants": self.constants}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Attach the arrays to the copied memory; if they were copied one by one, each would have separate memory."""
        self._attach(**state)

    def _attach(
        self, num_envs: int, specs: Mapping[str, ArraySpec], block: AnyArray, constants: dict[str, AnyArray]
    ) -> None:
        """Create the arrays: views of the common memory, and the constant arrays."""
        self.num_envs = num_envs
        self.whole_rows: IntArray | None = None
        self.specs = specs
        self.bound: dict[Any, tuple[Any, tuple[Any, ...]]] = {}
        self._block = block
        self.floats: FloatArray = self._block.view(np.float64)
        self.constants = constants
        self.arrays = arrays = _arrays_in(block, num_envs, specs, constants)
        self.time: FloatArray = arrays["time"]
        self.step: IntArray = arrays["step"]
        self.key: AnyArray = arrays["key"]
        self.position: FloatArray = arrays["position"]
        self.velocity: FloatArray = arrays["velocity"]
        self.control: FloatArray = arrays["control"]
        self.delta_v: FloatArray = arrays["delta_v"]
        self.interventions: IntArray = arrays["interventions"]
        self.finished: AnyArray = arrays["finished"]
        self.memory: dict[tuple[str, str, str], AnyArray] = {}
        self.owned: dict[str, dict[str, SimpleNamespace]] = {}
        for name, array in arrays.items():
            kind, _, rest = name.partition("/")
            if kind == "memory":
                group, part, label = rest.split("/")
                self.memory[group, part, label] = array.reshape(-1, *array.shape[2:])
            elif rest:
                owner, _, label = rest.partition("/")
                setattr(self.owned.setdefault(kind, {}).setdefault(owner, SimpleNamespace()), label, array)
        vars(self).update(self.owned)  # faster than `__getattr__`
        moving = [name for name, spec in specs.items() if not spec.constant]
        self._starts: IntArray = np.array([self.start(name) for name in moving], dtype=np.int64)
        self._widths: IntArray = np.array(
            [math.prod(specs[name].shape) * arrays[name].itemsize for name in moving], dtype=np.int64
        )

    def __getattr__(self, name: str) -> Any:
        """Return an array of a component by its name."""
        known = self.__dict__
        if name in known.get("arrays", ()):
            return known["arrays"][name]
        raise missing("state", name, {**known.get("arrays", {}), **known.get("owned", {})})

    def __getitem__(self, name: str) -> AnyArray:
        """Return an array by its name."""
        return self.arrays[name]

    @cached_property
    def read_only(self) -> State:
        """The same state with read-only arrays; this is the state that plugins get."""
        shown = object.__new__(State)
        shown.__dict__ |= {
            name: value if name.startswith("_") else _read_only(value) for name, value in self.__dict__.items()
        }
        return shown

    def start(self, name: str) -> int:
        """Return the byte of the common memory at which an array starts.

        Compiled kernels read the memory from there without bounds checks.

        Raises:
            ValueError: The array is constant, or is not in the common memory.
        """
        array = self.arrays[name]
        offset: int = array.ctypes.data - self._block.ctypes.data
        inside = 0 <= offset <= self._block.nbytes - array.nbytes
        if self.specs[name].constant or not (inside and array.flags.c_contiguous):
            raise ValueError(f"the array {name} does not lie in the common memory of the state")
        return offset

    def copy_from(self, other: State) -> None:
        """Overwrite this state with another of the same size with which it shares its constant arrays."""
        np.copyto(self._block, other._block)

    def put(self, rows: IntArray, other: State) -> None:
        """Overwrite some rows with the rows of a smaller state."""
        self._copy(rows, other, np.arange(other.num_envs))

    def take(self, rows: IntArray, into: State | None = None) -> State:
        """Return a state with copies of some rows: a new state, or the given state of that many rows, overwritten."""
        taken = State(len(rows), self.specs) if into is None else into
        taken._copy(np.arange(len(rows)), self, rows)
        return taken

    def _copy(self, rows: IntArray, other: State, their_rows: IntArray) -> None:
        if len(rows) != len(their_rows):
            raise ValueError(f"{len(rows)} rows are to be overwritten with {len(their_rows)}")
        rows, their_rows = _checked(rows, self.num_envs), _checked(their_rows, other.num_envs)
        copy_rows(self._block, self._starts, rows, other._block, other._starts, their_rows, self._widths)
        for name, array in self.constants.items():
            array[rows] = other.constants[name][their_rows]

    def save(self, path: str) -> None:
        """Write every array to a NumPy ``.npz`` file."""
        np.savez(path, **{name.replace("/", "."): array for name, array in self.arrays.items()})  # type: ignore[arg-type]


def _read_only(value: Any) -> Any:
    """Return an attribute of a state with its arrays made read-only."""
    if isinstance(value, np.ndarray):
        return read_only(value)
    if isinstance(value, SimpleNamespace):
        return SimpleNamespace(**{name: read_only(array) for name, array in vars(value).items()})
    if isinstance(value, dict):
        return {name: _read_only(item) for name, item in value.items()}
    return value


def _checked(rows: IntArray, count: int) -> IntArray:
    """Return row indices with negative ones converted to positive ones, after a bounds check that the kernel lacks."""
    rows = np.ascontiguousarray(rows, dtype=np.int64)
    if len(rows) and (rows.min() < 0 or rows.max() >= count):
        if rows.min() < -count or rows.max() >= count:
            raise IndexError(f"there are {count} environments, numbered from 0; got {rows.tolist()}")
        return rows % count
    return rows


def base_specs(
    num_bodies: int, num_deputies: int, control_size: int, of_body: Mapping[str, ArraySpec]
) -> dict[str, ArraySpec]:
    """Return the arrays that every state has.

    Args:
        num_bodies: Number of bodies, B.
        num_deputies: Number of deputies, D.
        control_size: Number of elements of a deputy's control, C.
        of_body: The arrays of one body, by name.
    """
    bodies = {
        name: ArraySpec((num_bodies, *spec.shape), spec.dtype, spec.fill, spec.constant)
        for name, spec in of_body.items()
    }
    return {
        "time": ArraySpec(()),
        "step": ArraySpec((), np.int64),
        "key": ArraySpec((), np.uint64, constant=True),
        **bodies,
        "control": ArraySpec((num_deputies, control_size)),
        "delta_v": ArraySpec((num_deputies,)),
        "interventions": ArraySpec((num_deputies,), np.int64),
        "finished": ArraySpec((num_deputies,), np.int8),
    }


def _arrays_in(
    block: AnyArray, num_envs: int, specs: Mapping[str, ArraySpec], constants: Mapping[str, AnyArray]
) -> dict[str, AnyArray]:
    """Return all arrays in the order of their specs: views of a block of memory, and the constant ones."""
    arrays: dict[str, AnyArray] = {}
    start = 0
    for name, spec in specs.items():
        if spec.constant:
            arrays[name] = constants[name]
        else:
            shape = (num_envs, *spec.shape)
            size = math.prod(shape) * np.dtype(spec.dtype).itemsize
            arrays[name] = block[start : start + size].view(spec.dtype).reshape(shape)
            start += _padded(num_envs, spec)
    return arrays


def _padded(num_envs: int, spec: ArraySpec) -> int:
    """Return the bytes that an array occupies in the common memory, including padding."""
    size: int = num_envs * math.prod(spec.shape) * np.dtype(spec.dtype).itemsize
    return -(-size // _ALIGNMENT) * _ALIGNMENT
