"""The spacecraft of Clohessy-Wiltshire tasks."""

from __future__ import annotations

from typing import ClassVar

from safe_inspect.platforms.base import Part, Platform


class CWHPlatform(Platform):
    """A point mass with thrust along each axis of Hill's frame; `cwh` in configurations. It accepts any parts.

    Attributes:
        mass: Mass [kg].
    """

    short_name: ClassVar[str] = "cwh"

    def __call__(self, parts: tuple[Part, ...]) -> tuple[str, ...]:
        """Return the names of the parts."""
        return tuple(part.part_name for part in parts)


class SixDofPlatform(Platform):
    """A rigid body with thrusters and reaction wheels; `six-dof` in configurations. It accepts any parts.

    Attributes:
        mass: Mass [kg].
    """

    turns: ClassVar[bool] = True
    short_name: ClassVar[str] = "six-dof"

    def __call__(self, parts: tuple[Part, ...]) -> tuple[str, ...]:
        """Return the names of the parts."""
        return tuple(part.part_name for part in parts)
