"""`Dynamics`: the motion of a vehicle, which the simulator uses only through its arrays, control and row kernel.

`DisturbanceBounds` state how far the real motion may depart from the model that safety filters use.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field

from safe_inspect.compiling import Kernel, generate
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.types import ArraySpec, FloatArray
from safe_inspect.units import ErrorAngle, NonNegativeLength, NonNegativeSpeed


@dataclass(frozen=True)
class MotionLimits:
    """Limits within which the bounds of a disturbance must be valid.

    Attributes:
        step_size: Time for which the agent's control is held [s].
        mass: Mass of the deputy [kg].
        thrust: Largest thrust along each axis [N].
        distance: Largest distance from the origin of Hill's frame [m]; infinite if it is not bounded.
        speed: Largest speed [m/s]; infinite if it is not bounded.
    """

    step_size: float
    mass: float
    thrust: float
    distance: float = math.inf
    speed: float = math.inf


class DisturbanceBounds(BaseModel):
    """Bounds of a disturbance; a bound of 0, the default, means no disturbance.

    Attributes:
        velocity: Magnitude of the velocity that disturbances add in a step [m/s].
        position_error: Distance of the estimated position from the true position [m].
        velocity_error: Magnitude of the error of the estimated velocity [m/s].
        thrust_gain: Relative error of the thrust's magnitude [-].
        thrust_direction: Angle between the thrust and the commanded thrust [rad].
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    velocity: NonNegativeSpeed = 0.0
    position_error: NonNegativeLength = 0.0
    velocity_error: NonNegativeSpeed = 0.0
    thrust_gain: float = Field(default=0.0, ge=0.0, lt=1.0, allow_inf_nan=False)
    thrust_direction: ErrorAngle = 0.0

    @property
    def bounds(self) -> tuple[float, float, float, float, float]:
        """The bounds, in the order of the fields."""
        return (self.velocity, self.position_error, self.velocity_error, self.thrust_gain, self.thrust_direction)

    @property
    def thrust_error(self) -> float:
        """Largest |applied - commanded| / |commanded| of the thrust [-].

        A thrust of magnitude g at the angle a to the commanded one of magnitude 1 differs by sqrt((g - 1)^2 + 4 g
        sin(a/2)^2).
        """
        chord = 2.0 * math.sin(0.5 * self.thrust_direction)
        return math.sqrt(self.thrust_gain**2 + (1.0 + self.thrust_gain) * chord**2)

    def exceeded(self, other: DisturbanceBounds) -> list[str]:
        """Return the names of the fields in which another disturbance is larger than this one."""
        return [name for name in DisturbanceBounds.model_fields if getattr(other, name) > getattr(self, name)]

    def __add__(self, other: DisturbanceBounds) -> DisturbanceBounds:
        """Return the bounds of two disturbances that act together; they may exceed the allowed range of the fields."""
        fields: Any = {name: getattr(self, name) + getattr(other, name) for name in DisturbanceBounds.model_fields}
        fields["thrust_gain"] += self.thrust_gain * other.thrust_gain
        return DisturbanceBounds.model_construct(**fields)


#: Bounds of a component that does not disturb the motion, the thrust or the estimates.
NO_DISTURBANCE = DisturbanceBounds()


class Dynamics(Plugin):
    """Motion of bodies under held controls, with one row kernel for all bodies.

    Calling it with a step size returns the parameters of the row kernel:

        rate = row(*parameters, *shared, *arrays, control, mass)

    The kernel advances one body by one physics step in place and returns the velocity change that it spends per second
    [m/s^2]. `shared` are the arrays of the environment, which it reads, and `arrays` those of the body, each without
    its leading axes; `control` is the held control, shape (`control_size`,), zeros for a body without thrusters; `mass`
    is in kg. After all bodies, ``shared_row(*parameters, *shared)`` advances the arrays of the environment.

    Class attributes:
        row: The row kernel.
        arrays: Arrays of one body by name, in the kernel's order, SI units. The first two are ``position`` [m] and
            ``velocity`` [m/s], shape (3,).
        shared: Arrays of one environment by name, in the kernel's order, SI units, such as the chief's orbit or a wind.
            Empty by default.
        shared_row: Kernel that advances them by one physics step in place; None if they are constant.
        parameters: SI unit by the name of each reset parameter that `reset_shared` uses if the configuration gives it.
        control_size: Number of elements of the control, C.
        control_unit: Their SI unit.
    """

    kind: ClassVar[str] = "dynamics"
    row: ClassVar[Kernel[..., float]]
    arrays: ClassVar[Mapping[str, ArraySpec]] = {"position": ArraySpec((3,)), "velocity": ArraySpec((3,))}
    shared: ClassVar[Mapping[str, ArraySpec]] = {}
    shared_row: ClassVar[Kernel[..., None] | None] = None
    parameters: ClassVar[Mapping[str, str]] = {}
    control_size: ClassVar[int] = 3
    control_unit: ClassVar[str] = "N"

    @property
    def traced(self) -> bool:
        """Whether a simulation stores the arrays of the bodies after every physics step. False by default."""
        return False

    @property
    def turns_thrust(self) -> bool:
        """Whether the thrust, the first three elements of the control, is given in body axes. False by default."""
        return False

    @property
    def allowed(self) -> Mapping[str, tuple[float, float]]:
        """Smallest and largest allowed value, in SI, by the name of a reset parameter. Empty by default."""
        return {}

    @abstractmethod
    def __call__(self, step_size: float) -> tuple[Any, ...]:
        """Return the first arguments of the row kernel: arrays and numbers.

        Args:
            step_size: Length of a physics step [s].
        """

    def initial(self) -> Mapping[str, Sequence[float]]:
        """Return values of arrays by name, for bodies whose initialiser does not set them; zeros by default."""
        return {}

    def reset_shared(self, values: Mapping[str, Any], rows: int) -> Mapping[str, FloatArray]:
        """Return initial values of arrays of the environment by name, each of shape (R, ...); empty by default.

        Args:
            values: The reset parameters and states that were drawn, by name, each with R rows.
            rows: Number of environments, R.
        """
        return {}

    def initial_figures(self, shared: Mapping[str, FloatArray]) -> Mapping[str, FloatArray]:
        """Return figures of the environment that evaluations list among the initial states; empty by default.

        Args:
            shared: The arrays of the environment at the start of the episodes, by name, each of shape (N, ...).

        Returns:
            Figures in SI by name, such as ``eccentricity``, each of shape (N,).
        """
        return {}

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds | None:
        """Return how far a step of the agents departs from the exact Clohessy-Wiltshire motion under the held thrust.

        That motion is the one at the ``mean_motion`` of `offers`; see `Component.disturbance_bounds`. The default,
        None, states nothing, and safety filters for Clohessy-Wiltshire dynamics are then rejected.

        Args:
            limits: The range of motion for which the bounds must be valid.
        """
        return None

    def offers(self) -> Mapping[str, Any]:
        """Return the values that plugins can read by name from `World`, such as ``mean_motion``. Empty by default."""
        return {}


#: Arrays of dynamics with an attitude.
TURNING_ARRAYS = {**Dynamics.arrays, "orientation": ArraySpec((4,)), "angular_velocity": ArraySpec((3,))}


def advance_kernel(dynamics: Dynamics, step_size: float, *, traced: bool = False) -> Kernel[..., None]:
    """Return the compiled loop that applies a vehicle's row kernel to environments, bodies and physics steps.

        advance(*parameters, *shared, *arrays, [*traces,] control, masses, step_size, physics_steps, delta_v, time,
                step)

    Args:
        dynamics: The dynamics.
        step_size: Length of a physics step [s].
        traced: Whether each array is also written after every physics step, into a trace (N, B, physics steps, ...).
    """
    parameters = ", ".join(f"p{index}" for index in range(len(dynamics(step_size))))
    arrays = ", ".join(f"a{index}" for index in range(len(dynamics.arrays)))
    rows = ", ".join(f"a{index}[n, b]" for index in range(len(dynamics.arrays)))
    shared = ", ".join(f"s{index}" for index in range(len(dynamics.shared)))
    given = ", ".join(f"s{index}[n]" for index in range(len(dynamics.shared)))
    first = "".join(f"{names}, " for names in (parameters, shared) if names)
    before = "".join(f"{names}, " for names in (parameters, given) if names)
    names = [f"a{index}" for index in range(len(dynamics.arrays))] if traced else []
    traces = "".join(f", of_{name}" for name in names)
    kept = "".join(f"\n                of_{name}[n, b, k] = {name}[n, b]" for name in names)
    turn = "" if dynamics.shared_row is None else f"\n            shared_row({before})"
    source = f"""import numpy as np


def advance({first}{arrays}{traces}, control, masses, step_size, physics_steps, delta_v, time, step):
    deputies, idle = masses.shape[0], np.empty(control.shape[2])
    for k in range(len(idle)):
        idle[k] = 0.0
    for n in range(a0.shape[0]):
        for k in range(physics_steps):
            for b in range(a0.shape[1]):
                held, mass = (control[n, b], masses[b]) if b < deputies else (idle, 1.0)
                rate = row({before}{rows}, held, mass){kept}
                if b < deputies:
                    delta_v[n, b] += rate * step_size{turn}
        time[n] += step_size * physics_steps
        step[n] += 1
"""
    return generate(
        "advance", source, {"row": dynamics.row, "shared_row": dynamics.shared_row or dynamics.row},
        {"error_model": "numpy"},
    )  # fmt: skip
