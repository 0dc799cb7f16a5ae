"""`Pilot`: flies a mission from the sensors' readings by the table of states, guards and actions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.dynamics import quaternion
from safe_inspect.errors import PluginValueError
from safe_inspect.plugins.results import called, require_arrays, require_type
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.control.attitude import AttitudeController, CameraPointing
from safe_inspect.rendezvous.control.tracker import LinearFeedback, TrackerOutput
from safe_inspect.rendezvous.control.tube import Axis, TrackedReference, TrackingLimits
from safe_inspect.rendezvous.coordination import actions, guards
from safe_inspect.rendezvous.coordination.actions import renew_reference, tide_of
from safe_inspect.rendezvous.coordination.context import MissionContext, Phase, PilotConfig
from safe_inspect.rendezvous.coordination.escape import CommandedMotion
from safe_inspect.rendezvous.estimate import StateEstimate
from safe_inspect.rendezvous.estimation.estimators import EstimatorRun
from safe_inspect.rendezvous.models import ChaserConfig
from safe_inspect.rendezvous.planner.query import Limits
from safe_inspect.rendezvous.readings import Command, Readings
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray

#: States that a mission does not leave.
FINAL = frozenset({Phase.DONE, Phase.ABORTED})
#: Largest number of transitions in a step; more mean that the table has a cycle.
_MOST_TRANSITIONS = 50
#: States in which the chaser may be near the target, so that a mission that is out of time retreats.
_NEAR = (Phase.PLAN, Phase.BOUND, Phase.WAIT, Phase.TRACK, Phase.MP_HOLD)
#: States in which a fault leads to a retreat. The rows of the faults come before the other rows of these states.
_ACTIVE = (Phase.CHECKOUT, Phase.OBSERVE, Phase.CHARACTERISE, *_NEAR)


@dataclass(frozen=True)
class TableRow:
    """A row of the table: a transition.

    Attributes:
        state: The state before the transition.
        guard: Function that returns whether the transition applies.
        action: Function that is called if the transition is taken.
        next: The state after the transition, which may be the same one.
    """

    state: Phase
    guard: Callable[[MissionContext], bool]
    action: Callable[[MissionContext], None]
    next: Phase


class Coordinator:
    """A state machine that takes, of the rows of its state, the first one whose guard holds.

    A row that does not change the state ends the step, so that its action may be tried again at the next step.

    Args:
        table: The rows of the table.
        report: Called with the state before, the row's guard and the state after.
    """

    def __init__(self, table: Sequence[TableRow], report: Callable[[Phase, str, Phase], None]) -> None:
        self._rows = {state: [row for row in table if row.state is state] for state in Phase}
        self._report = report
        self.state = Phase.CHECKOUT

    @property
    def finished(self) -> bool:
        """Whether the mission is over."""
        return self.state in FINAL

    def step(self, context: MissionContext) -> None:
        """Take transitions until no guard holds or a row does not change the state."""
        for _ in range(_MOST_TRANSITIONS):
            row = next((row for row in self._rows[self.state] if row.guard(context)), None)
            if row is None:
                return
            before, self.state = self.state, row.next
            row.action(context)
            self._report(before, row.guard.__name__, row.next)
            if row.next is before:
                return
        raise RuntimeError(f"the coordinator's table has a cycle at state {self.state.value}")


TABLE: tuple[TableRow, ...] = (
    *(
        TableRow(state, guards.out_of_time, actions.give_up, Phase.DEPART)
        for state in (Phase.CHECKOUT, Phase.OBSERVE, Phase.CHARACTERISE)
    ),
    *(TableRow(state, guards.out_of_time, actions.retreat, Phase.RETREAT) for state in _NEAR),
    *(TableRow(state, guards.fault, actions.retreat, Phase.RETREAT) for state in _ACTIVE),
    TableRow(Phase.CHECKOUT, guards.checked_out, actions.start_observing, Phase.OBSERVE),
    TableRow(Phase.CHECKOUT, guards.checkout_too_long, actions.give_up, Phase.DEPART),
    TableRow(Phase.OBSERVE, guards.observed, actions.end_observation, Phase.CHARACTERISE),
    TableRow(Phase.OBSERVE, guards.observed_at_most, actions.end_observation_coarse, Phase.CHARACTERISE),
    TableRow(Phase.CHARACTERISE, guards.characterised, actions.make_plan, Phase.PLAN),
    TableRow(Phase.CHARACTERISE, guards.may_observe_again, actions.start_observing, Phase.OBSERVE),
    TableRow(Phase.CHARACTERISE, guards.always, actions.retreat, Phase.RETREAT),
    TableRow(Phase.PLAN, guards.plan_found, actions.make_tube, Phase.BOUND),
    TableRow(Phase.PLAN, guards.plans_exhausted, actions.retreat, Phase.RETREAT),
    TableRow(Phase.PLAN, guards.estimate_is_new, actions.make_plan, Phase.PLAN),
    TableRow(Phase.BOUND, guards.tube_fits, actions.nothing, Phase.WAIT),
    TableRow(Phase.BOUND, guards.may_bound_again, actions.make_plan_again, Phase.PLAN),
    TableRow(Phase.BOUND, guards.may_observe_again, actions.start_observing, Phase.OBSERVE),
    TableRow(Phase.BOUND, guards.always, actions.retreat, Phase.RETREAT),
    TableRow(Phase.WAIT, guards.start_is_planned, actions.start_approach, Phase.TRACK),
    TableRow(Phase.WAIT, guards.start_is_near, actions.make_plan_now, Phase.PLAN),
    TableRow(Phase.TRACK, guards.arrived, actions.nothing, Phase.MP_HOLD),
    TableRow(Phase.TRACK, guards.may_replan, actions.replan_on_the_way, Phase.PLAN),
    TableRow(Phase.TRACK, guards.off_plan, actions.retreat, Phase.RETREAT),
    TableRow(Phase.MP_HOLD, guards.settled, actions.finish, Phase.DONE),
    TableRow(Phase.MP_HOLD, guards.hold_too_long, actions.retreat, Phase.RETREAT),
    TableRow(Phase.RETREAT, guards.may_return, actions.start_observing, Phase.OBSERVE),
    TableRow(Phase.RETREAT, guards.escaped, actions.depart, Phase.DEPART),
    TableRow(Phase.RETREAT, guards.unseen_outside, actions.depart, Phase.DEPART),
    TableRow(Phase.RETREAT, guards.retreat_too_long, actions.depart, Phase.DEPART),
    TableRow(Phase.DEPART, guards.may_resume, actions.start_observing, Phase.OBSERVE),
    TableRow(Phase.DEPART, guards.departed, actions.nothing, Phase.ABORTED),
)


def limits_of(chaser: ChaserConfig, length: float = 1.0) -> Limits:
    """Return the limits for the planner in a scenario of a given length [m]."""
    own = chaser.limits
    return Limits(
        **own.model_dump(exclude={"tracking_speed", "keep_in"}),
        keep_in=np.full(3, np.inf) if own.keep_in is None else np.array(own.keep_in),
        radius=chaser.radius,
        mass=chaser.mass,
        cone_range=0.7 * length,
        least_range=0.2 * length,
    )


def _check_estimate(call: str, estimate: StateEstimate) -> None:
    """Raise a `PluginValueError` if the result of an estimator is no estimate."""
    require_type(call, estimate, StateEstimate)
    sizes = {"position": 3, "velocity": 3, "orientation": 4, "angular_velocity": 3}
    states = [(body, getattr(estimate, body)) for body in ("chaser", "target")]
    parts = [
        (f"{body}.{name}", getattr(state, name, None), (size,))
        for body, state in states
        for name, size in sizes.items()
    ]
    require_arrays(call, [*parts, ("inertia", estimate.inertia, (3,))])


class Pilot:
    """The flight computer of one mission, which computes commands from readings.

    It reads

    - the `Readings` of each step: itself the time and the sensors that are silent, and once, at the first step, the
      chaser's state in `start`; the rest through the estimator: the command that was held since the last step and, as
      the estimator's `reads` names them, the depth frame or measured poses, inertial samples, measured states and an
      operator's mark;
    - its `PilotConfig`: the chaser with the errors of its actuators, the mission with the faults of the planner only,
      and planner, bound and tracker;
    - what `StateEstimator.known` returns of the target before the mission: by default everything.

    It must not read true states or the faults of sensors and target. It is given none of them, and it may not import
    `safe_inspect.missions`, by the rules of ``.importlinter``, which do not check plugins of other packages. What it
    gets of the truth nevertheless is the chaser's state in `Readings.start`, and the measurements of a sensor of
    states, see `safe_inspect.rendezvous.readings`.

    Readings come at every control step, `mission.step` [s]: a frame (or poses) and the mark every
    `sensors.frame_period` [s] from time 0, all inertial samples since the last step, the measured chaser at every step
    and the measured target every `mission.update_period` [s]. W are inertial axes with the origin in the target's
    centre of mass, T the target's principal axes, B the chaser's axes and C the camera's (z forward, x right, y down).
    States have position [m] and velocity [m/s] in W, a quaternion [x, y, z, w] from the body to W and a rate in body
    axes [rad/s]. Samples (specific force [m/s^2] and rate [rad/s]), commands ([N], [N m]) and the mark [m] are in B,
    depths and points [m] in C.

    It must draw from the streams only what is named ``bound.*``, because they are those of the mission. No check
    enforces this rule.

    Args:
        config: Configuration of the pilot.
        target: What is known of the target before the mission; a map replaces it.
        estimator: The estimator of the mission.
        streams: The random streams of the mission, from which the bound alone draws (``bound.*``).
        report: Called with the name and the data of each event.
        changed: Called at every change of state with the state before, the guard and the state after.

    Attributes:
        context: The pilot's memory; it does not exist before the first readings.
        followed: Position [m] and velocity [m/s] in W that the last call of `act` has followed, shape (6,).
        estimator: The estimator.
    """

    context: MissionContext
    followed: FloatArray

    def __init__(
        self,
        config: PilotConfig,
        target: Target,
        estimator: EstimatorRun,
        streams: Streams,
        report: Callable[[str, dict[str, Any]], None],
        changed: Callable[[Phase, str, Phase], None],
    ) -> None:
        self._config, self._target, self._streams = config, target, streams
        self._report, self._report_change = report, changed
        self.estimator = estimator
        chaser = config.chaser
        self._controller = AttitudeController(np.array(chaser.inertia), chaser.limits.torque)
        self._pointing: CameraPointing | None = None
        self._coordinator = Coordinator(TABLE, self._changed)

    @property
    def arrived(self) -> bool:
        """Whether the mission has ended at the mating point according to the estimate."""
        return self._coordinator.state is Phase.DONE

    def act(self, readings: Readings) -> Command | None:
        """Return the command to hold for a control step; None at the end of the mission.

        Args:
            readings: The measurements since the last call.
        """
        estimate = self.estimator.update(readings)
        _check_estimate(called(self.estimator, "update"), estimate)
        if self._pointing is None:
            self._begin(readings, estimate)
        self._sense(readings, estimate)
        context = self.context
        self._coordinator.step(context)
        if self._coordinator.finished:
            return None
        output, self.followed = self._follow()
        force = output.force
        command = Command(self._in_body(force), self._point())
        if not np.isfinite(np.concatenate(command)).all():  # The estimate is not finite, which is a fault.
            force, command = np.zeros(3), Command(np.zeros(3), np.zeros(3))
        context.motion.advance(force / self._config.chaser.mass, self._config.mission.step)
        return command

    def _in_body(self, force: FloatArray) -> FloatArray:
        """Return a force in W as components along the axes of B in the middle of the control step [N], shape (3,).

        The limit of the thrusters applies along the axes of B. A force beyond it is scaled down without a change of its
        direction.
        """
        chaser, limit = self.context.estimate.chaser, self._config.chaser.limits.force
        turn = quaternion.exp(0.5 * self._config.mission.step * chaser.angular_velocity)
        acting = quaternion.rotate(quaternion.conjugate(quaternion.multiply(chaser.orientation, turn)), force)
        return np.asarray(acting / max(1.0, float(np.abs(acting).max()) / limit))

    def _changed(self, before: Phase, guard: str, after: Phase) -> None:
        self._report_change(before, guard, after)
        if after is not before:
            self.context.phase, self.context.since = after, self.context.time

    def _begin(self, readings: Readings, estimate: StateEstimate) -> None:
        config, chaser = self._config, self._config.chaser
        assert readings.start is not None, "the first readings must contain the chaser's state"
        self._pointing = CameraPointing(readings.start.orientation)
        axis = Axis(chaser.mass, config.mission.step)
        own, limits = chaser.limits, limits_of(chaser, config.mission.length)
        self.context = MissionContext(
            config=config,
            target=self._target,
            limits=limits,
            axis=axis,
            tracking_limits=TrackingLimits(own.force, own.tracking_speed, limits.keep_in),
            streams=self._streams,
            holding=LinearFeedback.of_lqr(axis, own.force),
            report=self._report,
            readings=readings,
            estimate=estimate,
            motion=CommandedMotion.of(estimate),
        )
        self.context.hold_point = readings.start.position.copy()
        self.context.forget_tube()

    def _sense(self, readings: Readings, estimate: StateEstimate) -> None:
        """Update the context from new readings and their estimate."""
        context, mission = self.context, self._config.mission
        before = context.estimate.updated
        context.readings, context.estimate, context.time = readings, estimate, readings.time
        if estimate.mapped is not None and estimate.mapped is not context.target:
            context.use_map(estimate.mapped)
        context.step = round(readings.time / mission.step)
        if "camera" not in readings.silent:
            context.camera_time = context.time
        if "imu" not in readings.silent:
            context.imu_time = context.time
        if estimate.updated != before:
            context.motion, context.poses = CommandedMotion.of(estimate), context.poses + 1
        elif guards.unseen(context):
            context.poses = 0
        is_due = context.time >= context.renewed_at + mission.update_period - 1e-9
        if is_due and context.following is not None and estimate.updated != before:
            renew_reference(context)
            context.renewed_at = context.time
        is_slot = context.step * mission.control_ticks % mission.update_ticks == 0
        if is_slot and context.following is not None:
            actions.renew_escape(context)
        elif is_slot and context.phase is Phase.RETREAT:
            actions.keep_escape(context)
        self._check_settled()

    def _check_settled(self) -> None:
        context, mission = self.context, self._config.mission
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
        """Return the tracker's output and the state that it follows, shape (6,)."""
        context, x = self.context, self.context.estimate.translation
        following = context.following
        if following is not None:
            k = min(context.step - following.first_step, len(following.reference.position) - 1)
            output = following.tracker.step(x, following.reference, k)
            call, shape = called(following.tracker, "step"), (3,)
            require_type(call, output, TrackerOutput)
            require_arrays(call, (("force", output.force, shape), ("outside", output.outside, shape)))
            if np.isfinite(x).all() and not np.isfinite(output.force).all():
                raise PluginValueError(f"{call} returned the force {output.force} at {context.time:g} s; clip it")
            context.outside = float(np.linalg.norm(output.outside))
            return output, np.concatenate([following.reference.position[k], following.reference.velocity[k]])
        if context.phase is Phase.DEPART:
            return self._push(), np.concatenate([context.motion.position, context.motion.velocity])
        times = context.time + self._config.mission.step * np.arange(3.0)
        position = np.stack([context.watch_point(time) for time in times])
        velocity = np.diff(position, axis=0) / self._config.mission.step
        times, position = times[:2], position[:2]
        if context.phase is Phase.RETREAT and context.escape is not None:
            position, velocity = context.escape.at(times)
            position = position + context.estimate.target.position
        tide = tide_of(self._config.mission.mean_motion, times, position - context.estimate.target.position)
        reference = TrackedReference(position, velocity, tide)
        return context.holding.step(x, reference, 0), np.concatenate([reference.position[0], reference.velocity[0]])

    def _push(self) -> TrackerOutput:
        """Return the force for the rest of a departure's push, limited to what one control step can apply."""
        context, chaser = self.context, self._config.chaser
        per_step = self._config.mission.step / chaser.mass
        force = np.clip(context.push / per_step, -chaser.limits.force, chaser.limits.force)
        context.push = context.push - per_step * force
        return TrackerOutput(force, np.zeros(3))

    def _point(self) -> FloatArray:
        """Return the torque that points the camera at its aim [N m], shape (3,).

        It is zero while the inertial unit is silent, because the estimate then assumes a free rotation.
        """
        context, chaser = self.context, self.context.estimate.chaser
        position = context.motion.position if context.phase is Phase.DEPART else chaser.position
        assert self._pointing is not None, "the first readings must come before the camera is pointed"
        command = self._pointing.step(position, context.aim(), self._config.mission.step)
        error = quaternion.multiply(quaternion.conjugate(command.orientation), chaser.orientation)
        context.pointing_error = float(np.linalg.norm(quaternion.log(error)))
        if context.imu_time < context.time:
            return np.zeros(3)
        return self._controller(chaser.orientation, chaser.angular_velocity, command)
