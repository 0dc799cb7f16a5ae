"""`optimise`: finds the plan of least delta-v for each of some episodes, and flies each plan in the simulator."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones.limits import EpisodeLengthDone
from safe_inspect.dones.motion import CrashDoneFunction, MaxDistanceDoneFunction
from safe_inspect.dones.success import SuccessfulInspectionDoneFunction
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.rollouts import fly_slots
from safe_inspect.geometry.visibility import sight_range
from safe_inspect.policies.burn_problem import BurnProblem, burn_steps
from safe_inspect.policies.burn_search import AnnealingEffort, revise_plan
from safe_inspect.policies.inspector import NaturalMotionInspector
from safe_inspect.policies.open_loop import OpenLoopPlan
from safe_inspect.policies.plan_record import Entry, flight_plan
from safe_inspect.policies.plan_refinement import refine_plan
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.simulators.view import View
from safe_inspect.tasks.inspection.simulator import InspectionSimulator
from safe_inspect.types import FloatArray


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

    def inspector(self, near: float, far: float, **others: Any) -> NaturalMotionInspector:
        """Return the scripted inspector of this task within a range from `near` to `far` [m]."""
        return NaturalMotionInspector(
            inspection_entity_name=self.entity, horizon=self.horizon, near=near, far=far,
            field_of_view=self.field_of_view, **others,
        )  # fmt: skip


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


def coverage_problem(environment: TeamEnvironment, row: int, task: _CoverageTask) -> tuple[BurnProblem, FloatArray]:
    """Return the planning problem of one episode, and the deputy's position [m] and velocity [m/s], shape (6,).

    With a narrow field of view, a plan is limited to ranges at which the whole chief is in view.

    Args:
        environment: A batch after a reset.
        row: The episode's row.
        task: The requirements of the task.

    Raises:
        SafeInspectError: The chief is not at rest at the origin of Hill's frame.
    """
    state, world, group = environment.state, environment.simulation.world, environment.groups[0]
    model = world.points[task.entity]
    if state.position[row, model.body].any() or state.velocity[row, model.body].any():
        raise SafeInspectError(
            f"the open-loop optimiser only supports a body at rest at the origin; {model.entity!r} is not"
        )
    if "orbit" in world.offers.world:
        raise SafeInspectError(
            "the open-loop optimiser only supports Clohessy-Wiltshire dynamics; remove the RelativeOrbit"
        )
    near = max(task.near, sight_range(model.radius, task.field_of_view))
    planner = task.inspector(near, min(task.far, 1e9), speed=None)
    strength = np.maximum(np.minimum(group.limits.high, -group.limits.low), 0.0)
    reach = strength * (world.step_size / world.masses[0])
    problem = planner.burn_problem(View(state, world, group.group), row, 0, reach)
    return problem._replace(haste=0.0), np.concatenate((state.position[row, 0], state.velocity[row, 0]))


#: Number of plans that are refined for an episode, by the name of the effort.
EFFORTS = MappingProxyType({"quick": 5, "normal": 10, "thorough": 50})
#: Extent of the annealing that gives one of these plans, and the plan's number of burns.
_ANNEALING, _BURNS = AnnealingEffort(restarts=3, iterations=1000, stride=8), 3
_WORD, _MIX = 0xFFFFFFFFFFFFFFFF, 0x9E6C63D0876A9A99  # makes these samples independent of others with the episode's key


def optimise(spec: EnvironmentSpec, episodes: int, seed: int, first_slot: int, plans: int) -> list[Entry]:
    """Find a plan for the first episode of each of some slots, and fly it.

    The plan of an episode is a pure function of the task, the seed, the slot and the effort. The trajectory of the
    scripted inspector is one of the starting points; it is also the result if the search finds no plan of less delta-v
    that the simulator confirms.

    Args:
        spec: The task.
        episodes: Number of slots.
        seed: Seed of the run.
        first_slot: The first slot.
        plans: Number of plans that are refined for each episode, in addition to the inspector's.

    Raises:
        SafeInspectError: The optimiser does not support the task.
    """
    task = coverage_task(spec)
    inspector = task.inspector(max(16.0, 1.2 * task.near), min(0.975 * task.far, 1e6))
    guide, trajectories = fly_slots(spec, inspector, episodes, seed, first_slot)
    environment = TeamEnvironment(spec, episodes, seed=seed, first_slot=first_slot)
    environment.reset()
    flown_thrust = [trajectory.control[:, 0] for trajectory in trajectories]
    found = [_search(environment, row, task, thrust, plans) for row, thrust in enumerate(flown_thrust)]

    def confirmed(thrusts: list[FloatArray]) -> list[Entry]:
        """Fly the plans with these thrusts of every step in the simulator."""
        plans = [flight_plan(thrust) for thrust in thrusts]
        policy = OpenLoopPlan.of((known.key, plan) for known, plan in zip(guide, plans, strict=True))
        flown = fly_slots(spec, policy, episodes, seed, first_slot)[0]
        return [replace(entry, plan=plan) for entry, plan in zip(flown, plans, strict=True)]

    thrusts = [np.zeros((0, 3)) if thrust is None else thrust for thrust, _ in found]
    flown = confirmed(thrusts)
    own = [
        not known.success or (entry.success and entry.delta_v <= known.delta_v)
        for known, entry in zip(guide, flown, strict=True)
    ]
    if not all(own):
        flown = confirmed([thrusts[row] if own[row] else thrust for row, thrust in enumerate(flown_thrust)])
    return [
        replace(
            entry, planned=found[row][1], inspector=guide[row].delta_v if guide[row].success else None, own=own[row]
        )
        for row, entry in enumerate(flown)
    ]


def _search(
    environment: TeamEnvironment, row: int, task: _CoverageTask, guide: FloatArray, plans: int
) -> tuple[FloatArray | None, float | None]:
    """Return the thrust of the best plan of one episode in each step [N], and its cost [m/s]; None if none is found.

    Args:
        environment: The episodes after their reset.
        row: Row of the episode.
        task: Requirements that the plan must meet.
        guide: Thrust of the inspector in each step [N], shape (T, 3).
        plans: Number of plans that are refined, in addition to the inspector's.

    Raises:
        SafeInspectError: The chief is not at rest at the origin of Hill's frame.
    """
    problem, state = coverage_problem(environment, row, task)
    world = environment.simulation.world
    per_newton = world.step_size / world.masses[0]  # velocity change of a step [m/s] by thrust [N]
    seed = np.array([(int(environment.state.key[row]) ^ _MIX) & _WORD], np.uint64)
    best, cost = None, np.inf
    for number in range(plans + 1):
        delta_v = np.zeros((task.horizon, 3))
        if number == 0:
            delta_v[: len(guide)] = guide * per_newton
        else:
            start, burns = np.zeros(_BURNS, np.int64), np.zeros((_BURNS, 3))
            revise_plan(problem, state, start, burns, seed, _ANNEALING)
            for first, burn in zip(start, burns, strict=True):
                steps = burn_steps(burn, problem.reach)
                delta_v[first : first + steps] = burn / max(steps, 1)
        refined = refine_plan(problem, state, delta_v)
        if refined is not None and np.abs(refined).sum() < cost:
            best, cost = refined / per_newton, float(np.abs(refined).sum())
        if cost == 0.0:
            break
    return best, None if best is None else cost
