"""`Imitation`: how a policy learns from a scripted one before its training begins."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from safe_inspect.config.messages.report import problems_of
from safe_inspect.errors import Problem
from safe_inspect.plugins.functor import functor_field

#: The key of `rllib_configs`.
IMITATION = "imitation"


class Imitation(BaseModel):
    """Behaviour cloning of a scripted policy, with DAgger (Ross, Gordon and Bagnell, AISTATS 2011).

    In the first round the teacher flies the episodes, in each further one the policy as it is; the teacher says in
    every step what it would do. After each round the policy learns from all rounds, and behind the last its value
    function learns the returns of episodes of its own.

    Attributes:
        teacher: The scripted policy.
        rounds: Number of rounds; 1 is behaviour cloning.
        episodes: Episodes of a round.
        epochs: How often every step is used in a round.
        minibatch_size: Steps of a minibatch.
        lr: Learning rate.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    teacher: functor_field("policy")  # type: ignore[valid-type]
    rounds: int = Field(default=4, ge=1, le=1000)
    episodes: int = Field(default=64, ge=1, le=100_000)
    epochs: int = Field(default=5, ge=1, le=10_000)
    minibatch_size: int = Field(default=1024, ge=1)
    lr: float = Field(default=1e-3, gt=0.0, le=1.0)


def imitation_problems(value: Any, path: str, algorithm: str) -> list[Problem]:
    """Return what is wrong with the key `imitation`.

    Args:
        value: Its value.
        path: Where it stands.
        algorithm: Name of the algorithm.
    """
    if algorithm != "PPO":
        return [Problem("only PPO has the key `imitation`", path, hint="remove it")]
    if not isinstance(value, Mapping):
        return [Problem(f"a mapping with a `teacher` is wanted, not {value!r}", path)]
    try:
        Imitation.model_validate(value)
    except ValidationError as error:
        found = problems_of(error, value, model=Imitation)
        return [Problem(item.message, f"{path}.{item.path}", hint=item.hint) for item in found]
    return []
