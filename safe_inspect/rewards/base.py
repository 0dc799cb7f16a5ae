"""Base of the rewards."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.view import Step
from safe_inspect.types import FloatArray


class Reward(Plugin):
    """A term of the reward: called with a `Step`, it returns the reward of each row [-], shape (R,).

    A reward has no memory and changes nothing that it is given.
    """

    kind: ClassVar[str] = "reward"

    @abstractmethod
    def __call__(self, step: Step) -> FloatArray:
        """Return the reward of each row [-], shape (R,)."""
