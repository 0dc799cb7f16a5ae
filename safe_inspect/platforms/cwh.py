"""The spacecraft of Clohessy-Wiltshire tasks."""

from __future__ import annotations

from safe_inspect.platforms.base import Part, Platform


class CWHPlatform(Platform):
    """A point mass with thrust along each axis of Hill's frame.

    Attributes:
        mass: Mass [kg].
    """

    def __call__(self, parts: tuple[Part, ...]) -> tuple[str, ...]:
        """Return the names of the parts.

        Raises:
            ValueError: Two parts have one name.
        """
        names = tuple(part.part_name for part in parts)
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two parts are named `{twice[0]}`; give one of them a `name` of its own")
        return names
