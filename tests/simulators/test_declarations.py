"""What components declare by default, the ranges of reset parameters, and components that are given twice."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from safe_inspect.dynamics.base import MotionLimits
from safe_inspect.errors import ArgumentError
from safe_inspect.simulators.component import Component, RunningComponent, require_different
from safe_inspect.simulators.resets.parameters import ConstantParameter, TruncatedNormalParameter, UniformParameter


class Plain(Component, name="PlainComponent"):
    """A component that declares nothing."""

    def __call__(self, world: Any, num_envs: int) -> RunningComponent:
        return RunningComponent()


def test_a_component_declares_nothing_by_default() -> None:
    plain = Plain()
    assert (plain.bodies, dict(plain.radii), dict(plain.allowed), plain.estimates) == ((), {}, {}, False)
    assert plain.disturbance_bounds(MotionLimits(10.0, 12.0, 1.0)) is None
    running, control = plain(None, 3), object()
    assert running.actuate(SimpleNamespace(), control) is control
    assert (dict(running.info(None)), dict(running.team_info(None)), running.shared_state(None)) == ({}, {}, ())
    assert [dict(find()) for find in (running.of_world, running.of_view, running.of_team, running.of_step)] == [{}] * 4
    assert running.state_dict() == {}


def test_two_components_of_one_class_are_refused() -> None:
    other = SimpleNamespace(registered_name="Other", estimates=False)
    require_different([Plain(), other])  # type: ignore[list-item]
    for given in ([Plain(), Plain()], [other, Plain(), Plain()]):
        with pytest.raises(ArgumentError, match="there are 2 components PlainComponent; combine them into one"):
            require_different(given)  # type: ignore[arg-type]


def test_the_support_of_a_parameter_is_its_range_in_si() -> None:
    degree = math.pi / 180.0
    assert ConstantParameter(value=90.0, units="deg").support == pytest.approx((90.0 * degree, 90.0 * degree))
    assert UniformParameter(low=-2.0, high=3.0, units="km").support == (-2000.0, 3000.0)
    normal = TruncatedNormalParameter(mu=0.0, std=5.0, low=-1.0, high=4.0, units="deg")
    assert normal.support == pytest.approx((-degree, 4.0 * degree))
