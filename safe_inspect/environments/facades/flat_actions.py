"""`FlatDiscreteActions`: a single discrete action in place of one per controller, for learners that need it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Discrete, MultiDiscrete

from safe_inspect.errors import ArgumentError, SafeInspectError
from safe_inspect.types import AnyArray, IntArray


def flat_space(choices: Sequence[int]) -> Discrete[np.int64]:
    """Return the space with one index for each combination of choices, given their numbers of values K_1 to K_A."""
    return Discrete(int(np.prod(choices)))


def from_flat(index: AnyArray | int, choices: Sequence[int]) -> IntArray:
    """Return the choices that an index encodes, the last choice varying fastest, int64, shape (..., A)."""
    return np.stack(np.unravel_index(np.asarray(index, dtype=np.int64), tuple(choices)), axis=-1)


class FlatDiscreteActions(gymnasium.ActionWrapper[Any, Any, Any]):
    """Wrapper that makes an environment's action a single index: three controllers of three levels make 27 choices.

    Index i encodes the levels ``numpy.unravel_index(i, nvec)``, the last controller varying fastest. Learners such as
    DQN need such an action.

    Args:
        env: An environment whose actions are levels (`gymnasium.spaces.MultiDiscrete`).

    Raises:
        SafeInspectError: The actions are real numbers.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        if not isinstance(env.action_space, MultiDiscrete):
            raise SafeInspectError("the actions are real numbers; use a task with levels of thrust")
        super().__init__(env)
        self._counts = tuple(int(count) for count in env.action_space.nvec)
        self._last = int(np.prod(self._counts)) - 1
        self.action_space = flat_space(self._counts)

    def action(self, action: Any) -> Any:
        """Return the levels that an index encodes, int64, shape (A,).

        Raises:
            ArgumentError: The action is not an index of the space.
        """
        index = np.asarray(action)
        if index.ndim or index != np.clip(np.floor(index), 0, self._last):
            raise ArgumentError(f"the action is {action!r}; expected a whole number from 0 to {self._last}")
        return from_flat(int(index), self._counts)
