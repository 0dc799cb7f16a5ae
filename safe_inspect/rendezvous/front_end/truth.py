"""A front end that knows the true poses, with stated errors: for tests and ablations."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from safe_inspect.errors import ConfigError
from safe_inspect.rendezvous.edges import MODEL, Edge
from safe_inspect.rendezvous.front_end.context import FrontEnd, FrontEndContext
from safe_inspect.rendezvous.poses import inverse, perturbed
from safe_inspect.rendezvous.sensors.tof import DepthFrame
from safe_inspect.types import FloatArray
from safe_inspect.units import quantity

_Angle = quantity("rad", ge=0)
_Length = quantity("m", ge=0)


#: Least standard deviation that covariances state [rad, m].
_LEAST_SIGMA = 1e-6


class TruthFrontEnd(FrontEnd):
    """Gives the true poses with stated errors; for tests and ablations in a simulation.

    Attributes:
        rotation_sigma: Standard deviation of an edge's rotation about each axis [rad].
        translation_sigma: Of its translation along each axis [m].
        view_rotation: Of the error that all frames of one keyframe have in common, rotation [rad].
        view_translation: Of its translation [m].
        model: Whether poses to the known model are measured.
        model_rotation: Of a pose to the model, rotation [rad]; constant for a keyframe.
        model_translation: Of its translation [m].
        keyframe: Turn of the target after which the view is another one [rad].
        skips: To how many earlier frames there are edges.
    """

    needs_frames: ClassVar[bool] = False

    rotation_sigma: _Angle = 0.003490658503988659  # type: ignore[valid-type]
    translation_sigma: _Length = 0.003  # type: ignore[valid-type]
    view_rotation: _Angle = 0.008726646259971648  # type: ignore[valid-type]
    view_translation: _Length = 0.005  # type: ignore[valid-type]
    model: bool = True
    model_rotation: _Angle = 0.008726646259971648  # type: ignore[valid-type]
    model_translation: _Length = 0.005  # type: ignore[valid-type]
    keyframe: _Angle = 0.2094395102393195  # type: ignore[valid-type]
    skips: int = Field(default=3, ge=1)

    def __call__(self, context: FrontEndContext) -> TruthEdges:
        """Return the front end of a mission."""
        return TruthEdges(self, context)


class TruthEdges:
    """Gives edges from the true poses T_MB.

    Args:
        options: Their errors.
        context: The front end's context; its truth must be there.
    """

    def __init__(self, options: TruthFrontEnd, context: FrontEndContext) -> None:
        if context.truth is None:
            raise ConfigError("TruthFrontEnd works in simulations only; choose another front end for recorded frames")
        self._options, self._truth, self._streams = options, context.truth, context.streams
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
        noise, pose = self._options, self._truth()
        if self._keyframe is None or _angle(self._keyframe, pose) > noise.keyframe:
            self._keyframe, self._drawn = pose, self._drawn + 1
        unit = self._streams.normal("front_end.view", 12, self._drawn)[0]
        view = unit[:6] * np.repeat([noise.view_rotation, noise.view_translation], 3)
        edges = []
        earlier = range(max(len(self._poses) - noise.skips, 0), len(self._poses))
        for place, k in enumerate(earlier):
            kind: Literal["odometry", "skip"] = "odometry" if self._frames[k] == number - 1 else "skip"
            drawn = self._streams.normal(f"front_end.edge.{place}", 6, number)[0]
            error = drawn * np.repeat([noise.rotation_sigma, noise.translation_sigma], 3)
            same = np.array_equal(view, self._views[k])
            measured = perturbed(inverse(perturbed(self._poses[k], self._views[k])) @ perturbed(pose, view), error)
            own = 0.0 if same else np.sqrt(2.0)
            covariance = _covariance(
                np.hypot(noise.rotation_sigma, own * noise.view_rotation),
                np.hypot(noise.translation_sigma, own * noise.view_translation),
            )
            edges.append(Edge(self._frames[k], number, measured, covariance, 1.0, kind))
        if noise.model:
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
