"""`optimise`: finds the plan of least delta-v for each of some episodes, and flies each plan in the simulator."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.evaluation.baselines.flight import FlownSlots, fly_slots, sighting_steps
from safe_inspect.evaluation.baselines.task import CoverageTask, coverage_problem, coverage_task, thrust_reach
from safe_inspect.planning.coverage_search import SearchEffort, search_plan
from safe_inspect.planning.descent import MAX_BURNS
from safe_inspect.planning.record import Burn, Entry, FlightPlan
from safe_inspect.policies.inspector import NaturalMotionInspector
from safe_inspect.policies.open_loop import OpenLoopPlan
from safe_inspect.types import FloatArray, IntArray

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
    guide = fly_slots(spec, inspector, episodes, seed, first_slot)
    environment = TeamEnvironment(spec, episodes, seed=seed, first_slot=first_slot)
    environment.reset()
    found = [_search(environment, row, task, guide, effort) for row in range(episodes)]
    plans = [plan for plan, _ in found]
    flown = _confirm(spec, plans, guide, seed, first_slot)
    instead = [
        bool(guide.success[row]) and not (flown.success[row] and flown.delta_v[row] <= guide.delta_v[row])
        for row in range(episodes)
    ]
    if any(instead):
        plans = [
            _flown_plan(guide.trajectories[row].control[:, 0]) if instead[row] else plan
            for row, plan in enumerate(plans)
        ]
        flown = _confirm(spec, plans, guide, seed, first_slot)
    return [
        flown.entry(
            row,
            plan=plans[row],
            planned=found[row][1] if np.isfinite(found[row][1]) else None,
            inspector=float(guide.delta_v[row]) if guide.success[row] else None,
            own=not instead[row],
        )
        for row in range(episodes)
    ]


def _search(
    environment: TeamEnvironment, row: int, task: CoverageTask, guide: FlownSlots, effort: SearchEffort
) -> tuple[FlightPlan, float]:
    """Return the plan of one episode and its cost [m/s], which is infinite when no plan is found."""
    world, reach = environment.simulation.world, thrust_reach(environment)
    key, hold = int(environment.state.key[row]), 1
    start, burns = np.zeros(MAX_BURNS, np.int64), np.zeros((MAX_BURNS, 3))
    while True:
        problem, needed = coverage_problem(environment, row, task, hold)
        given = np.zeros((0, len(needed)), np.int64)
        if guide.success[row]:
            given = sighting_steps(guide.trajectories[row])[None, needed]
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


def _confirm(
    spec: EnvironmentSpec, plans: list[FlightPlan], guide: FlownSlots, seed: int, first_slot: int
) -> FlownSlots:
    """Fly the plans in the simulator."""
    policy = OpenLoopPlan.of(zip(guide.key.tolist(), plans, strict=True))
    return fly_slots(spec, policy, len(plans), seed, first_slot)
