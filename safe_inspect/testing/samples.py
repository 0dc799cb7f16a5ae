"""Sample world: steps of the shipped task with random and extreme actions, as inputs for plugins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from safe_inspect.compiling import Kernel, njit
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones.base import DoneFunction
from safe_inspect.dynamics.attitude.clohessy_wiltshire_attitude import ClohessyWiltshireAttitude
from safe_inspect.dynamics.attitude.rigid_body import rotation_row
from safe_inspect.dynamics.base import TURNING_ARRAYS, Dynamics
from safe_inspect.dynamics.clohessy_wiltshire import clohessy_wiltshire_row
from safe_inspect.dynamics.cwh import transition
from safe_inspect.environments.registration import load_spec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.glues.actions import ControllerGlue
from safe_inspect.platforms.base import Part, Sensor
from safe_inspect.platforms.controllers import RateController
from safe_inspect.platforms.state_sensors import SunlightSensor
from safe_inspect.plugins.functor import Named, build
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.policies.base import ScriptedPolicy
from safe_inspect.rta.base import TeamSafety
from safe_inspect.simulators.simulator import ComposedSimulator
from safe_inspect.simulators.state import State
from safe_inspect.simulators.team import TeamStep, TeamView
from safe_inspect.simulators.view import Step, View
from safe_inspect.task_ids import TASKS
from safe_inspect.tasks.docking.simulator import SpeedLimitMonitor
from safe_inspect.tasks.docking.target import TumblingTarget
from safe_inspect.tasks.inspection.sun import Sun
from safe_inspect.testing.flights import HORIZON, LENGTH, Flown, fly, take_rows
from safe_inspect.types import AnyArray, ArraySpec, BoolArray, FloatArray
from safe_inspect.units import PositiveAngularRate

__all__ = ["DEPUTIES", "ENVIRONMENTS", "sample_spec", "sample_steps", "sample_team_steps", "take_rows"]

#: Rows of most samples with which plugins are called.
ROWS = 48
#: Environments of a flight, and of a slower one: with several deputies, or flown by the plugin itself.
ENVIRONMENTS, FEW_ENVIRONMENTS = 32, 8
#: Parts that the shipped task does not have, under their default names.
_FURTHER_PARTS = (
    "RateController",
    "Sensor_EntityPosition",
    "Sensor_EntityVelocity",
    "Sensor_NearestDeputiesPosition",
    "Sensor_NearestDeputiesVelocity",
    "Sensor_AngularVelocity",
    "Sensor_OrientationUnitVector",
    "Sensor_Quaternion",
    "Sensor_RelativePosition",
    "Sensor_RelativeVelocity",
)
#: Deputies of the sample world with several deputies.
DEPUTIES = 3


@njit(error_model="numpy")
def _sample_vehicle_row(
    step_size: float,
    phi: FloatArray,
    gamma: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    orientation: FloatArray,
    angular_velocity: FloatArray,
    control: FloatArray,
    mass: float,
) -> float:
    """Advance one body; see `Dynamics`."""
    rate = clohessy_wiltshire_row(phi, gamma, position, velocity, control, mass)
    q, w = orientation, angular_velocity
    for k in range(3):
        w[k] = 0.1 * velocity[k]
    turned = rotation_row((1.0, 1.0, 1.0), (q[0], q[1], q[2], q[3], w[0], w[1], w[2]), (0.0, 0.0, 0.0), step_size)
    for k in range(4):
        q[k] = turned[k]
    return rate


class SampleVehicle(Dynamics):
    """Deputy in Clohessy-Wiltshire dynamics whose angular velocity follows its velocity, so that no two turn alike.

    Attributes:
        mean_motion: Mean motion of the chief's orbit [rad/s].
    """

    row: ClassVar[Kernel[..., float]] = _sample_vehicle_row
    arrays: ClassVar[Mapping[str, ArraySpec]] = TURNING_ARRAYS

    mean_motion: PositiveAngularRate = 0.001027

    def __call__(self, step_size: float) -> tuple[Any, ...]:
        """Return the length of the step [s] and the maps of a body of 1 kg."""
        return step_size, *transition(self.mean_motion, 1.0, step_size)

    def initial(self) -> Mapping[str, Sequence[float]]:
        """Return an attitude along Hill's axes."""
        return {"orientation": (0.0, 0.0, 0.0, 1.0)}

    def offers(self) -> Mapping[str, Any]:
        """Return the mean motion [rad/s]."""
        return {"mean_motion": self.mean_motion}


def sample_spec(plugin: Plugin | None = None, *, parts: Sequence[Part] = (), deputies: int = 1) -> EnvironmentSpec:
    """Return the environment of the sample world: the shipped task with one or more deputies and further parts.

    It contains every shipped part under its default name, and every shipped component, so that plugins built from their
    defaults find them. There is an eclipse only for `SunlightSensor`, which needs one.

    Args:
        plugin: The plugin under test: a part is added to the deputies, a scripted policy commands them, a team's safety
            filter filters their thrusts.
        parts: Further parts, for a plugin that refers to them.
        deputies: Number of deputies, `blue0`, `blue1` and so on, all of them alike.
    """
    spec = load_spec(next(iter(TASKS)))
    agent = spec.agents[0]
    own = (plugin,) if isinstance(plugin, Part) else ()
    further = (build("part", name) for name in _FURTHER_PARTS)
    named = {**agent.parts, **{part.part_name: part for part in (*further, *parts, *own)}}
    names = tuple(f"blue{index}" for index in range(deputies))
    scripted = plugin if isinstance(plugin, ScriptedPolicy) else None
    dones = (*agent.dones, Named("under test", plugin)) if isinstance(plugin, DoneFunction) else agent.dones
    platform, begin = spec.platforms[agent.platform], spec.reset.deputies[agent.platform]
    dynamics: Dynamics = SampleVehicle()
    glues = agent.glues
    if scripted is not None and scripted.commands_attitude:
        dynamics = ClohessyWiltshireAttitude()
        wheels = [
            RateController(name=f"{name} Moment", axis=axis, property_class="MomentProp")
            for axis, name in enumerate("XYZ", 3)
        ]
        named |= {part.part_name: part for part in wheels}
        glues = (*glues, *(ControllerGlue(controller=part.part_name) for part in wheels))
    agent = replace(agent, parts=named, glues=glues, dones=dones, scripted_policy=scripted)
    components = spec.simulator.compose()[1]
    if isinstance(plugin, SunlightSensor):
        components = [
            component.model_copy(update={"eclipse": True}) if isinstance(component, Sun) else component
            for component in components
        ]
    return replace(
        spec,
        simulator=ComposedSimulator(dynamics=dynamics, components=(*components, TumblingTarget(), SpeedLimitMonitor())),
        platforms=dict.fromkeys(names, platform),
        agents=tuple(replace(agent, name=f"{name}_ctrl", platform=name, policy=f"{name}_ctrl") for name in names),
        reset=replace(spec.reset, deputies=dict.fromkeys(names, begin)),
        team_safety=plugin if isinstance(plugin, TeamSafety) else None,
    )


def sample_steps(
    plugin: Plugin | None = None, rows: int = 64, seed: int = 0, *, parts: Sequence[Part] = (), deputies: int = 1
) -> Step:
    """Return steps of many episodes as one `Step`: each row is one step of one environment.

    Deputies fly at random, towards the chief and away from it. The rows include first steps, ends of every kind (crash,
    out of range, all points inspected), lit and dark points, and interventions of a safety filter. With several
    deputies, they also include deputies that are near each other or collide, and agents that have ended before others.

    Args:
        plugin: The plugin under test; a sensor is read, and updates its memory, in these steps.
        rows: Number of environments, N; with G deputies the step has R = N * G rows, environment by environment.
        seed: Seed of the flight and of the choice of rows.
        parts: Further parts of the deputies, for a plugin that refers to them.
        deputies: Number of deputies, all of one group.
    """
    return _sample(plugin, rows, seed, parts, deputies)[0]


def sample_team_steps(
    plugin: Plugin | None = None, rows: int = 64, seed: int = 0, *, parts: Sequence[Part] = (), deputies: int = DEPUTIES
) -> TeamStep:
    """Return the steps of `sample_steps`, in the same order, from the view of all deputies of the N environments.

    Args:
        plugin: The plugin under test.
        rows: Number of environments, N.
        seed: Seed of the flight and of the choice of rows.
        parts: Further parts of the deputies.
        deputies: Number of deputies, D.
    """
    step, status = _sample(plugin, rows, seed, parts, deputies)
    active = step.before.state.finished == 0
    dones = sample_spec(plugin, parts=parts, deputies=deputies).agents[0].dones
    before, after = (TeamView(view.writable, view.world) for view in (step.before, step.after))
    return TeamStep(
        before,
        after,
        fired={named.name: np.asarray(named.functor(step)).reshape(active.shape) & active for named in dones},
        status=status,
        dt=step.dt,
        has={named.name: np.ones(deputies, dtype=np.bool_) for named in dones},
    )


def sample_states() -> dict[str, FloatArray]:
    """Return the named states of one deputy in the sample world, as safety filters receive them, each with R rows."""
    view = sample_steps(rows=ROWS).after
    return {"position": view.position.copy(), "velocity": view.velocity.copy(), "sun_angle": view.sun_angle.copy()}


def team_sizes(plugin: Plugin | None) -> tuple[int, ...]:
    """Return the numbers of deputies of the sample worlds that contain the deputies to which a plugin refers."""
    references = {} if plugin is None else plugin.references()
    named = {getattr(plugin, field) for field, kind in references.items() if kind in ("entity", "platform")}
    further = {f"blue{index}" for index in range(1, DEPUTIES)}
    return (DEPUTIES,) if named & further else (1, DEPUTIES)


def _sample(
    plugin: Plugin | None, rows: int, seed: int, parts: Sequence[Part], deputies: int
) -> tuple[Step, AnyArray]:  # fmt: skip
    if rows < 1:
        raise ValueError(f"rows must be at least 1, got {rows}")
    remembers = isinstance(plugin, DoneFunction) and type(plugin).remember is not DoneFunction.remember
    if isinstance(plugin, (Sensor, ScriptedPolicy, TeamSafety)) or remembers or parts:
        spec = sample_spec(plugin, parts=parts, deputies=deputies)
        slow = deputies > 1 or isinstance(plugin, (ScriptedPolicy, TeamSafety))
        environments, length = (FEW_ENVIRONMENTS, HORIZON) if slow else (ENVIRONMENTS, LENGTH)
        flown = fly(TeamEnvironment(spec, environments, seed=seed), length=length)
    else:
        flown = _shipped_flight(seed, deputies)
    generator = np.random.default_rng(seed)
    ended = np.concatenate([one.over for one in flown])
    first = np.concatenate([one.step.before.state.step == 0 for one in flown])
    near = np.concatenate([_near(one.step.after) for one in flown]) & ~ended & ~first
    kinds = [ended, first & ~ended, *([near] if deputies > 1 else []), np.ones_like(ended)]
    share = -(-rows // (len(kinds) + 1))
    chosen = np.concatenate([generator.permutation(np.flatnonzero(kind))[:share] for kind in kinds])
    others = np.setdiff1d(generator.permutation(len(ended)), chosen)
    chosen = np.resize(np.concatenate((chosen, generator.permutation(others))), rows)
    return _gather(flown, generator.permutation(chosen), seed)


def _gather(flown: Sequence[Flown], chosen: AnyArray, seed: int) -> tuple[Step, AnyArray]:
    """Return the chosen environments, numbered consecutively over all steps, as one step and its statuses."""
    model = flown[0].step
    agents = model.after.group.size
    own = (chosen[:, None] * agents + np.arange(agents)).reshape(-1)
    action, control = (
        np.concatenate([getattr(one.step, name) for one in flown])[own] for name in ("action", "control")
    )
    generator = np.random.default_rng((seed, 1))
    intervening = generator.random(len(own)) < 0.25
    desired = control + np.where(intervening, generator.uniform(-0.5, 0.5, len(own)), 0.0)[:, None]
    before, after = (_joined([getattr(one.step, side) for one in flown], chosen) for side in ("before", "after"))
    status = np.concatenate([one.status for one in flown])[chosen]
    return Step(before, after, action, control, desired, intervening, model.dt), status


def _joined(views: Sequence[View], chosen: AnyArray) -> View:
    """Return the chosen environments, numbered consecutively over all views, as one view."""
    state = State(len(chosen), views[0].state.specs)
    for name, array in state.arrays.items():
        array[...] = np.concatenate([view.state[name] for view in views])[chosen]
    return View(state, views[0].world, views[0].group)


def _near(view: View) -> BoolArray:
    """Return the environments in which two deputies are closer than 10 m."""
    return np.asarray((TeamView(view.writable, view.world).distance < 10.0).any(axis=1))


@lru_cache(maxsize=4)
def _shipped_flight(seed: int, deputies: int) -> list[Flown]:
    return fly(TeamEnvironment(sample_spec(deputies=deputies), ENVIRONMENTS, seed=seed))
