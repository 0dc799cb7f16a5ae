"""Glues of vehicles that turn: vectors in body or Hill axes, magnitude and direction, axes, angles between vectors."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import model_validator

from safe_inspect.dynamics.quaternion import rotate, rotate_back
from safe_inspect.glues.base import Bounds, Parts
from safe_inspect.glues.derived import DerivedGlue, norms_of
from safe_inspect.glues.observe_sensor import ObserveSensor
from safe_inspect.plugins.functor import functor_field
from safe_inspect.simulators.view import View
from safe_inspect.types import FloatArray

#: Lengths below this have no direction.
_LEAST = 1e-5
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


class RotateVectorToLocalRef3d(DerivedGlue):
    """A vector that another glue observes in Hill's frame, in body axes, ``R^T v``; or the other way; shape (R, 3).

    Attributes:
        wrapped: The glue of the attitude, then that of the vector.
        mode: What the first gives: a ``quaternion`` [x, y, z, w] from body to Hill's frame, or ``euler`` angles, of
            which the first, a turn about z [rad], is used.
        apply_inv: False: the vector stands in body axes and is turned into Hill's frame, ``R v``.
    """

    wrapped: tuple[functor_field("glue"), functor_field("glue")] = (  # type: ignore[valid-type]
        ObserveSensor(sensor="Sensor_Quaternion"),
        ObserveSensor(sensor="Sensor_Position"),
    )
    mode: Literal["quaternion", "euler"] = "quaternion"
    apply_inv: bool = True

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return the names of the vector's elements with the frame that they are turned into."""
        vector: Any = self.wrapped[1]
        return tuple(f"{name} ({'body' if self.apply_inv else 'Hill'})" for name in vector.names(parts))

    def limits(self, parts: Parts) -> Bounds:
        """Return what no component of the turned vector exceeds.

        Raises:
            ValueError: The wrapped glues give other numbers of elements.
        """
        rotation, vector = _bounds_of(self.wrapped, parts)
        wanted = 4 if self.mode == "quaternion" else 1
        if len(rotation[0]) < wanted or len(vector[0]) != 3:
            raise ValueError(
                f"it wraps an attitude by {self.mode} ({wanted} elements) and a vector (3), not glues of "
                f"{len(rotation[0])} and {len(vector[0])} elements"
            )
        return _within_ball(vector)

    def values(self, view: View) -> FloatArray:
        """Return the turned vector, shape (R, 3)."""
        rotation, vector = (glue(view) for glue in self._glues)
        if self.mode == "euler":
            half, zero = 0.5 * rotation[:, 0], np.zeros(len(rotation))
            rotation = np.stack((zero, zero, np.sin(half), np.cos(half)), axis=-1)
        return rotate_back(rotation, vector) if self.apply_inv else rotate(rotation, vector)

    @property
    def _glues(self) -> tuple[Any, ...]:
        return self.wrapped


class MagNorm3DGlue(DerivedGlue):
    """Length and unit vector of a vector that another glue observes, zeros below 1e-5; shape (R, 4).

    Attributes:
        wrapped: The glue.
    """

    wrapped: functor_field("glue") = ObserveSensor(sensor="Sensor_Position")  # type: ignore[valid-type]

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return ``|vector|``, and each element with ``direction``."""
        wrapped: Any = self.wrapped
        names = wrapped.names(parts)
        return f"|{_stem(names)}|", *(f"{name} direction" for name in names)

    def limits(self, parts: Parts) -> Bounds:
        """Return 0 and the largest length, then -1 and 1.

        Raises:
            ValueError: The wrapped glue gives no vector of three elements.
        """
        ((low, high),) = _bounds_of((self.wrapped,), parts)
        if len(low) != 3:
            raise ValueError(f"it wraps a vector of 3 elements, not one of {len(low)}")
        largest = _within_ball((low, high))[1][:1]
        return np.array([0.0, -1.0, -1.0, -1.0]), np.concatenate((largest, np.ones(3)))

    def values(self, view: View) -> FloatArray:
        """Return length and unit vector, shape (R, 4)."""
        wrapped: Any = self.wrapped
        vector = wrapped(view)
        size = norms_of(vector)
        found = np.concatenate((size, np.clip(vector / np.maximum(size, _LEAST), -1.0, 1.0)), axis=1)
        return np.where(size < _LEAST, 0.0, found)


class AngleToUnitVector(DerivedGlue):
    """The unit vector ``[cos a, -sin a, 0]`` of an angle that another glue observes [rad]; shape (R, 3).

    Attributes:
        wrapped: The glue.
        output_units: The peer's key, without effect: the vector has no unit.
    """

    wrapped: functor_field("glue") = ObserveSensor(sensor="Sensor_SunAngle")  # type: ignore[valid-type]
    output_units: str | None = None

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return the angle's name with ``x``, ``y`` and ``z``."""
        wrapped: Any = self.wrapped
        return tuple(f"{wrapped.names(parts)[0]}.{axis}" for axis in _AXES)

    def limits(self, parts: Parts) -> Bounds:
        """Return -1 and 1.

        Raises:
            ValueError: The wrapped glue gives several numbers.
        """
        ((low, _),) = _bounds_of((self.wrapped,), parts)
        if len(low) != 1:
            raise ValueError(f"it wraps one angle, not {len(low)} numbers")
        return np.full(3, -1.0), np.ones(3)

    def values(self, view: View) -> FloatArray:
        """Return the unit vector, shape (R, 3)."""
        wrapped: Any = self.wrapped
        angle = wrapped(view)[:, 0]
        return np.stack((np.cos(angle), -np.sin(angle), np.zeros_like(angle)), axis=-1)


class CoordinateAxisGlue(DerivedGlue):
    """The unit vector along a coordinate axis; shape (R, 3).

    Attributes:
        axis: The axis.
    """

    axis: Literal["x", "y", "z"] = "x"

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return ``AXIS_axis.x`` and so on."""
        return tuple(f"{self.axis}_axis.{name}" for name in _AXES)

    def limits(self, parts: Parts) -> Bounds:
        """Return 0 and 1."""
        return np.zeros(3), np.ones(3)

    def values(self, view: View) -> FloatArray:
        """Return the unit vector, shape (R, 3)."""
        return np.tile(np.array(_AXES[self.axis]), (view.num_rows, 1))


class DotProductGlue(DerivedGlue):
    """The inner product of two vectors that other glues observe; shape (R, 1).

    Attributes:
        wrapped: The two glues.
        normalize_vectors: Give the cosine of their angle, ``a b / (|a| |b| + 1e-5)``, within -1 and 1.
    """

    wrapped: tuple[functor_field("glue"), functor_field("glue")] = (  # type: ignore[valid-type]
        ObserveSensor(sensor="Sensor_Position"),
        ObserveSensor(sensor="Sensor_Velocity"),
    )
    normalize_vectors: bool = False

    @model_validator(mode="before")
    @classmethod
    def _two(cls, data: Any) -> Any:
        wrapped = data.get("wrapped") if isinstance(data, dict) else None
        if isinstance(wrapped, (list, tuple)) and len(wrapped) != 2:
            raise ValueError(f"it wraps two glues, not {len(wrapped)}")
        return data

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return ``a . b``."""
        first, second = (_stem(glue.names(parts)) for glue in self._glues)
        return (f"{first} . {second}",)

    def limits(self, parts: Parts) -> Bounds:
        """Return -1 and 1, or what the lengths allow.

        Raises:
            ValueError: The two vectors have different numbers of elements.
        """
        first, second = _bounds_of(self.wrapped, parts)
        if len(first[0]) != len(second[0]):
            raise ValueError(f"the two vectors have {len(first[0])} and {len(second[0])} elements")
        largest = np.ones(1) if self.normalize_vectors else _within_ball(first)[1][:1] * _within_ball(second)[1][:1]
        return -largest, largest

    def values(self, view: View) -> FloatArray:
        """Return the inner product, shape (R, 1)."""
        first, second = (glue(view) for glue in self._glues)
        total = np.zeros(len(first))
        for a, b in zip(first.T, second.T, strict=True):
            total = total + a * b
        product = total[:, None]
        if not self.normalize_vectors:
            return product
        return np.asarray(np.clip(product / (norms_of(first) * norms_of(second) + _LEAST), -1.0, 1.0))

    @property
    def _glues(self) -> tuple[Any, ...]:
        return self.wrapped


def _stem(names: tuple[str, ...]) -> str:
    """Return the name of a vector: that of its first element without the component, with its frame."""
    vector, _, component = names[0].partition(".")
    return f"{vector} {component.partition(' ')[2]}".strip()


def _bounds_of(wrapped: tuple[Any, ...], parts: Parts) -> list[Bounds]:
    return [glue.bounds(parts) for glue in wrapped]


def _within_ball(bounds: Bounds) -> Bounds:
    """Return bounds that hold for the components of a vector within others, however it is turned."""
    largest = norms_of(np.maximum(np.abs(bounds[0]), np.abs(bounds[1]))[None])[0] * (1.0 + 1e-12)
    return -np.repeat(largest, len(bounds[0])), np.repeat(largest, len(bounds[0]))
