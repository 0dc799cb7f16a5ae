"""What the simulator refuses, and what it says then."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from safe_inspect.dynamics import Dynamics
from safe_inspect.simulators.resets.parameters import TruncatedNormalParameter
from safe_inspect.simulators.state import State, base_specs
from safe_inspect.simulators.team import TeamView
from safe_inspect.simulators.view import Group, Step, View
from safe_inspect.simulators.world import World


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"low": 2.0, "high": 2.0}, r"`low` \(2.0\) is not below `high` \(2.0\)"),
        ({"low": 3.0, "high": 2.0}, r"`low` \(3.0\) is not below `high` \(2.0\)"),
        (
            {"mu": 1.0, "std": 0.1, "low": 50.0, "high": 60.0},
            r"\[50.0, 60.0\] lies too far from `mu` \(1.0\) for a `std` of 0.1; widen one",
        ),
        (
            {"mu": 1.0, "std": 0.1, "low": -60.0, "high": -50.0},
            r"\[-60.0, -50.0\] lies too far from `mu` \(1.0\) for a `std` of 0.1; widen one",
        ),
    ],
)
def test_bounds_of_a_normal_that_no_draw_can_meet(fields, message):
    with pytest.raises(ValidationError, match=message):
        TruncatedNormalParameter(**fields)


def state(rows: int) -> State:
    return State(rows, base_specs(2, 1, 3, Dynamics.arrays))


def test_rows_are_copied_one_for_one():
    with pytest.raises(ValueError, match="1 rows are to be overwritten with 3"):
        state(4).put(np.array([1]), state(3))


def test_what_a_task_does_not_offer_is_named():
    group = Group("blue0", 0, 1, {})
    world = World(("blue0",), {"blue0": 0}, np.array([12.0]), 10.0)
    now = state(1)
    view = View(now, world, group)
    step = Step(view, view, *np.zeros((3, 1, 3)), np.zeros(1, dtype=bool), 10.0)
    for what, thing in (
        ("view of the team", TeamView(now, world)), ("view", view), ("step", step), ("state", now), ("world", world)
    ):  # fmt: skip
        with pytest.raises(AttributeError, match=f"the {what} of this task has no 'sun_angle'; ") as caught:
            thing.sun_angle  # noqa: B018
        assert caught.value.name == "sun_angle"
        assert not hasattr(thing, "sun_angle")
    for thing in (now, view, TeamView(now, world)):
        with pytest.raises(AttributeError, match="did you mean `position`"):
            thing.positon  # noqa: B018
    with pytest.raises(AttributeError, match="did you mean `control`"):
        step.contrl  # noqa: B018
