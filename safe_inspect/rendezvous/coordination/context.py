"""The pilot's memory of one mission: estimates, plan and reference, the requirements on the next plan, and events."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, rotate
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.control.bound import Bound, ConformalBound
from safe_inspect.rendezvous.control.design import TubeDesign
from safe_inspect.rendezvous.control.tracker import Tracker, TrackerRun
from safe_inspect.rendezvous.control.tube import Axis, TrackedReference, TrackingLimits
from safe_inspect.rendezvous.coordination.escape import CommandedMotion, Escape
from safe_inspect.rendezvous.estimate import StateEstimate
from safe_inspect.rendezvous.experiment import RendezvousConfig
from safe_inspect.rendezvous.models import ChaserConfig, MissionConfig
from safe_inspect.rendezvous.planner.approach import ApproachPlanner
from safe_inspect.rendezvous.planner.query import ALLOWANCE, Limits, Plan, PlanQuery
from safe_inspect.rendezvous.poses import rotation_exp
from safe_inspect.rendezvous.readings import Readings
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray

# Lengths are fractions of the scenario's length, which is 1 m by default.
#: Difference between the margin of a tube and the margin required from the plan: a part of the certificate's allowance.
#: The rest of the allowance is for the times between the plan's samples.
_PLANNED_ALLOWANCE = 0.6 * ALLOWANCE
#: Increase of the required margin after each refusal, and its largest value: the bound, and with it the tube, differs
#: from plan to plan by a few millimetres.
_GROWTH = 0.003
_MOST_GROWTH = 0.015
#: Reserve after a tube has exceeded a limit: of the keep-in box, and of the force as a fraction of its limit.
_SPARE_LENGTH = 0.002
_SPARE_FORCE = 0.005 / 0.30
#: Clearance of a mapped mating point that the first margin leaves to the errors of the map.
_MAP_ALLOWANCE = 0.015
#: Distance by which a chaser that holds its position may drift from the start of a plan.
_DRIFT = 0.02
#: Smallest fraction of a limit that a plan may use.
_LEAST_SHARE = 0.3


@dataclass(frozen=True, eq=False)
class PlanDemands:
    """The requirements on a plan, so that its tube is accepted.

    Attributes:
        margin: Function from times since a plan's start [s] to the clearance required beyond the chaser's radius [m].
        gain: Feedback gain of the tube to which the margin belongs, shape (2,) or (K, 2); None before a tube is known,
            or if the gain must be chosen again.
        growth: Difference between the margin and that of the last tube [m]; it grows after each refusal of a tube with
            a known gain.
        keep_in: Half sizes of the box in which the tube of a plan stays within the keep-in box [m], shape (3,).
        speed: Largest speed of a plan whose tube stays within the speed limit [m/s].
        force: Largest force of a plan that leaves the tube its feedback [N].
        length: Length of the scenario [m].
    """

    margin: Callable[[FloatArray], FloatArray] = PlanQuery.margin
    gain: FloatArray | None = None
    growth: float = 0.0
    keep_in: FloatArray = field(default_factory=lambda: np.full(3, np.inf))
    speed: float = np.inf
    force: float = np.inf
    length: float = 1.0

    @classmethod
    def first(cls, length: float, most: float = np.inf) -> PlanDemands:
        """Return the requirements before a tube is known.

        Args:
            length: Length of the scenario [m].
            most: Upper limit of the margin [m].
        """
        return cls(margin=lambda times: np.minimum(length * PlanQuery.margin(times), most), length=length)

    def limits(self, limits: Limits, position: FloatArray) -> Limits:
        """Return the limits for a plan; the box always contains the position [m], shape (3,), from which it starts."""
        box = limits.keep_in
        box = np.maximum(np.minimum(box, self.keep_in), np.minimum(np.abs(position) + _DRIFT * self.length, box))
        return replace(
            limits,
            keep_in=box,
            speed=min(limits.speed, max(self.speed, _LEAST_SHARE * limits.speed)),
            planned_force=min(limits.planned_force, max(self.force, _LEAST_SHARE * limits.planned_force)),
        )

    def later(self, elapsed: float) -> PlanDemands:
        """Return the requirements on the rest of a plan after a time [s]; its gain is chosen again."""
        margin = self.margin
        return replace(self, margin=lambda times: margin(np.asarray(times) + elapsed), gain=None)

    def after(self, design: TubeDesign) -> PlanDemands:
        """Return the requirements on the next plan.

        The gain stays the same, so that the margin of the next tube differs from the one in these requirements only as
        far as the bound of the reference does.

        Args:
            design: The tube of the last plan.
        """
        is_short = self.gain is not None and not design.accepted
        growth = min(self.growth + _GROWTH * self.length * is_short, _MOST_GROWTH * self.length)
        tube, own, gain = design.tube, design.limits, design.tube.gain
        keep_in, speed, force = self.keep_in, self.speed, self.force
        inside = own.keep_in - float(tube.position.max()) - _SPARE_LENGTH * self.length
        keep_in = np.where(design.state_reserve[:, 0] < 0.0, np.minimum(keep_in, inside), keep_in)
        if design.state_reserve[:, 1].min() < 0.0:
            speed = min(speed, own.speed - float(tube.velocity.max()))
        if design.force_reserve.min() < 0.0:
            force = min(force, own.force - float(tube.force.max()) - _SPARE_FORCE * own.force)
        allowance = _PLANNED_ALLOWANCE * self.length
        return PlanDemands(
            margin=lambda times: np.asarray(design.margin_at(times) + growth - allowance),
            gain=gain if gain.any() else None,
            growth=growth,
            keep_in=keep_in,
            speed=speed,
            force=force,
            length=self.length,
        )


class Phase(enum.Enum):
    """The state of a mission."""

    CHECKOUT = "CHECKOUT"
    OBSERVE = "OBSERVE"
    CHARACTERISE = "CHARACTERISE"
    PLAN = "PLAN"
    BOUND = "BOUND"
    WAIT = "WAIT"
    TRACK = "TRACK"
    MP_HOLD = "MP_HOLD"
    RETREAT = "RETREAT"
    DONE = "DONE"
    ABORTED = "ABORTED"
    DEPART = "DEPART"

    @property
    def number(self) -> int:
        """Number of the state in the arrays of a log."""
        return list(Phase).index(self)


class PilotConfig(NamedTuple):
    """The configuration of a pilot: the experiment without the simulated world.

    Attributes:
        chaser: The chaser.
        mission: Rates, guards and time limits, with only the faults of the flight computer.
        planner: Plans the approach.
        bound: Bounds the error of the reference.
        tracker: Follows the reference.
    """

    chaser: ChaserConfig
    mission: MissionConfig
    planner: ApproachPlanner
    bound: ConformalBound
    tracker: Tracker

    @classmethod
    def of(cls, config: RendezvousConfig) -> PilotConfig:
        """Return the pilot's configuration from an experiment."""
        own = tuple(fault for fault in config.mission.faults if fault.kind == "planner")
        mission = config.mission.model_copy(update={"faults": own})
        return cls(config.chaser, mission, config.planner, config.bound, config.tracker)


@dataclass(eq=False)
class Following:
    """The approach that is flown, which continues while another one is planned.

    Attributes:
        plan: Its plan.
        design: The tube of the plan, with its reserves.
        unrenewed: Bound of the error of the plan's reference without updates.
        reference: Positions and velocities at the control steps.
        first_step: Number of the control step at which the reference starts.
        tracker: The tracker that follows the reference.
    """

    plan: Plan
    design: TubeDesign
    unrenewed: Bound
    reference: TrackedReference
    first_step: int
    tracker: TrackerRun


@dataclass(eq=False)
class MissionContext:
    """The pilot's memory of one mission.

    Attributes:
        config: Configuration of the pilot.
        target: The target.
        limits: The chaser's limits.
        axis: Model of the chaser along one axis.
        tracking_limits: Limits of tracking.
        streams: The random streams of the mission.
        holding: Tracker without a tube, for everything except an approach.
        report: Called with the name and the data of each event.
        readings: The newest readings of the sensors.
        estimate: The newest estimate.
        step: Number of the control step.
        time: The current time [s].
        phase: The coordinator's state.
        since: Time at which the state was entered [s].
        hold_point: Position that the chaser holds while it waits, in W [m], shape (3,).
        plan: The newest plan.
        query: The query of the newest plan.
        planned_at: Time from which the newest plan may be flown, when its computation ends [s].
        design: The tube of the newest plan.
        reference_problem: Which limit the newest reference violates; empty for none.
        has_left_bound: Whether a reference of this approach was outside of its bound without updates.
        demands: The requirements on the next plan.
        first_margin: Upper limit of the margin before a tube is known [m].
        following: The approach that is flown.
        renewed_at: Time at which the reference was last updated [s].
        escape: The newest escape.
        plan_failures: Number of consecutive failures to plan.
        bound_failures: Number of consecutive refusals of a tube.
        replans: Number of plans made during the approach.
        outside: Distance of the chaser from the tube at the last step [m].
        on_approach: Whether the chaser has started an approach, so that it cannot wait for another plan.
        attempts: Number of times that the chaser has started to observe the target.
        awaits_poses: Whether the chaser did not see the target when it departed.
        coarse: Whether the observation ended without the required accuracy.
        settled_since: Time since which the chaser is at the mating point [s]; None while it is not.
        camera_time: Time at which the camera last worked [s].
        imu_time: Time at which the inertial unit last worked [s].
        motion: The chaser's motion since the last pose, computed from the commands.
        poses: Number of poses since they were last missing for longer than is tolerated.
        push: Remaining change of velocity of a departure [m/s], shape (3,).
        pointing_error: Angle between the commanded and the estimated attitude [rad].
        cause: Why the mission ended.
    """

    config: PilotConfig
    target: Target
    limits: Limits
    axis: Axis
    tracking_limits: TrackingLimits
    streams: Streams
    holding: TrackerRun
    report: Callable[[str, dict[str, Any]], None]
    readings: Readings
    estimate: StateEstimate
    motion: CommandedMotion
    step: int = 0
    time: float = 0.0
    phase: Phase = Phase.CHECKOUT
    since: float = 0.0
    hold_point: FloatArray = field(default_factory=lambda: np.zeros(3))
    plan: Plan | None = None
    query: PlanQuery | None = None
    planned_at: float = -1.0
    design: TubeDesign | None = None
    reference_problem: str = ""
    has_left_bound: bool = False
    demands: PlanDemands = field(default_factory=PlanDemands)
    first_margin: float = math.inf
    following: Following | None = None
    renewed_at: float = -math.inf
    escape: Escape | None = None
    plan_failures: int = 0
    bound_failures: int = 0
    replans: int = 0
    outside: float = 0.0
    on_approach: bool = False
    attempts: int = 0
    awaits_poses: bool = False
    coarse: bool = False
    settled_since: float | None = None
    camera_time: float = -math.inf
    imu_time: float = -math.inf
    poses: int = 0
    push: FloatArray = field(default_factory=lambda: np.zeros(3))
    pointing_error: float = 0.0
    cause: str = ""

    @property
    def elapsed(self) -> float:
        """Time since the state was entered [s]."""
        return self.time - self.since

    def aim(self) -> FloatArray:
        """Return the point at which the camera looks, in W [m], shape (3,).

        Far from the target it is the centre of mass. At the mating point's distance from the centre it is the corner
        nearest to the mating point. Between twice that distance and that distance it moves linearly from one to the
        other. Near the target one face may fill the image, which does not show the chaser's position along the face; a
        corner does.
        """
        target, chaser = self.estimate.target, self.estimate.chaser
        distance = np.linalg.norm(chaser.position - target.position) / np.linalg.norm(self.target.mating_point)
        share = min(max(2.0 - float(distance), 0.0), 1.0)
        return target.position + share * rotate(target.orientation, self.target.landmark)

    def watch_point(self, time: float) -> FloatArray:
        """Return where the chaser waits at a time [s], in W [m], shape (3,): at `hold_point`, or on its way around."""
        observes = self.phase in (Phase.CHECKOUT, Phase.OBSERVE)
        return self._flown_around(self.hold_point, time) if observes else self.hold_point

    def hold(self) -> None:
        """Hold the position of the chaser, or continue around the target from there while it is observed."""
        self.hold_point = self._flown_around(self.estimate.chaser.position, -self.time).copy()

    def _flown_around(self, point: FloatArray, time: float) -> FloatArray:
        """Return a point in W after a flight around the target for a time [s], which may be negative, shape (3,)."""
        whole, centre = self.config.mission.fly_around, self.estimate.target.position
        if not whole or self.estimate.mapped is not None:
            return point
        return np.asarray(centre + rotation_exp(np.array([0.0, 0.0, 2.0 * np.pi * time / whole])) @ (point - centre))

    def use_map(self, target: Target) -> None:
        """Continue with a mapped target; before a tube is known, plans keep at most its mating point's clearance."""
        self.target, self.hold_point = target, self.estimate.chaser.position.copy()
        point = target.R_MT @ target.mating_point
        spare = float(target.solid.distance(point[None])[0]) - self.limits.radius
        self.first_margin = spare - _MAP_ALLOWANCE * self.config.mission.length
        self.forget_tube()

    def forget_tube(self) -> None:
        """Require of the next plan what is required before a tube is known."""
        self.demands = PlanDemands.first(self.config.mission.length, self.first_margin)

    def clearance(self) -> float:
        """Return the estimated distance from the chaser's sphere to the target's boxes [m]."""
        estimate, radius = self.estimate, self.limits.radius
        orientation = estimate.target.orientation[None]
        return float(clearances(self.target, estimate.relative[None, :3], orientation, radius)[0])


def clearances(target: Target, positions: FloatArray, orientations: FloatArray, radius: float) -> FloatArray:
    """Return the distances of the chaser's sphere from the target's boxes [m], shape (K,).

    Args:
        target: The target.
        positions: Positions of the chaser relative to the target's centre of mass in W [m], shape (K, 3).
        orientations: Attitudes q_WT of the target, shape (K, 4).
        radius: Radius of the chaser's sphere [m].
    """
    in_target = rotate(conjugate(orientations), positions)
    return target.solid.distance(in_target @ target.R_MT.T) - radius
