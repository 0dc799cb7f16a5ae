"""Execution of plans in a batch, compiled: in which order deputies plan, which rows plan in a step, and the thrust."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.step_maps import StepMaps, advance_steps
from safe_inspect.policies.burn_problem import burn_steps
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

#: Number of rounds of turns within which conflicts are considered.
_ROUNDS = 3


@njit
def _first_conflict(
    position: FloatArray, velocity: FloatArray, maps: StepMaps, clearance: float, steps: int
) -> IntArray:
    """Return the steps until each pair of coasting deputies is too near, `steps` for never, shape (D, D)."""
    deputies = position.shape[0]
    found = np.full((deputies, deputies), steps, np.int64)
    now, after, coasting = np.empty((deputies, 6)), np.empty((deputies, 6)), np.zeros(3)
    now[:, :3], now[:, 3:] = position, velocity
    for j in range(min(steps, maps.phi.shape[0])):
        for d in range(deputies):
            advance_steps(maps, j, now[d], coasting, after[d])
        for a in range(deputies):
            for b in range(a):
                apart = after[a, :3] - after[b, :3]
                if (apart * apart).sum() < clearance * clearance and found[b, a] == steps:
                    found[b, a] = j
    return found


@njit
def take_turns(
    turn: IntArray,
    deputy: IntArray,
    group_size: int,
    position: FloatArray,
    velocity: FloatArray,
    maps: StepMaps,
    clearance: float,
) -> None:
    """Assign a turn to each row without one: 0 plans first, then 1, and so on; every deputy computes the same order.

    Of each pair that would soon come too near, one comes first, in the order of the conflicts; then the other deputies
    by index.

    Args:
        turn: Turn of each row, negative for none, shape (R,); read and written.
        deputy: Index of the deputy, shape (R,).
        group_size: Number of rows of one environment, G.
        position: Positions of all deputies at the reset [m], shape (N, D, 3).
        velocity: Their velocities [m/s], shape (N, D, 3).
        maps: The maps of 0, 1, ... steps.
        clearance: Distance below which two deputies are too near [m].
    """
    deputies = position.shape[1]
    steps = _ROUNDS * deputies
    order = np.empty(deputies, np.int64)
    for row in range(turn.shape[0]):
        if turn[row] >= 0:
            continue
        env = row // group_size
        conflict = _first_conflict(position[env], velocity[env], maps, clearance, steps)
        order[:] = -1
        settled = np.zeros(deputies, np.bool_)
        given = 0
        for j in range(steps):
            for a in range(deputies):
                for b in range(a):
                    if conflict[b, a] == j and not settled[a] and not settled[b]:
                        order[b] = given
                        given += 1
                        settled[a] = settled[b] = True
        for d in range(deputies):
            if order[d] < 0:
                order[d] = given
                given += 1
        turn[row] = order[deputy[row]]


#: Differences from the planned arc above which a deputy has left it [m], [m/s].
_OFF_ARC, _OFF_ARC_SPEED = 1e-4, 1e-7


class DeputyRows(NamedTuple):
    """State of R deputies before a step.

    Attributes:
        step: Steps since the reset, shape (R,).
        finished: Status with which the episode has ended for the deputy, 0 while it is running, shape (R,).
        position: Position [m], Hill frame, shape (R, 3).
        velocity: Velocity [m/s], Hill frame, shape (R, 3).
    """

    step: IntArray
    finished: AnyArray
    position: FloatArray
    velocity: FloatArray


class PlanRows(NamedTuple):
    """Plans of R deputies, with K burns each, and their memory.

    Attributes:
        start: First step of each burn, shape (R, K).
        delta_v: Velocity change of each burn [m/s], shape (R, K, 3).
        review: Step of the next review, 0 for a row that has left its planned arc, shape (R,).
        expected: Position [m] and velocity [m/s] to which the plan leads, shape (R, 6).
        arrival: The step at which this state is expected, shape (R,); the next step if the current one has been
            planned.
        turn: Turn of the deputy among all, negative if it has none yet, shape (R,).
        reach: Velocity change that one step can give along each axis [m/s], shape (R, 3).
    """

    start: IntArray
    delta_v: FloatArray
    review: IntArray
    expected: FloatArray
    arrival: IntArray
    turn: IntArray
    reach: FloatArray


@njit
def rows_to_plan(deputies: DeputyRows, plans: PlanRows, count: int) -> BoolArray:
    """Return the mask of the rows that must review their plan before this step, shape (R,).

    Deputies plan in turn, one per step, so that each can predict the others until they plan again. A row plans when its
    review is due, when it has left its planned arc, or when a burn starts, but never during a burn.

    Args:
        deputies: The deputies.
        plans: Their plans; `review` is written.
        count: Number of deputies of an environment, D.
    """
    step, start = deputies.step, plans.start
    due = np.zeros(step.shape[0], dtype=np.bool_)
    for row in range(step.shape[0]):
        if deputies.finished[row] != 0 or plans.arrival[row] == step[row] + 1:
            continue
        if plans.arrival[row] != step[row]:
            plans.review[row] = 0
        for axis in range(3):
            if (
                abs(deputies.position[row, axis] - plans.expected[row, axis]) > _OFF_ARC
                or abs(deputies.velocity[row, axis] - plans.expected[row, 3 + axis]) > _OFF_ARC_SPEED
            ):
                plans.review[row] = 0
        if step[row] % count != plans.turn[row]:
            continue
        due[row] = step[row] >= plans.review[row]
        for k in range(start.shape[1]):
            length = burn_steps(plans.delta_v[row, k], plans.reach[row])
            if length > 0 and start[row, k] == step[row]:
                due[row] = True
            if start[row, k] < step[row] < start[row, k] + length:
                due[row] = False
                break
    return due


@njit
def follow_plans(deputies: DeputyRows, plans: PlanRows, maps: StepMaps, acceleration: FloatArray) -> None:
    """Write the acceleration of each plan in this step, and the state to which it leads; finished deputies coast.

    Args:
        deputies: The deputies.
        plans: Their plans; `expected` and `arrival` are written.
        maps: The maps of 0, 1, ... steps.
        acceleration: Output: thrust over mass [m/s^2], Hill frame, shape (R, 3).
    """
    step, start = deputies.step, plans.start
    state = np.empty(6)
    for row in range(step.shape[0]):
        acceleration[row] = 0.0
        for k in range(start.shape[1] if deputies.finished[row] == 0 else 0):
            length = burn_steps(plans.delta_v[row, k], plans.reach[row])
            if start[row, k] <= step[row] < start[row, k] + length:
                for axis in range(3):
                    acceleration[row, axis] = plans.delta_v[row, k, axis] / (length * maps.step_size)
        state[:3], state[3:] = deputies.position[row], deputies.velocity[row]
        advance_steps(maps, 1, state, acceleration[row], plans.expected[row])
        plans.arrival[row] = step[row] + 1
