"""The sun: `Sun`, the component that moves it with the chief's orbit, its direction in Hill's frame, and its eclipse.

The direction is ``[cos b cos a, -cos b sin a, sin b]`` with a(t) = a(0) + rate t (`sun_directions`). The key
``illumination_params`` of an inspection simulator sets the fields of `Sun`; with None every point is always lit.
Docking and rendezvous have no sun.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime, timedelta
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from safe_inspect.compiling import njit
from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.orbit.earth import EARTH_RADIUS, Shadow, earth_shadow, sunlight_row
from safe_inspect.dynamics.orbit.relative_orbit import ORBIT, RelativeOrbit
from safe_inspect.dynamics.orbit.relative_orbit_row import in_hill_frame, in_inertial_axes
from safe_inspect.errors import ArgumentError
from safe_inspect.simulators import Component, OfView, PassiveComponent, RunningComponent, State, World
from safe_inspect.simulators.component import EntityParameter
from safe_inspect.types import ArraySpec, BoolArray, FloatArray
from safe_inspect.units import ElevationAngle, Length, NonNegativeLength, PositiveAngularRate, PositiveLength

#: The array of the direction of the light, with `Sun.eclipse`.
LIGHT = "light_direction"
#: The array of the angle between the sun and the orbital plane [rad], for a sun that is not in this plane.
BETA = "beta_angle"
#: The array of the direction of the sun in inertial axes, on a `RelativeOrbit`.
_INERTIAL = "sun_inertial"
_NONE = np.zeros(0)


def sun_directions(angle: FloatArray, beta: FloatArray | float = 0.0) -> FloatArray:
    """Return the unit vectors to the sun, Hill frame, shape (..., 3).

    Args:
        angle: Angle a of the sun in the orbital plane, clockwise about +z from the radial direction [rad].
        beta: Angle b between the sun and the plane, positive towards +z [rad].

    Returns:
        ``[cos b cos a, -cos b sin a, sin b]``.
    """
    across, up = np.cos(beta), np.sin(beta)
    return np.stack((across * np.cos(angle), -across * np.sin(angle), np.zeros_like(angle) + up), axis=-1)


@njit
def sun_row(angle: float) -> tuple[float, float, float]:
    """Return the unit vector to the sun for one angle [rad], with the sun in the orbital plane."""
    return math.cos(angle), -math.sin(angle), 0.0


def predicted_sun(state: State, row: int, angle: FloatArray, world: World) -> tuple[FloatArray, FloatArray]:
    """Return the predicted directions of the sun and of the light, for a beta angle that does not change.

    The shadow is that on the circular orbit.

    Args:
        state: The state.
        row: Index of the environment.
        angle: Predicted angles of the sun, see `sun_directions` [rad], shape (T,).
        world: The constant data of the simulation.

    Returns:
        The unit vectors to the sun, and the same with NaN where the Earth hides it and nothing is lit; each of shape
        (T, 3), Hill frame.
    """
    beta = float(state[BETA][row]) if BETA in state.arrays else 0.0
    sun, shadow = sun_directions(angle, beta), world.offers.world.get("shadow")
    light = sun.copy()
    if shadow is not None:
        light[light[:, 0] < shadow.edge] = np.nan
    return sun, light


@njit
def _turn_sun(turn: float, angle: FloatArray, beta: FloatArray, direction: FloatArray) -> None:
    """Add an angle to each sun angle [rad], shape (N,), and write the unit vectors to the sun, shape (N, 3).

    The beta angles [rad], shape (N,), do not change; an empty array: the sun is in the orbital plane.
    """
    for n in range(angle.shape[0]):
        angle[n] += turn
        x, y, z = sun_row(angle[n])
        if len(beta):
            x, y, z = math.cos(beta[n]) * x, math.cos(beta[n]) * y, math.sin(beta[n])
        direction[n, 0], direction[n, 1], direction[n, 2] = x, y, z


@njit
def _sun_of_orbit(
    orbit: FloatArray, inertial: FloatArray, angle: FloatArray, beta: FloatArray, direction: FloatArray
) -> None:
    """Write the sun's angle, which continues without a jump, its beta angle and its direction in Hill's frame.

    Args:
        orbit: The chief's orbit, see `RelativeOrbit`, shape (N, 6).
        inertial: Direction of the sun in inertial axes, shape (N, 3).
        angle: Output: angle of the sun [rad], shape (N,); on input, the last one.
        beta: Output: beta angle [rad], shape (N,).
        direction: Output: direction of the sun, Hill frame, shape (N, 3).
    """
    for n in range(angle.shape[0]):
        x, y, z = in_hill_frame(orbit[n], (inertial[n, 0], inertial[n, 1], inertial[n, 2]))
        direction[n, 0], direction[n, 1], direction[n, 2] = x, y, z
        turned = math.atan2(-y, x) - angle[n]
        angle[n] += turned - 2.0 * math.pi * math.floor(turned / (2.0 * math.pi) + 0.5)
        beta[n] = math.asin(max(min(z, 1.0), -1.0))


@njit
def shade(shadow: Shadow, distance: FloatArray, direction: FloatArray, sunlight: FloatArray, light: FloatArray) -> None:
    """Write the visible fraction of the sun, shape (N,), and the direction of the light, shape (N, 3); see `Sun`.

    The fraction is that of the sun's disc outside of the Earth's disc, as circles in the plane with the apparent radii
    asin(radius / distance). The centre of the sun is dark where the x component of its direction is below
    ``shadow.edge`` = -cos(asin(R / r)), with the radius R of the Earth and the chief's distance r from its centre.

    Args:
        shadow: The shadow on a circular orbit.
        distance: Distance of the chief from the Earth's centre [m], shape (N,); empty on a circular orbit.
        direction: Direction of the sun, Hill frame, shape (N, 3).
        sunlight: Output: the fraction.
        light: Output: the direction.
    """
    for n in range(sunlight.shape[0]):
        if len(distance):
            earth = math.asin(min(EARTH_RADIUS / distance[n], 1.0))
            shadow = Shadow(-math.cos(earth), earth, shadow.sun)
        sunlight[n] = sunlight_row(direction[n, 0], shadow)
        for axis in range(3):
            light[n, axis] = direction[n, axis] if direction[n, 0] >= shadow.edge else math.nan


def _written_date(value: Any) -> Any:
    if isinstance(value, int | float):  # which Pydantic takes as seconds since 1970
        raise ValueError(f"expected a date such as '2026-06-21 08:25', got {value}")
    return value


#: Field type of a date and time; a time without a zone is UTC.
WrittenDate = Annotated[datetime, BeforeValidator(_written_date)]


class SunDirection(BaseModel):
    """Fields of the models that set the direction of the sun, and whether the Earth hides it; see `Sun`.

    Attributes:
        eclipse: Whether the Earth hides the sun on a part of each orbit, in which no point is lit.
        beta_angle: Angle between the sun and the orbital plane at the reset [rad], positive towards +z, which the reset
            parameter ``beta_angle`` replaces; None: the sun is in the plane.
        date: Date and time (UTC if no zone is given), on a `RelativeOrbit`: the direction of the sun is that of this
            date in all episodes, and ``sun_angle`` is not used. Excludes `beta_angle`. None: these two determine it.
    """

    eclipse: bool = False
    beta_angle: ElevationAngle | None = None
    date: WrittenDate | None = None

    @model_validator(mode="after")
    def _one_direction(self) -> Self:
        if self.date is not None and self.beta_angle is not None:
            raise ValueError("`date` and `beta_angle` exclude each other; remove one of them")
        return self


def _sun_on(date: datetime) -> tuple[float, float, float]:
    """Return the unit vector to the sun in the Earth's equatorial axes of that date, to about 0.01 degrees.

    Source: Vallado, "Fundamentals of Astrodynamics and Applications", 4th edition, 2013, algorithm 29.
    """
    centuries = (date - datetime(2000, 1, 1, 12, tzinfo=UTC)) / timedelta(days=36525)
    anomaly = math.radians(357.529109 + 35999.05034 * centuries)
    longitude = 280.46 + 36000.771 * centuries + 1.914666471 * math.sin(anomaly) + 0.019994643 * math.sin(2.0 * anomaly)
    along, tilt = math.radians(longitude), math.radians(23.439291 - 0.0130042 * centuries)
    return math.cos(along), math.cos(tilt) * math.sin(along), math.sin(tilt) * math.sin(along)


class Sun(SunDirection, PassiveComponent):
    """Sun whose angle a grows at a constant rate, a(t) = a(0) + rate t, clockwise about +z of Hill's frame.

    Its direction is that of `sun_directions`. The rate is the `mean_motion` of `illumination_params`, 0.001027 rad/s by
    default, even if the simulator has another `mean_motion`: set both. With ``illumination_params: null``, the rate is
    the simulator's `mean_motion`.

    Arrays: ``sun_angle``, not wrapped [rad], shape (N,), and ``sun_direction``, the unit vector from the chief to the
    sun, shape (N, 3). A reset takes the angle from the sampled state ``sun_angle``, or 0 if there is none.

    With `beta_angle`, the sun is not in the orbital plane, and there is the array ``beta_angle`` [rad], shape (N,). On
    a `RelativeOrbit`, this array always exists. There, the direction of the sun is constant in inertial axes for an
    episode, and angle, beta angle and direction in Hill's frame follow from the motion of the frame. The inertial axes
    are the Earth's equatorial ones: z along its axis, right ascensions from x. `in_hill_frame` turns a vector by the
    node about z, the inclination about x and the argument of latitude about z, the elements 5, 3 and 4 of the array
    ``chief_orbit`` [rad].

    With `eclipse`, there are two more arrays: ``sunlight``, the fraction of the sun's disc that the Earth does not hide
    [-], shape (N,), see `sunlight_row`, and ``light_direction``, which is ``sun_direction`` while the centre of the
    disc is visible and NaN otherwise, shape (N, 3). Points, and the sensors that select points by their light, read
    ``light_direction``. No comparison with NaN is true, so that no point is lit, and they need not know of an eclipse
    (``illumination_params: {eclipse: True}``).

    These know of it: `SunlightSensor`, `SolarPressure` and figures read ``sunlight``; `CoastingInspectionSensor` and
    `NaturalMotionInspector` predict by `Shadow.edge`. `SunDirectionSensor` reads ``sun_direction``, which continues
    in the dark. The shadow is that of `dynamics.orbit.earth`. Another law of shadows must change `shade`, and what
    predicts: `Shadow.edge`, `predicted_sun` and the sensor. The world value ``shadow``, a `Shadow`, shows all others
    that there is an eclipse: where it exists, the points of a body that does not turn read ``light_direction``,
    and predictions take its `edge` as constant. A new field of `SunDirection` is a key of ``illumination_params``.

    Which points are lit is decided in `geometry.visibility` (`light_row`, `inspect_in_view`, `inspect_body`: q . s >
    terminator), which `InspectionPoints` calls with s from ``light_direction``, or from the copy of it along the axes
    of a body that rotates, see `array_in_axes_of`.

    Attributes:
        rate: Rate of the angle [rad/s]. On a `RelativeOrbit`, it does not move the sun; predictions use it nevertheless
            (``world.sun_rate``).
        distance: Distance of the sun [m]; it determines the apparent size of the disc.
    """

    entity: ClassVar[Mapping[str, EntityParameter]] = {"theta": EntityParameter("rad", "sun_angle", "sun")}

    optional_parameters: ClassVar[Mapping[str, str]] = {BETA: "its `beta_angle` is set, as by `illumination_params`"}

    rate: PositiveAngularRate = 0.001027
    distance: PositiveLength = 150e9

    @property
    def parameters(self) -> Mapping[str, str | None]:  # type: ignore[override]
        """The reset parameter ``beta_angle``, if the sun is not in the orbital plane."""
        return {} if self.beta_angle is None else {BETA: "rad"}

    @property
    def allowed(self) -> Mapping[str, tuple[float, float]]:
        """A beta angle of at most 90 degrees."""
        return {BETA: (-0.5 * math.pi, 0.5 * math.pi)}

    def __call__(self, world: World, num_envs: int) -> RunningComponent:
        """Return the running sun.

        Raises:
            ValueError: With `eclipse`, the orbit is not outside of the Earth.
            ArgumentError: A `date` without a `RelativeOrbit`.
        """
        if self.date is not None and "orbit" not in world.offers.world:
            raise ArgumentError("a sun with a `date` needs the dynamics RelativeOrbit; set them, or remove the date")
        shadow = earth_shadow(world.mean_motion, self.distance) if self.eclipse else None
        return _RunningSun(self, world, shadow)


def leaves_plane(dynamics: Dynamics, components: Iterable[Component]) -> bool:
    """Return whether the sun leaves the orbital plane, or its angle does not grow at a constant rate."""
    tilted = any(isinstance(component, Sun) and component.beta_angle is not None for component in components)
    return tilted or (isinstance(dynamics, RelativeOrbit) and not dynamics.uniform)


class _RunningSun(RunningComponent):
    def __init__(self, sun: Sun, world: World, shadow: Shadow | None) -> None:
        self._rate, self._turn, self._shadow = sun.rate, sun.rate * world.step_size, shadow
        self._beta, self._of_orbit = sun.beta_angle, "orbit" in world.offers.world
        date = sun.date
        self._fixed = None if date is None else _sun_on(date if date.tzinfo else date.replace(tzinfo=UTC))
        self.arrays = {"sun_angle": ArraySpec(()), "sun_direction": ArraySpec((3,))}
        if self._of_orbit:
            self.arrays |= {BETA: ArraySpec(()), _INERTIAL: ArraySpec((3,))}
        elif self._beta is not None:
            self.arrays |= {BETA: ArraySpec(())}
        if shadow is not None:
            self.arrays |= {"sunlight": ArraySpec(()), LIGHT: ArraySpec((3,))}
        self.recorded = tuple(name for name in ("sun_angle", BETA, "sunlight") if name in self.arrays)
        self.offered = dict.fromkeys(self.arrays, OfView)

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        state["sun_angle"][:] = values.get("sun_angle", 0.0)
        if self._beta is not None:
            state[BETA][:] = values.get(BETA, self._beta)
        _turn_sun(0.0, state["sun_angle"], self._beta_of(state), state["sun_direction"])
        if self._fixed is not None:
            state[_INERTIAL][:] = self._fixed
            _sun_of_orbit(state[ORBIT], state[_INERTIAL], *self._outputs(state))
        elif self._of_orbit:
            in_inertial_axes(state[ORBIT], state["sun_direction"], state[_INERTIAL])
        self._shade(state)

    def step(self, state: State, running: BoolArray) -> None:
        bound = state.bound.get("sun")
        if bound is None:
            bound = state.bound["sun"] = self._bind(state)
        bound[0](*bound[1])
        self._shade(state)

    def _bind(self, state: State) -> tuple[Callable[..., None], tuple[Any, ...]]:
        """Return the kernel that turns the sun in a step, and its arguments."""
        outputs = self._outputs(state)
        if self._of_orbit:
            return _sun_of_orbit.dispatcher, (state[ORBIT], state[_INERTIAL], *outputs)
        return _turn_sun.dispatcher, (self._turn, *outputs)

    def _outputs(self, state: State) -> tuple[FloatArray, FloatArray, FloatArray]:
        return state["sun_angle"], self._beta_of(state), state["sun_direction"]

    def _beta_of(self, state: State) -> FloatArray:
        return state[BETA] if BETA in self.arrays else _NONE

    def _shade(self, state: State) -> None:
        if self._shadow is not None:
            distance = np.ascontiguousarray(state[ORBIT][:, 0]) if self._of_orbit else _NONE
            shade(self._shadow, distance, state["sun_direction"], state["sunlight"], state[LIGHT])

    def of_world(self) -> Mapping[str, Any]:
        return {"sun_rate": self._rate} | ({} if self._shadow is None else {"shadow": self._shadow})

    def shared_state(self, team: Any) -> tuple[Any, ...]:
        return (team.sun_direction,)


class IlluminationParams(SunDirection):
    """Properties of the sun and its light.

    Attributes:
        mean_motion: Rate of the sun's angle [rad/s]; it does not follow the simulator's `mean_motion`, see `Sun`.
        avg_rad_Earth2Sun: Distance of the sun [m]; its rays are parallel on the chief, and the distance only determines
            the penumbra of an eclipse.
        light_properties: Colour of the light; recorded, without effect on the simulation.
        chief_properties: Colour of the chief's surface; recorded, without effect on the simulation.
        bin_ray_flag: Must be true: a point is lit if its ray to the sun is free, and dark otherwise.
        ray_offset: Height above the surface at which the ray to the sun starts [m]. 0 is exact; safe-autonomy-sims
            uses 1e-5.
        resolution: Pixels of the camera; recorded, without effect on the simulation.
        focal_length: Focal length of the camera [m]; recorded, without effect on the simulation.
        pixel_pitch: Pixel pitch of the camera [m]; recorded, without effect on the simulation.
        render_flag_3d: Must be false: the simulator does not render; use `safe_inspect.figures` instead.
        render_flag_subplots: Must be false, for the same reason.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    mean_motion: PositiveAngularRate = 0.001027
    avg_rad_Earth2Sun: PositiveLength = 150e9  # noqa: N815 - the key of safe-autonomy-sims
    light_properties: dict[str, Any] = Field(default_factory=dict)
    chief_properties: dict[str, Any] = Field(default_factory=dict)
    bin_ray_flag: bool = True
    ray_offset: NonNegativeLength = 0.0
    resolution: tuple[int, int] = (200, 200)
    focal_length: Length = 9.6e-3
    pixel_pitch: Length = 5.6e-3
    render_flag_3d: bool = False
    render_flag_subplots: bool = False

    @model_validator(mode="after")
    def _simulated(self) -> IlluminationParams:
        if self.render_flag_3d or self.render_flag_subplots:
            raise ValueError("the simulator does not render; set the render flags to False and plot recorded episodes")
        if not self.bin_ray_flag:
            raise ValueError("points are lit or dark, without colours; remove `bin_ray_flag: False`")
        return self
