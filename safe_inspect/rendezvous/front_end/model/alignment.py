"""Alignment of an observed shape to the known model: which of four attitudes it has, and where the model is in G."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from safe_inspect.rendezvous.characterise.polhode import HALF_TURNS
from safe_inspect.rendezvous.front_end.cleaning import Cloud
from safe_inspect.rendezvous.front_end.model.registration import ModelRegistration, limited
from safe_inspect.rendezvous.poses import adjoint, inverse, perturbed, pose
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray

#: A step shorter than this ends the iteration [rad, m].
_CONVERGED = 1e-6


class ObservedView(NamedTuple):
    """A keyframe: its cleaned points in B, and T_GB, shape (4, 4)."""

    cloud: Cloud
    pose: FloatArray


@dataclass(frozen=True, eq=False)
class Alignment:
    """The model in the frame G that is glued to the target.

    Attributes:
        T_GM: Pose of the model in G, shape (4, 4).
        hessian: Information of the tangent of its inverse T_MG from the right, shape (6, 6).
        score: Mean over the views of the distance between points, shape and silhouette [m].
        scores: Those of all candidates, in their order [m].
        margin: The second score over the best one; below about 1.05 more views are needed to be sure.
        chosen: Which candidate it is.
    """

    T_GM: FloatArray
    hessian: FloatArray
    score: float
    scores: tuple[float, ...]
    margin: float
    chosen: int


def axis_candidates(target: Target, R_GT: FloatArray, centre: FloatArray) -> list[FloatArray]:  # noqa: N803
    """Return the four poses T_GM that principal axes without signs leave open, each of shape (4, 4).

    ``R_GM = R_GT D R_MT^T`` with D the identity and the half turns about the three axes.

    Args:
        target: The known target.
        R_GT: Principal axes in G, any signs, shape (3, 3).
        centre: Centre of mass in G [m], shape (3,).
    """
    return [pose(R_GT @ turn @ target.R_MT.T, centre) for turn in HALF_TURNS]


def align(
    registration: ModelRegistration,
    views: Sequence[ObservedView],
    candidates: Sequence[FloatArray],
    iterations: int = 20,
) -> Alignment:
    """Return the candidate that fits all views best, refined by Gauss-Newton steps over all of them.

    With ``T_MB = T_MG T_GB`` a tangent at T_MG acts on T_MB as ``Ad(T_GB^-1)`` times itself: the normal equations of
    the views add up.

    Args:
        registration: Registers frames to the model.
        views: Keyframes with their poses in G.
        candidates: Poses T_GM to start from, each of shape (4, 4).
        iterations: Largest number of steps of each candidate.
    """
    transports = [adjoint(inverse(view.pose)) for view in views]
    found: list[tuple[float, FloatArray, FloatArray]] = []
    for candidate in candidates:
        T_MG = inverse(candidate)  # noqa: N806
        for step in range(iterations + 1):
            widening = max(2.0 * (1.0 - step / 5.0), 1.0)
            parts = [registration.linearise(view.cloud, T_MG @ view.pose, widening) for view in views]
            hessian = sum(
                (transport.T @ part.hessian @ transport for transport, part in zip(transports, parts, strict=True)),
                np.zeros((6, 6)),
            )
            gradient = sum(
                (transport.T @ part.gradient for transport, part in zip(transports, parts, strict=True)), np.zeros(6)
            )
            if step == iterations:
                break
            move = -np.linalg.solve(hessian + np.diag(1e-6 * np.diag(hessian) + 1e-6), gradient)
            T_MG = perturbed(T_MG, limited(np.asarray(move, dtype=np.float64)))  # noqa: N806
            if np.abs(move).max() < _CONVERGED and step >= 5:
                break
        found.append((float(np.mean([part.score for part in parts])), T_MG, hessian))
    scores = tuple(score for score, _, _ in found)
    chosen = int(np.argmin(scores))
    others = sorted(scores)
    margin = others[1] / max(others[0], 1e-9) if len(others) > 1 else np.inf
    return Alignment(inverse(found[chosen][1]), found[chosen][2], scores[chosen], scores, float(margin), chosen)
