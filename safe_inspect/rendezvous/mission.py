"""One mission: the loop of truth, sensors and pilot, and its log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from safe_inspect.dynamics import quaternion
from safe_inspect.rendezvous.chaser import Actuator, ChaserDynamics
from safe_inspect.rendezvous.control.attitude import CameraPointing
from safe_inspect.rendezvous.coordination.context import MissionContext, PilotConfig, clearances
from safe_inspect.rendezvous.coordination.coordinator import Phase
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.estimation.consistency import normalised_error
from safe_inspect.rendezvous.estimation.context import estimator_context
from safe_inspect.rendezvous.log import MissionLog
from safe_inspect.rendezvous.models import RendezvousConfig
from safe_inspect.rendezvous.pilot import Pilot
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
        watch: Called at every step of control, with the pilot's memory as it is then; it must not change it.

    Attributes:
        pilot: What flies it.
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
        self._target = target = checked_target(config)
        tumbling = config.tumble(self._streams)
        check_start(config, target, tumbling[0])
        # At the start the camera looks at the target.
        position = np.array(chaser.position)
        orientation = CameraPointing(np.array([0.0, 0.0, 0.0, 1.0])).step(position, np.zeros(3), 1.0).orientation
        start = BodyState(position, np.array(chaser.velocity), orientation, np.zeros(3))
        self._truth = MissionTruth(
            dynamics_of(config), start, target.principal, tumbling, mission.tick, mission.control_ticks,
            self._streams, mission.impulses,
        )  # fmt: skip
        self._sensors = SensorSuite(config.sensors, chaser, mission, target, self._streams, config.estimator.reads)
        estimator = config.estimator(estimator_context(target, chaser, mission, config.sensors, self._streams))
        self.pilot = Pilot(PilotConfig.of(config), target, estimator, self._streams, self._event, self._changed)

    def run(self) -> MissionResult:
        """Fly the mission to its end.

        The linear algebra has one thread meanwhile: its matrices are small, and threads would only wait for each other.
        """
        with threadpool_limits(limits=1, user_api="blas"):
            return self._run()

    def _run(self) -> MissionResult:
        truth, pilot = self._truth, self.pilot
        readings = self._sensors.read(0.0, truth.chaser, truth.target)
        while (command := pilot.act(readings)) is not None:
            if self._watch is not None:
                self._watch(pilot.context)
            acting = Command(self._in_inertial(command.force), command.torque)
            done = truth.advance(*acting)
            self._record(acting, done)
            readings = self._sensors.read(truth.time, truth.chaser, truth.target, done.chaser, command)
        summary = summarise_mission(self._config, self._target, self._log, pilot.arrived, pilot.context.cause)
        return MissionResult(summary, self._log)

    def _in_inertial(self, force: FloatArray) -> FloatArray:
        """Return a force of the estimated frame W as it acts: thrusters are fixed in B [N], shape (3,)."""
        estimated, true = self.pilot.context.estimate.chaser.orientation, self._truth.chaser.orientation
        if np.array_equal(estimated, true):
            return force
        return quaternion.rotate(true, quaternion.rotate(quaternion.conjugate(estimated), force))

    def _record(self, command: Command, done: TruthStep) -> None:
        context, target = self.pilot.context, self._target
        output, reference = self.pilot.followed
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
            force=command.force,
            torque=command.torque,
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
        context = self.pilot.context
        tick = context.step * self._config.mission.control_ticks
        self._log.event(tick, context.time, context.phase.value, name, data)

    def _changed(self, before: Phase, guard: str, after: Phase) -> None:
        context = self.pilot.context
        if after is Phase.TRACK and context.plan is not None:
            self._log.plans.append(context.plan)
        self._event("transition", {"from": before.value, "guard": guard, "to": after.value})
        if after is not before and self._progress is not None:
            self._progress(context.time, before, guard, after)
