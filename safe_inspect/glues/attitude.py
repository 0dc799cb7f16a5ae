"""Glues for vehicles with attitude: rotated vectors, magnitude and direction, coordinate axes, inner products."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.rotation_row import rotated, rotated_back
from safe_inspect.geometry.distance import lengths
from safe_inspect.glues.base import Bounds, Parts
from safe_inspect.glues.observations import DerivedGlue, ObserveSensor
from safe_inspect.platforms.copies import copy_vector
from safe_inspect.plugins.functor import functor_field
from safe_inspect.simulators import Group, World
from safe_inspect.simulators.row_terms import GlueReading, RowTerm, SensorReading
from safe_inspect.tasks.inspection.sun import sun_row
from safe_inspect.types import FloatArray

#: Vectors shorter than this have no direction.
_LEAST = 1e-5
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@njit
def _turned(back: float, euler: float, rotation: FloatArray, vector: FloatArray, out: FloatArray) -> None:
    if euler != 0.0:
        half = 0.5 * rotation[0]
        q = (0.0, 0.0, math.sin(half), math.cos(half))
    else:
        q = (rotation[0], rotation[1], rotation[2], rotation[3])
    if back != 0.0:
        out[0], out[1], out[2] = rotated_back(q, vector[0], vector[1], vector[2])
    else:
        out[0], out[1], out[2] = rotated(q, vector[0], vector[1], vector[2])


@njit
def _length(vector: FloatArray) -> float:
    total = 0.0
    for k in range(len(vector)):
        total += vector[k] * vector[k]
    return math.sqrt(total)


@njit
def _magnitude_and_direction(vector: FloatArray, out: FloatArray) -> None:
    size = _length(vector)
    out[0] = size if size >= _LEAST else 0.0
    for k in range(3):
        out[1 + k] = min(max(vector[k] / size, -1.0), 1.0) if size >= _LEAST else 0.0


@njit
def _direction(angle: FloatArray, out: FloatArray) -> None:
    out[0], out[1], out[2] = sun_row(angle[0])


@njit
def _product(normalises: float, first: FloatArray, second: FloatArray, out: FloatArray) -> None:
    total = 0.0
    for k in range(len(first)):
        total += first[k] * second[k]
    if normalises != 0.0:
        total = min(max(total / (_length(first) * _length(second) + _LEAST), -1.0), 1.0)
    out[0] = total


class RotateVectorToLocalRef3d(DerivedGlue):
    """Rotation of another glue's vector from Hill's frame to body axes, ``R^T v``, or the reverse; shape (R, 3).

    Attributes:
        wrapped: The glue that observes the attitude, then the glue that observes the vector.
        mode: Form of the attitude: a ``quaternion`` [x, y, z, w] from body to Hill's frame, or ``euler`` angles, of
            which only the first, the rotation about z [rad], is used.
        apply_inv: If False, the vector is given in body axes and is rotated to Hill's frame, ``R v``.
    """

    row_size: ClassVar[int] = 3

    wrapped: tuple[functor_field("glue"), functor_field("glue")] = (  # type: ignore[valid-type]
        ObserveSensor(sensor="Sensor_Quaternion"),
        ObserveSensor(sensor="Sensor_Position"),
    )
    mode: Literal["quaternion", "euler"] = "quaternion"
    apply_inv: bool = True

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return the names of the vector's elements, each followed by the frame of the result."""
        vector: Any = self.wrapped[1]
        return tuple(f"{name} ({'body' if self.apply_inv else 'Hill'})" for name in vector.names(parts))

    def limits(self, parts: Parts) -> Bounds:
        """Return bounds of the components of the rotated vector.

        Raises:
            ValueError: A wrapped glue has the wrong number of elements.
        """
        rotation, vector = _bounds_of(self.wrapped, parts)
        wanted = 4 if self.mode == "quaternion" else 1
        if len(rotation[0]) < wanted or len(vector[0]) != 3:
            raise ValueError(
                f"`wrapped` must be an attitude in the form {self.mode} ({wanted} elements) and a vector (3), not "
                f"glues of {len(rotation[0])} and {len(vector[0])} elements"
            )
        return _within_ball(vector)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that writes the rotated vector."""
        rotation, vector = (_wrapped_input(glue, group) for glue in self.wrapped)
        euler = self.mode == "euler"
        return RowTerm(_turned, (float(self.apply_inv), float(euler), rotation, vector))


class MagNorm3DGlue(DerivedGlue):
    """Length and unit vector of the vector that another glue observes, zeros below length 1e-5; shape (R, 4).

    Attributes:
        wrapped: The glue that observes the vector.
    """

    row_size: ClassVar[int] = 4

    wrapped: functor_field("glue") = ObserveSensor(sensor="Sensor_Position")  # type: ignore[valid-type]

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return ``|vector|``, then the name of each element followed by ``direction``."""
        wrapped: Any = self.wrapped
        names = wrapped.names(parts)
        return f"|{_stem(names)}|", *(f"{name} direction" for name in names)

    def limits(self, parts: Parts) -> Bounds:
        """Return 0 and the largest length, then -1 and 1 for the elements of the unit vector.

        Raises:
            ValueError: The wrapped glue does not have three elements.
        """
        ((low, high),) = _bounds_of((self.wrapped,), parts)
        if len(low) != 3:
            raise ValueError(f"`wrapped` must be a vector of 3 elements, not of {len(low)}")
        largest = _within_ball((low, high))[1][:1]
        return np.array([0.0, -1.0, -1.0, -1.0]), np.concatenate((largest, np.ones(3)))

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that writes length and unit vector."""
        return RowTerm(_magnitude_and_direction, (_wrapped_input(self.wrapped, group),))


class AngleToUnitVector(DerivedGlue):
    """The unit vector ``[cos a, -sin a, 0]`` of an angle that another glue observes [rad]; shape (R, 3).

    Attributes:
        wrapped: The glue that observes the angle.
        output_units: A key of safe-autonomy-sims, without effect because the vector has no unit.
    """

    row_size: ClassVar[int] = 3

    wrapped: functor_field("glue") = ObserveSensor(sensor="Sensor_SunAngle")  # type: ignore[valid-type]
    output_units: str | None = None

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return the angle's name followed by ``.x``, ``.y`` and ``.z``."""
        wrapped: Any = self.wrapped
        return tuple(f"{wrapped.names(parts)[0]}.{axis}" for axis in _AXES)

    def limits(self, parts: Parts) -> Bounds:
        """Return -1 and 1.

        Raises:
            ValueError: The wrapped glue has more than one element.
        """
        ((low, _),) = _bounds_of((self.wrapped,), parts)
        if len(low) != 1:
            raise ValueError(f"`wrapped` must be one angle, not {len(low)} numbers")
        return np.full(3, -1.0), np.ones(3)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that writes the unit vector."""
        return RowTerm(_direction, (_wrapped_input(self.wrapped, group),))


class CoordinateAxisGlue(DerivedGlue):
    """The unit vector along a coordinate axis; shape (R, 3).

    Attributes:
        axis: Name of the axis.
    """

    row_size: ClassVar[int] = 3

    axis: Literal["x", "y", "z"] = "x"

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return ``AXIS_axis.x`` and so on."""
        return tuple(f"{self.axis}_axis.{name}" for name in _AXES)

    def limits(self, parts: Parts) -> Bounds:
        """Return 0 and 1."""
        return np.zeros(3), np.ones(3)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that writes the unit vector."""
        return RowTerm(copy_vector, (np.array(_AXES[self.axis]),))


class DotProductGlue(DerivedGlue):
    """The inner product of two vectors that other glues observe; shape (R, 1).

    Attributes:
        wrapped: The two glues that observe the vectors.
        normalize_vectors: Return the cosine of the angle, ``a b / (|a| |b| + 1e-5)``, clipped to -1 and 1.
    """

    row_size: ClassVar[int] = 1

    wrapped: tuple[functor_field("glue"), functor_field("glue")] = (  # type: ignore[valid-type]
        ObserveSensor(sensor="Sensor_Position"),
        ObserveSensor(sensor="Sensor_Velocity"),
    )
    normalize_vectors: bool = False

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return ``a . b``."""
        glues: tuple[Any, ...] = self.wrapped
        first, second = (_stem(glue.names(parts)) for glue in glues)
        return (f"{first} . {second}",)

    def limits(self, parts: Parts) -> Bounds:
        """Return -1 and 1 for normalised vectors, otherwise the largest product of the two lengths.

        Raises:
            ValueError: The two vectors have different numbers of elements.
        """
        first, second = _bounds_of(self.wrapped, parts)
        if len(first[0]) != len(second[0]):
            raise ValueError(f"the two vectors have {len(first[0])} and {len(second[0])} elements")
        largest = np.ones(1) if self.normalize_vectors else _within_ball(first)[1][:1] * _within_ball(second)[1][:1]
        return -largest, largest

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that writes the inner product."""
        first, second = (_wrapped_input(glue, group) for glue in self.wrapped)
        return RowTerm(_product, (float(self.normalize_vectors), first, second))


def _stem(names: tuple[str, ...]) -> str:
    """Return the name of a vector: its first element's name without the component, followed by its frame."""
    vector, _, component = names[0].partition(".")
    return f"{vector} {component.partition(' ')[2]}".strip()


def _bounds_of(wrapped: tuple[Any, ...], parts: Parts) -> list[Bounds]:
    return [glue.bounds(parts) for glue in wrapped]


def _within_ball(bounds: Bounds) -> Bounds:
    """Return bounds of a vector's components that hold for every rotation, for given bounds of the components."""
    largest = lengths(np.maximum(np.abs(bounds[0]), np.abs(bounds[1]))[None]) * (1.0 + 1e-12)
    return -np.repeat(largest, len(bounds[0])), np.repeat(largest, len(bounds[0]))


def _wrapped_input(glue: Any, group: Group) -> SensorReading | GlueReading:
    """Return the observation of a wrapped glue as an input of a row kernel.

    Args:
        glue: The wrapped glue.
        group: The agents whose sensors are read.
    """
    if type(glue) is ObserveSensor:
        scale, normalizer, _, _ = glue.prepared(group.sensors[glue.sensor])
        if scale == 1.0 and normalizer is None:
            return SensorReading(glue.sensor)
    return GlueReading(glue, len(glue.names(group.sensors)))
