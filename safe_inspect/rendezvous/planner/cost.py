"""What a plan costs: force, or mechanical power, each with the quadratic model that an iteration minimises."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from safe_inspect.rendezvous.planner.spline import SplineBasis
from safe_inspect.types import FloatArray

_REGULARISATION = 1e-3  # s^2, of the squared acceleration: power leaves a chaser at rest free to push


class Cost(Protocol):
    """A cost of control points."""

    def value(self, basis: SplineBasis, mass: float, points: FloatArray) -> float:
        """Return the cost of control points [m], shape (n, 3)."""
        ...

    def model(self, basis: SplineBasis, mass: float, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the gradient, shape (n, 3), and a positive Hessian of each axis, shape (3, n, n)."""
        ...


class ForceCost:
    """Half the integral of the squared force, ``m^2 / 2 int |a|^2`` [N^2 s]; exactly quadratic."""

    def value(self, basis: SplineBasis, mass: float, points: FloatArray) -> float:
        """Return the cost of control points [m], shape (n, 3)."""
        return 0.5 * mass**2 * float(np.einsum("ia,ij,ja->", points, basis.gram, points))

    def model(self, basis: SplineBasis, mass: float, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gradient and Hessians."""
        hessian = mass**2 * basis.gram
        return hessian @ points, np.broadcast_to(hessian, (3, *hessian.shape))


class PowerCost:
    """The integral of the squared mechanical power of each axis, ``int sum_i (F_i v_i)^2`` [W^2 s], by Gauss-Newton.

    Source: Albee et al., "A robust observation, planning, and control pipeline for autonomous rendezvous with tumbling
    targets", Frontiers in Robotics and AI 8, 2021. A thousandth of the squared acceleration is added.
    """

    def value(self, basis: SplineBasis, mass: float, points: FloatArray) -> float:
        """Return the cost of control points [m], shape (n, 3)."""
        residual, _, weights = self._residual(basis, mass, points)
        small = _REGULARISATION * float(np.einsum("ia,ij,ja->", points, basis.gram, points))
        return float((weights[:, None] * residual**2).sum()) + small

    def model(self, basis: SplineBasis, mass: float, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gradient and Hessians, those of the linearised power."""
        residual, slope, weights = self._residual(basis, mass, points)
        weighted = weights[:, None, None] * slope
        gradient = 2.0 * np.einsum("qan,qa->na", weighted, residual)
        hessian = 2.0 * np.einsum("qan,qam->anm", weighted, slope)
        return gradient + 2.0 * _REGULARISATION * basis.gram @ points, hessian + 2.0 * _REGULARISATION * basis.gram

    @staticmethod
    def _residual(basis: SplineBasis, mass: float, points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return power (Q, 3), its slope (Q, 3, n) and the weights of the quadrature (Q,)."""
        (first, second), weights = basis.quadrature
        v, a = first @ points, second @ points
        slope = mass * (v[:, :, None] * second[:, None] + a[:, :, None] * first[:, None])
        return mass * v * a, slope, weights
