"""The true motion of one mission: the chaser under its commands, and the target's free tumble."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.tumble import tumble
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.chaser import ChaserDynamics, ChaserState, last
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.types import FloatArray

#: Change of the angular velocity by an impulse, as a share of its magnitude.
_IMPULSE = 0.5
#: Steps of control whose target attitudes are computed at a time.
_BLOCK = 64


class TruthStep(NamedTuple):
    """What happened in one step of control.

    Attributes:
        chaser_before: The chaser before it.
        target_before: The target before it.
        chaser: The chaser after each tick, one row, shape (1, ticks, ...).
        target: The target's attitude q_WT after each tick, shape (ticks, 4).
        error: The uniform numbers that scaled the actuators' noise, shape (6,).
    """

    chaser_before: BodyState
    target_before: BodyState
    chaser: ChaserState
    target: FloatArray
    error: FloatArray


def target_motion(
    inertia: FloatArray, tumbling: tuple[FloatArray, FloatArray], impulses: tuple[float, ...], times: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the target's attitudes q_WT, shape (K, 4), and angular velocities in T [rad/s], shape (K, 3).

    Args:
        inertia: Principal moments, up to one factor, shape (3,).
        tumbling: Attitude and angular velocity at time zero, shapes (4,) and (3,).
        impulses: When an impulse changes the angular velocity [s], ascending: by half its magnitude along axis 1.
        times: Times [s], ascending, shape (K,).
    """
    q, w = (value[0] for value in tumble(inertia, tumbling[0][None], tumbling[1][None], times))
    before = 0.0
    state = tumbling
    for impulse in impulses:
        q0, w0 = (
            value[0, 0] for value in tumble(inertia, state[0][None], state[1][None], np.array([impulse - before]))
        )
        state = (q0, w0 + _IMPULSE * np.linalg.norm(w0) * np.array([1.0, 0.0, 0.0]))
        before, later = impulse, times >= impulse
        if later.any():
            after = tumble(inertia, state[0][None], state[1][None], times[later] - impulse)
            q[later], w[later] = after[0][0], after[1][0]
    return q, w


class MissionTruth:
    """The truth of one mission. W has the target's centre of mass at its origin; its axes do not turn.

    Args:
        dynamics: How the chaser moves.
        start: The chaser at the start.
        inertia: The target's principal moments, up to one factor, shape (3,).
        tumbling: The target's attitude q_WT, shape (4,), and angular velocity in T [rad/s], shape (3,), at the start.
        tick: Length of a tick [s].
        ticks: Ticks of a step of control.
        streams: The random streams of the mission.
        impulses: When something strikes the target [s]; see `target_motion`.
    """

    def __init__(
        self,
        dynamics: ChaserDynamics,
        start: BodyState,
        inertia: FloatArray,
        tumbling: tuple[FloatArray, FloatArray],
        tick: float,
        ticks: int,
        streams: Streams,
        impulses: tuple[float, ...] = (),
    ) -> None:
        self._impulses = impulses
        self._dynamics, self._inertia, self._tumbling = dynamics, inertia, tumbling
        self._tick, self._ticks, self._streams = tick, ticks, streams
        translation = np.concatenate([start.position, start.velocity])[None]
        self._state = ChaserState(translation, start.orientation[None], start.angular_velocity[None], np.zeros((1, 6)))
        self._steps = 0
        self._block = -1
        self._attitudes = (np.empty((0, 4)), np.empty((0, 3)))

    @property
    def step_number(self) -> int:
        """How many steps of control have been made."""
        return self._steps

    @property
    def time(self) -> float:
        """The time [s]."""
        return self._steps * self._ticks * self._tick

    @property
    def chaser(self) -> BodyState:
        """The chaser's true state."""
        x, q, w, _ = self._state
        return BodyState(x[0, :3], x[0, 3:], q[0], w[0])

    @property
    def wrench(self) -> FloatArray:
        """Force in W [N] and torque in B [N m] that act, shape (6,)."""
        wrench: FloatArray = self._state.wrench[0]
        return wrench

    @property
    def target(self) -> BodyState:
        """The target's true state."""
        orientations, rates = self._target_ticks()
        zero = np.zeros(3)
        return BodyState(zero, zero, orientations[0], rates[0])

    def advance(self, force: FloatArray, torque: FloatArray) -> TruthStep:
        """Hold a command for one step of control.

        Args:
            force: In W [N], shape (3,).
            torque: In B [N m], shape (3,).
        """
        before, target = self.chaser, self.target
        error = 2.0 * self._streams.uniform("actuator.noise", 6, self._steps) - 1.0
        command = np.concatenate([force, torque])[None]
        history = self._dynamics.advance(self._state, command, error, self._ticks, self.time)
        orientations = self._target_ticks()[0][1:]
        self._state = last(history)
        self._steps += 1
        return TruthStep(before, target, history, orientations, error[0])

    def _target_ticks(self) -> tuple[FloatArray, FloatArray]:
        """Return the target's attitudes and rates at the ticks of this step, its start and its end included."""
        block, index = divmod(self._steps, _BLOCK)
        if block != self._block:
            first, count = block * _BLOCK * self._ticks, _BLOCK * self._ticks + 1
            times = self._tick * np.arange(first, first + count, dtype=np.float64)
            self._block = block
            self._attitudes = target_motion(self._inertia, self._tumbling, self._impulses, times)
        window = slice(index * self._ticks, (index + 1) * self._ticks + 1)
        return self._attitudes[0][window], self._attitudes[1][window]
