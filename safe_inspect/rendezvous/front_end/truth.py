"""A front end that knows the true poses, with stated errors: for tests and ablations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from safe_inspect.errors import ConfigError
from safe_inspect.rendezvous.edges import MODEL, Edge
from safe_inspect.rendezvous.front_end.context import FrontEndContext
from safe_inspect.rendezvous.poses import inverse, perturbed
from safe_inspect.rendezvous.sensors.tof import DepthFrame
from safe_inspect.types import FloatArray


@dataclass(frozen=True)
class TruthNoise:
    """Errors of the measured poses; standard deviations are of one axis.

    Attributes:
        rotation: Of an edge [rad].
        translation: Of an edge [m].
        view_rotation: Of the view [rad]: it is constant while the same keyframe is current, and adds to the pose of
            every frame of it. Edges within one keyframe do not have it.
        view_translation: The same [m].
        model_rotation: Of a pose to the model [rad]; it is constant for a keyframe as well. None for no such poses.
        model_translation: The same [m].
        keyframe: Turn of the target as seen from the chaser after which the view is another one [rad].
        skips: Edges to how many earlier frames.
        loop: Edges to the oldest frame that is seen at a smaller angle than this [rad], at least ten frames back; 0 for
            none.
    """

    rotation: float = 0.0
    translation: float = 0.0
    view_rotation: float = 0.0
    view_translation: float = 0.0
    model_rotation: float | None = None
    model_translation: float = 0.0
    keyframe: float = 0.2094395102393195
    skips: int = 3
    loop: float = 0.0


#: Least standard deviations that covariances state [rad, m], and frames between the ends of a loop.
_LEAST_SIGMA, _LOOP_FRAMES = 1e-6, 10


class TruthEdges:
    """Gives edges from the true poses T_MB.

    Args:
        noise: Their errors.
        context: The front end's context; its truth must be there.
    """

    def __init__(self, noise: TruthNoise, context: FrontEndContext) -> None:
        if context.truth is None:
            raise ConfigError("TruthFrontEnd works in simulations only; choose another front end for recorded frames")
        self._noise, self._truth, self._streams = noise, context.truth, context.streams
        self._poses: list[FloatArray] = []
        self._views: list[FloatArray] = []  # the tangent of each frame's view error
        self._keyframe: FloatArray | None = None
        self._count = self._drawn = 0
        self._frames: list[int] = []

    def step(self, frame: DepthFrame, predicted: FloatArray | None, rotation: FloatArray) -> list[Edge]:
        """Return the edges of a frame."""
        number, self._count = self._count, self._count + 1
        if "out_of_view" in frame.flags:
            return []
        noise, pose = self._noise, self._truth()
        if self._keyframe is None or _angle(self._keyframe, pose) > noise.keyframe:
            self._keyframe, self._drawn = pose, self._drawn + 1
        unit = self._streams.normal("front_end.view", 12, self._drawn)[0]
        view = unit[:6] * np.repeat([noise.view_rotation, noise.view_translation], 3)
        edges = []
        earlier = list(range(max(len(self._poses) - noise.skips, 0), len(self._poses)))
        if noise.loop > 0.0:
            old = range(max(len(self._poses) - _LOOP_FRAMES, 0))
            near = [k for k in old if _angle(self._poses[k], pose) < noise.loop]
            earlier += near[:1]
        for place, k in enumerate(earlier):
            is_neighbour = self._frames[k] == number - 1
            gap = number - self._frames[k]
            kind: Literal["odometry", "skip", "loop"] = (
                "odometry" if is_neighbour else "loop" if gap > _LOOP_FRAMES else "skip"
            )
            drawn = self._streams.normal(f"front_end.edge.{place}", 6, number)[0]
            error = drawn * np.repeat([noise.rotation, noise.translation], 3)
            same = np.array_equal(view, self._views[k])
            measured = perturbed(inverse(perturbed(self._poses[k], self._views[k])) @ perturbed(pose, view), error)
            own = 0.0 if same else np.sqrt(2.0)
            covariance = _covariance(
                np.hypot(noise.rotation, own * noise.view_rotation),
                np.hypot(noise.translation, own * noise.view_translation),
            )
            edges.append(Edge(self._frames[k], number, measured, covariance, 1.0, kind))
        if noise.model_rotation is not None:
            error = unit[6:] * np.repeat([noise.model_rotation, noise.model_translation], 3)
            covariance = _covariance(noise.model_rotation, noise.model_translation)
            edges.append(Edge(MODEL, number, perturbed(pose, error), covariance, 1.0, "model"))
        self._poses.append(pose)
        self._views.append(view)
        self._frames.append(number)
        return edges


def _covariance(rotation: float, translation: float) -> FloatArray:
    sigmas = np.maximum(np.repeat([rotation, translation], 3), _LEAST_SIGMA)
    return np.diag(sigmas**2)


def _angle(first: FloatArray, second: FloatArray) -> float:
    cosine = 0.5 * (np.trace(first[:3, :3].T @ second[:3, :3]) - 1.0)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))
