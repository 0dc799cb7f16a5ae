"""The state of N environments as arrays, and how rows of it are copied and replaced."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.types import AnyArray, FloatArray, IntArray


@dataclass(frozen=True)
class ArraySpec:
    """One declared array of the state: its shape behind the environment axis, its type and its value at reset."""

    shape: tuple[int, ...]
    dtype: Any = np.float64
    fill: float = 0


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


class State:
    """The state of N environments with D deputies and B bodies (the deputies first).

    All arrays are created once and written in place. SI units, Hill's frame.

    Attributes:
        time: Time since the reset [s], shape (N,).
        step: Steps since the reset [-], shape (N,).
        key: Random key of the episode for draws inside a step, shape (N,), uint64.
        position: Position of the bodies [m], shape (N, B, 3).
        velocity: Velocity of the bodies [m/s], shape (N, B, 3).
        control: Thrust held over the last step [N], shape (N, D, 3).
        delta_v: Velocity change spent in the episode, sum of abs(u_i) dt / m [m/s], shape (N, D).
        sun_angle: Angle of the sun, not wrapped [rad], shape (N,).
        delta_v_scale: Scale of the delta-v reward [1/(m/s)], shape (N,).
        points: `PointsState` by the body's name.
        memory: Declared arrays of the sensors, by "agent group/part/array".
    """

    def __init__(self, num_envs: int, specs: Mapping[str, ArraySpec]) -> None:
        self.num_envs = num_envs
        self.specs = specs
        self.arrays: dict[str, AnyArray] = {
            name: np.full((num_envs, *spec.shape), spec.fill, dtype=spec.dtype) for name, spec in specs.items()
        }
        arrays = self.arrays
        self.time: FloatArray = arrays["time"]
        self.step: IntArray = arrays["step"]
        self.key: AnyArray = arrays["key"]
        self.position: FloatArray = arrays["position"]
        self.velocity: FloatArray = arrays["velocity"]
        self.control: FloatArray = arrays["control"]
        self.delta_v: FloatArray = arrays["delta_v"]
        self.sun_angle: FloatArray = arrays["sun_angle"]
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
        self.memory: dict[str, AnyArray] = {
            name.removeprefix("memory/"): array for name, array in arrays.items() if name.startswith("memory/")
        }
        self._list = list(arrays.values())

    def copy_from(self, other: State) -> None:
        """Overwrite this state with another of the same size."""
        for mine, theirs in zip(self._list, other._list, strict=True):
            np.copyto(mine, theirs)

    def put(self, rows: IntArray, other: State) -> None:
        """Overwrite some rows with the rows of a smaller state."""
        for mine, theirs in zip(self._list, other._list, strict=True):
            mine[rows] = theirs

    def take(self, rows: IntArray) -> State:
        """Return a new state that holds copies of some rows."""
        taken = State(len(rows), self.specs)
        for mine, theirs in zip(taken._list, self._list, strict=True):
            mine[...] = theirs[rows]
        return taken

    def save(self, path: str) -> None:
        """Write every array to a NumPy ``.npz`` file."""
        np.savez(path, **{name.replace("/", "."): array for name, array in self.arrays.items()})  # type: ignore[arg-type]


def base_specs(num_bodies: int, num_deputies: int, points: Iterable[tuple[str, int]]) -> dict[str, ArraySpec]:
    """Return the arrays that every state has; `points` holds (body, number of points)."""
    specs = {
        "time": ArraySpec(()),
        "step": ArraySpec((), np.int64),
        "key": ArraySpec((), np.uint64),
        "position": ArraySpec((num_bodies, 3)),
        "velocity": ArraySpec((num_bodies, 3)),
        "control": ArraySpec((num_deputies, 3)),
        "delta_v": ArraySpec((num_deputies,)),
        "sun_angle": ArraySpec(()),
        "delta_v_scale": ArraySpec(()),
    }
    for name, count in points:
        specs |= {
            f"points/{name}/inspector": ArraySpec((count,), np.int8, -1),
            f"points/{name}/team_count": ArraySpec((), np.int64),
            f"points/{name}/own_count": ArraySpec((num_deputies,), np.int64),
            f"points/{name}/weights": ArraySpec((count,), np.float64, 1.0 / count),
        }
    return specs
