"""Control points from which the optimiser starts when the cheapest spline leads nowhere."""

from __future__ import annotations

import numpy as np

from safe_inspect.rendezvous.planner.problem import ApproachProblem
from safe_inspect.types import FloatArray

_BEND = 0.5  # m


def bent_starts(problem: ApproachProblem) -> list[FloatArray]:
    """Return the cheapest approach bent by 0.5 m sin(pi s) to four sides of its chord, each of shape (n, 3)."""
    cold = problem.cold()
    chord = problem.end[0] - problem.start[0]
    chord = chord / max(float(np.linalg.norm(chord)), 1e-9)
    side = np.cross(chord, np.eye(3)[np.abs(chord).argmin()])
    side /= np.linalg.norm(side)
    bend = _BEND * np.sin(np.pi * np.linspace(0.0, 1.0, len(cold)))[:, None]
    bend[: problem.basis.free.start] = bend[problem.basis.free.stop :] = 0.0
    return [cold + sign * bend * axis for axis in (side, np.cross(chord, side)) for sign in (1.0, -1.0)]
