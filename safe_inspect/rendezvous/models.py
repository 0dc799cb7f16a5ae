"""The configuration models of a rendezvous experiment: chaser, mission, sensors and experiment."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from safe_inspect.config.models import Model
from safe_inspect.tasks.docking.shape import ASTROBEE_RADIUS
from safe_inspect.units import (
    Length,
    NonNegativeAngularRate,
    NonNegativeDuration,
    NonNegativeForce,
    NonNegativeTorque,
    PositiveAngularRate,
    PositiveDuration,
    PositiveForce,
    PositiveLength,
    PositiveMass,
    PositiveMomentOfInertia,
    PositiveSpeed,
    PositiveTorque,
    Speed,
    quantity,
)

PositiveAngle = quantity("rad", gt=0)
_Vector = tuple[Length, Length, Length]  # type: ignore[valid-type]
_Moments = tuple[PositiveMomentOfInertia, PositiveMomentOfInertia, PositiveMomentOfInertia]  # type: ignore[valid-type]
_VelocityVector = tuple[Speed, Speed, Speed]  # type: ignore[valid-type]
#: Shortest tick, and shortest and longest control step, that the attitude controller was tested with [s].
_LEAST_TICK, _STEPS = 1e-4, (0.02, 1.0)
#: Largest number of control steps of an approach, and of waits that are tried before one.
_MOST_STEPS, _MOST_WAITS = 5_000, 1_000
#: Largest length of a scenario [m].
_LARGEST_LENGTH = 1e6


class ActuatorConfig(Model):
    """Errors of the actuators.

    Attributes:
        scale_error: Relative error of all forces and torques.
        lag: Time constant of the response [s].
        force_noise: Half width of the uniformly distributed error of a force [N].
        torque_noise: Half width of the uniformly distributed error of a torque [N m].
    """

    scale_error: float = Field(default=0.0, gt=-1.0, lt=1.0)
    lag: NonNegativeDuration = 0.0  # type: ignore[valid-type]
    force_noise: NonNegativeForce = 0.0  # type: ignore[valid-type]
    torque_noise: NonNegativeTorque = 0.0  # type: ignore[valid-type]


class LimitsConfig(Model):
    """Limits of the chaser's motion and of its actuators, along each axis.

    Attributes:
        speed: Largest planned speed [m/s].
        tracking_speed: Largest speed during tracking, when errors are corrected [m/s].
        planned_force: Largest planned force [N].
        force: Largest force of the actuators [N].
        torque: Largest torque of the actuators [N m].
        keep_in: Half sizes of the box about W's origin that the chaser's centre must stay in [m]; null for none.
        line_of_sight_rate: Largest rate of the direction to the target [rad/s].
        cone: Half angle of the approach cone about the mating point's direction [rad]; null for none.
    """

    speed: PositiveSpeed = 0.115  # type: ignore[valid-type]
    tracking_speed: PositiveSpeed = 0.2  # type: ignore[valid-type]
    planned_force: PositiveForce = 0.168  # type: ignore[valid-type]
    force: PositiveForce = 0.30  # type: ignore[valid-type]
    torque: PositiveTorque = 0.025  # type: ignore[valid-type]
    keep_in: tuple[PositiveLength, PositiveLength, PositiveLength] | None = (0.8, 3.0, 0.8)  # type: ignore[valid-type]
    line_of_sight_rate: PositiveAngularRate = 0.17  # type: ignore[valid-type]
    cone: quantity("rad", gt=0, le=math.pi) | None = None  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _leave_force_to_feedback(self) -> LimitsConfig:
        if self.planned_force >= self.force:
            raise ValueError(
                f"planned_force ({self.planned_force} N) must be below force ({self.force} N); feedback needs the rest"
            )
        return self


class ChaserConfig(Model):
    """The chaser. The defaults are those of Astrobee.

    Attributes:
        mass: Mass [kg].
        inertia: Principal moments about the axes of B [kg m^2].
        radius: Radius of the sphere that contains the chaser [m].
        position: Initial position in W [m].
        velocity: Initial velocity in W [m/s].
        limits: Limits of its motion and of its actuators.
        actuator: Errors of its actuators.
        camera_position: Position of the camera in B [m]; it looks along x of B.
    """

    mass: PositiveMass = 9.583788668  # type: ignore[valid-type]
    inertia: _Moments = (0.153427995, 0.14271405, 0.162302759)
    radius: PositiveLength = ASTROBEE_RADIUS  # type: ignore[valid-type]
    position: _Vector = (0.0, -1.5, 0.0)
    velocity: _VelocityVector = (0.0, 0.0, 0.0)
    limits: LimitsConfig = LimitsConfig()
    actuator: ActuatorConfig = ActuatorConfig()
    camera_position: _Vector = (0.13, 0.0, 0.0)

    @model_validator(mode="after")
    def _is_rigid(self) -> ChaserConfig:
        least, middle, largest = sorted(self.inertia)
        if least + middle < largest * (1.0 - 1e-12):
            raise ValueError(
                f"inertia: no body has the moments {least:g}, {middle:g} and {largest:g} kg m^2: the sum of the two "
                "smaller must not be below the largest"
            )
        return self


class Fault(Model):
    """A fault during a mission.

    Attributes:
        kind: ``camera``: the camera takes no frames; ``imu``: the inertial unit gives no samples; ``imu_bias``: the
            biases of the inertial unit jump; ``tumble``: an impact at the start of the fault changes the target's
            motion permanently; ``planner``: the planner finds no plan.
        start: Start of the fault [s].
        duration: Duration of the fault [s].
    """

    kind: Literal["camera", "imu", "imu_bias", "tumble", "planner"]
    start: NonNegativeDuration  # type: ignore[valid-type]
    duration: PositiveDuration  # type: ignore[valid-type]


class MissionConfig(Model):
    """Rates, guards and time limits of a mission.

    Attributes:
        tick: Length of a tick of the simulated truth [s].
        control_ticks: Number of ticks from one command to the next. They are the control step, at which plans are
            sampled.
        update_ticks: Number of ticks from one update of the reference to the next; a multiple of `control_ticks`.
        checkout: Time for which all sensors must have worked before the mission starts [s].
        checkout_limit: Time after which the mission is given up if they have not [s].
        observe: Shortest observation of the target [s].
        observe_limit: Longest observation of the target [s].
        fly_around: Time of a flight around the target, about z of W, during the observation of a target without a map
            [s], which shows all of its sides; 0: the chaser holds its position.
        attitude_sigma: Error of the target's axes below which the observation may end [rad].
        rate_sigma: Error of the target's rate below which the observation may end [rad/s].
        durations: Durations of the approach to try, in this order [s].
        planning_time: Time that the flight computer takes for a plan and its tube [s], a multiple of the control step.
            The chaser holds its position, or stays on the reference, until then; the plan starts from where it will be.
        wait_limit: Longest wait before an approach [s].
        wait_step: Step between two waits to try [s].
        attempts: Largest number of times that the chaser starts to observe the target: the first, and again after a
            retreat, a departure without poses, or plans without an accepted tube.
        plan_attempts: Number of failures to plan after which the chaser retreats.
        bound_attempts: Number of plans refused by their tube after which the target is observed again.
        hold: Time for which the chaser must stay at the mating point [s].
        hold_limit: Time after which the mission is given up at the mating point [s].
        hold_position: Largest position error at the mating point [m].
        hold_speed: Largest velocity error at the mating point [m/s].
        hold_angle: Largest pointing error at the mating point [rad].
        camera_silence: Longest time without a camera frame, in every state [s]. The longest time without a frame that
            shows the target is longer by one `update_period`.
        imu_silence: Longest time without an inertial sample [s].
        escapes: Durations of an escape to try, in this order [s].
        retreat_limit: Time after which a retreat is given up [s].
        departure_speed: Speed at which the chaser leaves the target after it has given up or lost its poses [m/s].
        departure_limit: Time for which a departing chaser waits for poses before the mission ends [s].
        time_limit: Time at which an approach or a wait ends at the latest, with a retreat [s].
        mean_motion: Mean motion of the target's orbit [rad/s]; 0 for free space. The axes of W do not rotate.
        length: Length of the scenario [m], about the radius that the target sweeps. The clearances that planner, tube
            and escape reserve are fractions of it, and planner and `PipelineEstimator` use it as their unit of length.
        faults: Faults to simulate.
    """

    tick: PositiveDuration = 0.008  # type: ignore[valid-type]
    control_ticks: int = Field(default=25, ge=1)
    update_ticks: int = Field(default=125, ge=1)
    checkout: NonNegativeDuration = 2.0  # type: ignore[valid-type]
    checkout_limit: PositiveDuration = 10.0  # type: ignore[valid-type]
    observe: NonNegativeDuration = 120.0  # type: ignore[valid-type]
    observe_limit: PositiveDuration = 300.0  # type: ignore[valid-type]
    fly_around: NonNegativeDuration = 0.0  # type: ignore[valid-type]
    attitude_sigma: PositiveAngle = 0.052359878  # type: ignore[valid-type]
    rate_sigma: PositiveAngularRate = 0.001745329  # type: ignore[valid-type]
    durations: Annotated[tuple[PositiveDuration, ...], Field(min_length=1)] = (60.0, 80.0, 45.0)  # type: ignore[valid-type]
    planning_time: NonNegativeDuration = 2.0  # type: ignore[valid-type]
    wait_limit: NonNegativeDuration = 60.0  # type: ignore[valid-type]
    wait_step: PositiveDuration = 1.0  # type: ignore[valid-type]
    attempts: int = Field(default=5, ge=1)
    plan_attempts: int = Field(default=3, ge=1)
    bound_attempts: int = Field(default=6, ge=1)
    hold: PositiveDuration = 5.0  # type: ignore[valid-type]
    hold_limit: PositiveDuration = 20.0  # type: ignore[valid-type]
    hold_position: PositiveLength = 0.03  # type: ignore[valid-type]
    hold_speed: PositiveSpeed = 0.01  # type: ignore[valid-type]
    hold_angle: PositiveAngle = 0.052359878  # type: ignore[valid-type]
    camera_silence: PositiveDuration = 5.0  # type: ignore[valid-type]
    imu_silence: PositiveDuration = 0.2  # type: ignore[valid-type]
    escapes: Annotated[tuple[PositiveDuration, ...], Field(min_length=1)] = (10.0, 14.0, 20.0, 28.0, 40.0)  # type: ignore[valid-type]
    retreat_limit: PositiveDuration = 120.0  # type: ignore[valid-type]
    departure_speed: PositiveSpeed = 0.02  # type: ignore[valid-type]
    departure_limit: PositiveDuration = 60.0  # type: ignore[valid-type]
    time_limit: PositiveDuration = 900.0  # type: ignore[valid-type]
    mean_motion: NonNegativeAngularRate = 0.0  # type: ignore[valid-type]
    length: PositiveLength = 1.0  # type: ignore[valid-type]
    faults: tuple[Fault, ...] = ()

    @model_validator(mode="after")
    def _check_rates(self) -> MissionConfig:
        if self.update_ticks % self.control_ticks:
            raise ValueError(
                f"update_ticks ({self.update_ticks}) must be a multiple of control_ticks ({self.control_ticks})"
            )
        if not (_STEPS[0] - 1e-9 <= self.step <= _STEPS[1] + 1e-9 and self.tick >= _LEAST_TICK):
            allowed = f"{_STEPS[0]:g} to {_STEPS[1]:g} s, and a tick {_LEAST_TICK:g} s or more"
            raise ValueError(f"the control step, tick times control_ticks, is {self.step:g} s; it must be {allowed}")
        if self.length > _LARGEST_LENGTH:
            raise ValueError(f"length: {self.length:g} m is more than {_LARGEST_LENGTH:,.0f} m")
        durations = (("durations", duration) for duration in self.durations)
        planning = (("planning_time", self.planning_time),) if self.planning_time else ()
        others = (("update_ticks", self.update_period), ("hold_limit", self.hold_limit), ("wait_step", self.wait_step))
        for name, seconds in (*planning, *others, *durations):
            steps = seconds / self.step
            if steps > _MOST_STEPS:
                most = _MOST_STEPS * self.step
                raise ValueError(f"{name}: {seconds:g} s is more than {_MOST_STEPS:,} control steps, {most:g} s")
            if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
                step = f"the control step, {self.step:g} s (tick times control_ticks)"
                raise ValueError(f"{name}: {seconds:g} s is not a multiple of {step}")
        for name in ("checkout", "hold"):
            least, most = getattr(self, name), getattr(self, f"{name}_limit")
            if least > most:
                raise ValueError(f"{name} ({least:g} s) is more than {name}_limit ({most:g} s)")
        wait, step = f"wait_limit ({self.wait_limit:g} s)", f"wait_step ({self.wait_step:g} s)"
        if self.wait_limit / self.wait_step > _MOST_WAITS:
            raise ValueError(f"{wait} is more than {_MOST_WAITS:,} times {step}")
        return self

    @property
    def step(self) -> float:
        """The control step [s]."""
        return float(self.tick * self.control_ticks)

    @property
    def impulses(self) -> tuple[float, ...]:
        """Times of the impacts on the target [s], ascending."""
        return tuple(sorted(fault.start for fault in self.faults if fault.kind == "tumble"))

    @property
    def update_period(self) -> float:
        """Time between two updates of the reference [s]."""
        return float(self.tick * self.update_ticks)

    def fails(self, kind: str, time: float) -> bool:
        """Return whether there is a fault of a kind at a time [s]."""
        return any(fault.kind == kind and fault.start <= time < fault.start + fault.duration for fault in self.faults)
