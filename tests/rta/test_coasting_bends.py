"""The bounds on which the certificate of coasting after a part of a hold rests, against samples of the exact motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from safe_inspect.compiling import njit
from safe_inspect.rta.backup.holds import coasting_bends, held
from safe_inspect.rta.backup.model import HOLD_PIECES
from safe_inspect.rta.backup.safety_filter import BackupFilter

from ..golden.records import check_record

RECORD = Path(__file__).with_name("certificates.json")


@njit
def _bends(m: Any, x: Any, u: Any) -> tuple[float, float]:
    return coasting_bends(m, x, held(m, x, u, HOLD_PIECES), u)


def motion(n: float) -> np.ndarray:
    """Return the matrix of the Clohessy-Wiltshire equations, of the state and a constant acceleration."""
    a = np.zeros((9, 9))
    a[:6, 3:] = np.eye(6)
    a[3, 0], a[3, 4], a[4, 3], a[5, 2] = 3.0 * n * n, 2.0 * n, -2.0 * n, -n * n
    return a


@pytest.mark.parametrize(
    ("n", "dt", "horizon", "size"),
    [(0.001027, 10.0, 100.0, 0.1), (0.0015, 60.0, 1000.0, 1.0), (0.0015, 100.0, 50.0, 2.0)],
)
def test_second_derivatives_are_below_their_bounds(n: float, dt: float, horizon: float, size: float) -> None:
    """Bounds are met closely by some motion: each axis, out and back, with and without thrust and speed."""
    run = BackupFilter(
        {"n": n, "step_size": dt, "psm_horizon": horizon, "u_max": size, "r_max": 1500.0}, ["PSM", "r_max"]
    )
    generator, bounds, closest = np.random.default_rng(3), [], np.zeros(2)
    matrix = motion(n)
    into = [expm(matrix * t) for t in np.linspace(0.0, dt, 12)]
    coasts = [expm(matrix[:6, :6] * s) for s in np.linspace(0.0, horizon, 25)]
    for number in range(60):
        x = generator.normal(size=6) * np.array([300.0] * 3 + [4.0 * size] * 3) * generator.choice([0.0, 0.01, 1.0], 6)
        if number < 36:  # along one axis, from rest, towards the chief or away from it
            x = np.zeros(6)
            x[number % 3], x[3 + number % 3] = [0.0, 5.0, 1000.0][number // 12], [0.0, 1.0, -1.0][number // 3 % 3]
        u = generator.uniform(-size, size, 3) * (number % 4 > 0)
        bend = np.array(_bends(run._model, tuple(x.tolist()), u))
        bounds.append(bend)
        most = np.zeros(2)
        for hold in into:
            whole = hold @ np.concatenate((x, u / 12.0))
            rate = matrix @ whole  # velocity and acceleration with the thrust; its derivative gives the jerk
            coasting = matrix[:6, :6] @ whole[:6]
            for phi in coasts:
                along_t = phi[:3, :3] @ rate[3:6] + phi[:3, 3:] @ (matrix @ rate)[3:6]
                along_s = (phi @ coasting)[3:]
                most = np.maximum(most, [np.linalg.norm(along_t), np.linalg.norm(along_s)])
        assert (most <= bend * (1.0 + 1e-9)).all(), number
        closest = np.maximum(closest, most / np.maximum(bend, 1e-300))
    assert (closest > 0.25).all()
    check_record(RECORD, f"bends: {n}, {dt}", {"bounds": bounds})
