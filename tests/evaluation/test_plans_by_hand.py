"""The parts of the search for plans that need no search: what a step can give, and the plan of a flight."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.evaluation.optimiser import EFFORTS, _flown_plan, _within
from safe_inspect.planning.record import Burn


def test_how_long_is_searched() -> None:
    found = {name: (e.starts, e.chains, e.programs, e.temperature) for name, e in EFFORTS.items()}
    assert found == {
        "quick": (30, 3, 200, 0.004), "normal": (100, 4, 300, 0.004), "thorough": (1000, 12, 1500, 0.01)
    }  # fmt: skip


@pytest.mark.parametrize(
    ("starts", "burns", "hold", "fits"),
    [
        ([], [], 1, True),
        ([0], [[1.0, 2.0, 3.0]], 1, True),
        ([5], [[0.0, 0.0, 3.0 + 1e-9]], 1, False),
        ([5], [[-1.0 - 1e-9, 0.0, 0.0]], 1, False),
        ([5], [[-2.0, 4.0, -6.0]], 2, True),
        ([5], [[-2.0, 4.1, -6.0]], 2, False),
        ([5, 6], [[0.0, 2.0, 0.0], [0.0, 2.0, 0.0]], 2, True),
        ([5, 6], [[0.0, 2.0, 0.0], [0.0, 2.1, 0.0]], 2, False),
        ([5, 7], [[0.0, 4.0, 0.0], [0.0, 4.0, 0.0]], 2, True),
        ([5, 6], [[0.0, 4.0, 0.0], [0.0, -4.0, 0.0]], 2, True),
        ([6, 5], [[0.0, 4.0, 0.0], [0.0, 0.1, 0.0]], 2, False),
    ],
)
def test_burns_that_overlap_share_what_a_step_can_give(starts, burns, hold, fits) -> None:
    start, burn = np.array(starts, dtype=np.int64), np.array(burns, dtype=float).reshape(-1, 3)
    assert _within(start, burn, hold, np.array([1.0, 2.0, 3.0])) is fits


def test_the_plan_of_a_flight_has_its_steps_with_thrust() -> None:
    thrust = np.zeros((6, 3))
    thrust[1], thrust[4] = (0.5, 0.0, 0.0), (0.0, -0.25, 1.0)
    assert _flown_plan(thrust) == (
        Burn(step=1, steps=1, thrust=(0.5, 0.0, 0.0)), Burn(step=4, steps=1, thrust=(0.0, -0.25, 1.0))
    )  # fmt: skip
    assert _flown_plan(np.zeros((3, 3))) == ()
