"""`optimise`: finds the plan of least delta-v for each of some episodes, and flies each plan in the simulator."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones.limits import EpisodeLengthDone
from safe_inspect.dones.motion import CrashDoneFunction, MaxDistanceDoneFunction
from safe_inspect.dones.success import SuccessfulInspectionDoneFunction
from safe_inspect.dynamics.step_maps import step_maps
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.episodes import Trajectory
from safe_inspect.evaluation.rollouts import fly_slots, sighting_steps
from safe_inspect.planning.coverage_problem import (
    CoverageProblem,
    control_authorities,
    impulse_responses,
    sight_range,
)
from safe_inspect.planning.coverage_search import MAX_BURNS, SearchEffort, search_plan
from safe_inspect.planning.record import Burn, Entry, FlightPlan
from safe_inspect.policies.inspector import NaturalMotionInspector
from safe_inspect.policies.open_loop import OpenLoopPlan
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.tasks.inspection.simulator import InspectionSimulator
from safe_inspect.tasks.inspection.sun import predicted_sun
from safe_inspect.types import FloatArray, IntArray


@dataclass(frozen=True)
class _CoverageTask:
    """Requirements that a plan must meet.

    Attributes:
        entity: The body whose points are inspected.
        horizon: Number of steps of an episode.
        near: Least range [m].
        far: Largest range, infinite for none [m].
        field_of_view: Full angle of the camera's cone [rad].
    """

    entity: str
    horizon: int
    near: float
    far: float
    field_of_view: float


def coverage_task(spec: EnvironmentSpec) -> _CoverageTask:
    """Return the requirements of a task for a plan.

    Raises:
        SafeInspectError: The optimiser does not support the task.
    """

    def stop(why: str, instead: str) -> SafeInspectError:
        return SafeInspectError(f"the open-loop optimiser only supports {why}; {instead}")

    if len(spec.agents) != 1:
        raise stop(f"one deputy, and this task has {len(spec.agents)}", "give the task of one deputy")
    agent = spec.agents[0]
    filters = [glue.registered_name for glue in agent.action_glues if isinstance(glue, SafetyGlue) and glue.enabled]
    if filters or (spec.team_safety is not None and spec.team_safety.enabled):
        raise stop(
            f"flights without a safety filter, and {filters[0] if filters else 'the team filter'} is enabled here",
            "disable it: the initial states stay the same, so the result is also valid for the task with the filter",
        )
    simulator = spec.simulator
    if not isinstance(simulator, InspectionSimulator):
        raise stop("the InspectionSimulator", f"this task has the simulator {simulator.registered_name}")
    if simulator.turns:
        raise stop("deputies whose thrust is in Hill's frame", "these turn; use the baseline SixDofInspector")
    if any(simulator.chief_angular_velocity):
        raise stop("a chief at rest", "this one rotates; leave out `chief_angular_velocity`")
    wins = [item.functor for item in agent.dones if isinstance(item.functor, SuccessfulInspectionDoneFunction)]
    if len(wins) != 1 or list(simulator.inspection_points_map) != [wins[0].inspection_entity_name]:
        raise stop(
            "tasks that are won by inspecting the points of the only body with points", "this one is won otherwise"
        )
    if wins[0].weight_threshold is not None:
        raise stop("tasks that are won when all points are inspected", "leave out `weight_threshold`")
    dones = [item.functor for item in agent.dones]
    return _CoverageTask(
        entity=wins[0].inspection_entity_name,
        horizon=min(done.horizon for done in dones if isinstance(done, EpisodeLengthDone)),
        near=max((done.crash_region_radius for done in dones if isinstance(done, CrashDoneFunction)), default=0.0),
        far=min((done.max_distance for done in dones if isinstance(done, MaxDistanceDoneFunction)), default=math.inf),
        field_of_view=simulator.field_of_view,
    )


def _thrust_reach(environment: TeamEnvironment) -> FloatArray:
    """Return the velocity change that one step can give along each axis in both directions [m/s], shape (3,)."""
    limits, world = environment.groups[0].limits, environment.simulation.world
    strength = np.maximum(np.minimum(limits.high, -limits.low), 0.0)
    return np.asarray(strength * (world.step_size / world.masses[0]))


def coverage_problem(
    environment: TeamEnvironment, row: int, task: _CoverageTask, hold: int
) -> tuple[CoverageProblem, IntArray]:
    """Return the planning problem of one episode, and the indices of the points that are to be inspected.

    With a narrow field of view, a plan is limited to ranges at which the whole chief is in view.

    Args:
        environment: A batch after a reset.
        row: The episode's row.
        task: The requirements of the task.
        hold: Number of steps of a burn.

    Raises:
        SafeInspectError: The chief is not at rest at the origin of Hill's frame.
    """
    simulation, state = environment.simulation, environment.state
    world, steps = simulation.world, task.horizon
    model = world.points[task.entity]
    if state.position[row, model.body].any() or state.velocity[row, model.body].any():
        raise SafeInspectError(
            f"the open-loop optimiser only supports a body at rest at the origin; {model.entity!r} is not"
        )
    if "orbit" in world.offers.world:
        raise SafeInspectError(
            "the open-loop optimiser only supports Clohessy-Wiltshire dynamics; remove the RelativeOrbit"
        )
    maps = step_maps(world.mean_motion, world.step_size, steps)
    turns = np.full(steps + 1, world.sun_rate * world.step_size)
    turns[0] = state.sun_angle[row]
    angle = np.add.accumulate(turns)  # summed exactly as the simulator does
    lit = model.lit(predicted_sun(state, row, angle, world)[1])
    needed = np.flatnonzero(state.points[task.entity].inspector[row] < 0)
    normals = model.points[needed] / model.radius
    begin = np.concatenate((state.position[row, 0], state.velocity[row, 0]))
    coast = (maps.phi[:, :3, :] * begin).sum(axis=-1)
    response = impulse_responses(maps, steps, hold)
    response[:, :, _thrust_reach(environment) <= 0.0] = 0.0
    problem = CoverageProblem(
        impulse_response=response,
        hold=hold,
        coast=coast,
        control_authority=control_authorities(response),
        normals=normals,
        slopes=np.stack((np.sqrt(normals[:, 0] ** 2 + normals[:, 1] ** 2), np.abs(normals[:, 2])), axis=1),
        lit=np.ascontiguousarray(lit[:, needed]),
        radius=model.radius,
        near=max(task.near, sight_range(model.radius, task.field_of_view)),
        far=task.far,
    )
    return problem, needed


#: Extent of the search, by the name of the effort.
EFFORTS = MappingProxyType(
    {
        "quick": SearchEffort(starts=30, chains=3, programs=200, temperature=0.004),
        "normal": SearchEffort(starts=100, chains=4, programs=300, temperature=0.004),
        "thorough": SearchEffort(starts=1000, chains=12, programs=1500, temperature=0.01),
    }
)
#: Largest number of steps of a burn.
_LONGEST = 256
_WORD, _MIX = 0xFFFFFFFFFFFFFFFF, 0x9E6C63D0876A9A99  # makes these samples independent of others with the episode's key


def optimise(spec: EnvironmentSpec, episodes: int, seed: int, first_slot: int, effort: SearchEffort) -> list[Entry]:
    """Find a plan for the first episode of each of some slots, and fly it.

    The plan of an episode is a pure function of the task, the seed, the slot and the effort. The trajectory of the
    scripted inspector is one of the starting points; it is also the result if the search finds no plan of less delta-v
    that the simulator confirms.

    Args:
        spec: The task.
        episodes: Number of slots.
        seed: Seed of the run.
        first_slot: The first slot.
        effort: Extent of the search.

    Raises:
        SafeInspectError: The optimiser does not support the task.
    """
    task = coverage_task(spec)
    inspector = NaturalMotionInspector(
        inspection_entity_name=task.entity,
        horizon=task.horizon,
        near=max(16.0, 1.2 * task.near),
        far=min(0.975 * task.far, 1e6),
        field_of_view=task.field_of_view,
    )
    guide, ways = fly_slots(spec, inspector, episodes, seed, first_slot)
    environment = TeamEnvironment(spec, episodes, seed=seed, first_slot=first_slot)
    environment.reset()
    found = [
        _search(environment, row, task, way if known.success else None, effort)
        for row, (known, way) in enumerate(zip(guide, ways, strict=True))
    ]

    def confirmed(plans: list[FlightPlan]) -> list[Entry]:
        """Fly the plans in the simulator."""
        policy = OpenLoopPlan.of((known.key, plan) for known, plan in zip(guide, plans, strict=True))
        return fly_slots(spec, policy, episodes, seed, first_slot)[0]

    plans = [plan for plan, _ in found]
    flown = confirmed(plans)
    instead = [
        known.success and not (own.success and own.delta_v <= known.delta_v)
        for known, own in zip(guide, flown, strict=True)
    ]
    if any(instead):
        plans = [_flown_plan(ways[row].control[:, 0]) if instead[row] else plan for row, plan in enumerate(plans)]
        flown = confirmed(plans)
    return [
        replace(
            entry,
            plan=plans[row],
            planned=found[row][1] if np.isfinite(found[row][1]) else None,
            inspector=guide[row].delta_v if guide[row].success else None,
            own=not instead[row],
        )
        for row, entry in enumerate(flown)
    ]


def _search(
    environment: TeamEnvironment, row: int, task: _CoverageTask, guide: Trajectory | None, effort: SearchEffort
) -> tuple[FlightPlan, float]:
    """Return the plan of one episode and its cost [m/s], which is infinite when no plan is found.

    Args:
        environment: The episodes after their reset.
        row: Row of the episode.
        task: Requirements that the plan must meet.
        guide: A trajectory that meets them, from which the search starts too, if there is one.
        effort: Extent of the search.
    """
    world, reach = environment.simulation.world, _thrust_reach(environment)
    key, hold = int(environment.state.key[row]), 1
    start, burns = np.zeros(MAX_BURNS, np.int64), np.zeros((MAX_BURNS, 3))
    while True:
        problem, needed = coverage_problem(environment, row, task, hold)
        given = np.zeros((0, len(needed)), np.int64) if guide is None else sighting_steps(guide)[None, needed]
        random = np.array([(key ^ _MIX) & _WORD], np.uint64)
        delta_v, count = search_plan(problem, np.ascontiguousarray(given), random, effort, start, burns)
        if not np.isfinite(delta_v):
            return (), delta_v
        if _within(start[:count], burns[:count], hold, reach) or hold >= _LONGEST:
            break
        hold *= 2  # longer burns need less thrust
    force = world.masses[0] / (hold * world.step_size)
    rows = zip(start[:count].tolist(), (burns[:count] * force).tolist(), strict=True)
    return tuple(Burn(step=step, steps=hold, thrust=tuple(thrust)) for step, thrust in rows), delta_v


def _within(start: IntArray, burns: FloatArray, hold: int, reach: FloatArray) -> bool:
    """Return whether the burns, which may overlap, are within the velocity change that a step can give."""
    steps = np.zeros((int(start.max(initial=0)) + hold, 3))
    for step, burn in zip(start, burns, strict=True):
        steps[step : step + hold] += burn / hold
    return bool((np.abs(steps) <= reach * (1.0 + 1e-12)).all())


def _flown_plan(thrust: FloatArray) -> FlightPlan:
    """Return a plan with the thrust of every step, shape (T, 3)."""
    return tuple(
        Burn(step=int(step), thrust=tuple(thrust[step].tolist())) for step in np.flatnonzero(thrust.any(axis=1))
    )
