"""`FreeFlyer`: a rigid body with body-fixed thrusters, in axes that do not turn."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

from safe_inspect.compiling import Kernel, njit
from safe_inspect.dynamics.attitude.inertia import PrincipalMoments
from safe_inspect.dynamics.attitude.rigid_body import rotation_row
from safe_inspect.dynamics.base import TURNING_ARRAYS, Dynamics
from safe_inspect.dynamics.cwh import cwh_row, transition
from safe_inspect.dynamics.rotation_row import rotated
from safe_inspect.types import ArraySpec, FloatArray
from safe_inspect.units import NonNegativeAngularRate, NonNegativeDuration


class FreeFlight(NamedTuple):
    """Parameters of a step.

    Attributes:
        phi: Transition matrix of the step in Hill's frame, shape (6, 6).
        gamma: Input matrix for 1 kg, shape (6, 3).
        inertia: Principal moments of inertia [kg m^2].
        share: Fraction of the difference between control and wrench that the actuators remove in the step.
        mean_motion: Mean motion of the orbit [rad/s].
        step_size: Length of the step [s].
    """

    phi: FloatArray
    gamma: FloatArray
    inertia: tuple[float, float, float]
    share: float
    mean_motion: float
    step_size: float


@njit(error_model="numpy")
def _free_flyer_row(
    flight: FreeFlight,
    position: FloatArray,
    velocity: FloatArray,
    orientation: FloatArray,
    angular_velocity: FloatArray,
    wrench: FloatArray,
    orbit_angle: FloatArray,
    control: FloatArray,
    mass: float,
) -> float:
    """Advance one body; see `Dynamics`. The force acts along the mean of the axes before and after the step."""
    for i in range(6):
        wrench[i] += flight.share * (control[i] - wrench[i])
    q, w = orientation, angular_velocity
    before = (q[0], q[1], q[2], q[3], w[0], w[1], w[2])
    after = rotation_row(flight.inertia, before, (wrench[3], wrench[4], wrench[5]), flight.step_size)
    first = rotated((before[0], before[1], before[2], before[3]), wrench[0], wrench[1], wrench[2])
    second = rotated((after[0], after[1], after[2], after[3]), wrench[0], wrench[1], wrench[2])
    half = 0.5 / mass
    ax, ay, az = half * (first[0] + second[0]), half * (first[1] + second[1]), half * (first[2] + second[2])
    # The position is advanced in Hill's frame, whose x axis turns with the orbit, and rotated back.
    n, angle, turn = flight.mean_motion, orbit_angle[0], flight.mean_motion * flight.step_size
    c, s = math.cos(angle), math.sin(angle)
    p, v = position, velocity
    x, y = c * p[0] + s * p[1], c * p[1] - s * p[0]
    vx, vy = c * v[0] + s * v[1] + n * y, c * v[1] - s * v[0] - n * x
    cm, sm = math.cos(angle + 0.5 * turn), math.sin(angle + 0.5 * turn)
    hill = cwh_row(flight.phi, flight.gamma, (x, y, p[2], vx, vy, v[2]), cm * ax + sm * ay, cm * ay - sm * ax, az)
    c, s = math.cos(angle + turn), math.sin(angle + turn)
    vx, vy = hill[3] - n * hill[1], hill[4] + n * hill[0]
    p[0], p[1], p[2] = c * hill[0] - s * hill[1], s * hill[0] + c * hill[1], hill[2]
    v[0], v[1], v[2] = c * vx - s * vy, s * vx + c * vy, hill[5]
    orbit_angle[0] = angle + turn
    for i in range(4):
        orientation[i] = after[i]
    for i in range(3):
        angular_velocity[i] = after[4 + i]
    rate: float = (abs(wrench[0]) + abs(wrench[1]) + abs(wrench[2])) / mass
    return rate


class FreeFlyer(Dynamics):
    """A rigid body about a point in free fall, under forces and torques along its own axes, in axes W that do not turn.

    ``p'' = R(q) F / m + tide``, ``q' = q [w, 0] / 2``, ``J w' = M - w x J w``, with q = q_WB and w in body axes. The
    control is F in newtons, then M in newton metres, along the body's axes. ``wrench`` is the control that acts on the
    body; it follows the commanded control with the lag T: ``wrench' = (control - wrench) / T``. On an orbit, W
    coincides with Hill's frame at time zero (x radially outwards, y along the orbit), ``orbit_angle`` is the angle by
    which Hill's frame has turned since, and the tide is ``n^2 (3 (e . p) e - p)`` with e radially outwards: the motion
    of Clohessy and Wiltshire, in inertial axes. Translation is exact for a held force; rotation is a step of the
    classical Runge-Kutta method. The dynamics provide no ``mean_motion`` to plugins, so safety filters for
    Clohessy-Wiltshire dynamics are rejected. Source: Clohessy and Wiltshire, "Terminal guidance system for satellite
    rendezvous", 1960; Markley and Crassidis, "Fundamentals of Spacecraft Attitude Determination and Control", Springer
    2014, chapter 3.

    Attributes:
        inertia: Principal moments of inertia J along the body's axes [kg m^2].
        lag: Time constant of the actuators [s]; with 0 they follow at once.
        mean_motion: Mean motion n of the orbit of the origin [rad/s]; 0 for free space.
        keeps_trace: Whether the simulation stores the arrays after every physics step, for sensors that measure between
            the steps of the agents.
    """

    row: ClassVar[Kernel[..., float]] = _free_flyer_row
    arrays: ClassVar[Mapping[str, ArraySpec]] = {
        **TURNING_ARRAYS,
        "wrench": ArraySpec((6,)),
        "orbit_angle": ArraySpec((1,)),
    }
    control_size: ClassVar[int] = 6
    control_unit: ClassVar[str] = "N and N m"

    inertia: PrincipalMoments = (0.153427995, 0.14271405, 0.162302759)
    lag: NonNegativeDuration = 0.0
    mean_motion: NonNegativeAngularRate = 0.0
    keeps_trace: bool = False

    @property
    def traced(self) -> bool:
        """Whether the trace is stored."""
        return self.keeps_trace

    @property
    def turns_thrust(self) -> bool:
        """Whether the thrust turns with the body; always true."""
        return True

    def __call__(self, step_size: float) -> tuple[Any, ...]:
        """Return the parameters of a step."""
        phi, gamma = transition(self.mean_motion, 1.0, step_size)
        share = 1.0 if self.lag == 0.0 else -math.expm1(-step_size / self.lag)
        return (FreeFlight(phi, gamma, self.inertia, share, self.mean_motion, step_size),)

    def initial(self) -> Mapping[str, Sequence[float]]:
        """Return the attitude of a body that is aligned with the axes of W."""
        return {"orientation": (0.0, 0.0, 0.0, 1.0)}
