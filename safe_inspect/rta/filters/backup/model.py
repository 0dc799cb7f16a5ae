"""What the compiled rows of the backup filter know of the task: numbers and tables, built once."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from safe_inspect.dynamics.cwh import transition
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.sets import NAMES
from safe_inspect.types import FloatArray

#: The constraints that the backup filter has bounds of its own for; the index of a name is its code in compiled rows.
KNOWN = NAMES
COLLISION, REL_VEL, SUN, R_MAX, PSM, X_VEL, Y_VEL, Z_VEL = range(8)
#: Code of the first further constraint; see `half_spaces`.
FURTHER = len(KNOWN)
#: Bit of what keeps pairs of deputies apart; their passive safety has the next. The bits of codes end before it.
PAIR_BIT = 60
#: Options of compiled functions that only compiled ones call: without a wrapper for Python they compile sooner.
INNER: dict[str, Any] = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
#: Finest pieces of a hold.
HOLD_PIECES = 256
#: Cells into which an orbit is cut before any refinement.
ORBIT_CELLS = 16
#: Cells of an orbit after the last halving; what they leave uncertain is far less than the margins.
FINEST = ORBIT_CELLS * 2**10
#: Nodes of an orbit at which its slack is made linear.
FINE_NODES = 64
_COAST_ANGLE = 0.2
_COAST_PIECES = 64


class Model(NamedTuple):
    """Numbers (SI) and tables of one task.

    Attributes:
        n: Mean motion [rad/s].
        mass: Mass [kg].
        u_max: Largest thrust of each axis [N].
        dt: Length of a hold [s].
        near: Collision radius [m]; minus infinity where the range has no lower bound.
        near_psm: Radius that coasting must miss [m]; minus infinity where coasting is not bounded.
        v0: Speed limit at `d0` [m/s]; infinite where there is none.
        d0: Range of the speed limit `v0` [m].
        v1: Slope of the speed limit [1/s].
        cos_b: Cosine of the sun cone's half angle.
        sin_b: Sine of the sun cone's half angle.
        sun: True where the sun cone is forbidden.
        far: Largest range [m], or infinity.
        limit: Largest speed of each axis [m/s], or infinity, shape (3,).
        stretch: Largest gains of coasting over the horizon: position to position, velocity to position [s],
            velocity to velocity of accelerations [-] and of jerks [1/s], shape (4,).
        hold_phi: Transition matrices to the times k dt / 256, shape (257, 6, 6).
        hold_gamma: Input matrices of the same times [1/N], shape (257, 6, 3).
        hold_sun: Cosine and sine of the sun's turn to those times, shape (257, 2).
        coast: Position rows of the transition matrices over the horizon of passive safety, shape (L + 1, 3, 6).
        coast_step: Time between them [s].
        orbit: Cosine and sine of the first cells' ends of an orbit, shape (17, 2).
        fine: The same of `FINE_NODES` nodes, shape (64, 2).
        plan: Control of a plan from (targets - free motion), shape (3, 3), with the row order x, y, z of the velocity.
        further: How many further constraints there are; see `half_spaces`.
        kernels: Address of the addresses of their kernels and parameters; see `KernelTable`. Two numbers instead of
            arrays, for models are handed on by value.
    """

    n: float
    mass: float
    u_max: float
    dt: float
    near: float
    near_psm: float
    v0: float
    d0: float
    v1: float
    cos_b: float
    sin_b: float
    sun: bool
    far: float
    limit: FloatArray
    stretch: FloatArray
    hold_phi: FloatArray
    hold_gamma: FloatArray
    hold_sun: FloatArray
    coast: FloatArray
    coast_step: float
    orbit: FloatArray
    fine: FloatArray
    plan: FloatArray
    further: int
    kernels: int


def build_model(parameters: ConstraintParameters, names: Iterable[str] = KNOWN) -> Model:
    """Return the numbers and tables of a task.

    Args:
        parameters: The task's parameters.
        names: The constraints that count, of `KNOWN`.
    """
    chosen = set(names)
    p = parameters
    n, dt, angle = float(p.n), float(p.step_size), float(p.n * p.step_size)
    holds = [transition(n, p.m, dt * k / HOLD_PIECES) for k in range(HOLD_PIECES)] + [transition(n, p.m, dt)]
    pieces = _COAST_PIECES * max(1, math.ceil(n * p.psm_horizon / _COAST_ANGLE))
    coasts = np.stack([transition(n, p.m, p.psm_horizon * k / pieces)[0] for k in range(pieces + 1)])
    turns = angle * np.arange(HOLD_PIECES + 1) / HOLD_PIECES
    circle = 2.0 * np.pi * np.arange(ORBIT_CELLS + 1) / ORBIT_CELLS
    nodes = 2.0 * np.pi * np.arange(FINE_NODES) / FINE_NODES
    blocks = (coasts[:, :3, :3], coasts[:, :3, 3:], coasts[:, 3:, 3:], coasts[:, 3:, :3])
    # a hundredth more than the largest of the table bounds what lies between its entries
    stretch = np.array([1.01 * np.linalg.norm(block, ord=2, axis=(1, 2)).max() for block in blocks])
    gamma = holds[-1][1]
    closing = np.array(gamma[3:], dtype=np.float64)
    closing[1] += 2.0 * n * gamma[0]  # the drift v_y + 2 n x after the hold
    return Model(
        n=n, mass=float(p.m), u_max=float(p.u_max), dt=dt,
        near=float(p.collision_radius) if "chief_collision" in chosen else -math.inf,
        near_psm=float(p.collision_radius) if "PSM" in chosen else -math.inf,
        v0=float(p.v0) if "rel_vel" in chosen else math.inf, d0=p.speed_distance, v1=p.v1,
        cos_b=math.cos(0.5 * p.fov), sin_b=math.sin(0.5 * p.fov), sun="sun" in chosen,
        far=float(p.r_max) if "r_max" in chosen else math.inf,
        limit=np.array([p.vel_limit if f"{axis}_vel" in chosen else math.inf for axis in "xyz"], dtype=np.float64),
        stretch=stretch,
        hold_phi=np.stack([phi for phi, _ in holds]), hold_gamma=np.stack([gamma for _, gamma in holds]),
        hold_sun=np.stack((np.cos(turns), np.sin(turns)), axis=-1),
        coast=np.ascontiguousarray(coasts[:, :3]), coast_step=float(p.psm_horizon / pieces),
        orbit=np.stack((np.cos(circle), np.sin(circle)), axis=-1),
        fine=np.stack((np.cos(nodes), np.sin(nodes)), axis=-1),
        plan=np.asarray(np.linalg.inv(closing), dtype=np.float64),
        further=0, kernels=0,
    )  # fmt: skip
