"""A task: a beacon that moves on a circle, and is to be visited."""

from typing import ClassVar

import numpy as np

from safe_inspect.dynamics import NO_DISTURBANCE
from safe_inspect.simulators import Component, RunningComponent
from safe_inspect.simulators.offers import OfView
from safe_inspect.types import ArraySpec
from safe_inspect.units import PositiveAngularRate, PositiveLength


class MovingBeacon(Component):
    """A beacon on a circle about the origin, in the plane z = 0.

    Arrays: ``beacon_angle`` [rad], shape (N,), and ``beacon_position`` [m], shape (N, 3). A reset takes the angle
    from the reset parameter of that name, 0 unless there is one.

    Attributes:
        radius: Radius of the circle [m].
        rate: Rate of the angle [rad/s].
    """

    parameters: ClassVar = {"beacon_angle": "rad"}

    radius: PositiveLength = 50.0
    rate: PositiveAngularRate = 0.005

    def disturbance_bounds(self, limits):
        """Return none: the vehicles move as without it, on which safety filters may count."""
        return NO_DISTURBANCE

    def __call__(self, world, num_envs):
        """Return the running beacon."""
        return _RunningBeacon(self.radius, self.rate * world.step_size)


class _RunningBeacon(RunningComponent):
    arrays = {"beacon_angle": ArraySpec(()), "beacon_position": ArraySpec((3,))}  # noqa: RUF012 - never written
    recorded = ("beacon_angle",)
    figures = {"beacon_distance": ("beacon distance", "m")}  # noqa: RUF012 - never written

    def __init__(self, radius, turn):
        self._radius, self._turn = radius, turn

    def reset(self, state, values):
        state.beacon_angle[:] = values.get("beacon_angle", 0.0)
        self._place(state)

    def step(self, state, running):
        state.beacon_angle[:] += self._turn
        self._place(state)

    def of_view(self):
        return {name: OfView(name) for name in self.arrays}

    def info(self, view):
        return {"beacon_distance": distance(view)}

    def _place(self, state):
        state.beacon_position[:, 0] = self._radius * np.cos(state.beacon_angle)
        state.beacon_position[:, 1] = self._radius * np.sin(state.beacon_angle)


def distance(view):
    """Return the distance of each deputy to the beacon [m], shape (R,)."""
    return np.sqrt(np.square(view.position - view.beacon_position).sum(axis=-1))
