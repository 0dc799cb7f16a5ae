"""Target models and tumbles."""

from __future__ import annotations

import math

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from safe_inspect.dynamics.inertia import principal_axes
from safe_inspect.dynamics.quaternion import exp, normalise, to_matrix
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.plugins.base import DataFile, TargetModel, Tumble
from safe_inspect.rendezvous.poses import check_unit
from safe_inspect.rendezvous.target.box import inertia_of_boxes, mesh_of_boxes
from safe_inspect.rendezvous.target.envisat import envisat
from safe_inspect.rendezvous.target.mesh import mesh_target, read_mesh
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray
from safe_inspect.units import Angle, Length, NonNegativeAngularRate, PositiveLength, quantity

_Moment = quantity("kg m^2")

_Point = tuple[Length, Length, Length]  # type: ignore[valid-type]
_Row = tuple[_Moment, _Moment, _Moment]  # type: ignore[valid-type]
InertiaMatrix = tuple[_Row, _Row, _Row]


class EnvisatTarget(TargetModel):
    """Envisat as boxes for its bus, boom, radar antenna and solar array.

    Attributes:
        scale: Its size relative to the satellite's.
        mating_point: Where the chaser's centre shall be, in the principal axes [m].
        detail_seed: Seed of the small boxes on the bus that only sensors see.
    """

    scale: float = Field(default=0.05, gt=0.0)
    mating_point: _Point = (0.25, 0.0, 0.42)
    detail_seed: int = Field(default=0, ge=0)

    def __call__(self) -> Target:
        """Return the target."""
        return envisat(self.scale, np.array(self.mating_point), self.detail_seed)


class Box(BaseModel):
    """One box of a target.

    Attributes:
        centre: Its centre in the model's frame [m].
        half_size: Half of its lengths along its own axes [m].
        rotation: Rotation vector that takes its axes to the model's [rad].
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    centre: _Point = (0.0, 0.0, 0.0)
    half_size: tuple[PositiveLength, PositiveLength, PositiveLength] = (0.3, 0.2, 0.1)  # type: ignore[valid-type]
    rotation: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)  # type: ignore[valid-type]


def _checked_inertia(inertia: InertiaMatrix | None) -> InertiaMatrix | None:
    """Check that an inertia is that of a rigid body."""
    if inertia is not None:
        principal_axes(np.array(inertia))
    return inertia


class BoxTarget(TargetModel):
    """A target of boxes; their common centre of mass is the origin of its frame.

    Attributes:
        boxes: The boxes.
        inertia: Inertia about the centre of mass [kg m^2], which is then the origin; null for one density of all boxes.
        mating_point: Where the chaser's centre shall be, in the principal axes [m].
    """

    boxes: tuple[Box, ...] = Field(default=(Box(),), min_length=1)
    inertia: InertiaMatrix | None = None
    mating_point: _Point = (0.0, 0.0, 0.5)

    _check_inertia = field_validator("inertia")(_checked_inertia)

    def __call__(self) -> Target:
        """Return the target."""
        rotation = to_matrix(exp(np.array([box.rotation for box in self.boxes])))
        centre = np.array([box.centre for box in self.boxes])
        half_size = np.array([box.half_size for box in self.boxes])
        inertia: FloatArray | None = None if self.inertia is None else np.array(self.inertia)
        if inertia is None:
            volume = half_size.prod(axis=1, keepdims=True)
            centre = centre - (volume * centre).sum(axis=0) / volume.sum()
            inertia = inertia_of_boxes(OrientedBoxes(centre, half_size, rotation), 1.0)
        boxes = OrientedBoxes(centre, half_size, rotation)
        return Target(boxes, mesh_of_boxes(boxes), inertia, np.array(self.mating_point))


class MeshTarget(TargetModel):
    """A target from a closed mesh file (STL, PLY or OBJ), covered by boxes.

    Attributes:
        path: The file; a relative name is looked for beside the configuration that names it.
        scale: What its lengths are multiplied by to get metres.
        inertia: Inertia about the mesh's origin [kg m^2], which is the centre of mass; null for one density inside.
        mating_point: Where the chaser's centre shall be, in the principal axes [m].
        boxes: Largest number of boxes that cover it.
    """

    path: DataFile
    scale: float = Field(default=1.0, gt=0.0)
    inertia: InertiaMatrix | None = None
    mating_point: _Point = (0.0, 0.0, 0.5)
    boxes: int = Field(default=12, ge=1)

    _check_inertia = field_validator("inertia")(_checked_inertia)

    def __call__(self) -> Target:
        """Return the target."""
        mesh = read_mesh(self.path, self.scale)
        inertia: FloatArray | None = None if self.inertia is None else np.array(self.inertia)
        return mesh_target(mesh, inertia, np.array(self.mating_point), self.boxes, self.path)


class TriAxialTumble(Tumble):
    """A tumble about a direction that is given in the principal axes, from a uniform random attitude.

    Attributes:
        rate: Angular rate at the start [rad/s].
        direction: Direction of the angular velocity in the principal axes; its length does not matter.
        attitude: Quaternion [x, y, z, w] at the start, from the principal axes to W; null for a random one.
    """

    rate: NonNegativeAngularRate = 0.08726646259971647  # type: ignore[valid-type]
    direction: tuple[float, float, float] = (0.7, 0.5, 0.5)
    attitude: tuple[float, float, float, float] | None = None

    @field_validator("direction", "attitude")
    @classmethod
    def _has_length(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None and not (all(map(math.isfinite, value)) and any(value)):
            raise ValueError(f"{list(value)} is no direction and no attitude: give finite components, not all 0")
        return value

    @field_validator("attitude")
    @classmethod
    def _is_rotation(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is not None:
            check_unit("the attitude", value)
        return value

    def __call__(self, streams: Streams) -> tuple[FloatArray, FloatArray]:
        """Return attitude, shape (4,), and angular velocity in T [rad/s], shape (3,)."""
        direction = np.array(self.direction)
        velocity = self.rate * direction / np.linalg.norm(direction)
        if self.attitude is not None:
            return normalise(np.array(self.attitude)), velocity
        return random_attitude(streams), velocity


class FlatSpin(Tumble):
    """A spin about a principal axis, from a uniform random attitude.

    Attributes:
        rate: Angular rate [rad/s].
        axis: The axis: 1 of the least and 3 of the largest moment; about 2 it is unstable.
        wobble: Angle between the angular velocity and the axis [rad].
    """

    rate: NonNegativeAngularRate = 0.08726646259971647  # type: ignore[valid-type]
    axis: int = Field(default=3, ge=1, le=3)
    wobble: Angle = 0.0  # type: ignore[valid-type]

    def __call__(self, streams: Streams) -> tuple[FloatArray, FloatArray]:
        """Return attitude, shape (4,), and angular velocity in T [rad/s], shape (3,)."""
        velocity = np.zeros(3)
        velocity[self.axis - 1] = self.rate * np.cos(self.wobble)
        velocity[self.axis % 3] = self.rate * np.sin(self.wobble)
        return random_attitude(streams), velocity


class RandomTumble(Tumble):
    """A tumble about a uniform random direction with a uniform random rate, from a uniform random attitude.

    Attributes:
        least_rate: Least angular rate [rad/s].
        largest_rate: Largest angular rate [rad/s].
    """

    least_rate: NonNegativeAngularRate = 0.03490658503988659  # type: ignore[valid-type]
    largest_rate: NonNegativeAngularRate = 0.08726646259971647  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _is_range(self) -> RandomTumble:
        if self.least_rate > self.largest_rate:
            raise ValueError(
                f"least_rate ({self.least_rate:.4g} rad/s) is more than largest_rate ({self.largest_rate:.4g} rad/s)"
            )
        return self

    def __call__(self, streams: Streams) -> tuple[FloatArray, FloatArray]:
        """Return attitude, shape (4,), and angular velocity in T [rad/s], shape (3,)."""
        direction = streams.normal("tumble.direction", 3)[0]
        share = float(streams.uniform("tumble.rate")[0, 0])
        rate = self.least_rate + share * (self.largest_rate - self.least_rate)
        return random_attitude(streams), rate * direction / np.linalg.norm(direction)


def random_attitude(streams: Streams) -> FloatArray:
    """Return a uniform random attitude, shape (4,)."""
    return normalise(streams.normal("tumble.attitude", 4)[0])
