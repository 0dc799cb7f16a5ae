"""What a component or dynamics declare to do to the motion is compared with what they do."""

from __future__ import annotations

from typing import ClassVar

import pytest

from safe_inspect.compiling import njit
from safe_inspect.dynamics import NO_DISTURBANCE, DisturbanceBounds, Dynamics
from safe_inspect.dynamics.clohessy_wiltshire import clohessy_wiltshire_row
from safe_inspect.dynamics.cwh import transition
from safe_inspect.simulators import Component, RunningComponent
from safe_inspect.tasks.bounded_disturbance import BoundedDisturbance
from safe_inspect.testing import check_plugin
from safe_inspect.units import NonNegativeSpeed

from .reports import breaches

BOUNDS = {
    "velocity": 1e-3, "position_error": 0.1, "velocity_error": 2e-3, "thrust_gain": 0.05, "thrust_direction": 0.1
}  # fmt: skip


class Push(Component, name="TestPush"):
    """Adds a velocity along y in every step.

    Attributes:
        added: What it adds in a step [m/s].
        declared: What it says that it adds [m/s]; negative: nothing.
    """

    added: NonNegativeSpeed = 0.01
    declared: float = 0.01

    def __call__(self, world, num_envs):
        """Return the running component."""
        return _RunningPush(self.added)

    def disturbance_bounds(self, limits):
        """Return what is declared."""
        return None if self.declared < 0.0 else DisturbanceBounds(velocity=self.declared)


class _RunningPush(RunningComponent):
    def __init__(self, added):
        self._added = added

    def step(self, state, running):
        state["velocity"][:, 0, 1] += self._added


@njit
def leaning_row(leaning, phi, gamma, position, velocity, control, mass):
    rate = clohessy_wiltshire_row(phi, gamma, position, velocity, control, mass)
    position[1] += 0.5 * leaning * 100.0
    velocity[1] += leaning * 10.0
    return rate


class Leaning(Dynamics, name="TestLeaning"):
    """Clohessy-Wiltshire motion in steps of 10 s with a further acceleration along y.

    Attributes:
        acceleration: The acceleration [m/s^2].
        declared: What it says that it is [m/s^2]; negative: nothing.
    """

    row: ClassVar = leaning_row

    acceleration: float = 1e-4
    declared: float = 1e-4

    def __call__(self, step_size):
        """Return the acceleration and the maps of a body of 1 kg."""
        return (self.acceleration, *transition(0.001027, 1.0, step_size))

    def offers(self):
        """Return the mean motion."""
        return {"mean_motion": 0.001027}

    def disturbance_bounds(self, limits):
        """Return what is declared."""
        return None if self.declared < 0.0 else DisturbanceBounds(velocity=self.declared * limits.step_size)


@pytest.mark.parametrize(
    "plugin",
    [Push(), Push(declared=-1.0), Push(added=0.0, declared=0.0), Leaning(), Leaning(declared=-1.0),
     BoundedDisturbance(**BOUNDS), BoundedDisturbance(**BOUNDS, distribution="extreme")],
    ids=repr,
)  # fmt: skip
def test_what_is_declared_and_done_passes(plugin):
    check_plugin(plugin)


@pytest.mark.parametrize(
    ("plugin", "words"),
    [
        (
            Push(declared=0.009),
            "a step moves `velocity` by 0.01 m/s from what the filters assume, but the declared bounds allow 0.009 m/s",
        ),
        (Push(declared=0.0), "a step moves `velocity` by 0.01 m/s"),
        (Leaning(declared=8e-5), "a step moves `velocity` by 0.001 m/s"),
    ],
    ids=["less than a push", "nothing of a push", "less than a lean"],
)
def test_more_than_is_declared_breaks_the_contract(plugin, words):
    assert words in "".join(breaches(plugin).values())


class Boastful(Component, name="TestBoastful"):
    """A component that returns something else."""

    def __call__(self, world, num_envs):
        """Return a component that does nothing."""
        return RunningComponent()

    def disturbance_bounds(self, limits):
        """Return a number."""
        return 0.0


class Nowhere(Dynamics, name="TestNowhere"):
    """Clohessy-Wiltshire motion that does not say about which orbit."""

    row: ClassVar = clohessy_wiltshire_row

    def __call__(self, step_size):
        """Return the maps of a body of 1 kg."""
        return transition(0.001027, 1.0, step_size)

    def disturbance_bounds(self, limits):
        """Return none."""
        return NO_DISTURBANCE


@pytest.mark.parametrize(
    ("plugin", "words"),
    [(Boastful(), "`disturbance_bounds` returned float"), (Nowhere(), "`offers` gives no `mean_motion`")],
)
def test_a_declaration_that_says_nothing_is_named(plugin, words):
    assert words in "".join(breaches(plugin).values())


def test_bounds_that_act_together_add_up():
    one, other = DisturbanceBounds(**BOUNDS), DisturbanceBounds(velocity=1e-3, thrust_gain=0.1)
    total = one + other
    assert total.bounds == pytest.approx((2e-3, 0.1, 2e-3, 0.155, 0.1))
    assert one + NO_DISTURBANCE == one
