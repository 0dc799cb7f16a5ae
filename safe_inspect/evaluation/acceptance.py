"""`acceptance`: the share of sampled initial states that are safe, and the share that each constraint refuses."""

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
    """First samples of a rejection sampler, and which of them its constraints refuse.

    Attributes:
        parameter: Name of the reset parameter.
        states: The sampled states by name, each with R rows.
        refused: For each constraint the mask of the rows that it refuses, shape (R,).
        accepted: Mask of the rows that no constraint refuses, shape (R,).
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
    """Sample initial states once each, without retries, and check them against the constraints.

    Args:
        spec: The task; one of its reset parameters must be a rejection sampler.
        draws: Number of samples, R.
        seed: Seed of the samples.

    Raises:
        ConfigError: The task has no rejection sampler.
        ValueError: `draws` is not positive.
    """
    if draws < 1:
        raise ValueError(f"`draws` must be at least 1, got {draws}")
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
    raise ConfigError(
        "no reset parameter of this task is a RejectionSampler, so all samples are accepted and there is no share"
    )
