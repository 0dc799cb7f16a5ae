"""The state of N environments as arrays, and how rows of it are copied and replaced."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.simulators.arrays import read_only
from safe_inspect.types import AnyArray, FloatArray, IntArray


@dataclass(frozen=True)
class ArraySpec:
    """One declared array of the state.

    Attributes:
        shape: Shape behind the environment axis.
        dtype: NumPy type.
        fill: Value at the beginning of an episode.
        constant: Whether it keeps its value through an episode.
    """

    shape: tuple[int, ...]
    dtype: Any = np.float64
    fill: float = 0
    constant: bool = False


@dataclass(frozen=True)
class PointsState:
    """What has been inspected of one body's points.

    Attributes:
        inspector: Index of the deputy that first inspected the point, -1 for none, shape (N, P).
        team_count: Points inspected by all deputies, shape (N,).
        own_count: Points first inspected by each deputy, shape (N, D).
        weights: Weight of each point, each row sums to 1, shape (N, P).
    """

    inspector: AnyArray
    team_count: IntArray
    own_count: IntArray
    weights: FloatArray


#: Every array of a state begins at a multiple of this many bytes.
_ALIGNMENT = 64


class State:
    """The state of N environments with D deputies and B bodies (the deputies first).

    All arrays are created once, in one block of memory, and written in place. SI units, Hill's frame.

    Args:
        num_envs: Number of environments, N.
        specs: The arrays, by name.
        constants: A state of the same size that shares its arrays that are constant through an episode.

    Attributes:
        time: Time since the reset [s], shape (N,).
        step: Steps since the reset [-], shape (N,).
        key: Random key of the episode for draws inside a step, shape (N,), uint64.
        position: Position of the bodies [m], shape (N, B, 3).
        velocity: Velocity of the bodies [m/s], shape (N, B, 3).
        control: Thrust held over the last step [N], shape (N, D, 3).
        delta_v: Velocity change spent in the episode, sum of abs(u_i) dt / m [m/s], shape (N, D).
        interventions: Steps of the episode in which a safety filter changed the thrust, shape (N, D).
        finished: `DoneStatus` with which each deputy's agent has ended, 0 while it runs, int8, shape (N, D).
        sun_angle: Angle of the sun, not wrapped [rad], shape (N,).
        sun_direction: Unit vector from the chief to the sun, [cos, -sin, 0] of its angle, shape (N, 3).
        delta_v_scale: Scale of the delta-v reward [1/(m/s)], shape (N,).
        points: `PointsState` by the body's name.
        arrays: All arrays by name, in the order of `specs`.
        constants: Those that are constant through an episode.
        floats: The memory of all arrays that are not constant as numbers of float64; see `start`.
        wholes: The same memory as numbers of int64.
        memory: Declared arrays of the sensors by (agent group, part, array), a row for each environment and agent.
    """

    _read_only: State | None = None

    def __init__(self, num_envs: int, specs: Mapping[str, ArraySpec], constants: State | None = None) -> None:
        block = np.zeros(sum(_padded(num_envs, spec) for spec in specs.values() if not spec.constant), dtype=np.uint8)
        fixed = (
            constants.constants
            if constants is not None
            else {
                name: np.full((num_envs, *spec.shape), spec.fill, spec.dtype)
                for name, spec in specs.items()
                if spec.constant
            }
        )
        self._attach(num_envs, specs, block, fixed)
        for name, spec in specs.items():
            if not spec.constant:
                self.arrays[name][...] = spec.fill

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy is made from: the common memory, and the constant arrays, which states may share."""
        return {"num_envs": self.num_envs, "specs": self.specs, "block": self._block, "constants": self.constants}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Attach the arrays to the copied memory: copied one by one, each would have a memory of its own."""
        self._attach(**state)

    def _attach(
        self, num_envs: int, specs: Mapping[str, ArraySpec], block: AnyArray, constants: dict[str, AnyArray]
    ) -> None:
        """Make the arrays: views of the common memory, and the constant ones beside it."""
        self.num_envs = num_envs
        self.specs = specs
        self._block = block
        self.floats: FloatArray = self._block.view(np.float64)
        self.wholes: IntArray = self._block.view(np.int64)
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
        self.sun_angle: FloatArray = arrays["sun_angle"]
        self.sun_direction: FloatArray = arrays["sun_direction"]
        self.delta_v_scale: FloatArray = arrays["delta_v_scale"]
        self.points: dict[str, PointsState] = {
            entity: PointsState(
                inspector=arrays[f"points/{entity}/inspector"],
                team_count=arrays[f"points/{entity}/team_count"],
                own_count=arrays[f"points/{entity}/own_count"],
                weights=arrays[f"points/{entity}/weights"],
            )
            for entity in (name.split("/")[1] for name in arrays if name.startswith("points/"))
        }
        self.memory: dict[tuple[str, str, str], AnyArray] = {}
        for name, array in arrays.items():
            kind, _, rest = name.partition("/")
            if kind == "memory":
                group, part, label = rest.split("/")
                self.memory[group, part, label] = array.reshape(-1, *array.shape[2:])
        moving = [name for name, spec in specs.items() if not spec.constant]
        self._starts: IntArray = np.array([self.start(name) for name in moving], dtype=np.int64)
        self._widths: IntArray = np.array(
            [math.prod(specs[name].shape) * arrays[name].itemsize for name in moving], dtype=np.int64
        )

    @property
    def read_only(self) -> State:
        """The same state with arrays that cannot be written; plugins are given this one."""
        shown = self._read_only
        if shown is None:
            shown = self._read_only = object.__new__(State)
            shown.__dict__ |= {
                name: value if name.startswith("_") else _read_only(value) for name, value in self.__dict__.items()
            }
        return shown

    def start(self, name: str) -> int:
        """Return at which byte of the common memory an array begins.

        Compiled kernels read the memory from there without checking bounds.

        Raises:
            ValueError: The array is constant, or does not lie in the common memory.
        """
        array = self.arrays[name]
        offset: int = array.ctypes.data - self._block.ctypes.data
        inside = 0 <= offset <= self._block.nbytes - array.nbytes
        if self.specs[name].constant or not (inside and array.flags.c_contiguous):
            raise ValueError(f"the array {name} does not lie in the common memory of the state")
        return offset

    def copy_from(self, other: State) -> None:
        """Overwrite this state with another of the same size that shares its constant arrays."""
        np.copyto(self._block, other._block)

    def put(self, rows: IntArray, other: State) -> None:
        """Overwrite some rows with the rows of a smaller state."""
        self._copy(rows, other, np.arange(other.num_envs))

    def take(self, rows: IntArray, into: State | None = None) -> State:
        """Return a state that holds copies of some rows: a new one, or another of that many rows, overwritten."""
        taken = State(len(rows), self.specs) if into is None else into
        taken._copy(np.arange(len(rows)), self, rows)
        return taken

    def _copy(self, rows: IntArray, other: State, their_rows: IntArray) -> None:
        from safe_inspect.simulators.rows import copy_rows  # compiled: not when only validated

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
    """Return an attribute of a state with read-only arrays in place of its own."""
    if isinstance(value, np.ndarray):
        return read_only(value)
    if isinstance(value, PointsState):
        return PointsState(**{name: read_only(array) for name, array in vars(value).items()})
    if isinstance(value, dict):
        return {name: _read_only(item) for name, item in value.items()}
    return value


def _checked(rows: IntArray, count: int) -> IntArray:
    """Return the indices of rows, those from the end counted from the beginning; the kernel itself checks nothing."""
    rows = np.ascontiguousarray(rows, dtype=np.int64)
    if len(rows) and (rows.min() < 0 or rows.max() >= count):
        if rows.min() < -count or rows.max() >= count:
            raise IndexError(f"there are {count} environments, numbered from 0; {rows.tolist()} are given")
        return rows % count
    return rows


def base_specs(num_bodies: int, num_deputies: int, points: Iterable[tuple[str, int]]) -> dict[str, ArraySpec]:
    """Return the arrays that every state has; `points` holds (body, number of points)."""
    specs = {
        "time": ArraySpec(()),
        "step": ArraySpec((), np.int64),
        "key": ArraySpec((), np.uint64, constant=True),
        "position": ArraySpec((num_bodies, 3)),
        "velocity": ArraySpec((num_bodies, 3)),
        "control": ArraySpec((num_deputies, 3)),
        "delta_v": ArraySpec((num_deputies,)),
        "interventions": ArraySpec((num_deputies,), np.int64),
        "finished": ArraySpec((num_deputies,), np.int8),
        "sun_angle": ArraySpec(()),
        "sun_direction": ArraySpec((3,)),
        "delta_v_scale": ArraySpec(()),
    }
    for name, count in points:
        specs |= {
            f"points/{name}/inspector": ArraySpec((count,), np.int8, -1),
            f"points/{name}/team_count": ArraySpec((), np.int64),
            f"points/{name}/own_count": ArraySpec((num_deputies,), np.int64),
            f"points/{name}/weights": ArraySpec((count,), np.float64, 1.0 / count, constant=True),
        }
    return specs


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
    """Return the bytes that an array takes in the common memory."""
    size: int = num_envs * math.prod(spec.shape) * np.dtype(spec.dtype).itemsize
    return -(-size // _ALIGNMENT) * _ALIGNMENT
