"""Planar zonotopes about the origin: sums, images, supports and exact tests of inclusion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from safe_inspect.types import FloatArray


@dataclass(frozen=True, eq=False)
class Zonotope:
    """The set of all sums ``c_1 g_1 + ... + c_n g_n`` with ``|c_i| <= 1``.

    Its facets are parallel to its generators, so the perpendiculars of the generators are all normals of its facets:
    a set P lies inside exactly if ``h_P(normal) <= h(normal)`` for each of them.

    Attributes:
        generators: Generators g, shape (n, 2); zero and parallel ones are allowed.
    """

    generators: FloatArray

    @classmethod
    def box(cls, half_size: FloatArray | Sequence[float]) -> Zonotope:
        """Return the box ``|x_i| <= half_size_i``, of half sizes, shape (2,)."""
        return cls(np.diag(np.asarray(half_size, dtype=float)))

    def support(self, directions: FloatArray) -> FloatArray:
        """Return the support function ``h(d) = max d.x = sum_i |d.g_i|`` of directions (..., 2), shape (...)."""
        return np.asarray(np.abs(directions @ self.generators.T).sum(axis=-1))

    def mapped(self, matrix: FloatArray) -> Zonotope:
        """Return the image under a matrix, shape (2, 2)."""
        return Zonotope(self.generators @ matrix.T)

    def scaled(self, factor: float) -> Zonotope:
        """Return the set times a factor."""
        return Zonotope(factor * self.generators)

    def __add__(self, other: Zonotope) -> Zonotope:
        """Return the Minkowski sum."""
        return minkowski_sum((self, other))

    @cached_property
    def normals(self) -> FloatArray:
        """Unit normals of the facets, one of each opposite pair, shape (m, 2)."""
        lengths = np.hypot(self.generators[:, 0], self.generators[:, 1])
        sides = self.generators[lengths > 0.0] / lengths[lengths > 0.0, None]
        return np.stack((-sides[:, 1], sides[:, 0]), axis=1)

    @cached_property
    def offsets(self) -> FloatArray:
        """Support along each of the normals, shape (m,): the set is ``|normals @ x| <= offsets``."""
        return self.support(self.normals)

    def gauge(self, points: FloatArray) -> FloatArray:
        """Return the least factor by which the set must be scaled to hold each point (..., 2), shape (...).

        The set must have an interior.
        """
        return np.asarray((np.abs(points @ self.normals.T) / self.offsets).max(axis=-1))

    def inclusion(self, inner: Zonotope) -> float:
        """Return the largest ``h_inner / h`` over the normals: at most 1 exactly if the inner set lies inside."""
        return float((inner.support(self.normals) / self.offsets).max())

    def merged(self, tolerance: float = 1e-12) -> Zonotope:
        """Return the same set with parallel generators (sine of their angle at most `tolerance`) added up."""
        lengths = np.hypot(self.generators[:, 0], self.generators[:, 1])
        kept = self.generators[lengths > 0.0]
        flipped = (kept[:, 1] < 0.0) | ((kept[:, 1] == 0.0) & (kept[:, 0] < 0.0))
        kept = np.where(flipped[:, None], -kept, kept)
        angles = np.arctan2(kept[:, 1], kept[:, 0])
        order = np.argsort(angles, kind="stable")
        kept, angles = kept[order], angles[order]
        groups = np.concatenate(([0], np.cumsum(np.diff(angles) > tolerance))) if len(kept) else np.empty(0, int)
        sums = np.zeros((groups[-1] + 1 if len(kept) else 0, 2))
        np.add.at(sums, groups, kept)
        return Zonotope(sums)


def minkowski_sum(sets: Sequence[Zonotope]) -> Zonotope:
    """Return the Minkowski sum of zonotopes: all of their generators together."""
    return Zonotope(np.concatenate([item.generators for item in sets]))
