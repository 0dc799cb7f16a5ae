"""How the plans in a batch are flown, compiled: who has to plan now, and what thrust a plan asks for."""

from __future__ import annotations

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.policies.arcs import fly
from safe_inspect.policies.plan import burn_steps
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

#: A deputy is off its course beyond these distances from it [m], [m/s].
_ASTRAY, _ASTRAY_SPEED = 1e-4, 1e-7


@njit
def who_plans(
    step: IntArray,
    turn: IntArray,
    deputies: int,
    finished: AnyArray,
    position: FloatArray,
    velocity: FloatArray,
    expected: FloatArray,
    arrival: IntArray,
    start: IntArray,
    delta_v: FloatArray,
    reach: FloatArray,
    review: IntArray,
) -> BoolArray:
    """Return which rows have to look at their plan before this step, shape (R,).

    Deputies plan by turns, one a step, so that each knows where the others go unless they plan anew. A row looks when
    its review is due, when it is off its course, or when a burn begins; never amid a burn.

    Args:
        step: Steps since the reset, shape (R,).
        turn: Turn of the deputy among all, shape (R,).
        deputies: Number of deputies, D.
        finished: Status with which the episode has ended for the deputy, shape (R,).
        position: Position [m], shape (R, 3).
        velocity: Velocity [m/s], shape (R, 3).
        expected: Position and velocity that the plan leads to, shape (R, 6).
        arrival: The step at which it does, shape (R,); the step after this one when this one was looked at before.
        start: First step of each burn, shape (R, K).
        delta_v: Velocity change of each burn [m/s], shape (R, K, 3).
        reach: Velocity change that one step can give [m/s], shape (R, 3).
        review: Step of the next review, shape (R,); 0 for a row that is off its course. Read and written.
    """
    due = np.zeros(step.shape[0], dtype=np.bool_)
    for row in range(step.shape[0]):
        if finished[row] != 0 or arrival[row] == step[row] + 1:
            continue
        if arrival[row] != step[row]:
            review[row] = 0
        for axis in range(3):
            if (
                abs(position[row, axis] - expected[row, axis]) > _ASTRAY
                or abs(velocity[row, axis] - expected[row, 3 + axis]) > _ASTRAY_SPEED
            ):
                review[row] = 0
        if step[row] % deputies != turn[row]:
            continue
        due[row] = step[row] >= review[row]
        for k in range(start.shape[1]):
            length = burn_steps(delta_v[row, k], reach[row])
            if length > 0 and start[row, k] == step[row]:
                due[row] = True
            if start[row, k] < step[row] < start[row, k] + length:
                due[row] = False
                break
    return due


@njit
def follow(
    step: IntArray,
    position: FloatArray,
    velocity: FloatArray,
    start: IntArray,
    delta_v: FloatArray,
    reach: FloatArray,
    step_size: float,
    phi: FloatArray,
    gamma: FloatArray,
    finished: AnyArray,
    expected: FloatArray,
    arrival: IntArray,
    acceleration: FloatArray,
) -> None:
    """Write the acceleration that each plan asks for in this step, and where it leads.

    Args:
        step: Steps since the reset, shape (R,).
        position: Position [m], shape (R, 3).
        velocity: Velocity [m/s], shape (R, 3).
        start: First step of each burn, shape (R, K).
        delta_v: Velocity change of each burn [m/s], shape (R, K, 3).
        reach: Velocity change that one step can give [m/s], shape (R, 3).
        step_size: Length of a step [s].
        phi: Transition matrices by the number of steps.
        gamma: Input matrices of a body of 1 kg, likewise.
        finished: Status with which the episode has ended for the deputy, shape (R,); it coasts.
        expected: Receives position and velocity at the next step, shape (R, 6).
        arrival: Receives the number of the next step, shape (R,).
        acceleration: Receives the thrust over the mass [m/s^2], Hill frame, shape (R, 3).
    """
    state = np.empty(6)
    for row in range(step.shape[0]):
        acceleration[row] = 0.0
        for k in range(start.shape[1] if finished[row] == 0 else 0):
            length = burn_steps(delta_v[row, k], reach[row])
            if start[row, k] <= step[row] < start[row, k] + length:
                for axis in range(3):
                    acceleration[row, axis] = delta_v[row, k, axis] / (length * step_size)
        state[:3], state[3:] = position[row], velocity[row]
        fly(phi, gamma, 1, state, acceleration[row], expected[row])
        arrival[row] = step[row] + 1
