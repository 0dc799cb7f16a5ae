"""The sensors of one mission, which turn its true states into `Readings` and simulate the faults of the sensors."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.geometry.pointing import R_BC
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.estimation.estimators import EstimatorContext
from safe_inspect.rendezvous.experiment import SensorsConfig
from safe_inspect.rendezvous.missions.truth import ChaserTrace
from safe_inspect.rendezvous.models import ChaserConfig, MissionConfig
from safe_inspect.rendezvous.poses import pose
from safe_inspect.rendezvous.readings import Command, Reading, Readings
from safe_inspect.rendezvous.sensors.imu import Imu, InertialSample
from safe_inspect.rendezvous.sensors.measured import PoseFrame, PoseSensorRun, StateSensorRun
from safe_inspect.rendezvous.sensors.tof import DepthFrame, no_frame
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray

#: Jump of the inertial unit's biases during a fault [m/s^2, rad/s].
_BIAS_STEP = (0.02, 5e-4)


def estimator_context(
    target: Target, chaser: ChaserConfig, mission: MissionConfig, sensors: SensorsConfig, streams: Streams
) -> EstimatorContext:
    """Return the context of the estimator of a mission.

    Args:
        target: The target.
        chaser: The chaser.
        mission: Rates of the mission.
        sensors: The sensors of the chaser.
        streams: Random streams of the mission. The samples of the estimator are independent of those of the mission
            and reveal nothing about them.
    """
    own = Streams(int(streams.bits("estimator")[0, 0]), np.zeros(1, np.int64), np.zeros(1, np.int64))
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
        config: The sensors.
        chaser: The chaser that carries them.
        mission: Rates and faults.
        target: The target.
        streams: The random streams of the mission.
        reads: The kinds of measurements that are read; the others are not simulated.
    """

    def __init__(
        self,
        config: SensorsConfig,
        chaser: ChaserConfig,
        mission: MissionConfig,
        target: Target,
        streams: Streams,
        reads: Collection[Reading],
    ) -> None:
        self._config, self._chaser, self._mission = config, chaser, mission
        self._target, self._streams = target, streams
        self._reads = frozenset(reads)
        self._renderer = config.camera(target) if "frames" in reads else None
        self._poses = PoseSensorRun(config.poses, streams)
        self._states = StateSensorRun(config.state, mission.update_period, streams)
        self._imu = Imu(config.imu, config.imu_ticks * mission.tick, streams)
        self._frame_steps = max(1, round(config.frame_period / mission.step))
        self._calls = self._ticks = self._seen = 0
        self._biases = self._is_imu_silent = False
        self._T_BC = _camera_mount(chaser)

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
        flags = {"camera": is_blind, "imu": self._is_imu_silent}
        silent = frozenset(name for name, is_silent in flags.items() if is_silent)
        return Readings(time, start, frame, samples, command, state, silent)

    def _samples(self, trace: ChaserTrace) -> tuple[InertialSample, ...]:
        """Return the samples of the inertial unit over a control step; none if it was silent."""
        bias = np.repeat(_BIAS_STEP if self._biases else (0.0, 0.0), 3)
        measured = []
        for tick, (wrench, rate) in enumerate(zip(trace.wrench, trace.angular_velocity, strict=True)):
            self._ticks += 1
            if self._ticks % self._config.imu_ticks:
                continue
            acceleration, turning = self._imu.sample(wrench[:3] / self._chaser.mass, rate)
            time = (tick + 1) * self._mission.tick
            measured.append(InertialSample(time, acceleration + bias[:3], turning + bias[3:]))
        return () if self._is_imu_silent else tuple(measured)

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
