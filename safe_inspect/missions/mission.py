"""One mission: the loop of truth, sensors and pilot, and the log that it writes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from safe_inspect.missions.record import MissionLog
from safe_inspect.missions.scenario import check_start, checked_target, initial_tumbles, mission_streams
from safe_inspect.missions.summary import normalised_error, summarise_mission
from safe_inspect.missions.truth import MissionTruth, SensorSuite, TruthStep, estimator_context
from safe_inspect.rendezvous.control.attitude import CameraPointing
from safe_inspect.rendezvous.coordination.context import MissionContext, Phase, PilotConfig, clearances
from safe_inspect.rendezvous.coordination.pilot import Pilot
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.experiment import RendezvousConfig
from safe_inspect.rendezvous.readings import Command, Reading, Readings

#: Function called at every change of state with the time [s], the state before, the guard and the state after.
_Progress = Callable[[float, Phase, str, Phase], None]


@dataclass(frozen=True, eq=False)
class MissionResult:
    """The result of a mission.

    Attributes:
        summary: Success, cause of failure, clearance, errors, effort; see `summarise_mission`.
        log: The log of the mission.
    """

    summary: dict[str, Any]
    log: MissionLog


class Mission:
    """A mission of an experiment.

    Args:
        config: The experiment.
        number: Number of the mission, from which its tumble and noise are sampled.
        progress: Called at every change of phase with the time [s], the old phase, the guard and the new phase.
        watch: Called at every control step with the pilot's current memory, which it must not change.
        reads: Kinds of measurements to simulate in addition to those that the estimator reads.

    Attributes:
        pilot: The pilot that flies the mission.
    """

    def __init__(
        self,
        config: RendezvousConfig,
        number: int = 0,
        progress: _Progress | None = None,
        watch: Callable[[MissionContext], None] | None = None,
        reads: tuple[Reading, ...] = (),
    ) -> None:
        if not isinstance(config, RendezvousConfig):
            raise TypeError(
                f"a mission needs a RendezvousConfig, such as `load_rendezvous(FILE).config`, not {config!r:.60}"
            )
        if not isinstance(number, (int, np.integer)) or number < 0:
            raise ValueError(f"the number of a mission must be a whole number of 0 or more, not {number!r}")
        self._config, self._progress, self._watch = config, progress, watch
        self._streams = mission_streams(config, number)
        self._log = MissionLog()
        self._target = target = checked_target(config)
        tumbling = tuple(values[0] for values in initial_tumbles(config, self._streams))
        check_start(config, target, tumbling[0])
        # The initial attitude points the camera at the target.
        position = np.array(config.chaser.position)
        orientation = CameraPointing(np.array([0.0, 0.0, 0.0, 1.0])).step(position, np.zeros(3), 1.0).orientation
        start = BodyState(position, np.array(config.chaser.velocity), orientation, np.zeros(3))
        self._truth = MissionTruth(config, start, target.principal, tumbling, self._streams)
        reads = (*config.estimator.reads, *reads)
        self._sensors = SensorSuite(config, target, self._streams, reads)
        known = config.estimator.known(target)
        estimator = config.estimator(estimator_context(config, known, self._streams))
        self.pilot = Pilot(PilotConfig.of(config), known, estimator, self._streams, self._event, self._changed)

    def run(self) -> MissionResult:
        """Fly the mission to its end and return the result.

        The linear algebra runs in one thread, because its matrices are small and several threads would only wait for
        each other.
        """
        with threadpool_limits(limits=1, user_api="blas"):
            for _ in self.steps():
                pass
        summary = summarise_mission(self._config, self._target, self._log, self.pilot.arrived, self.pilot.context.cause)
        return MissionResult(summary, self._log)

    def steps(self) -> Iterator[tuple[Readings, BodyState, BodyState]]:
        """Fly the mission; yield the readings and the true states of chaser and target, in T, before the pilot acts."""
        truth, pilot = self._truth, self.pilot
        readings = self._sensors.read(0.0, truth.chaser, truth.target)
        while True:
            yield readings, truth.chaser, truth.target
            command = pilot.act(readings)
            if command is None:
                return
            if self._watch is not None:
                self._watch(pilot.context)
            done = truth.advance(command)
            self._record(command, done)
            readings = self._sensors.read(truth.time, truth.chaser, truth.target, done.chaser, command)

    def _record(self, command: Command, done: TruthStep) -> None:
        context, target = self.pilot.context, self._target
        distances = clearances(target, done.chaser.position, done.target, context.limits.radius)
        following = context.following
        tube = margin = tube_force = np.nan
        if following is not None:
            design = following.design
            k = min(context.step - following.first_step, len(design.tube.clearance) - 1)
            tube, margin = float(design.tube.clearance[k]), float(design.margin[k])
            tube_force = float(design.tube.force[k])
        estimate = context.estimate
        self._log.add(
            t=context.time,
            state=context.phase.number,
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
            reference=self.pilot.followed,
            force=command.force,
            torque=command.torque,
            flown=done.flown,
            wrench=done.chaser.wrench[-1],
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
