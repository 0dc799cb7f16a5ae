"""Contract of the elements of a simulation: parameters, initialisers, simulators, components and dynamics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.dones.limits import EpisodeLengthDone
from safe_inspect.dynamics.base import DisturbanceBounds, Dynamics, MotionLimits, advance_kernel
from safe_inspect.dynamics.cwh import transition
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import InitialStateError
from safe_inspect.glues.base import ActionGlue
from safe_inspect.platforms.base import Sensor
from safe_inspect.platforms.cwh import CWHPlatform
from safe_inspect.platforms.state_sensors import PositionSensor, VelocitySensor
from safe_inspect.random.streams import Streams
from safe_inspect.simulators.component import Component
from safe_inspect.simulators.resets.initializers import Initializer
from safe_inspect.simulators.resets.parameters import Draw, Parameter
from safe_inspect.simulators.simulator import ComposedSimulator, Simulator
from safe_inspect.tasks.docking.tumble_parameter import tumble_states
from safe_inspect.testing.calls import Call, Check, SampleParts, Shape, check_alone, check_call, spread
from safe_inspect.testing.flights import HORIZON, fly
from safe_inspect.testing.report import Report
from safe_inspect.testing.samples import DEPUTIES, FEW_ENVIRONMENTS, ROWS, SampleVehicle, sample_spec, sample_states
from safe_inspect.types import AnyArray, FloatArray

#: Ranges of sampled values, by their SI unit.
_RANGES = {"m": (50.0, 100.0), "m/s": (0.0, 0.3), "rad": (-1.5, 6.28)}


def _check_parameter(plugin: Parameter, parts: SampleParts, report: Report) -> None:
    """Check a reset parameter: it must return a number for each row, (R,), or named states, such as a tumble's."""

    def draw(slots: AnyArray, states: dict[str, FloatArray]) -> Any:
        return plugin(Draw(Streams(12345, slots % 7, slots), "sample", values={"init_state": states}))

    given: dict[str, Any] = {"the slots": np.arange(ROWS), "init_state": sample_states()}
    call = Call("the parameter", draw, given, Shape(None, "f", "(R,)"), shapes={"": Shape()})
    result = check_call(call, report)
    if isinstance(result, Mapping) and {"orientation", "angular_velocity"} <= result.keys():
        try:
            tumble_states(plugin.registered_name, result, ROWS)
        except InitialStateError as error:
            report.expect(False, "tumble", str(error), "return what `TumbleParameter` returns")


def _check_initializer(plugin: Initializer, parts: SampleParts, report: Report) -> None:
    """Check an initialiser: it must return named states with R rows, including those of `gives`."""
    slots = np.arange(ROWS)
    draw = Draw(Streams(12345, slots, slots), "sample")
    given: dict[str, Any] = {name: parameter(draw.child(name)) for name, parameter in plugin.defaults.items()}
    for index, (name, symbol) in enumerate(plugin.parameters.items()):
        low, high = _RANGES.get(symbol or "", (0.1, 1.0))
        values = spread(np.array([low]), np.array([high]))[:, 0]
        given.setdefault(name, sample_states() if symbol is None else np.roll(values, index))
    shapes = {"position": Shape((3,), "f", "(R, 3)"), "velocity": Shape((3,), "f", "(R, 3)")}
    call = Call("the initialiser", plugin, {"parameters": given}, Shape(None, "f", "(R, ...)"), shapes)
    result = check_call(call, report)
    if result is not None:
        for name in plugin.gives:
            report.expect(
                name in result,
                "gives",
                f"`gives` names the state {name!r}, which is not returned",
                "return it, or remove it from `gives`",
            )


def _check_simulator(plugin: Simulator, parts: SampleParts, report: Report) -> None:
    """Check a simulator: an environment must evolve identically alone and in a batch."""
    known = len(report.breaches)
    with report.attempt("the simulator"):
        for deputies in (1, DEPUTIES):
            spec = replace(sample_spec(deputies=deputies), simulator=plugin)
            if not any(component.bodies for component in plugin.compose()[1]):
                spec = replace(spec, agents=tuple(map(_without_task, spec.agents)))
            if len(report.breaches) == known:
                check_alone(
                    spec,
                    lambda flown: flown.step.after.state.arrays,
                    "`{}` differs between alone and in a batch",
                    "compute each row from itself",
                    report,
                )


def _without_task(agent: AgentSpec) -> AgentSpec:
    """Return an agent that observes its motion and flies, for simulators without points to inspect."""
    parts = {
        name: part
        for name, part in agent.parts.items()
        if isinstance(part, PositionSensor | VelocitySensor) or not isinstance(part, Sensor)
    }
    glues = tuple(
        glue for glue in agent.glues if isinstance(glue, ActionGlue) or getattr(glue, "sensor", None) in parts
    )
    dones = tuple(named for named in agent.dones if isinstance(named.functor, EpisodeLengthDone))
    return replace(agent, parts=parts, glues=glues, rewards=(), dones=dones)


#: Limits of the motion for which the bounds are declared.
_FLIGHT = MotionLimits(step_size=10.0, mass=CWHPlatform().mass, thrust=1.0, distance=2000.0, speed=10.0)
_BODIES = 256
#: A bound may be exceeded by this factor, because a push early in a step rotates with the frame, and by rounding.
_MORE, _ROUNDING = 1.05, 1e-9


def _check_component(plugin: Component, parts: SampleParts, report: Report) -> None:
    """Check that a component disturbs the deputies of the sample world by no more than it declares."""
    bounds = _declared(plugin, report)
    spec = sample_spec(parts=parts)
    if bounds is None or not set(plugin.bodies) <= {*spec.platforms, *spec.reset.entities}:
        return
    with report.attempt("the component"):
        for flown in fly(_environment(plugin, spec), length=HORIZON):
            before, after = flown.step.before.state, flown.step.after.state
            _compare(
                {name: before[name][:, 0] for name in ("position", "velocity")},
                {name: after[name][:, 0] for name in ("position", "velocity", "control")}
                | {name: after[name][:, 0] for name in after.arrays if name.startswith("estimated_")},
                SampleVehicle().mean_motion, bounds, report,
            )  # fmt: skip


def _environment(plugin: Component, spec: EnvironmentSpec) -> TeamEnvironment:
    """Return the sample world with a component, as the last component, or the latest that others allow."""
    dynamics, components = spec.simulator.compose()
    others = [other for other in components if type(other) is not type(plugin)]
    for place in reversed(range(len(others) + 1)):
        simulator = ComposedSimulator(dynamics=dynamics, components=(*others[:place], plugin, *others[place:]))
        try:
            return TeamEnvironment(replace(spec, simulator=simulator), FEW_ENVIRONMENTS, seed=1)
        except ValueError:  # The component must precede another one.
            if place == 0:
                raise
    raise AssertionError("a place is found, or the last error is raised")


def _check_dynamics(plugin: Dynamics, parts: SampleParts, report: Report) -> None:
    """Check that dynamics differ from Clohessy-Wiltshire motion by no more than they declare."""
    bounds = _declared(plugin, report)
    if bounds is None or not report.expect(
        "mean_motion" in plugin.offers(),
        "disturbance_bounds",
        "bounds are declared, but `offers` gives no `mean_motion` of the motion to which they refer",
        "offer it, or declare None",
    ):
        return
    rng, dt, cube = np.random.default_rng(5), _FLIGHT.step_size, 1.0 / np.sqrt(3.0)
    size = {"position": cube * _FLIGHT.distance, "velocity": cube * _FLIGHT.speed}
    initial = plugin.initial()
    arrays = {name: np.zeros((_BODIES, 1, *spec.shape)) for name, spec in plugin.arrays.items()}
    for name, array in arrays.items():
        array[...] = rng.uniform(-size[name], size[name], array.shape) if name in size else initial.get(name, 0.0)
    before = {name: arrays[name][:, 0].copy() for name in size}
    control = np.zeros((_BODIES, 1, plugin.control_size))
    control[..., :3] = rng.uniform(-_FLIGHT.thrust, _FLIGHT.thrust, (_BODIES, 1, 3))
    shared: Mapping[str, FloatArray] = {}
    with report.attempt("`reset_shared`", "return arrays of shape (R, ...)"):
        shared = plugin.reset_shared({}, _BODIES)
    with report.attempt("the row kernel"):
        advance_kernel(plugin, dt)(
            *plugin(dt), *(shared[name].copy() for name in plugin.shared), *arrays.values(), control,
            np.array([_FLIGHT.mass]), dt, 1, np.zeros((_BODIES, 1)),
            np.zeros(_BODIES), np.zeros(_BODIES, np.int64),
        )  # fmt: skip
        after = {name: arrays[name][:, 0] for name in size} | {"control": control[:, 0]}
        _compare(before, after, plugin.offers()["mean_motion"], bounds, report)


def _declared(plugin: Component | Dynamics, report: Report) -> DisturbanceBounds | None:
    """Return the bounds that a plugin declares, or None."""
    bounds: Any = None
    with report.attempt("`disturbance_bounds`", "return DisturbanceBounds or None"):
        bounds = plugin.disturbance_bounds(_FLIGHT)
        report.expect(
            bounds is None or isinstance(bounds, DisturbanceBounds),
            "disturbance_bounds",
            f"`disturbance_bounds` returned {type(bounds).__name__}",
            "return DisturbanceBounds, such as NO_DISTURBANCE, or None",
        )
    return bounds if isinstance(bounds, DisturbanceBounds) else None


def _compare(
    before: Mapping[str, FloatArray], after: Mapping[str, FloatArray], mean_motion: float, bounds: DisturbanceBounds,
    report: Report,
) -> None:  # fmt: skip
    """Compare a step of R deputies with the exact step under the commanded thrust."""
    phi, gamma = transition(mean_motion, _FLIGHT.mass, _FLIGHT.step_size)
    thrust = after["control"][:, :3]
    start = np.concatenate((before["position"], before["velocity"]), axis=1)
    exact = start @ phi.T + thrust @ gamma.T
    asked = np.linalg.norm(start[:, :3], axis=1) <= _FLIGHT.distance
    asked &= np.linalg.norm(start[:, 3:], axis=1) <= _FLIGHT.speed
    pushed = bounds.velocity + bounds.thrust_error * np.linalg.norm(thrust, axis=1) * (_FLIGHT.step_size / _FLIGHT.mass)
    limits = {
        "velocity": (after["velocity"] - exact[:, 3:], pushed, "m/s"),
        "position": (after["position"] - exact[:, :3], pushed * _FLIGHT.step_size, "m"),
    }
    for name, bound in (("position", bounds.position_error), ("velocity", bounds.velocity_error)):
        if f"estimated_{name}" in after:
            error = after[f"estimated_{name}"] - after[name]
            limits[f"estimated_{name}"] = error, np.full(len(start), bound), "m" if name == "position" else "m/s"
    for name, (departure, bound, unit) in limits.items():
        size = np.linalg.norm(departure, axis=1)
        rounding = _ROUNDING * (1.0 + np.linalg.norm(exact, axis=1))
        over = np.flatnonzero(asked & ~(size <= _MORE * bound + rounding))
        if len(over):
            row = int(over[np.argmax(size[over] - bound[over])])
            report.add(
                "disturbance_bounds",
                f"a step moves `{name}` by {size[row]:.4g} {unit} from what the filters assume, but the declared "
                f"bounds allow {bound[row]:.4g} {unit}",
                "declare bounds that cover a step, or None",
            )


SIMULATION_CHECKS: dict[str, Check] = {
    "component": _check_component,
    "dynamics": _check_dynamics,
    "initializer": _check_initializer,
    "parameter": _check_parameter,
    "simulator": _check_simulator,
}
