"""The docking region about a reference that moves: only motion relative to it counts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.tasks.docking.speed_limit import DOCKED, OUTSIDE, TOO_FAST, docking_outcome, entry_speed

RADIUS, STEP = 0.5, 1.0
#: Speed limit 0.2 m/s within 0.5 m, and from there on by a line; the region and the step.
RULE = np.array([0.2, 0.5, 0.002, 1.0, RADIUS, STEP])
vectors = st.tuples(*[st.floats(-2.0, 2.0)] * 3)


def passage(start, speed, bend):
    """Return position and velocity before and after a step, and the cubic between them as a function of the share."""
    before, velocity = np.array(start), np.array(speed)
    jerk = np.array(bend)
    after = before + velocity * STEP + jerk * STEP**3 / 6.0
    ends = before, velocity, after, velocity + 0.5 * jerk * STEP**2
    return ends, lambda t: before + velocity * t + jerk * t**3 / 6.0, lambda t: velocity + 0.5 * jerk * t**2


@settings(max_examples=200, deadline=None)
@given(start=vectors, speed=vectors, bend=vectors, drift=vectors, place=vectors)
def test_a_reference_that_moves_along_changes_nothing(start, speed, bend, drift, place):
    (before, velocity, after, last), path, rate = passage(start, speed, bend)
    rest = np.zeros(3)
    still = entry_speed(RADIUS, STEP, before, velocity, after, last, rest, rest)
    drift, place = np.array(drift), np.array(place)
    moving = entry_speed(
        RADIUS, STEP, before + place - drift * STEP, velocity + drift, after + place, last + drift, place, drift
    )
    distances = np.linalg.norm([path(t) for t in np.linspace(0.0, STEP, 400)], axis=-1)
    if abs(distances.min() - RADIUS) < 5e-3:
        return  # a grazing passage, which rounding decides
    assert moving == pytest.approx(still, abs=1e-6)
    inside = np.flatnonzero(distances <= RADIUS)
    if len(inside):
        assert moving == pytest.approx(np.linalg.norm(rate(inside[0] * STEP / 399)), abs=2e-2)
    else:
        assert moving == -1.0


@pytest.mark.parametrize("drift", [(0.0, 0.0, 0.0), (0.7, -0.4, 0.3), (0.0, -5.0, 0.0)])
@pytest.mark.parametrize(("speed", "outcome"), [(0.1, DOCKED), (0.3, TOO_FAST), (-0.3, OUTSIDE)])
def test_the_speed_against_the_reference_decides(drift, speed, outcome):
    """It comes from 0.51 m away, towards the reference or away from it."""
    drift, along = np.array(drift), np.array([0.0, 0.6, 0.8])
    end = (RADIUS + 0.01 - speed * STEP) * along
    found = docking_outcome(
        RULE, (RADIUS + 0.01) * along - drift * STEP, drift - speed * along, end, drift - speed * along,
        np.zeros(3), drift,
    )  # fmt: skip
    assert found == outcome
