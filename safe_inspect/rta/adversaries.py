"""Desired thrusts and disturbances that try to violate the safety constraints."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.random.streams import Streams
from safe_inspect.rta.constraints.base import RelativeState
from safe_inspect.simulators.view import View
from safe_inspect.tasks.inspection.sun import sun_directions
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


#: Directions in which the disturbances of a rollout push; row r has the one that was sampled for it.
PUSHES = ("at random", "always one way", "inward", "outward", "along the velocity", "against it", "to the sun cone",
          "to the nearest limit", "to and fro")  # fmt: skip
_RANDOM, _STEADY, _INWARD, _OUTWARD, _ALONG, _AGAINST, _SUN, _NEAREST, _TO_AND_FRO = range(len(PUSHES))
#: Direction of the push towards each constraint.
_TOWARDS = {"chief_collision": _INWARD, "PSM": _INWARD, "r_max": _OUTWARD, "sun": _SUN}


class DisturbanceAdversary:
    """Disturbances of R rollouts: errors of the estimate, errors of the thrust, and velocities.

    All of them push in one direction. A deputy that corrects the error of the estimate pushes in that direction too; in
    one third of the rollouts it pushes in the opposite direction, and in another third the error is random.

    Attributes:
        push: Index in `PUSHES` of the direction for each rollout, shape (R,).
        direction: Direction of the push in this step, unit vectors, Hill frame, shape (R, 3).
    """

    def __init__(self, bounds: DisturbanceBounds, rows: int, rng: np.random.Generator) -> None:
        self._bounds, self._rng = bounds, rng
        self.push: IntArray = rng.integers(0, len(PUSHES), rows)
        self._trick = rng.integers(0, 3, rows)[:, None]
        self._one_way = normalised_rows(rng.normal(size=(rows, 3)))
        self._steps = 0
        self.direction: FloatArray = self._one_way

    def estimate(self, state: RelativeState, phi: dict[str, FloatArray]) -> RelativeState:
        """Return the state estimates of the deputies, and choose the directions in which this step's disturbances push.

        Args:
            state: The states.
            phi: The constraints' safety quantities; the least one determines the nearest limit.
        """
        self.direction = self._choose(state, phi)
        bounds, errors = self._bounds, []
        for bound in (bounds.position_error, bounds.velocity_error):
            noise = normalised_rows(self._rng.normal(size=state.position.shape))
            errors.append(
                bound * np.select([self._trick == 0, self._trick == 1], [-self.direction, self.direction], noise)
            )
        return RelativeState(state.position + errors[0], state.velocity + errors[1], state.sun_angle)

    def flown(self, control: FloatArray) -> FloatArray:
        """Return the applied thrust [N], shape (R, 3), with the largest errors that the bounds allow.

        The thrust is rotated towards the direction of the disturbance by `thrust_direction`. Its magnitude is increased
        by the factor `thrust_gain` if it has a component in that direction, otherwise decreased.
        """
        size = np.linalg.norm(control, axis=1, keepdims=True)
        along = control / np.maximum(size, 1e-300)
        part = (along * self.direction).sum(axis=1, keepdims=True)
        across = normalised_rows(self.direction - part * along)
        angle = self._bounds.thrust_direction
        gain = 1.0 + np.where(part > 0.0, 1.0, -1.0) * self._bounds.thrust_gain
        return np.asarray(gain * size * (np.cos(angle) * along + np.sin(angle) * across))

    def disturbed(self, state: RelativeState) -> RelativeState:
        """Return the states after adding the velocity that the disturbance causes in a step."""
        added = self._bounds.velocity * self.direction
        return RelativeState(state.position, state.velocity + added, state.sun_angle)

    def _choose(self, state: RelativeState, phi: dict[str, FloatArray]) -> FloatArray:
        self._steps += 1
        inward, along = -normalised_rows(state.position), normalised_rows(state.velocity)
        away = -sun_directions(state.sun_angle)
        ways = {
            _RANDOM: normalised_rows(self._rng.normal(size=state.position.shape)), _STEADY: self._one_way,
            _INWARD: inward, _OUTWARD: -inward, _ALONG: along, _AGAINST: -along,
            _SUN: normalised_rows(away * np.linalg.norm(state.position, axis=1, keepdims=True) - state.position),
            _TO_AND_FRO: self._one_way if self._steps % 4 < 2 else -self._one_way,
        }  # fmt: skip
        names = ["PSM", *phi]  # PSM is not among those of every step, and is never the nearest of them.
        near = [np.full(len(state), np.inf), *(value / _SCALES.get(name, 0.1) for name, value in phi.items())]
        towards = np.array([_TOWARDS.get(name, _ALONG) for name in names])[np.argmin(np.stack(near), axis=0)]
        push = np.where(self.push == _NEAREST, towards, self.push)
        known = sorted(ways)
        return np.stack([ways[k] for k in known])[np.searchsorted(known, push), np.arange(len(state))]


#: Scales on which distances count as equally near: metres, radians, and otherwise metres per second.
_SCALES = {"chief_collision": 10.0, "r_max": 10.0, "sun": 0.2}


def normalised_rows(v: FloatArray) -> FloatArray:
    """Return vectors scaled to length 1, shape (R, 3); zero vectors are unchanged."""
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-300))
