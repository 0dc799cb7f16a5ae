"""Ratios of the principal moments, and their parametrisation by unbounded logits."""

from __future__ import annotations

import numpy as np

from safe_inspect.types import FloatArray

#: Minimum of a logistic value, so that the logits of a body of revolution are finite.
LEAST_SHARE = 1e-9
#: Logits are clipped to this magnitude.
_LARGEST = 25.0


def ratios_of(logits: FloatArray) -> FloatArray:
    """Return k1 = J1 / J3 and k2 = J2 / J3, which are those of a rigid body for any logits, shape (..., 2).

    ``k2 = (1 + s(a)) / 2`` and ``k1 = 1 - k2 + (2 k2 - 1) s(b)`` with the logistic function s.

    Args:
        logits: Logits a and b, shape (..., 2).
    """
    s = 1.0 / (1.0 + np.exp(-np.clip(np.asarray(logits, dtype=np.float64), -_LARGEST, _LARGEST)))
    k2 = 0.5 + 0.5 * s[..., 0]
    return np.stack((np.minimum(1.0 - k2 + s[..., 0] * s[..., 1], k2), k2), axis=-1)


def logits_of(ratios: FloatArray) -> FloatArray:
    """Return the logits of ratios, shape (..., 2); ratios that no rigid body has are moved to the nearest possible."""
    k1, k2 = np.asarray(ratios, dtype=np.float64)[..., 0], np.asarray(ratios, dtype=np.float64)[..., 1]
    spread = np.clip(2.0 * k2 - 1.0, LEAST_SHARE, 1.0 - LEAST_SHARE)
    shares = np.clip(np.stack((spread, (k1 - (1.0 - k2)) / spread), axis=-1), LEAST_SHARE, 1.0 - LEAST_SHARE)
    return np.asarray(np.log(shares / (1.0 - shares)))


def inertia_of(logits: FloatArray) -> FloatArray:
    """Return principal moments with J3 = 1, shape (..., 3)."""
    ratios = ratios_of(logits)
    return np.concatenate((ratios, np.ones((*ratios.shape[:-1], 1))), axis=-1)
