"""How much room the certificates find: the largest margin that each still certifies, which looser bounds would lessen.

Samples of the motion say that nothing unsafe is certified; these numbers also say that little that is safe is refused.
A change that is meant to change them has to update the record:

    RECORD_RESULTS=1 python -m pytest -n 0 tests/rta/test_recorded_certificates.py
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from safe_inspect.rta.backup.closed_motion import NODE_STACK, closed_motion
from safe_inspect.rta.backup.holds import hold
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.backup.sequences import SAFE
from safe_inspect.rta.constraints.rows import Margins
from safe_inspect.rta.constraints.sets import NAMES
from safe_inspect.rta.team.plans import apart

from ..golden.records import check_record

RECORD = Path(__file__).with_name("certificates.json")
N, CASES = 0.001027, 24
#: The unit of each constraint's margin: length, speed, and range of coasting.
MARGIN = {name: (0.0, 1.0, 0.0) if name.endswith("vel") else (1.0, 0.0, 0.0) for name in NAMES} | {
    "PSM": (0.0, 0.0, 1.0)
}
#: Where a deputy is drawn for each constraint: nearest and farthest range [m], and largest speed [m/s].
WHERE = {"r_max": (780.0, 800.0, 0.3), "PSM": (12.0, 60.0, 0.1), "rel_vel": (11.0, 60.0, 0.1)}


def largest(certified: Callable[[float], bool], low: float, high: float) -> float:
    """Return the largest number that is certified, to rounding; minus infinity where the lowest is not."""
    if not certified(low):
        return -np.inf
    for _ in range(45):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if certified(middle) else (low, middle)
    return low


def drawn(generator: np.random.Generator, nearest: float, farthest: float, fastest: float) -> list[Any]:
    """Return states, sun angles and thrusts."""
    found = []
    for _ in range(CASES):
        directions = generator.normal(size=(2, 3))
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        angle, speed = generator.uniform(0.0, 2.0 * np.pi), fastest * generator.uniform(0.1, 1.0)
        position = generator.uniform(nearest, farthest) * directions[0]
        thrust = generator.uniform(-1.0, 1.0, 3) * generator.choice([0.02, 0.3, 1.0])
        state = (*position.tolist(), *(speed * directions[1]).tolist())
        found.append((state, (float(np.cos(angle)), float(np.sin(angle))), thrust))
    return found


@pytest.mark.parametrize("name", NAMES)
def test_the_margin_of_a_hold(name: str) -> None:
    """With the piece of the hold, and the moment of coasting from it, at which a larger margin is refused."""
    model, unit = BackupFilter({}, [name], several_holds=False)._model, np.array(MARGIN[name])
    work, where = np.empty((64, 4), np.int64), np.empty(2, np.int64)
    margins, places = [], []
    for x, sun, u in drawn(np.random.default_rng(NAMES.index(name)), *WHERE.get(name, (11.0, 60.0, 0.3))):

        def certified(margin: float) -> bool:
            three = Margins(*np.where(unit > 0.0, margin, -200.0).tolist())
            return bool(hold(model, x, sun, u, three, work, where) == SAFE)  # noqa: B023

        margin = largest(certified, -20.0, 100.0)
        margins.append(margin)
        certified(margin + 1e-9 * abs(margin))
        places.append(where.copy())
    assert np.isfinite(margins).sum() > CASES // 2
    check_record(RECORD, f"hold: {name}", {"margin": margins, "refused at": places})


@pytest.mark.parametrize("orbits", [0.25, 4.0])
def test_the_margin_of_coasting_from_a_hold_that_takes_many_cells(orbits: float) -> None:
    """Far ahead or behind, coasting remains near the chief for long: the number of cells ends the search."""
    horizon = orbits * 2.0 * np.pi / N
    model = BackupFilter({"psm_horizon": horizon}, ["PSM"], several_holds=False)._model
    work, where, generator = np.empty((64, 4), np.int64), np.empty(2, np.int64), np.random.default_rng(20)
    margins = []
    for _ in range(CASES):
        size = generator.uniform(20.0, 200.0)
        side, shift = generator.normal(size=2) * size * 0.02
        x = (shift, float(size), 0.1 * side, 1e-3 * N * size, -2.0 * N * shift, N * side)
        u = generator.uniform(-1.0, 1.0, 3) * 10.0 ** generator.uniform(-4.0, -1.0)

        def certified(margin: float) -> bool:
            three = Margins(-200.0, -200.0, margin)
            return bool(hold(model, x, (1.0, 0.0), u, three, work, where) == SAFE)  # noqa: B023

        margins.append(largest(certified, -10.0, 300.0))
    check_record(RECORD, f"coasting for {orbits} orbits", {"margin": margins})


@pytest.mark.parametrize("name", NAMES)
def test_the_margin_of_a_closed_motion(name: str) -> None:
    """With the nodes of the orbit that are remembered as the weakest."""
    unit = np.array((0.0, 0.0, 1.0) if name == "chief_collision" else MARGIN[name])
    model = BackupFilter({}, [name], several_holds=False)._model
    work, generator = np.empty(NODE_STACK), np.random.default_rng(30 + NAMES.index(name))
    margins, weakest = [], []
    for x, sun, _ in drawn(generator, *WHERE.get(name, (20.0, 120.0, 0.05))):
        weak = np.zeros(2, np.int64)
        at = (*x[:3], x[3], -2.0 * N * x[0], x[5])

        def certified(margin: float) -> bool:
            three = Margins(*np.where(unit > 0.0, margin, -200.0).tolist())
            return bool(closed_motion(model, at, sun, three, work, weak) == SAFE)  # noqa: B023

        margins.append(largest(certified, -150.0, 150.0))
        weakest.append(weak)
    check_record(RECORD, f"closed motion: {name}", {"margin": margins, "weakest": weakest})


@pytest.mark.parametrize("name", ["chief_collision", "sun"])
@pytest.mark.parametrize("margin", [0.0, 5e-4, 1e-3, 2e-3])
def test_the_largest_closed_motion_whose_finest_cells_miss_little(name: str, margin: float) -> None:
    """About the chief and opposite to the sun cone, where nothing else is in the way of motions of any size."""
    model = BackupFilter({}, [name], several_holds=False)._model
    work, generator, sizes = np.empty(NODE_STACK), np.random.default_rng(40), []
    for _ in range(6):
        across, ahead = generator.normal(size=2) * 0.1

        def certified(size: float) -> bool:
            at = (0.0, (2.0 + ahead) * size, across * size, N * size, 0.0, N * across * size)  # noqa: B023
            three = Margins(margin, margin, margin)
            return bool(closed_motion(model, at, (0.0, -1.0), three, work, np.zeros(2, np.int64)) == SAFE)

        sizes.append(largest(certified, 100.0, 1e5))
    assert np.isfinite(sizes).all()
    check_record(RECORD, f"largest closed motion: {name}, {margin}", {"size": sizes})


def test_the_distance_that_a_drifting_motion_keeps() -> None:
    """Drifting past fast or slowly, over the orbits for which it is certified, and at no drift at all."""
    generator, found = np.random.default_rng(50), []
    for k in range(80):
        size = generator.uniform(5.0, 40.0)
        position = generator.normal(size=3) * size
        velocity = generator.normal(size=3) * 0.5 * N * size
        drift = generator.choice([-1.0, 1.0]) * 10.0 ** generator.uniform(-5.0, 0.0)
        velocity[1] = -2.0 * N * position[0] + drift * N * size
        x = (*position.tolist(), *velocity.tolist())
        if k % 8 == 0:
            x = (0.0, size, 0.0, 0.0, 0.0, 0.0)
        found.append(largest(lambda reach: bool(apart(N, x, reach)), 0.0, 400.0))  # noqa: B023
    check_record(RECORD, "drifting", {"reach": found})
