"""A table of solved approaches, whose neighbours of a query are starts for its optimiser.

Entries are compared by where key points of the target, the mating point and its farthest corners, are during the
approach. The end points of a start are always the query's own.
"""

from __future__ import annotations

import functools
import hashlib
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.dynamics.tumble import classify, tumble
from safe_inspect.errors import CheckpointError
from safe_inspect.rendezvous.planner.approach import PlannerOptions, plan_approach
from safe_inspect.rendezvous.planner.problem import ApproachProblem, approach_problem
from safe_inspect.rendezvous.planner.query import PlanQuery
from safe_inspect.types import FloatArray

_TIMES = 5
_CORNERS = 3
_NEAR = 0.3  # m
_NEIGHBOURS = 3


@dataclass(frozen=True, eq=False)
class PlanTable:
    """Solved approaches to one target.

    Attributes:
        key: Digest of geometry, limits and spline, which must be the query's.
        orientation: Quaternions q_WT at the approach's start, shape (E, 4).
        angular_velocity: Angular velocities in T at the approach's start [rad/s], shape (E, 3).
        start: Positions of the chaser at the start in W [m], shape (E, 3).
        free_points: The free control points in W [m], shape (E, n - 6, 3).
        cost: Half the integrals of the squared force [N^2 s], shape (E,).
        clearance: Certified clearances beyond radius and margin [m], shape (E,).
    """

    key: str
    orientation: FloatArray
    angular_velocity: FloatArray
    start: FloatArray
    free_points: FloatArray
    cost: FloatArray
    clearance: FloatArray

    def __len__(self) -> int:
        return len(self.cost)

    def __call__(self, problem: ApproachProblem) -> list[FloatArray]:
        """Return the starts of the three nearest entries that are near, the nearest first, each of shape (n, 3).

        Args:
            problem: An approach to the same target; one to another target has no neighbours.
        """
        if len(self) == 0 or table_key(problem) != self.key:
            return []
        query, points = problem.query, _key_points(problem.query)
        times = np.linspace(0.0, problem.basis.duration, _TIMES)
        own, _ = tumble(query.inertia, query.orientation[None], query.angular_velocity[None], problem.wait + times)
        others, _ = tumble(query.inertia, self.orientation, self.angular_velocity, times)
        apart = np.einsum("etij,pj->etpi", to_matrix(others) - to_matrix(own), points)
        distance = np.sqrt((apart**2).sum(axis=3)).mean(axis=(1, 2))
        distance += np.sqrt(((self.start - problem.start[0]) ** 2).sum(axis=1))
        starts = []
        for entry in np.argsort(distance, kind="stable")[:_NEIGHBOURS]:
            if distance[entry] < _NEAR:
                start = problem.ends.copy()
                start[problem.basis.free] = self.free_points[entry]
                starts.append(start)
        return starts

    def save(self, path: Path) -> None:
        """Write the table as an .npz file."""
        np.savez_compressed(path, **vars(self))

    @classmethod
    def load(cls, path: Path) -> PlanTable:
        """Return the table of an .npz file.

        Raises:
            CheckpointError: The file is missing, damaged, or something else.
        """
        path = path.expanduser()
        try:
            if path.is_file() and not zipfile.is_zipfile(path):
                raise ValueError("it is no .npz file")
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files if name != "key"}
                table = cls(str(file["key"]), **arrays)
            entries = {len(array) for array in arrays.values()}
            if len(entries) != 1:
                raise ValueError(f"its arrays have {sorted(entries)} entries")
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
            reason = str(error).partition("\n")[0]
            raise CheckpointError(f"{path}: no table of approaches can be read ({reason}); build it anew") from None
        return table


def read_table(path: Path) -> PlanTable:
    """Return the table of a file, which is read again when it has changed.

    Raises:
        CheckpointError: The file is missing or damaged.
    """
    path = path.expanduser()
    return _read(path, path.stat().st_mtime_ns if path.exists() else 0)


@functools.lru_cache(maxsize=4)
def _read(path: Path, changed: int) -> PlanTable:
    return PlanTable.load(path)


def table_key(problem: ApproachProblem) -> str:
    """Return the digest of geometry, mating point, inertia ratios, limits, and spline of an approach."""
    query, digest = problem.query, hashlib.sha256()
    arrays = (query.boxes.centre, query.boxes.half_size, query.boxes.rotation, query.R_MT, query.mating_point)
    for array in (*arrays, query.inertia / query.inertia[2], problem.margin, problem.basis.knots):
        digest.update(np.round(array, 9).tobytes())
    for name, value in sorted(vars(query.limits).items()):
        digest.update(f"{name} {None if value is None else np.round(value, 9).tolist()}".encode())
    return digest.hexdigest()[:16]


def build_table(queries: Iterable[PlanQuery], options: PlannerOptions | None = None) -> PlanTable:
    """Return the table of the queries that are solved, from several starts each.

    Args:
        queries: Queries about one target, of one duration, without waits.
        options: How plans are made.

    Raises:
        ValueError: The queries differ in what the key holds, or none was solved.
    """
    options = replace(options or PlannerOptions(), multi_start=True)
    keys, solved = set(), []
    for query in queries:
        plan = plan_approach(replace(query, waits=(0.0,)), options)
        if plan.solved:
            keys.add(table_key(approach_problem(query, 0.0, plan.duration, options.control_points, options.samples)))
            solved.append((query, plan))
    if len(keys) != 1:
        raise ValueError(f"table: the solved queries must have one target, duration and limits; they have {len(keys)}")
    return PlanTable(
        key=keys.pop(),
        orientation=np.stack([query.orientation for query, _ in solved]),
        angular_velocity=np.stack([query.angular_velocity for query, _ in solved]),
        start=np.stack([query.state[:3] for query, _ in solved]),
        free_points=np.stack([plan.control_points[3:-3] for _, plan in solved]),
        cost=np.array([plan.report.cost for _, plan in solved]),
        clearance=np.array([plan.report.clearance for _, plan in solved]),
    )


def table_queries(query: PlanQuery, count: int, rates: tuple[float, float] = (1.0, 1.0)) -> Iterator[PlanQuery]:
    """Yield queries that cover attitude, phase of the polhode and rate evenly, by Halton's sequence.

    Args:
        query: What the queries have in common; its angular velocity is on the polhode.
        count: Number of queries.
        rates: Least and largest factor of the angular velocity.
    """
    period = float(classify(query.inertia, query.angular_velocity[None]).period[0])
    for a, b, c, phase, rate in qmc.Halton(5, scramble=False).random(count):
        angles = 2.0 * np.pi * np.array([b, b, c, c])  # uniform over rotations (Shoemake 1992)
        radii = np.sqrt([1.0 - a, 1.0 - a, a, a])
        orientation = radii * np.array([np.sin(angles[0]), np.cos(angles[1]), np.sin(angles[2]), np.cos(angles[3])])
        time = np.array([phase * period if np.isfinite(period) else 0.0])
        _, w = tumble(query.inertia, query.orientation[None], query.angular_velocity[None], time)
        factor = rates[0] + rate * (rates[1] - rates[0])
        yield replace(query, orientation=orientation, angular_velocity=factor * w[0, 0])


def _key_points(query: PlanQuery) -> FloatArray:
    """Return the mating point and the corners farthest from the centre of mass, of different boxes, in T."""
    boxes = query.boxes
    corners = boxes.corners
    farthest = np.argsort(-(corners**2).sum(axis=2), axis=1)[:, 0]
    tips = corners[np.arange(len(boxes)), farthest]
    tips = tips[np.argsort(-(tips**2).sum(axis=1), kind="stable")[:_CORNERS]]
    return np.concatenate((query.mating_point[None], tips @ query.R_MT))
