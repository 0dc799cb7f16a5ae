"""`acceptance`: how many of the drawn initial states are safe, and which constraint refuses the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.errors import ConfigError
from safe_inspect.random.streams import Streams
from safe_inspect.rta.rejection_sampler import RejectionSampler
from safe_inspect.simulators.resets.parameters import Draw, Value
from safe_inspect.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Acceptance:
    """First draws of a rejection sampler, and what its constraints say of them.

    Attributes:
        parameter: Name of the reset parameter.
        states: The drawn states by name, each with R rows.
        refused: For each constraint the rows that it refuses, shape (R,).
        accepted: Rows that no constraint refuses, shape (R,).
    """

    parameter: str
    states: Mapping[str, FloatArray]
    refused: Mapping[str, BoolArray]
    accepted: BoolArray

    def __str__(self) -> str:
        count = len(self.accepted)
        width = max(len("constraint"), *map(len, self.refused)) if self.refused else 10
        lines = [
            f"{self.parameter}: {100.0 * self.accepted.mean():.2f} % of {count:,} draws are accepted",
            f"{'constraint':<{width}}  refuses  alone",
        ]
        total = np.sum(list(self.refused.values()), axis=0) if self.refused else np.zeros(count)
        for name, rows in self.refused.items():
            alone = rows & (total == 1)
            lines.append(f"{name:<{width}}  {100.0 * rows.mean():6.2f} % {100.0 * alone.mean():6.2f} %")
        return "\n".join(lines)


def acceptance(spec: EnvironmentSpec, draws: int = 100_000, seed: int = 0) -> Acceptance:
    """Draw initial states once each, without a second try, and test them.

    Args:
        spec: The task; one of its reset parameters is a rejection sampler.
        draws: Number of draws, R.
        seed: Seed of the draws.

    Raises:
        ConfigError: The task has no rejection sampler.
        ValueError: `draws` is not positive.
    """
    if draws < 1:
        raise ValueError(f"draws is at least 1, not {draws}")
    streams = Streams(seed, np.arange(draws), np.zeros(draws, dtype=np.int64))
    values: dict[str, Value] = {}
    for name, parameter in spec.reset.parameters.items():
        draw = Draw(streams, name, values=values)
        if isinstance(parameter, RejectionSampler):
            states, refused = parameter.candidates(draw)
            accepted = np.ones(draws, dtype=np.bool_)
            for rows in refused.values():
                accepted &= ~rows
            return Acceptance(name, states, refused, accepted)
        values[name] = parameter(draw)
    raise ConfigError("no reset parameter of this task is a RejectionSampler, so every draw is accepted")
