"""Requirements of a task for a plan, and the `CoverageProblem` of each of its episodes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones.range import CrashDoneFunction, MaxDistanceDoneFunction
from safe_inspect.dones.success import SuccessfulInspectionDoneFunction
from safe_inspect.dones.time_limit import EpisodeLengthDone
from safe_inspect.dynamics.step_maps import step_maps
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import SafeInspectError
from safe_inspect.planning.coverage_problem import (
    CoverageProblem,
    control_authorities,
    impulse_responses,
    lit_from_all_sides,
    sight_range,
)
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.tasks.inspection.simulator import InspectionSimulator
from safe_inspect.tasks.inspection.sun import sun_directions
from safe_inspect.types import FloatArray, IntArray


@dataclass(frozen=True)
class CoverageTask:
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


def coverage_task(spec: EnvironmentSpec) -> CoverageTask:
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
    return CoverageTask(
        entity=wins[0].inspection_entity_name,
        horizon=min(done.horizon for done in dones if isinstance(done, EpisodeLengthDone)),
        near=max((done.crash_region_radius for done in dones if isinstance(done, CrashDoneFunction)), default=0.0),
        far=min((done.max_distance for done in dones if isinstance(done, MaxDistanceDoneFunction)), default=math.inf),
        field_of_view=simulator.field_of_view,
    )


def thrust_reach(environment: TeamEnvironment) -> FloatArray:
    """Return the velocity change that one step can give along each axis in both directions [m/s], shape (3,)."""
    limits, world = environment.groups[0].limits, environment.simulation.world
    strength = np.maximum(np.minimum(limits.high, -limits.low), 0.0)
    return np.asarray(strength * (world.step_size / world.masses[0]))


def coverage_problem(
    environment: TeamEnvironment, row: int, task: CoverageTask, hold: int
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
    maps = step_maps(world.mean_motion, world.step_size, steps)
    turns = np.full(steps + 1, world.sun_rate * world.step_size)
    turns[0] = state.sun_angle[row]
    angle = np.add.accumulate(turns)  # summed exactly as the simulator does
    lit = lit_from_all_sides(model, sun_directions(angle))
    needed = np.flatnonzero(state.points[task.entity].inspector[row] < 0)
    normals = model.points[needed] / model.radius
    begin = np.concatenate((state.position[row, 0], state.velocity[row, 0]))
    coast = (maps.phi[:, :3, :] * begin).sum(axis=-1)
    response = impulse_responses(maps, steps, hold)
    response[:, :, thrust_reach(environment) <= 0.0] = 0.0
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
