from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.rta.constraints import RelativeState

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))  # the adversaries of a team, which the benchmark has too


@pytest.fixture(scope="session")
def draw() -> Callable[..., RelativeState]:
    """Return a function that draws relative states: directions and speeds isotropic, ranges uniform."""

    def states(
        seed: int, rows: int, nearest: float = 1.0, farthest: float = 900.0, fastest: float = 1.5
    ) -> RelativeState:  # fmt: skip
        generator = np.random.default_rng(seed)
        directions = generator.normal(size=(2, rows, 3))
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        return RelativeState(
            directions[0] * generator.uniform(nearest, farthest, (rows, 1)),
            directions[1] * generator.uniform(0.01, fastest, (rows, 1)),
            generator.uniform(0.0, 2.0 * np.pi, rows),
        )

    return states
