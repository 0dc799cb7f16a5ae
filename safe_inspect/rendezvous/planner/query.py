"""The input and the output of a planner: `PlanQuery` and `Plan`."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from safe_inspect.dynamics.tide import largest_tide
from safe_inspect.rendezvous.planner.paths import ApproachPath
from safe_inspect.rendezvous.target.model import Solid
from safe_inspect.tasks.docking.shape import ASTROBEE_RADIUS
from safe_inspect.types import FloatArray

#: Amount by which the clearance may be below the margin between samples, as a fraction of the scenario's length.
ALLOWANCE = 0.01


def _first_margin(times: FloatArray) -> FloatArray:
    """Return the clearance beyond the chaser's radius before a tube is known: 8 cm at all times."""
    return np.full(times.shape, 0.08)


@dataclass(frozen=True, eq=False)
class Limits:
    """The limits of the chaser. The defaults are those of Astrobee in the Japanese Experiment Module.

    Attributes:
        speed: Largest speed along each axis of W [m/s].
        planned_force: Largest force of a plan along each axis of W [N].
        force: Largest force of the actuators along each axis [N]; what a plan does not use is for feedback.
        torque: Largest torque about each axis [N m].
        keep_in: Half sizes of the box about W's origin that the chaser's centre must stay in [m], shape (3,); infinite
            for no box.
        radius: Radius of the sphere that contains the chaser [m].
        line_of_sight_rate: Largest rate of the direction to the target's centre of mass [rad/s].
        mass: Mass of the chaser [kg].
        cone: Half angle of the approach cone about the mating point's direction [rad], or None for no cone.
        cone_range: Distance from the target's centre of mass below which the cone applies [m].
        least_range: Smallest distance from the target's centre of mass [m].
    """

    speed: float = 0.115
    planned_force: float = 0.168
    force: float = 0.30
    torque: float = 0.025
    keep_in: FloatArray = field(default_factory=lambda: np.array([0.8, 3.0, 0.8]))
    radius: float = ASTROBEE_RADIUS
    line_of_sight_rate: float = 0.17
    mass: float = 9.583788668
    cone: float | None = None
    cone_range: float = 0.7
    least_range: float = 0.2


@dataclass(frozen=True, eq=False)
class PlanQuery:
    """A query for the plan of an approach.

    W is the inertial frame at the target's centre of mass, T the frame of the target's principal axes, and M the frame
    of the target's model.

    Attributes:
        t0: Time of the chaser's and the target's state [s].
        state: The chaser's position [m] and velocity [m/s] in W, shape (6,).
        orientation: Quaternion q_WT [x, y, z, w] of the target at t0, shape (4,).
        angular_velocity: The target's angular velocity in T at t0 [rad/s], shape (3,).
        inertia: The target's principal moments J1 <= J2 <= J3, up to a common factor, shape (3,).
        mating_point: Position, fixed in T, that the chaser's centre must reach [m], shape (3,).
        solid: The target, in M: distances to it are clearances.
        R_MT: Rotation that takes coordinates in T to M, shape (3, 3).
        limits: The chaser's limits.
        margin: Function from times since the plan's start [s], shape (K,), to the clearance required beyond the
            chaser's radius [m], shape (K,).
        durations: Durations of the approach to try [s]; the plan with the lowest cost is returned.
        waits: Waits before the approach [s] from which the planner chooses.
        mean_motion: Mean motion of the target's orbit [rad/s]; 0 for free space. The axes of W do not rotate, see
            `dynamics.tide`.
        length: Length of the scenario [m], about the radius that the target sweeps; the optimiser's unit of length.
        step: Control step [s], at which plans are sampled; durations are multiples of it.
        hold: Time after a plan for which the chaser may hold the mating point, which must stay in the keep-in box [s].
    """

    t0: float
    state: FloatArray
    orientation: FloatArray
    angular_velocity: FloatArray
    inertia: FloatArray
    mating_point: FloatArray
    solid: Solid
    R_MT: FloatArray
    limits: Limits = field(default_factory=Limits)
    margin: Callable[[FloatArray], FloatArray] = _first_margin
    durations: tuple[float, ...] = (60.0,)
    waits: tuple[float, ...] = (0.0,)
    mean_motion: float = 0.0
    length: float = 1.0
    step: float = 0.2
    hold: float = 0.0

    @property
    def planned_acceleration(self) -> float:
        """Largest acceleration of a plan along each axis, less the largest tidal acceleration in the box [m/s^2]."""
        limits = self.limits
        tide = largest_tide(self.mean_motion, float(np.linalg.norm(limits.keep_in))) if self.mean_motion else 0.0
        return limits.planned_force / limits.mass - tide


class PlanStatus(enum.Enum):
    """The result of planning. Only a SOLVED plan may be flown."""

    SOLVED = "solved"
    TERMINAL_INFEASIBLE = "terminal infeasible"  # The state at the mating point violates a limit.
    START_INFEASIBLE = "start infeasible"  # The start violates a limit, or leads to a violation.
    NOT_CONVERGED = "not converged"  # No start of the optimiser led to a feasible plan.
    NOT_CERTIFIED = "not certified"  # Feasible at the samples, but the clearance between them is not proved.
    REFUSED = "refused"  # Solved according to its planner, but the plan does not match the query.


@dataclass(frozen=True, eq=False)
class PlanReport:
    """A report of how a plan was found.

    Attributes:
        message: Reason of the failure with the value; empty for a solved plan.
        cost: The minimised cost, by default half the integral of the squared force [N^2 s].
        iterations: Number of iterations of the optimiser over all starts.
        starts: Number of starts of the optimiser that were tried.
        violation: Largest violation of a constraint at the samples [m; m/s for the line of sight].
        clearance: Certified lower bound of (clearance - radius - margin) [m]; NaN without a certificate.
        seconds: Computing time [s].
    """

    message: str = ""
    cost: float = float("nan")
    iterations: int = 0
    starts: int = 0
    violation: float = float("nan")
    clearance: float = float("nan")
    seconds: float = 0.0


@dataclass(frozen=True, eq=False)
class Plan:
    """A plan of an approach. Unless its status is SOLVED, it has no path and its arrays are empty.

    `planner.problem.sampled_plan` makes a plan from the path that a planner has found.

    Attributes:
        status: Result of planning.
        t_start: Time at which the approach starts, after the wait [s].
        duration: Duration of the approach [s].
        path: The chaser's path at all times, which the certificate of clearance needs; None without a plan.
        times: Times of the samples [s], t_start to t_start + duration, shape (K,).
        position: Position in W [m], shape (K, 3).
        velocity: Velocity in W [m/s], shape (K, 3).
        acceleration: Acceleration in W [m/s^2], shape (K, 3).
        force: Force in W, without that of the tide [N], shape (K, 3).
        position_target: Position in T [m], shape (K, 3).
        velocity_target: Derivative of the position in T [m/s], shape (K, 3).
        acceleration_target: Second derivative of the position in T [m/s^2], shape (K, 3).
        orientation: The target's predicted attitude q_WT, shape (K, 4).
        angular_velocity: The target's predicted angular velocity in T [rad/s], shape (K, 3).
        report: Report of how the plan was found.
        tide: Tidal acceleration on an orbit [m/s^2], shape (K, 3); None in free space.
    """

    status: PlanStatus
    t_start: float
    duration: float
    path: ApproachPath | None = None
    times: FloatArray = field(default_factory=lambda: np.empty(0))
    position: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    velocity: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    acceleration: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    force: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    position_target: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    velocity_target: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    acceleration_target: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    orientation: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    angular_velocity: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    report: PlanReport = field(default_factory=PlanReport)
    tide: FloatArray | None = None

    @property
    def solved(self) -> bool:
        """Whether the plan may be flown."""
        return self.status is PlanStatus.SOLVED
