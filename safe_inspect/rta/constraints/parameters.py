"""Parameters of a task from which its constraints are built, named as in safe-autonomy-sims."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from safe_inspect.errors import did_you_mean
from safe_inspect.units import (
    ConeAngle,
    NonNegativeSpeed,
    PositiveAngularRate,
    PositiveDuration,
    PositiveForce,
    PositiveLength,
    PositiveMass,
    PositiveSpeed,
)


class FromWorld(BaseModel):
    """Plugin of which some fields have values of the simulated world unless they are given."""

    def in_world(self, world: Mapping[str, float]) -> Self:
        """Return a copy in which fields that are not given have the values of the world.

        Args:
            world: Values of fields in SI units; others are ignored.

        Raises:
            ValidationError: The values contradict each other.
        """
        given = {name: getattr(self, name) for name in self.model_fields_set}
        taken = {k: v for k, v in world.items() if k not in given and k in type(self).model_fields}
        return type(self).model_validate(given | taken) if taken else self


class TaskParameters(FromWorld):
    """Parameters of a task that constraints and safety filters need; all quantities accept units.

    In an experiment, four of them default to values of the simulated world: `step_size` to the period of the frame
    rate, `n` to the mean motion of the simulator, `m` to the mass of the platform, and `u_max` to the limit of the
    controllers. The value null means that the default is used.

    Attributes:
        step_size: Time for which a control is held [s]. No constraint depends on it, but the filters do.
        collision_radius: Range at which the deputy hits the chief [m].
        v0: Speed allowed at `v0_distance` [m/s].
        v0_distance: Range at which the speed `v0` is allowed [m]; by default, the collision radius.
        v1_coef: Slope of the speed limit, v0 + v1_coef n (range - v0_distance), as a multiple of n [-].
        n: Mean motion [rad/s].
        r_max: Largest range [m].
        u_max: Largest thrust of each axis [N].
        m: Mass of the deputy [kg].
        fov: Full opening angle of the sun keep-out cone [rad], which is the field of view of the sensor.
        vel_limit: Largest allowed speed along each axis [m/s].
        psm_horizon: Duration for which coasting must be safe [s].
    """

    model_config = ConfigDict(frozen=True, extra="forbid", validate_default=True)

    step_size: PositiveDuration = 10.0
    collision_radius: PositiveLength = 10.0
    v0: NonNegativeSpeed = 0.2
    v0_distance: PositiveLength | None = None
    v1_coef: float = Field(default=2.0, ge=0.0, allow_inf_nan=False)
    n: PositiveAngularRate = 0.001027
    r_max: PositiveLength = 800.0
    u_max: PositiveForce = 1.0
    m: PositiveMass = 12.0
    fov: ConeAngle = math.pi / 3.0
    vel_limit: PositiveSpeed = 1.0
    psm_horizon: PositiveDuration = 100.0

    @model_validator(mode="before")
    @classmethod
    def _null_is_not_given(cls, values: Any) -> Any:
        if isinstance(values, Mapping):
            return {k: v for k, v in values.items() if v is not None or k not in TaskParameters.model_fields}
        return values

    @cached_property
    def agreeing(self) -> ConstraintParameters:
        """The same parameters, after the checks of `ConstraintParameters`."""
        return ConstraintParameters.of({name: getattr(self, name) for name in TaskParameters.model_fields})


class ConstraintParameters(TaskParameters):
    """Consistent parameters of a task; see `TaskParameters`.

    Raises:
        ValueError: A key is unknown, a value is impossible, or two values contradict each other.
    """

    @classmethod
    def of(cls, parameters: Mapping[str, Any] | ConstraintParameters) -> ConstraintParameters:
        """Return the parameters of a mapping; `ConstraintParameters` are returned as they are.

        Raises:
            ValueError: As for the class; the message lists every mistake.
        """
        if isinstance(parameters, ConstraintParameters):
            return parameters
        problems = [
            f"unknown parameter {str(key)!r}; {did_you_mean(str(key), cls.model_fields)}"
            for key in parameters
            if key not in cls.model_fields
        ]
        try:
            known = cls.model_validate({key: value for key, value in parameters.items() if key in cls.model_fields})
        except ValidationError as error:
            for problem in error.errors(include_url=False):
                where = ".".join(map(str, problem["loc"]))
                text = problem["msg"].removeprefix("Value error, ")
                problems.append(f"{where}: {text}" if where else text)
        if problems:
            raise ValueError("the parameters are invalid or contradict each other: " + "; ".join(problems))
        return known

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.r_max <= self.collision_radius:
            raise ValueError(
                f"r_max {self.r_max} m does not exceed collision_radius {self.collision_radius} m: "
                f"no position is safe; give a larger r_max"
            )
        if self.speed_distance >= self.r_max:
            raise ValueError(f"v0_distance {self.speed_distance} m must be below r_max {self.r_max} m")
        if self.v0 + self.v1 * (self.collision_radius - self.speed_distance) < 0.0:
            raise ValueError(
                f"the speed limit is negative at the collision radius (v0 {self.v0} m/s at {self.speed_distance} m, "
                f"slope {self.v1:g} 1/s): even a deputy at rest violates it; lower v0_distance or v1_coef"
            )
        return self

    @property
    def speed_distance(self) -> float:
        """Range at which the speed v0 is allowed [m]."""
        return self.collision_radius if self.v0_distance is None else float(self.v0_distance)

    @property
    def v1(self) -> float:
        """Slope of the speed limit over the range [1/s]."""
        return float(self.v1_coef * self.n)

    @property
    def net_acceleration(self) -> float:
        """Deceleration that the thrusters can give in any direction, up to the largest allowed speed v [m/s^2].

        It is the acceleration of the thrust minus the largest tidal and Coriolis accelerations:
        u_max / m - 3 n^2 r_max - 2 n v.
        """
        top_speed = min(self.vel_limit, self.v0 + self.v1 * self.r_max)
        return float(self.u_max / self.m - 3.0 * self.n**2 * self.r_max - 2.0 * self.n * top_speed)

    @property
    def max_acceleration(self) -> float:
        """Deceleration that the barrier functions h assume: `net_acceleration` [m/s^2].

        Where that is not positive, it is the acceleration of the thrusters alone, as near the chief; then no filter
        can enforce such an h.
        """
        net = self.net_acceleration
        return net if net > 0.0 else self.u_max / self.m


#: Defaults of the constraints' fields: those of the inspection task.
DEFAULTS = ConstraintParameters()
