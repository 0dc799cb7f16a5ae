"""Numbers and tables of a task for the compiled rows of the backup filter, built once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from safe_inspect.dynamics.cwh import transition
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.sets import CERTIFIED, COLLISION, NAMES
from safe_inspect.types import FloatArray

#: Code of the first further constraint; see `half_spaces`.
FURTHER = len(CERTIFIED)
#: Bit of the constraint that keeps pairs of deputies apart; that of their passive safety is the next. Bits of codes are
#: below it.
PAIR_BIT = 60
#: Number of the finest pieces of a hold.
HOLD_PIECES = 256
#: Number of cells into which an orbit is divided before any refinement.
ORBIT_CELLS = 16
#: Number of cells of an orbit after the last halving.
FINEST = ORBIT_CELLS * 2**16
#: Number of nodes of an orbit at which its slack is linearised.
FINE_NODES = 64
#: Radial and cross-track speeds of a plan in units of n r; the radial one is relative to that of the centred ellipse.
RADIAL = (0.0, 0.25, -0.25, 0.5, -0.5, 1.0, -1.0, 2.0, -2.0)
CROSS = (0.0, 0.5, -0.5, 1.0, -1.0, 2.0, -2.0)
#: Number of plans.
PLANS = (len(RADIAL) + 1) * (len(CROSS) + 1)
#: Parts of the motion for which a tube has margins: a hold of a thrust, the hold of the plan after it, and the closed
#: motion after that; then the last two for a plan without a hold before it.
HOLD, PLAN, CLOSED, FIRST_PLAN, FIRST_CLOSED = range(5)
#: Margins if there is no tube.
NO_TUBE = np.zeros((5, 4, 3))
_COAST_ANGLE = 0.2
#: Change of the velocity that the holds of a plan must reach together [m/s], and the largest number of holds.
_CHANGE, _MOST_HOLDS = 0.8, 16
_COAST_PIECES = 64


class FilterModel(NamedTuple):
    """Numbers (SI) and tables of one task.

    Attributes:
        n: Mean motion [rad/s].
        mass: Mass [kg].
        u_max: Largest thrust of each axis [N].
        dt: Length of a hold [s].
        constraints: The numbers of each constraint of `CERTIFIED`; see `Constraint.row_numbers`.
        active: The bits of those that apply, and of all further ones.
        near_psm: Radius that coasting must avoid [m]; minus infinity if there is no such constraint.
        stretch: Largest gains of coasting over the horizon: position to position, velocity to position [s],
            velocity to velocity of accelerations [-] and of jerks [1/s], shape (4,).
        hold_phi: Transition matrices to the times k dt / 256, shape (257, 6, 6).
        hold_gamma: Input matrices for the same times [1/N], shape (257, 6, 3).
        hold_sun: Cosine and sine of the sun's rotation until those times, shape (257, 2).
        coast: Position rows of the transition matrices over the horizon of passive safety, shape (L + 1, 3, 6).
        coast_step: Time between them [s].
        orbit: Cosine and sine of the ends of an orbit's first cells, shape (17, 2).
        fine: Cosine and sine of the `FINE_NODES` nodes, shape (64, 2).
        turning: Largest curvature of the regions that closed motions must not enter, with the sun's rotation [1/m].
        plan: Control of a plan from (targets - free motion), shape (3, 3), with the row order x, y, z of the velocity.
        further: Number of further constraints; see `half_spaces`.
        kernels: Address of the addresses of their kernels and parameters; see `KernelTable`. `further` and `kernels`
            are numbers instead of arrays because models are passed by value.
        leads: Number of holds of thrust allowed before the hold of a plan; see `plans`.
        tube: Largest distance of the real motion from that of the model in each part: in lengths [m], speeds [m/s],
            ranges of coasting [m] and the thrust of an axis [N], each as multiples of 1, of the thrust of the hold [N]
            and of that of the plan [N], shape (5, 4, 3).
    """

    n: float
    mass: float
    u_max: float
    dt: float
    constraints: tuple[Any, ...]
    active: int
    near_psm: float
    stretch: FloatArray
    hold_phi: FloatArray
    hold_gamma: FloatArray
    hold_sun: FloatArray
    coast: FloatArray
    coast_step: float
    orbit: FloatArray
    fine: FloatArray
    turning: float
    plan: FloatArray
    further: int
    kernels: int
    leads: int
    tube: FloatArray


def leading_holds(parameters: ConstraintParameters) -> int:
    """Return the number of holds that a plan may have before its last: 0 if one changes the velocity enough."""
    p = parameters
    return min(math.ceil(_CHANGE / float(p.u_max * p.step_size / p.m)), _MOST_HOLDS) - 1


def build_model(p: ConstraintParameters, constraints: Mapping[str, Any]) -> FilterModel:
    """Compute the numbers and tables of a task.

    Args:
        p: Parameters of the task, of which `step_size`, `n`, `m` and `u_max` determine the motion of the deputy.
        constraints: The constraints that apply, by name; those that are not in `CERTIFIED` are ignored.
    """
    chosen = {name: constraint for name, constraint in constraints.items() if name in NAMES}
    horizon = float(chosen["PSM"].horizon if "PSM" in chosen else p.psm_horizon)
    n, dt, angle = float(p.n), float(p.step_size), float(p.n * p.step_size)
    holds = [transition(n, p.m, dt * k / HOLD_PIECES) for k in range(HOLD_PIECES)] + [transition(n, p.m, dt)]
    pieces = _COAST_PIECES * max(1, math.ceil(n * horizon / _COAST_ANGLE))
    coasts = np.stack([transition(n, p.m, horizon * k / pieces)[0] for k in range(pieces + 1)])
    turns = angle * np.arange(HOLD_PIECES + 1) / HOLD_PIECES
    circle = 2.0 * np.pi * np.arange(ORBIT_CELLS + 1) / ORBIT_CELLS
    nodes = 2.0 * np.pi * np.arange(FINE_NODES) / FINE_NODES
    blocks = (coasts[:, :3, :3], coasts[:, :3, 3:], coasts[:, 3:, 3:], coasts[:, 3:, :3])
    # Increasing the largest entries of the table by 1 % also bounds the values between the entries.
    stretch = np.array([1.01 * np.linalg.norm(block, ord=2, axis=(1, 2)).max() for block in blocks])
    gamma = holds[-1][1]
    closing = np.array(gamma[3:], dtype=np.float64)
    # Add the drift v_y + 2 n x after the hold.
    closing[1] += 2.0 * n * gamma[0]
    numbers: tuple[Any, ...] = tuple(constraint.row_numbers(n, chosen) for constraint in CERTIFIED)
    near = numbers[COLLISION].closed_near
    # In the frame that rotates with the sun, a motion is at most twice as fast, and the cone's section is a smaller
    # circle.
    turning = (4.0 / math.sin(0.5 * chosen["sun"].fov) if "sun" in chosen else 1.0) / near if near > 0.0 else 0.0
    return FilterModel(
        n=n, mass=float(p.m), u_max=float(p.u_max), dt=dt,
        constraints=numbers,
        active=(-1 << FURTHER) | sum(1 << code for code, known in enumerate(CERTIFIED) if known.counts(chosen.keys())),
        near_psm=float(chosen["PSM"].collision_radius) if "PSM" in chosen else -math.inf,
        stretch=stretch,
        hold_phi=np.stack([phi for phi, _ in holds]), hold_gamma=np.stack([gamma for _, gamma in holds]),
        hold_sun=np.stack((np.cos(turns), np.sin(turns)), axis=-1),
        coast=np.ascontiguousarray(coasts[:, :3]), coast_step=float(horizon / pieces),
        orbit=np.stack((np.cos(circle), np.sin(circle)), axis=-1),
        fine=np.stack((np.cos(nodes), np.sin(nodes)), axis=-1),
        turning=turning, plan=np.asarray(np.linalg.inv(closing), dtype=np.float64),
        further=0, kernels=0, leads=0, tube=NO_TUBE,
    )  # fmt: skip
