"""Principal moments and axes of a rigid body."""

from __future__ import annotations

import numpy as np

from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveMomentOfInertia

#: Field type of the principal moments of inertia of a body.
PrincipalMoments = tuple[PositiveMomentOfInertia, PositiveMomentOfInertia, PositiveMomentOfInertia]

#: Relative error of data that are rounded: of their symmetry, and by which a principal moment may exceed the sum of the
#: others.
_ROUNDING = 1e-9


def principal_axes(inertia: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the principal moments and axes: ``inertia = R diag(J) R^T``.

    The axes are ordered J1 <= J2 <= J3. The first two point along the positive side of the axis of M with the same
    number, and the third completes a right-handed frame; near the identity all three diagonal elements are positive.

    Args:
        inertia: Inertia [kg m^2], shape (3, 3).

    Returns:
        J, shape (3,), and R_MT, shape (3, 3).

    Raises:
        ValueError: The matrix is not the inertia of a body: it is not symmetric, not positive, or J1 + J2 < J3.
    """
    inertia = np.asarray(inertia, dtype=np.float64)
    rounding = _ROUNDING * abs(np.trace(inertia)) if inertia.shape == (3, 3) else 0.0
    if inertia.shape != (3, 3) or not np.allclose(inertia, inertia.T, rtol=_ROUNDING, atol=rounding):
        raise ValueError(
            "inertia must be a symmetric matrix of shape (3, 3) [kg m^2]; give it about the centre of mass"
        )
    moments, axes = np.linalg.eigh(inertia)
    if not moments[0] > 0.0:
        raise ValueError(f"inertia must be positive definite, its least principal moment is {moments[0]:.6g} kg m^2")
    if moments[0] + moments[1] < moments[2] * (1.0 - _ROUNDING):
        raise ValueError(
            f"no body has the principal moments {moments[0]:.6g}, {moments[1]:.6g} and {moments[2]:.6g} kg m^2: the "
            "sum of the two smaller must not be below the largest; check the inertia's units and reference point"
        )
    for column in range(2):
        diagonal = axes[column, column]
        leading = diagonal if abs(diagonal) > 1e-9 else axes[np.abs(axes[:, column]).argmax(), column]
        if leading < 0.0:
            axes[:, column] *= -1.0
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return moments, axes
