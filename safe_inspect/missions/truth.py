"""The truth of one mission and its sensors: the chaser under its commands, the tumbling target, faults; its replay."""

from __future__ import annotations

import os
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.free_flyer import FreeFlyer
from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.geometry.pointing import R_BC
from safe_inspect.missions.record import read_mission
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.coordination.context import clearances
from safe_inspect.rendezvous.depth_camera import DepthFrame, no_frame
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.estimation.estimators import EstimatorContext
from safe_inspect.rendezvous.experiment import RendezvousConfig
from safe_inspect.rendezvous.inertial_unit import Imu, InertialSample
from safe_inspect.rendezvous.measured_poses import PoseFrame, PoseSensorRun, StateSensorRun
from safe_inspect.rendezvous.models import ChaserConfig
from safe_inspect.rendezvous.poses import pose
from safe_inspect.rendezvous.readings import Command, Reading, Readings
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.simulators.resets.initializers import PositionVelocityInitializer
from safe_inspect.simulators.resets.parameters import ConstantParameter
from safe_inspect.simulators.resets.plan import BodyReset, ResetPlan
from safe_inspect.simulators.simulator import Simulation
from safe_inspect.tasks.thruster_model import Actuators
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
    """

    def __init__(
        self,
        config: RendezvousConfig,
        start: BodyState,
        inertia: FloatArray,
        tumbling: tuple[FloatArray, FloatArray],
        streams: Streams,
    ) -> None:
        self._flight = ChaserFlight(config, start, streams=streams)
        self._impulses, self._inertia, self._tumbling = config.mission.impulses, inertia, tumbling
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


class _Replay(NamedTuple):
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


def replay(folder: str | os.PathLike[str]) -> _Replay:
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
    return _Replay(time, np.hstack((position, velocity)), orientation, q, clearance)


#: Smallest cosine between the normal of a surface and the direction to the camera at which an operator marks a point.
_LEAST_MARKED = 0.5
#: Jump of the inertial unit's biases during a fault [m/s^2, rad/s].
_BIAS_STEP = (0.02, 5e-4)


def estimator_context(config: RendezvousConfig, target: Target, streams: Streams) -> EstimatorContext:
    """Return the context of the estimator of a mission.

    Args:
        config: The experiment.
        target: The target.
        streams: Random streams of the mission. The samples of the estimator are independent of those of the mission
            and reveal nothing about them.
    """
    own = Streams(int(streams.bits("estimator")[0, 0]), np.zeros(1, np.int64), np.zeros(1, np.int64))
    chaser, mission, sensors = config.chaser, config.mission, config.sensors
    return EstimatorContext(
        target=target,
        chaser=chaser,
        step=mission.step,
        camera=sensors.camera.geometry,
        T_BC=_camera_mount(chaser),
        frame_period=sensors.frame_period,
        imu=sensors.imu,
        imu_period=sensors.imu_ticks * mission.tick,
        streams=own,
        length=mission.length,
    )


def pose_in_model(target: Target, chaser: BodyState, body: BodyState) -> FloatArray:
    """Return T_MB from the states of the chaser and of the target, shape (4, 4)."""
    R_MW = target.R_MT @ to_matrix(body.orientation).T  # noqa: N806
    return pose(R_MW @ to_matrix(chaser.orientation), R_MW @ (chaser.position - body.position))


def _camera_mount(chaser: ChaserConfig) -> FloatArray:
    """Return T_BC, the pose of the camera in the chaser's frame, shape (4, 4)."""
    return pose(R_BC, np.array(chaser.camera_position))


class SensorSuite:
    """The sensors of one mission.

    Args:
        config: The experiment.
        target: The target.
        streams: The random streams of the mission.
        reads: The kinds of measurements that are read; the others are not simulated.
    """

    def __init__(self, config: RendezvousConfig, target: Target, streams: Streams, reads: Collection[Reading]) -> None:
        self._config, self._chaser, self._mission = config.sensors, config.chaser, config.mission
        self._target, self._streams, self._reads = target, streams, frozenset(reads)
        sensors, mission = config.sensors, config.mission
        self._renderer = sensors.camera(target) if "frames" in reads else None
        self._poses = PoseSensorRun(sensors.poses, streams)
        self._states = StateSensorRun(sensors.state, mission.update_period, streams)
        self._imu = Imu(sensors.imu, sensors.imu_ticks * mission.tick, streams)
        self._frame_steps = max(1, round(sensors.frame_period / mission.step))
        self._calls = self._ticks = self._seen = 0
        self._biases = self._is_imu_silent = False
        self._T_BC = _camera_mount(config.chaser)

    def read(
        self,
        time: float,
        chaser: BodyState,
        target: BodyState,
        trace: ChaserTrace | None = None,
        command: Command | None = None,
    ) -> Readings:
        """Return the readings of a control step; called once for each.

        Args:
            time: Time of the control step [s].
            chaser: The chaser's true state.
            target: The target's true state.
            trace: The chaser after each tick since the last step; None at the first step.
            command: The command that was held since the last step; None at the first step.
        """
        fails, reads = self._mission.fails, self._reads
        is_blind = fails("camera", time)
        samples = () if trace is None or "inertial" not in reads else self._samples(trace)
        self._is_imu_silent, self._biases = fails("imu", time), fails("imu_bias", time)
        number, late = divmod(self._calls, self._frame_steps)
        start = None if self._calls else chaser
        self._calls += 1
        frame = None if late or is_blind else self._frame(time, chaser, target, number)
        state = self._states.measure(time, chaser, target, silent=is_blind) if "state" in reads else None
        mark = None if frame is None or "mark" not in reads else self._mark(chaser, target, number)
        flags = {"camera": is_blind, "imu": self._is_imu_silent}
        silent = frozenset(name for name, is_silent in flags.items() if is_silent)
        return Readings(time, start, frame, samples, command, state, mark, silent)

    def _mark(self, chaser: BodyState, target: BodyState, number: int) -> FloatArray | None:
        """Return the mating point in B with the operator's error; None if the surface below it looks away."""
        T_MB, known = pose_in_model(self._target, chaser, target), self._target  # noqa: N806
        point = known.R_MT @ known.mating_point
        distances, gradients = known.solid.distances(point[None])
        nearest = distances[0].argmin()
        foot, normal = point - distances[0, nearest] * gradients[0, nearest], gradients[0, nearest]
        to_camera = (T_MB @ self._T_BC)[:3, 3] - foot
        if normal @ to_camera < _LEAST_MARKED * np.linalg.norm(to_camera):
            return None
        error = self._config.mark.sigma * self._streams.normal("operator.mark", 3, number)[0]
        return np.asarray(T_MB[:3, :3].T @ (point - T_MB[:3, 3]) + error)

    def _samples(self, trace: ChaserTrace) -> tuple[InertialSample, ...]:
        """Return the samples of the inertial unit over a control step; none if it was silent."""
        ticks = np.arange(len(trace.wrench))
        sampled = ticks[(self._ticks + ticks + 1) % self._config.imu_ticks == 0]
        self._ticks += len(ticks)
        forces, rates = self._imu.measure(
            trace.wrench[sampled, :3] / self._chaser.mass, trace.angular_velocity[sampled]
        )
        if self._is_imu_silent:
            return ()
        jumps = _BIAS_STEP if self._biases else (0.0, 0.0)
        times = (sampled + 1) * self._mission.tick
        return tuple(map(InertialSample, times.tolist(), forces + jumps[0], rates + jumps[1]))

    def _frame(self, time: float, chaser: BodyState, target: BodyState, number: int) -> DepthFrame | None:
        """Return the frame with a number; None if no frames are read."""
        T_MB = pose_in_model(self._target, chaser, target)  # noqa: N806
        T_MC = T_MB @ self._T_BC  # noqa: N806
        if self._renderer is not None:
            taken: DepthFrame = self._renderer.render(T_MC[:3, :3], T_MC[:3, 3], self._streams, number, time)
            return taken
        return self._measured_poses(time, T_MB, T_MC) if "poses" in self._reads else None

    def _measured_poses(self, time: float, T_MB: FloatArray, T_MC: FloatArray) -> PoseFrame:  # noqa: N803
        """Return a frame of the pose sensor, whose field of view is that of the camera."""
        number, self._seen = self._seen, self._seen + 1
        camera = self._config.camera.geometry
        centre = -T_MC[:3, :3].T @ T_MC[:3, 3]
        half = 0.5 * np.array([camera.width, camera.height]) / camera.focal_length
        in_view = centre[2] > 0.0 and (np.abs(centre[:2]) <= half * centre[2] + self._target.swept_radius).all()
        poses = self._poses.measure(number, T_MB, in_view=in_view)
        return PoseFrame(**vars(no_frame(time)), number=number, poses=poses)
