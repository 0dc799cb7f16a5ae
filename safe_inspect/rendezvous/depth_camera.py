"""A time-of-flight depth camera, simulated by ray casting with noise, dropouts and flying pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.target.model import Target, TriangleMesh
from safe_inspect.types import BoolArray, FloatArray
from safe_inspect.units import PositiveLength

#: Largest number of words that one index of a stream gives; an image uses several indices.
_WORDS_PER_INDEX = 8192
#: Range above which a ray hits nothing [m]; the ray caster returns such a range.
_FAR = 1e30
#: Number of points below which a frame is flagged.
_FEW_POINTS = 50


@dataclass(frozen=True)
class NoiseProfile:
    """Errors of the camera; the standard deviation of a range is ``sigma0 + k r^2 / max(cos(incidence), 0.15)``.

    Attributes:
        sigma0: Constant part [m].
        k: Quadratic part [1/m].
        dropout: Probability that a pixel measures nothing.
        grazing: Cosine of the angle of incidence below which a pixel measures nothing.
        flying: Probability that a pixel at an edge of the depth image is a flying pixel.
        flying_range: Largest displacement of a flying pixel along its ray [m].
        edge: Difference of depth between neighbouring pixels above which they are at an edge [m].
    """

    sigma0: float
    k: float
    dropout: float = 0.01
    grazing: float = 0.12
    flying: float = 0.5
    flying_range: float = 0.08
    edge: float = 0.05

    def at(self, distance: float) -> float:
        """Return the standard deviation of a range [m] at perpendicular incidence."""
        return self.sigma0 + self.k * distance**2

    def scaled(self, scale: float) -> NoiseProfile:
        """Return the profile whose errors are `scale` times as large at `scale` times the range."""
        lengths = {name: scale * getattr(self, name) for name in ("sigma0", "flying_range", "edge")}
        return replace(self, k=self.k / scale, **lengths)


#: Profiles by name: `ideal` has no errors; the others are measured cameras, from the best to the worst.
PROFILES = {
    "ideal": NoiseProfile(0.0, 0.0, dropout=0.0, grazing=0.0, flying=0.0),
    "clean": NoiseProfile(2e-3, 0.0),
    "nominal": NoiseProfile(3e-3, 1.5e-3),
    "harsh": NoiseProfile(5e-3, 3e-3),
}


@dataclass(frozen=True)
class DepthCamera:
    """Geometry of the camera. In its frame C, z is forward, x right and y down.

    Attributes:
        width: Number of pixels in a row.
        height: Number of pixels in a column.
        focal_length: Focal length along a row [px].
        least_range: Smallest measured range [m].
        largest_range: Largest measured range [m].
        focal_length_y: Focal length along a column [px]; None for the same as along a row.
        principal_point: Column and row where the optical axis intersects the image [px], 0 at the centre of the first
            pixel; None for the centre of the image.
    """

    width: int
    height: int
    focal_length: float
    least_range: float
    largest_range: float
    focal_length_y: float | None = None
    principal_point: tuple[float, float] | None = None

    @cached_property
    def intrinsics(self) -> tuple[float, float, float, float]:
        """Focal lengths along rows and columns and the principal point [px], 0 at the centre of the first pixel."""
        middle = (0.5 * self.width - 0.5, 0.5 * self.height - 0.5)
        return (
            self.focal_length,
            self.focal_length if self.focal_length_y is None else self.focal_length_y,
            *(middle if self.principal_point is None else self.principal_point),
        )

    @cached_property
    def directions(self) -> FloatArray:
        """Unit vectors through the centres of the pixels in C, shape (height, width, 3)."""
        fx, fy, cx, cy = self.intrinsics
        x = (np.arange(self.width) - cx) / fx
        y = (np.arange(self.height) - cy) / fy
        rays = np.stack([*np.meshgrid(x, y), np.ones((self.height, self.width))], axis=2)
        return np.asarray(rays / np.linalg.norm(rays, axis=2, keepdims=True))

    def in_units_of(self, length: float) -> DepthCamera:
        """Return the camera with all lengths divided by a length [m]."""
        return replace(self, least_range=self.least_range / length, largest_range=self.largest_range / length)


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """A depth frame.

    Attributes:
        time: Time of the frame [s].
        depth: Coordinate z in C of the point that each pixel sees [m], 0 if it sees nothing, shape (height, width).
        points: Points in C [m], in the order of the pixels, shape (n, 3).
        valid: Mask of the pixels that see something, shape (height, width).
        flags: ``out_of_view`` (no point), ``few_points``, ``inside`` (the camera is inside the target).
    """

    time: float
    depth: FloatArray
    points: FloatArray
    valid: BoolArray
    flags: tuple[str, ...]

    def in_units_of(self, length: float) -> Self:
        """Return the frame with all lengths divided by a length [m]."""
        return replace(self, depth=self.depth / length, points=self.points / length)


class TimeOfFlightCamera(Plugin):
    """A time-of-flight camera of 224 x 171 pixels with noise, dropouts and flying pixels.

    Attributes:
        profile: Errors of the camera: ``ideal`` (none), ``clean``, ``nominal`` or ``harsh``.
        width: Number of pixels in a row.
        height: Number of pixels in a column.
        focal_length: Focal length [px].
        least_range: Smallest measured range [m].
        largest_range: Largest measured range [m].
        scale: Factor for a larger scenario: at `scale` times the range, errors are `scale` times those of the profile.
    """

    profile: Literal["ideal", "clean", "nominal", "harsh"] = "nominal"
    width: int = Field(default=224, ge=1)
    height: int = Field(default=171, ge=1)
    focal_length: float = Field(default=186.4, gt=0.0)
    least_range: PositiveLength = 0.2  # type: ignore[valid-type]
    largest_range: PositiveLength = 4.0  # type: ignore[valid-type]
    scale: float = Field(default=1.0, gt=0.0)

    @model_validator(mode="after")
    def _is_range(self) -> TimeOfFlightCamera:
        if self.least_range >= self.largest_range:
            raise ValueError(
                f"least_range ({self.least_range:g} m) must be below largest_range ({self.largest_range:g} m)"
            )
        return self

    @property
    def geometry(self) -> DepthCamera:
        """The camera's geometry."""
        return DepthCamera(self.width, self.height, self.focal_length, self.least_range, self.largest_range)

    @property
    def noise(self) -> NoiseProfile:
        """The camera's errors."""
        return PROFILES[self.profile].scaled(self.scale)

    def __call__(self, target: Target) -> DepthRenderer:
        """Return a renderer of depth frames of a target."""
        return DepthRenderer(self.geometry, target.mesh, self.noise)


def no_frame(time: float) -> DepthFrame:
    """Return a frame without pixels."""
    return DepthFrame(time, np.zeros((0, 0)), np.zeros((0, 3)), np.zeros((0, 0), bool), ("out_of_view",))


class DepthRenderer:
    """Renderer of depth frames of a mesh. A frame depends only on the pose, the streams and its number."""

    def __init__(self, camera: DepthCamera, mesh: TriangleMesh, profile: NoiseProfile) -> None:
        self._camera = camera
        self._profile = profile
        self._scene: Any = require("embreex.rtcore_scene").EmbreeScene()
        # Keep a reference to the triangles: the scene refers to them but does not own them.
        self._triangles = require("embreex.mesh_construction").TriangleMesh(
            self._scene, np.ascontiguousarray(mesh.corners, np.float32)
        )

    def render(
        self, rotation: FloatArray, translation: FloatArray, streams: Streams, frame: int, time: float
    ) -> DepthFrame:
        """Render a frame.

        Args:
            rotation: R_MC, which takes coordinates in the camera's frame C to the target's frame M, shape (3, 3).
            translation: The camera's position in M [m], shape (3,).
            streams: The random streams of one mission.
            frame: Number of the frame.
            time: Time of the frame [s].
        """
        camera, profile = self._camera, self._profile
        shape = (camera.height, camera.width)
        distance, cosine, inside = self._cast(rotation, translation)
        seen = np.isfinite(distance) & (cosine >= profile.grazing)
        edges = _edges(np.where(seen, distance * camera.directions[..., 2], np.inf), profile.edge)
        safe = np.where(seen, distance, 0.0)
        sigma = profile.sigma0 + profile.k * safe**2 / np.maximum(cosine, 0.15)
        measured = safe + sigma * _fill(streams.normal, "camera.noise", shape, frame)
        flies = edges & (_fill(streams.uniform, "camera.flying", shape, frame) < profile.flying)
        shift = (2.0 * _fill(streams.uniform, "camera.shift", shape, frame) - 1.0) * profile.flying_range
        measured = np.where(flies, measured + shift, measured)
        kept = _fill(streams.uniform, "camera.dropout", shape, frame) >= profile.dropout
        valid = seen & kept & (measured >= camera.least_range) & (measured <= camera.largest_range)
        points = measured[valid][:, None] * camera.directions[valid]
        flags = ("out_of_view",) if len(points) == 0 else ("few_points",) * (len(points) < _FEW_POINTS)
        depth = np.where(valid, measured * camera.directions[..., 2], 0.0)
        return DepthFrame(time, depth, points, valid, (*flags, *(("inside",) * inside)))

    def _cast(self, rotation: FloatArray, translation: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
        """Return ranges of first hits (infinite without a hit), cosines of incidence, and if one is from inside."""
        rays = np.ascontiguousarray(self._camera.directions.reshape(-1, 3) @ rotation.T, np.float32)
        origins = np.ascontiguousarray(np.broadcast_to(translation, rays.shape), np.float32)
        hit = self._scene.run(origins, rays, output=True)
        missed = (hit["primID"] < 0) | (hit["tfar"] > _FAR)
        normal = hit["Ng"].astype(np.float64)
        length = np.linalg.norm(normal, axis=1)
        cosine = -np.einsum("ri,ri->r", normal, rays) / np.where(length > 0.0, length, 1.0)
        inside = bool((~missed & (cosine < -1e-3)).any())
        distance = np.where(missed, np.inf, hit["tfar"].astype(np.float64))
        shape = (self._camera.height, self._camera.width)
        return distance.reshape(shape), np.abs(cosine).reshape(shape), inside


def _edges(depth: FloatArray, jump: float) -> BoolArray:
    """Return a mask of the pixels that differ by more than `jump` from one of four neighbours; no depth is infinity."""
    found = np.zeros(depth.shape, np.bool_)
    finite = np.where(np.isfinite(depth), depth, 1e9)
    down, right = (np.abs(np.diff(finite, axis=axis)) > jump for axis in (0, 1))
    found[:-1] |= down
    found[1:] |= down
    found[:, :-1] |= right
    found[:, 1:] |= right
    return found


def _fill(draw: Any, purpose: str, shape: tuple[int, int], frame: int) -> FloatArray:
    """Sample an image in blocks of a stream that do not overlap with those of other frames."""
    size = shape[0] * shape[1]
    blocks = -(-size // _WORDS_PER_INDEX)
    parts = [draw(purpose, _WORDS_PER_INDEX, frame * blocks + block)[0] for block in range(blocks)]
    return np.concatenate(parts)[:size].reshape(shape)
