"""Desired thrusts that try to violate the safety constraints."""

from __future__ import annotations

import numpy as np

from safe_inspect.random.streams import Streams
from safe_inspect.simulators.view import View
from safe_inspect.types import FloatArray, IntArray

#: The adversaries; row r of a batch has the one with index r modulo their number.
ADVERSARIES = ("to the chief", "to the sun cone or ahead", "outward", "random corners", "bang-bang", "zero")


def adversarial_thrust(view: View, step: int, slots: IntArray, seed: int) -> FloatArray:
    """Return the adversaries' desired thrusts, as fractions of the largest thrust in [-1, 1], Hill frame, shape (R, 3).

    In the order of `ADVERSARIES`: straight to the chief; towards the axis of the sun's keep-out cone or, without a sun,
    along the velocity; straight outward; the largest thrust in random directions; along and against the velocity, for
    seven steps each; no thrust.

    Args:
        view: The state.
        step: Number of the step, for the random and the bang-bang adversaries.
        slots: Global index of the environment slot of each row, shape (R,).
        seed: Seed of the random adversary.
    """
    position = view.position
    distance = view.range_to(None)[:, None]
    outward = position / distance
    lit = "sun_direction" in view.world.offers.view
    axis = -view.sun_direction * distance - position if lit else view.velocity.copy()
    axis /= np.sqrt(np.square(axis).sum(axis=-1, keepdims=True)) + 1e-9
    corners = np.where(Streams(seed, slots, np.zeros_like(slots)).uniform("corners", 3, index=step) < 0.5, -1.0, 1.0)
    along = np.sign(view.velocity + 1e-12) * (1.0 if step // 7 % 2 else -1.0)
    choices = np.stack((-1.8 * outward, 1.8 * axis, 1.8 * outward, corners, along, np.zeros_like(position)))
    kinds = slots % len(ADVERSARIES)
    return np.asarray(np.clip(choices[kinds, np.arange(len(slots))], -1.0, 1.0))
