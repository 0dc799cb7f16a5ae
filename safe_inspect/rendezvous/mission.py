"""One mission: the loop of truth, estimate, coordinator and control."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from safe_inspect.dynamics import quaternion
from safe_inspect.rendezvous.chaser import Actuator, ChaserDynamics
from safe_inspect.rendezvous.control.attitude import AttitudeController, CameraPointing
from safe_inspect.rendezvous.control.axis import Axis
from safe_inspect.rendezvous.control.lqr import LQRTrackerRun
from safe_inspect.rendezvous.control.tightening import TrackedReference, TrackingLimits
from safe_inspect.rendezvous.control.tracker import AxisStatus, TrackerOutput
from safe_inspect.rendezvous.coordination import actions, guards
from safe_inspect.rendezvous.coordination.context import MissionContext, clearances
from safe_inspect.rendezvous.coordination.coordinator import Coordinator, Phase
from safe_inspect.rendezvous.coordination.demands import PlanDemands
from safe_inspect.rendezvous.coordination.departure import CommandedMotion
from safe_inspect.rendezvous.coordination.reference import tide_of
from safe_inspect.rendezvous.coordination.table import TABLE
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.estimation.consistency import normalised_error
from safe_inspect.rendezvous.estimation.context import estimator_context
from safe_inspect.rendezvous.log import MissionLog
from safe_inspect.rendezvous.models import ChaserConfig, RendezvousConfig
from safe_inspect.rendezvous.planner.query import Limits
from safe_inspect.rendezvous.readings import Command
from safe_inspect.rendezvous.scenario import check_start, checked_target, mission_streams
from safe_inspect.rendezvous.sensors.suite import SensorSuite
from safe_inspect.rendezvous.summary import summarise_mission
from safe_inspect.rendezvous.truth import MissionTruth, TruthStep
from safe_inspect.types import FloatArray

#: Called at every change of state with the time [s], the state before, the guard and the state after.
_Progress = Callable[[float, Phase, str, Phase], None]


@dataclass(frozen=True, eq=False)
class MissionResult:
    """How a mission ended.

    Attributes:
        summary: Success, cause of failure, clearance, errors, effort; see `safe_inspect.rendezvous.summary`.
        log: Everything that happened.
    """

    summary: dict[str, Any]
    log: MissionLog


def limits_of(chaser: ChaserConfig, length: float = 1.0) -> Limits:
    """Return the limits for the planner, in a scenario of a length [m]."""
    own = chaser.limits
    return Limits(
        speed=own.speed,
        planned_force=own.planned_force,
        force=own.force,
        torque=own.torque,
        keep_in=None if own.keep_in is None else np.array(own.keep_in),
        radius=chaser.radius,
        line_of_sight_rate=own.line_of_sight_rate,
        mass=chaser.mass,
        cone=own.cone,
        cone_range=0.7 * length,
        least_range=0.2 * length,
    )


def dynamics_of(config: RendezvousConfig) -> ChaserDynamics:
    """Return how the chaser moves."""
    chaser, own = config.chaser, config.chaser.actuator
    actuator = Actuator(
        force=chaser.limits.force,
        torque=chaser.limits.torque,
        scale_error=own.scale_error,
        lag=own.lag,
        force_noise=own.force_noise,
        torque_noise=own.torque_noise,
    )
    return ChaserDynamics(
        chaser.mass, np.array(chaser.inertia), actuator, config.mission.tick, config.mission.mean_motion
    )


class Mission:
    """One mission of an experiment.

    Args:
        config: The experiment.
        number: Number of the mission; it draws its own tumble and noise.
        progress: Called at every change of state.
        watch: Called at every step of control, with the mission as it is then; it must not change it.
    """

    def __init__(
        self,
        config: RendezvousConfig,
        number: int = 0,
        progress: _Progress | None = None,
        watch: Callable[[MissionContext], None] | None = None,
    ) -> None:
        if not isinstance(config, RendezvousConfig):
            raise TypeError(
                f"a mission is made of a RendezvousConfig, `load_rendezvous(FILE).config`, not {config!r:.60}"
            )
        if not isinstance(number, (int, np.integer)) or number < 0:
            raise ValueError(f"the number of a mission is a whole number of 0 or more, not {number!r}")
        self._config, self._progress, self._watch = config, progress, watch
        self._streams = mission_streams(config, number)
        self._log = MissionLog()
        mission, chaser = config.mission, config.chaser
        target = checked_target(config)
        self._tumbling = config.tumble(self._streams)
        check_start(config, target, self._tumbling[0])
        self._estimator = config.estimator(estimator_context(target, chaser, mission, config.sensors, self._streams))
        self._sensors = SensorSuite(config.sensors, chaser, mission, target, self._streams, config.estimator.reads)
        self._done: tuple[Command, TruthStep] | None = None
        # At the start the camera looks at the target.
        position = np.array(chaser.position)
        orientation = CameraPointing(np.array([0.0, 0.0, 0.0, 1.0])).step(position, np.zeros(3), 1.0).orientation
        self._pointing = CameraPointing(orientation)
        self._controller = AttitudeController(np.array(chaser.inertia), chaser.limits.torque)
        start = BodyState(position, np.array(chaser.velocity), orientation, np.zeros(3))
        self._truth = MissionTruth(
            dynamics_of(config), start, target.principal, self._tumbling, mission.tick, mission.control_ticks,
            self._streams, mission.impulses,
        )  # fmt: skip
        readings = self._sensors.read(0.0, self._truth.chaser, self._truth.target)
        estimate = self._estimator.update(readings)
        axis = Axis(chaser.mass, mission.step)
        own = chaser.limits
        self._flight = MissionContext(
            config=config,
            target=target,
            limits=limits_of(chaser, mission.length),
            axis=axis,
            tracking_limits=TrackingLimits(own.force, own.tracking_speed, own.keep_in),
            streams=self._streams,
            hold=LQRTrackerRun(axis, own.force),
            report=self._event,
            readings=readings,
            estimate=estimate,
            motion=CommandedMotion.of(estimate),
        )
        self._flight.hold_point = np.array(chaser.position)
        self._flight.demands = PlanDemands.first(mission.length)
        self._coordinator: Coordinator[MissionContext] = Coordinator(TABLE, self._changed)

    def run(self) -> MissionResult:
        """Fly the mission to its end.

        The linear algebra has one thread meanwhile: its matrices are small, and threads would only wait for each other.
        """
        with threadpool_limits(limits=1, user_api="blas"):
            return self._run()

    def _run(self) -> MissionResult:
        context, coordinator = self._flight, self._coordinator
        while True:
            self._sense()
            coordinator.step(context)
            if coordinator.finished:
                break
            if self._watch is not None:
                self._watch(context)
            output, reference = self._follow()
            torque = self._point()
            context.motion.advance(output.force / self._config.chaser.mass, self._config.mission.step)
            force = self._in_inertial(output.force)
            done = self._truth.advance(force, torque)
            self._done = Command(output.force, torque), done
            self._record(output, reference, (force, torque), done)
        summary = summarise_mission(
            self._config, context.target, self._log, coordinator.state is Phase.DONE, context.cause
        )
        return MissionResult(summary, self._log)

    def _sense(self) -> None:
        """Bring the estimate, and what depends on it, up to now."""
        context, truth, mission = self._flight, self._truth, self._config.mission
        context.step, context.time = truth.step_number, truth.time
        before = context.estimate.updated
        if self._done is not None:
            command, done = self._done
            context.readings = self._sensors.read(context.time, truth.chaser, truth.target, done.chaser, command)
            context.estimate = self._estimator.update(context.readings)
        if "camera" not in context.readings.silent:
            context.camera_time = context.time
        if "imu" not in context.readings.silent:
            context.imu_time = context.time
        if context.estimate.updated != before:
            context.motion, context.poses = CommandedMotion.of(context.estimate), context.poses + 1
        elif guards.unseen(context):
            context.poses = 0
        is_slot = context.step * mission.control_ticks % mission.update_ticks == 0
        if is_slot and context.following is not None and context.estimate.updated != before:
            actions.renew_reference(context)
        if is_slot and context.following is not None:
            actions.renew_escape(context)
        elif is_slot and context.phase is Phase.RETREAT:
            actions.keep_escape(context)
        self._check_settled()

    def _check_settled(self) -> None:
        context, mission = self._flight, self._config.mission
        if context.phase is not Phase.MP_HOLD or context.following is None:
            context.settled_since = None
            return
        reference = context.following.reference
        k = min(context.step - context.following.first_step, len(reference.position) - 1)
        chaser = context.estimate.chaser
        near = (
            np.linalg.norm(chaser.position - reference.position[k]) < mission.hold_position
            and np.linalg.norm(chaser.velocity - reference.velocity[k]) < mission.hold_speed
            and context.pointing_error < mission.hold_angle
        )
        if not near:
            context.settled_since = None
        elif context.settled_since is None:
            context.settled_since = context.time

    def _follow(self) -> tuple[TrackerOutput, FloatArray]:
        """Return the tracker's output, and the state that it follows, shape (6,)."""
        context, x = self._flight, self._flight.estimate.translation
        following = context.following
        if following is not None:
            k = min(context.step - following.first_step, len(following.reference.position) - 1)
            is_solved = not context.fails("solver")
            output = (following.tracker if is_solved else context.hold).step(x, following.reference, k)
            context.infeasible = 0 if is_solved and output.feasible else context.infeasible + 1
            context.nominal = output.nominal
            return output, np.concatenate([following.reference.position[k], following.reference.velocity[k]])
        if context.phase is Phase.DEPART:
            return self._push(), np.concatenate([context.motion.position, context.motion.velocity])
        times = context.time + self._config.mission.step * np.arange(2.0)
        position, velocity = context.hold_point[None].repeat(2, axis=0), np.zeros((2, 3))
        if context.phase is Phase.RETREAT and context.escape is not None:
            position, velocity = context.escape.at(times)
            position = position + context.estimate.target.position
        tide = tide_of(self._config.mission.mean_motion, times, position - context.estimate.target.position)
        reference = TrackedReference(position, velocity, tide)
        return context.hold.step(x, reference, 0), np.concatenate([reference.position[0], reference.velocity[0]])

    def _push(self) -> TrackerOutput:
        """Return what is left of a departure's push, as far as one step gives it."""
        context, chaser = self._flight, self._config.chaser
        per_step = self._config.mission.step / chaser.mass
        force = np.clip(context.push / per_step, -chaser.limits.force, chaser.limits.force)
        context.push = context.push - per_step * force
        return TrackerOutput(force, np.zeros((3, 2)), np.zeros(3), (AxisStatus.SOLVED,) * 3)

    def _point(self) -> FloatArray:
        """Return the torque that turns the camera to where it shall look [N m], shape (3,).

        It is zero while the inertial unit is silent: a free rotation goes on as it was, which the estimate counts on.
        """
        context, chaser = self._flight, self._flight.estimate.chaser
        position = context.motion.position if context.phase is Phase.DEPART else chaser.position
        command = self._pointing.step(position, context.aim(), self._config.mission.step)
        error = quaternion.multiply(quaternion.conjugate(command.orientation), chaser.orientation)
        context.pointing_error = float(np.linalg.norm(quaternion.log(error)))
        if context.imu_time < context.time:
            return np.zeros(3)
        return self._controller(chaser.orientation, chaser.angular_velocity, command)

    def _in_inertial(self, force: FloatArray) -> FloatArray:
        """Return a force of the estimated frame W as it acts: thrusters are fixed in B [N], shape (3,)."""
        estimated, true = self._flight.estimate.chaser.orientation, self._truth.chaser.orientation
        if np.array_equal(estimated, true):
            return force
        return quaternion.rotate(true, quaternion.rotate(quaternion.conjugate(estimated), force))

    def _record(
        self, output: TrackerOutput, reference: FloatArray, command: tuple[FloatArray, FloatArray], done: TruthStep
    ) -> None:
        context, target = self._flight, self._flight.target
        history = done.chaser
        distances = clearances(target, history.translation[0, :, :3], done.target, context.limits.radius)
        design, plan = context.design, context.plan
        tube = margin = tube_force = np.nan
        if context.following is not None and design is not None and plan is not None:
            k = min(context.step - context.following.first_step, len(design.tube.clearance) - 1)
            tube, margin = float(design.tube.clearance[k]), float(design.margin[k])
            tube_force = float(design.tube.force[k])
        estimate = context.estimate
        self._log.add(
            t=context.time,
            state=list(Phase).index(context.phase),
            x=np.concatenate([done.chaser_before.position, done.chaser_before.velocity]),
            q=done.chaser_before.orientation,
            w=done.chaser_before.angular_velocity,
            target_q=done.target_before.orientation,
            target_w=done.target_before.angular_velocity,
            estimated_x=estimate.translation,
            estimated_q=estimate.chaser.orientation,
            estimated_target_p=estimate.target.position,
            estimated_target_q=estimate.target.orientation,
            estimated_target_w=estimate.target.angular_velocity,
            estimated_ratios=estimate.inertia[:2] / estimate.inertia[2],
            nees=normalised_error(estimate, done.chaser_before, done.target_before),
            sigma=[estimate.errors.attitude, estimate.errors.rate],
            reference=reference,
            z=output.nominal,
            v=output.nominal_force,
            force=command[0],
            torque=command[1],
            actuator_error=done.error,
            wrench=history.wrench[0, -1],
            status=[int(status) for status in output.status],
            clearance=distances.min(),
            margin=margin,
            tube=tube,
            tube_force=tube_force,
            pointing_error=context.pointing_error,
        )

    def _event(self, name: str, data: dict[str, Any]) -> None:
        context = self._flight
        tick = context.step * self._config.mission.control_ticks
        self._log.event(tick, context.time, context.phase.value, name, data)

    def _changed(self, before: Phase, guard: str, after: Phase) -> None:
        context = self._flight
        if after is Phase.TRACK and context.plan is not None:
            self._log.plans.append(context.plan)
        self._event("transition", {"from": before.value, "guard": guard, "to": after.value})
        if after is not before:
            context.phase, context.since = after, context.time
            if self._progress is not None:
                self._progress(context.time, before, guard, after)
