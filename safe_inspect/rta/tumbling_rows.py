"""Escapes from a tumbling target, as compiled rows: which thrusts leave one, and what the escapes command.

A chaser is a point mass in free space, ``p'' = u / m``, whose thrust is held for a control step. The target turns
without torque about the origin. An *escape* is a rule that gives the thrust of every later step. To certify it, it is
simulated until the chaser can brake outside the sphere that the target sweeps; it must be clear of the target at every
moment.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.attitude.rigid_body import rotation_row
from safe_inspect.dynamics.rotation_row import rotated, rotated_back
from safe_inspect.geometry.oriented_boxes import BoxArrays, box_distance
from safe_inspect.rta.constraints.rows import size_of
from safe_inspect.types import FloatArray, IntArray

#: Rules of an escape, the first element of its four numbers; the other three are a unit vector in W. NONE: no escape;
#: BRAKE: stop; PUSH: the largest thrust along the vector; FOLLOW: the velocity `EscapeModel.pace` along the vector.
NONE, BRAKE, PUSH, FOLLOW = 0.0, 1.0, 2.0, 3.0
#: Number of elements of an escape.
ESCAPE = 4
#: Shares of the desired thrust, the rest being that of the escape, that are tried if the desired thrust is refused.
_SHARES = (0.8, 0.6, 0.4, 0.2)
#: Difference between the sets of states that end an escape when it is certified and when it is commanded, so that
#: rounding errors do not matter: of the range [m], and of the product of range and range rate [m^2/s].
_ROUNDING, _STILL = 1e-6, 1e-9


class EscapeModel(NamedTuple):
    """Constants of the filter.

    Attributes:
        inertia: Principal moments of the target, up to a factor, shape (3,).
        boxes: The target in its principal axes T.
        least: Distance between the chaser's centre and the boxes that must be kept [m].
        swept: Radius of the sphere that the target sweeps [m].
        outside: Range beyond which the target does not reach the chaser [m].
        farthest: Largest range [m].
        acceleration: Largest acceleration along each axis of W [m/s^2].
        step: Length of a control step [s].
        cells: Number of parts of a control step between whose ends clearances are bounded.
        horizon: Largest number of steps of an escape.
        pace: Speed of an escape by the rule FOLLOW [m/s].
        directions: Directions of escapes in T, shape (K, 3); in place of the first, outwards.
    """

    inertia: FloatArray
    boxes: BoxArrays
    least: float
    swept: float
    outside: float
    farthest: float
    acceleration: float
    step: float
    cells: int
    horizon: int
    pace: float
    directions: FloatArray


@njit
def _turn(model: EscapeModel, attitudes: FloatArray, known: int, needed: int) -> int:
    """Advance the target's rotation to a number of cells, if it is not known that far; return how far it is known.

    Args:
        model: The model.
        attitudes: Attitude q_WT and angular velocity in T at the ends of the cells, shape (K, 7), completed.
        known: Number of cells up to which they are known.
        needed: Number of cells up to which they are needed.
    """
    j, h = (model.inertia[0], model.inertia[1], model.inertia[2]), model.step / model.cells
    for k in range(known, needed):
        x = attitudes[k]
        y = rotation_row(j, (x[0], x[1], x[2], x[3], x[4], x[5], x[6]), (0.0, 0.0, 0.0), h)
        for i in range(7):
            attitudes[k + 1, i] = y[i]
    return max(known, needed)


@njit
def _is_clear(model: EscapeModel, attitudes: FloatArray, first: int, state: FloatArray, push: FloatArray) -> bool:
    """Return whether a hold keeps the clearance and the largest range at every moment.

    With the distances a and b at the ends of a cell of length h, the distance within is at least ``(a + b - L h) / 2``,
    where L bounds the speed of the chaser relative to the target's axes, ``|v| + |w| |p|``; likewise for the distance
    to the sphere that the target sweeps, with ``|v|``.

    Args:
        model: The model.
        attitudes: Rotation of the target, known to the end of the hold.
        first: Index of the hold's first cell.
        state: Position [m] and velocity [m/s] at its start, shape (6,).
        push: Acceleration [m/s^2], shape (3,).
    """
    h = model.step / model.cells
    bend = 0.125 * h * h * size_of(push)  # between a chord and the path
    before = speed_before = range_before = rate_before = 0.0
    for k in range(model.cells + 1):
        t = k * h
        x = state[0] + t * (state[3] + 0.5 * t * push[0])
        y = state[1] + t * (state[4] + 0.5 * t * push[1])
        z = state[2] + t * (state[5] + 0.5 * t * push[2])
        q = attitudes[first + k]
        p = rotated_back(q, x, y, z)
        distance = box_distance(model.boxes, p[0], p[1], p[2])
        speed = size_of((state[3] + t * push[0], state[4] + t * push[1], state[5] + t * push[2]))
        reach, rate = size_of((x, y, z)), size_of((q[4], q[5], q[6]))
        if k > 0:
            turn = max(rate, rate_before)
            turn *= 1.0 + h * turn  # |w'| <= |w|^2 without torque
            own = max(speed, speed_before)
            relative = own + turn * (max(reach, range_before) + bend)
            bound = max(before + distance - relative * h, range_before + reach - own * h - 2.0 * model.swept)
            if 0.5 * bound < model.least:
                return False
        if reach > model.farthest:
            return False
        before, speed_before, range_before, rate_before = distance, speed, reach, rate
    return True


@njit
def _ends(model: EscapeModel, state: FloatArray, share: float) -> bool:
    """Return whether an escape ends at a state: braking stays between the swept sphere and the largest range.

    Args:
        model: The model.
        state: The state, shape (6,).
        share: Share of the tolerances for rounding: 1 when an escape is certified, 0 when it is commanded.
    """
    reach, speed = size_of(state), size_of((state[3], state[4], state[5]))
    outward = state[0] * state[3] + state[1] * state[4] + state[2] * state[5]
    if reach < model.outside + share * _ROUNDING or outward < (share - 2.0) * _STILL:
        return False
    return reach + speed * (0.5 * speed / model.acceleration + model.step) <= model.farthest - share * _ROUNDING


@njit
def _command(model: EscapeModel, state: FloatArray, escape: FloatArray, push: FloatArray) -> None:
    """Write the acceleration that an escape commands from a state, within the limits along each axis, shape (3,)."""
    rule = BRAKE if _ends(model, state, 0.0) else escape[0]
    pace = model.pace if rule == FOLLOW else 0.0
    for i in range(3):
        push[i] = escape[1 + i] if rule == PUSH else (pace * escape[1 + i] - state[3 + i]) / model.step
    largest = max(abs(push[0]), abs(push[1]), abs(push[2]))
    scale = model.acceleration / max(largest, 1e-300) if rule == PUSH or largest > model.acceleration else 1.0
    for i in range(3):
        push[i] *= scale


@njit
def _fly(model: EscapeModel, state: FloatArray, push: FloatArray) -> None:
    """Advance a state, shape (6,), by one hold of an acceleration [m/s^2], shape (3,)."""
    for i in range(3):
        state[i] += model.step * (state[3 + i] + 0.5 * model.step * push[i])
        state[3 + i] += model.step * push[i]


class _Scratch(NamedTuple):
    """Arrays that are written.

    Attributes:
        attitudes: Rotation of the target, shape (K, 7).
        state: A state, shape (6,).
        push: An acceleration [m/s^2], shape (3,).
        found: An escape, shape (4,).
    """

    attitudes: FloatArray
    state: FloatArray
    push: FloatArray
    found: FloatArray


@njit
def _is_safe(
    model: EscapeModel, scratch: _Scratch, known: int, start: int, state: FloatArray, escape: FloatArray
) -> int:
    """Return the number of cells up to which the rotation is known, negative unless an escape from a state is safe.

    Args:
        model: The model.
        scratch: The arrays.
        known: Number of cells up to which the target's rotation is known, at least 1.
        start: Number of the steps before.
        state: The state, shape (6,).
        escape: The escape, shape (4,).
    """
    flown, push = scratch.state, scratch.push
    for i in range(6):
        flown[i] = state[i]
    for k in range(start, start + model.horizon):
        if _ends(model, flown, 1.0):
            return known
        known = _turn(model, scratch.attitudes, known, (k + 1) * model.cells)
        _command(model, flown, escape, push)
        if not _is_clear(model, scratch.attitudes, k * model.cells, flown, push):
            return -known
        _fly(model, flown, push)
    return -known


@njit
def _find(model: EscapeModel, scratch: _Scratch, known: int, start: int, state: FloatArray, escape: FloatArray) -> int:
    """Write an escape from a state, the one that is given if it is safe; return what `_is_safe` returns."""
    if escape[0] != NONE:
        known = _is_safe(model, scratch, known, start, state, escape)
        if known > 0:
            return known
        known = -known
    found = scratch.found
    found[:] = 0.0
    found[0] = BRAKE
    known = _is_safe(model, scratch, known, start, state, found)
    q, reach = scratch.attitudes[start * model.cells], max(size_of(state), 1e-9)
    for index in range(2 * len(model.directions)):
        if known > 0:
            break
        known = -known
        way = model.directions[index // 2]
        d = rotated(q, way[0], way[1], way[2])
        if index < 2:
            d = (state[0] / reach, state[1] / reach, state[2] / reach)
        found[0] = PUSH if index % 2 == 0 else FOLLOW
        for i in range(3):
            found[1 + i] = d[i]
        known = _is_safe(model, scratch, known, start, state, found)
    if known > 0:
        escape[:] = found
    return known


#: What a row applies: the desired thrust, a share of it, the escape's thrust, or that without a certified escape.
DESIRED, SHARE, BACKUP, UNSAFE = 0, 1, 2, 3


@njit
def keep_escapes(
    model: EscapeModel,
    motion: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    desired: FloatArray,
    escapes: FloatArray,
    attitudes: FloatArray,
    stages: IntArray,
) -> None:
    """Replace desired accelerations by ones that leave an escape, and store the escapes.

    Args:
        model: The model.
        motion: Positions [m] and velocities [m/s] of the chasers in W, attitudes q_WT and angular velocities in T
            [rad/s] of the target, each with R rows.
        desired: Desired accelerations, overwritten [m/s^2], shape (R, 3).
        escapes: Escapes of the last step, overwritten, shape (R, 4).
        attitudes: Room for the rotation of a target, shape (K, 7), where K is 1 + (1 + horizon) cells.
        stages: What each row applies, shape (R,), written.
    """
    scratch = _Scratch(attitudes, np.empty(6), np.empty(3), np.empty(ESCAPE))
    state, after, escape, backup, wanted = np.empty(6), np.empty(6), np.empty(ESCAPE), np.empty(3), np.empty(3)
    for r in range(desired.shape[0]):
        for i in range(3):
            state[i], state[3 + i] = motion[0][r, i], motion[1][r, i]
            attitudes[0, 4 + i] = motion[3][r, i]
            wanted[i] = min(max(desired[r, i], -model.acceleration), model.acceleration)
            attitudes[0, i] = motion[2][r, i]
        attitudes[0, 3] = motion[2][r, 3]
        known = _turn(model, attitudes, 0, model.cells)
        stage = DESIRED
        if escapes[r, 0] == NONE:
            escapes[r] = 0.0
            known = _find(model, scratch, known, 0, state, escapes[r])
            if known < 0:
                known = -known
                stage = UNSAFE
                escapes[r, 0] = PUSH
                reach = size_of(state)
                for i in range(3):
                    escapes[r, 1 + i] = state[i] / reach if reach > 0.0 else 1.0
        _command(model, state, escapes[r], backup)
        passed = False
        for attempt in range(1 + len(_SHARES)):
            share = 1.0 if attempt == 0 else _SHARES[attempt - 1]
            for i in range(3):
                desired[r, i] = share * wanted[i] + (1.0 - share) * backup[i]
                after[i], after[3 + i] = state[i], state[3 + i]
            escape[:] = escapes[r]
            if not _is_clear(model, attitudes, 0, state, desired[r]):
                continue
            _fly(model, after, desired[r])
            known = _find(model, scratch, known, 1, after, escape)
            passed = known > 0
            known = abs(known)
            if passed:
                stage = DESIRED if attempt == 0 else SHARE
                escapes[r] = escape
                break
        if not passed:
            for i in range(3):
                desired[r, i] = backup[i]
            if stage == UNSAFE:
                escapes[r, 0] = NONE
            else:
                stage = BACKUP
        stages[r] = stage
