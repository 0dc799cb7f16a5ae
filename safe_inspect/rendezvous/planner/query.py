"""What a planner is asked, and what it answers."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from safe_inspect.dynamics.tide import largest_tide
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.rendezvous.planner.path import ApproachPath
from safe_inspect.types import FloatArray

#: What the clearance may be below the margin between samples, as a share of the scenario's length.
ALLOWANCE = 0.01


def _constant_margin(times: FloatArray) -> FloatArray:
    """Return a clearance margin of 8 cm at all times."""
    return np.full(times.shape, 0.08)


def _jem_keep_in() -> FloatArray:
    """Return the half sizes of the Japanese Experiment Module, less the chaser's radius [m]."""
    return np.array([0.8, 3.0, 0.8])


@dataclass(frozen=True, eq=False)
class Limits:
    """What the chaser can do and where it may be. Defaults: Astrobee in the Japanese Experiment Module.

    Attributes:
        speed: Largest speed along each axis of W [m/s].
        planned_force: Largest force along each axis of W that a plan may ask for [N].
        force: Largest force along each axis that the actuators give [N]; the rest is left to feedback.
        torque: Largest torque about each axis [N m].
        keep_in: Half sizes of the box about the origin of W that the chaser's centre stays in [m], shape (3,), or None.
        radius: Radius of the sphere that holds the chaser [m].
        line_of_sight_rate: Largest rate of the direction to the target's centre of mass [rad/s].
        mass: Mass of the chaser [kg].
        cone: Half angle of the approach cone about the mating point's direction [rad], or None for no cone.
        cone_range: Distance from the target's centre of mass below which the cone holds [m].
        least_range: Least distance from the target's centre of mass [m].
    """

    speed: float = 0.115
    planned_force: float = 0.168
    force: float = 0.30
    torque: float = 0.025
    keep_in: FloatArray | None = field(default_factory=_jem_keep_in)
    radius: float = 0.25
    line_of_sight_rate: float = 0.17
    mass: float = 9.583788668
    cone: float | None = None
    cone_range: float = 0.7
    least_range: float = 0.2


@dataclass(frozen=True, eq=False)
class PlanQuery:
    """An approach to plan. Frames: W inertial, at the target's centre of mass; T principal axes; M model of the target.

    Attributes:
        t0: Time of the state [s].
        state: The chaser's position [m] and velocity [m/s] in W, shape (6,).
        orientation: Quaternion q_WT [x, y, z, w] of the target at t0, shape (4,).
        angular_velocity: The target's angular velocity in T at t0 [rad/s], shape (3,).
        inertia: The target's principal moments J1 <= J2 <= J3, up to one factor, shape (3,).
        mating_point: Where the chaser's centre shall be, fixed in T [m], shape (3,).
        boxes: The target's shape in M.
        R_MT: Takes coordinates in T to M, shape (3, 3).
        limits: The chaser's limits.
        margin: Gives, for times since the plan's start [s], shape (K,), the clearance to keep beyond the chaser's
            radius [m], shape (K,).
        durations: Durations of the approach to try [s]; the cheapest plan is returned.
        waits: Times to wait before the approach [s] to choose from.
        mean_motion: Mean motion of the target's orbit [rad/s]; 0 for free space. W does not turn, see `dynamics.tide`.
        length: Length of the scenario [m], about the radius that the target sweeps: unit of the optimiser.
        step: Step of control [s], at which plans are sampled; durations are multiples of it.
    """

    t0: float
    state: FloatArray
    orientation: FloatArray
    angular_velocity: FloatArray
    inertia: FloatArray
    mating_point: FloatArray
    boxes: OrientedBoxes
    R_MT: FloatArray
    limits: Limits = field(default_factory=Limits)
    margin: Callable[[FloatArray], FloatArray] = _constant_margin
    durations: tuple[float, ...] = (60.0,)
    waits: tuple[float, ...] = (0.0,)
    mean_motion: float = 0.0
    length: float = 1.0
    step: float = 0.2

    def __post_init__(self) -> None:
        for name, shape in (
            ("state", (6,)),
            ("orientation", (4,)),
            ("angular_velocity", (3,)),
            ("inertia", (3,)),
            ("mating_point", (3,)),
            ("R_MT", (3, 3)),
        ):
            array = np.asarray(getattr(self, name), dtype=np.float64)
            if array.shape != shape or not np.isfinite(array).all():
                raise ValueError(f"plan query: {name} must be finite, of shape {shape}, got {array.tolist()}")
            object.__setattr__(self, name, array)
        if not self.mating_point.any():
            raise ValueError("plan query: mating_point must not be the target's centre of mass")
        if abs(float(self.orientation @ self.orientation) - 1.0) > 1e-6:
            raise ValueError(f"plan query: orientation must be a unit quaternion, got {self.orientation.tolist()}")
        if not self.durations or not self.waits or min(self.durations) <= 0.0 or min(self.waits) < 0.0:
            raise ValueError("plan query: durations must be positive and waits not negative [s], at least one of each")
        if self.mean_motion and self.limits.keep_in is None:
            raise ValueError(
                "plan query: on an orbit (mean_motion > 0) limits.keep_in must be given: it bounds the tide"
            )

    @property
    def planned_acceleration(self) -> float:
        """Largest acceleration along each axis that a plan may have, less the largest tide in the box [m/s^2]."""
        limits = self.limits
        reach = 0.0 if limits.keep_in is None else float(np.linalg.norm(limits.keep_in))
        return limits.planned_force / limits.mass - largest_tide(self.mean_motion, reach)


class PlanStatus(enum.Enum):
    """How planning ended; only a SOLVED plan may be flown."""

    SOLVED = "solved"
    TERMINAL_INFEASIBLE = "terminal infeasible"  # the state at the mating point breaks a limit
    START_INFEASIBLE = "start infeasible"  # the start breaks a limit, or is about to
    NOT_CONVERGED = "not converged"  # no start of the optimiser led to a feasible plan
    NOT_CERTIFIED = "not certified"  # feasible at the samples, but not shown to be clear between them
    REFUSED = "refused"  # called solved by its planner, but it is not what was asked for


@dataclass(frozen=True, eq=False)
class PlanReport:
    """How a plan was found.

    Attributes:
        message: What failed, and the value; empty for a solved plan.
        cost: The cost that was minimised, by default half the integral of the squared force [N^2 s].
        iterations: Iterations of the optimiser, over all its starts.
        starts: Number of starts of the optimiser that were tried.
        violation: Largest violation of a constraint at the samples [m, or m/s for the line of sight].
        clearance: Certified lower bound of (clearance - radius - margin) [m]; nan without a certificate.
        seconds: Computing time [s].
    """

    message: str = ""
    cost: float = float("nan")
    iterations: int = 0
    starts: int = 0
    violation: float = float("nan")
    clearance: float = float("nan")
    seconds: float = 0.0


def _no_rows() -> FloatArray:
    return np.empty((0, 3))


@dataclass(frozen=True, eq=False)
class Plan:
    """An approach. Without status SOLVED it has no path, and the arrays are empty.

    A planner returns a path; `planner.problem.sampled_plan` makes the plan of it.

    Attributes:
        status: How planning ended.
        t_start: When the approach starts, with the wait [s].
        duration: How long it takes [s].
        path: Where the chaser is at every time, which the certificate of clearance needs; None without a plan.
        times: Times of the samples [s], t_start to t_start + duration, shape (K,).
        position: Position in W [m], shape (K, 3).
        velocity: Velocity in W [m/s], shape (K, 3).
        acceleration: Acceleration in W [m/s^2], shape (K, 3).
        force: Force in W, without what the tide does [N], shape (K, 3).
        position_target: Position in T [m], shape (K, 3).
        velocity_target: Its derivative in T [m/s], shape (K, 3).
        acceleration_target: Its second derivative in T [m/s^2], shape (K, 3).
        orientation: The target's predicted attitude q_WT, shape (K, 4).
        angular_velocity: The target's predicted angular velocity in T [rad/s], shape (K, 3).
        report: How the plan was found.
        tide: Tidal acceleration on an orbit [m/s^2], shape (K, 3); None in free space.
    """

    status: PlanStatus
    t_start: float
    duration: float
    path: ApproachPath | None = None
    times: FloatArray = field(default_factory=lambda: np.empty(0))
    position: FloatArray = field(default_factory=_no_rows)
    velocity: FloatArray = field(default_factory=_no_rows)
    acceleration: FloatArray = field(default_factory=_no_rows)
    force: FloatArray = field(default_factory=_no_rows)
    position_target: FloatArray = field(default_factory=_no_rows)
    velocity_target: FloatArray = field(default_factory=_no_rows)
    acceleration_target: FloatArray = field(default_factory=_no_rows)
    orientation: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    angular_velocity: FloatArray = field(default_factory=_no_rows)
    report: PlanReport = field(default_factory=PlanReport)
    tide: FloatArray | None = None

    @property
    def solved(self) -> bool:
        """Whether the plan may be flown."""
        return self.status is PlanStatus.SOLVED
