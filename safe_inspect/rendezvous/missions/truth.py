"""The true motion of one mission, the chaser under its commands and the freely tumbling target; and its replay."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.free_flyer import FreeFlyer
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.coordination.context import clearances
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.experiment import RendezvousConfig
from safe_inspect.rendezvous.missions.record import read_mission
from safe_inspect.rendezvous.readings import Command
from safe_inspect.simulators.resets.initializers import PositionVelocityInitializer
from safe_inspect.simulators.resets.parameters import ConstantParameter
from safe_inspect.simulators.resets.plan import BodyReset, ResetPlan
from safe_inspect.simulators.simulator import Simulation
from safe_inspect.tasks.rendezvous.actuators import Actuators
from safe_inspect.types import FloatArray

#: Change of the angular velocity by an impact, as a fraction of its magnitude.
_IMPULSE = 0.5
#: Number of control steps whose target attitudes are computed at a time.
_BLOCK = 64
#: Parameters of the initialiser. Their values do not matter: the initial state is written after the reset.
_AT_ORIGIN = {name: ConstantParameter(value=0.0) for name in PositionVelocityInitializer.parameters}


class ChaserTrace(NamedTuple):
    """The chaser after each tick of a control step.

    Attributes:
        position: Position in W [m], shape (ticks, 3).
        velocity: Velocity in W [m/s], shape (ticks, 3).
        orientation: Quaternion q_WB [x, y, z, w], shape (ticks, 4).
        angular_velocity: Angular velocity in B [rad/s], shape (ticks, 3).
        wrench: Force [N] and torque [N m] that act on the chaser, in B, shape (ticks, 6).
    """

    position: FloatArray
    velocity: FloatArray
    orientation: FloatArray
    angular_velocity: FloatArray
    wrench: FloatArray


class TruthStep(NamedTuple):
    """The true motion in one control step.

    Attributes:
        chaser_before: The chaser before the step.
        target_before: The target before the step.
        chaser: The chaser after each tick.
        target: The target's attitude q_WT after each tick, shape (ticks, 4).
        flown: Force [N] and torque [N m] in B that the actuators gave for the command, without their lag, shape (6,).
    """

    chaser_before: BodyState
    target_before: BodyState
    chaser: ChaserTrace
    target: FloatArray
    flown: FloatArray


class ChaserFlight:
    """A simulation of the chaser as one free flyer; its step is a control step, its physics step a tick.

    Args:
        config: The experiment.
        start: Initial state of the chaser.
        time: Initial time [s], which matters on an orbit.
        streams: The random streams of the mission, from which the actuators' noise is sampled; None for actuators
            without limits and errors.
    """

    def __init__(
        self, config: RendezvousConfig, start: BodyState, time: float = 0.0, streams: Streams | None = None
    ) -> None:
        chaser, own, mission = config.chaser, config.chaser.actuator, config.mission
        errors = own.model_dump(exclude={"lag"})
        actuators = Actuators(force=chaser.limits.force, torque=chaser.limits.torque, **errors)
        self._simulation = Simulation(
            FreeFlyer(inertia=chaser.inertia, lag=own.lag, mean_motion=mission.mean_motion, keeps_trace=True),
            () if streams is None else (actuators,),
            masses={"chaser": chaser.mass},
            groups=(),
            reset=ResetPlan({}, {"chaser": BodyReset(PositionVelocityInitializer(), _AT_ORIGIN)}, {}),
            step_size=mission.step,
            decimation=mission.control_ticks,
            num_envs=1,
            seed=0 if streams is None else streams.seed,
            first_slot=0 if streams is None else int(streams.slot[0]),
        )
        state = self._simulation.reset(np.zeros(1, np.int64))
        for name, value in start._asdict().items():
            state[name][0, 0] = value
        state["orbit_angle"][...] = mission.mean_motion * time
        self._simulation.state.put(np.zeros(1, np.int64), state)

    @property
    def state(self) -> BodyState:
        """The chaser's current state."""
        return BodyState(*(self._simulation.state[name][0, 0].copy() for name in BodyState._fields))

    def step(self, force: FloatArray, torque: FloatArray) -> tuple[ChaserTrace, FloatArray]:
        """Hold a command for one control step.

        Args:
            force: Force in B [N], shape (3,).
            torque: Torque in B [N m], shape (3,).

        Returns:
            The chaser after each tick, and the force [N] and torque [N m] that the actuators gave for the command,
            without their lag, shape (6,).
        """
        simulation = self._simulation
        simulation.step(np.concatenate([force, torque])[None, None])
        trace = ChaserTrace(*(simulation.trace[name][0, 0].copy() for name in ChaserTrace._fields))
        return trace, simulation.flown[0, 0].copy()


def target_motion(
    inertia: FloatArray, tumbling: tuple[FloatArray, FloatArray], impulses: tuple[float, ...], times: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the target's attitudes q_WT, shape (K, 4), and angular velocities in T [rad/s], shape (K, 3).

    Args:
        inertia: Principal moments, up to a common factor, shape (3,).
        tumbling: Attitude and angular velocity at time zero, shapes (4,) and (3,).
        impulses: Times of impacts [s], ascending. Each adds half of the angular velocity's magnitude along axis 1.
        times: Times [s], ascending, shape (K,).
    """
    q, w = (value[0] for value in tumble(inertia, tumbling[0][None], tumbling[1][None], times))
    before = 0.0
    state = tumbling
    for impulse in impulses:
        q0, w0 = (
            value[0, 0] for value in tumble(inertia, state[0][None], state[1][None], np.array([impulse - before]))
        )
        state = (q0, w0 + _IMPULSE * np.linalg.norm(w0) * np.array([1.0, 0.0, 0.0]))
        before, later = impulse, times >= impulse
        if later.any():
            after = tumble(inertia, state[0][None], state[1][None], times[later] - impulse)
            q[later], w[later] = after[0][0], after[1][0]
    return q, w


class MissionTruth:
    """The truth of one mission. The origin of W is the target's centre of mass; the axes of W do not rotate.

    Args:
        config: The experiment.
        start: Initial state of the chaser.
        inertia: The target's principal moments, up to a common factor, shape (3,).
        tumbling: The target's initial attitude q_WT, shape (4,), and angular velocity in T [rad/s], shape (3,).
        streams: The random streams of the mission.
        impulses: Times of impacts on the target [s]; see `target_motion`.
    """

    def __init__(
        self,
        config: RendezvousConfig,
        start: BodyState,
        inertia: FloatArray,
        tumbling: tuple[FloatArray, FloatArray],
        streams: Streams,
        impulses: tuple[float, ...] = (),
    ) -> None:
        self._flight = ChaserFlight(config, start, streams=streams)
        self._impulses, self._inertia, self._tumbling = impulses, inertia, tumbling
        self._tick, self._ticks = config.mission.tick, config.mission.control_ticks
        self._steps = 0
        self._block = -1
        self._attitudes = (np.empty((0, 4)), np.empty((0, 3)))

    @property
    def time(self) -> float:
        """The current time [s]."""
        return float(self._steps * self._ticks * self._tick)

    @property
    def chaser(self) -> BodyState:
        """The chaser's true state."""
        return self._flight.state

    @property
    def target(self) -> BodyState:
        """The target's true state."""
        orientations, rates = self._target_ticks()
        zero = np.zeros(3)
        return BodyState(zero, zero, orientations[0], rates[0])

    def advance(self, command: Command) -> TruthStep:
        """Hold a command for one control step and return the motion."""
        before, target = self.chaser, self.target
        trace, flown = self._flight.step(*command)
        orientations = self._target_ticks()[0][1:]
        self._steps += 1
        return TruthStep(before, target, trace, orientations, flown)

    def _target_ticks(self) -> tuple[FloatArray, FloatArray]:
        """Return the target's attitudes and rates at all ticks of this step, including its start and its end."""
        block, index = divmod(self._steps, _BLOCK)
        if block != self._block:
            first, count = block * _BLOCK * self._ticks, _BLOCK * self._ticks + 1
            times = self._tick * np.arange(first, first + count, dtype=np.float64)
            self._block = block
            self._attitudes = target_motion(self._inertia, self._tumbling, self._impulses, times)
        window = slice(index * self._ticks, (index + 1) * self._ticks + 1)
        return self._attitudes[0][window], self._attitudes[1][window]


class Replay(NamedTuple):
    """The motion of a replayed mission.

    Attributes:
        time: Times of the ticks [s], shape (K,).
        translation: Position [m] and velocity [m/s] of the chaser in W, shape (K, 6).
        orientation: Attitude q_WB of the chaser, shape (K, 4).
        target: Attitude q_WT of the target, shape (K, 4).
        clearance: Distance of the chaser's sphere to the target's boxes [m], shape (K,).
    """

    time: FloatArray
    translation: FloatArray
    orientation: FloatArray
    target: FloatArray
    clearance: FloatArray


def replay(folder: str | os.PathLike[str]) -> Replay:
    """Run the commands of a mission's log again from the logged initial state.

    The log contains the states before each control step, which are those of the replay after each `control_ticks`.

    Raises:
        CheckpointError: A file is missing or damaged.
    """
    record = read_mission(folder)
    config, target, logged = record.config, record.target, record.arrays
    flight = ChaserFlight(config, BodyState(logged["x"][0, :3], logged["x"][0, 3:], logged["q"][0], logged["w"][0]))
    parts = [flight.step(flown[:3], flown[3:])[0] for flown in logged["flown"]]
    position, velocity, orientation, _, _ = (np.concatenate(values) for values in zip(*parts, strict=True))
    time = config.mission.tick * np.arange(1, len(position) + 1)
    tumbling = (logged["target_q"][0], logged["target_w"][0])
    q, _ = target_motion(target.principal, tumbling, config.mission.impulses, time)
    clearance = clearances(target, position, q, config.chaser.radius)
    return Replay(time, np.hstack((position, velocity)), orientation, q, clearance)
