"""The plan of a flight, from the thrust of every step."""

from __future__ import annotations

import numpy as np

from safe_inspect.policies.plan_record import Burn, flight_plan


def test_the_plan_of_a_flight_has_its_steps_with_thrust() -> None:
    thrust = np.zeros((8, 3))
    thrust[1], thrust[4], thrust[5:8] = (0.5, 0.0, 0.0), (0.0, -0.25, 1.0), (0.0, -0.5, 1.0)
    assert flight_plan(thrust) == (
        Burn(step=1, steps=1, thrust=(0.5, 0.0, 0.0)),
        Burn(step=4, steps=1, thrust=(0.0, -0.25, 1.0)),
        Burn(step=5, steps=3, thrust=(0.0, -0.5, 1.0)),
    )
    assert flight_plan(np.zeros((3, 3))) == ()
    assert flight_plan(np.zeros((0, 3))) == ()
