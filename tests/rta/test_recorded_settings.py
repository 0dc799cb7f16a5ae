"""What each safety filter flies with random parameters and choices of constraints, against a record.

A change that is meant to change thrusts has to update the record:

    RECORD_RESULTS=1 python -m pytest -n 0 tests/rta/test_recorded_settings.py
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.rta.audit import grazing_states, settings
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import RelativeState
from safe_inspect.rta.continuous import ContinuousFilter
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState
from safe_inspect.types import FloatArray

from ..golden.records import check_record
from .coasting_others import filtered_first
from .limit_flights import BOUNDS, SUMS, drawn, noted, one_number, wanted

RECORD, SETTINGS = Path(__file__).with_name("settings.json"), 24


def of_settings(seed: int, build: Callable[[dict[str, float], tuple[str, ...]], Any]) -> Iterator[Any]:
    """Yield filters with random parameters and constraints, and states near the limits; None if a filter is refused."""
    for number, (values, names) in enumerate(itertools.islice(settings(seed), SETTINGS)):
        try:
            run, plain = build(values, names), BackupFilter(values, names)
        except ValueError:
            yield None
            continue
        state = grazing_states(plain, np.random.default_rng([seed, number]), 16)
        near, size = values["collision_radius"], 40
        further = drawn(number, size, (1.1 * near, 8.0 * near, 1.5 * values["v0"]))
        both = [np.concatenate((getattr(state, a), getattr(further, a))) for a in ("position", "velocity", "sun_angle")]
        yield run, RelativeState(*both), values


def sums(step: Callable[[RelativeState, FloatArray], Any], state: RelativeState, values: dict[str, float]) -> list[Any]:
    """Fly, and return sums of thrusts, of what refused, of what was flown, and of steps without a plan."""
    found = []
    rows = np.arange(1, 1 + len(state))
    for k in range(12):
        result = step(state, wanted(state, k, values["u_max"]))
        refusing = rows @ result.active
        found += [one_number(one_number(result.control)), refusing, rows @ result.backup, rows @ result.infeasible]
        p, v, control = state.position.copy(), state.velocity.copy(), np.ascontiguousarray(result.control)
        propagate(p, v, control, *transition(values["n"], values["m"], values["step_size"]), p, v)
        state = RelativeState(p, v, state.sun_angle + values["n"] * values["step_size"])
    return found


BUILT: dict[str, Callable[[dict[str, float], tuple[str, ...]], Any]] = {
    "backup": BackupFilter,
    "the plan itself": lambda values, names: BackupFilter(values, names, intervention="backup"),
    "one hold": lambda values, names: BackupFilter(values, names, several_holds=False),
    "tube": lambda values, names: BackupFilter(values, names, disturbance=BOUNDS),
    "continuous": ContinuousFilter,
    "decentralised": lambda values, names: TeamFilter(values, (*names, "deputy_collision", "deputy_PSM")),
}


@pytest.mark.parametrize("name", BUILT)
def test_random_settings(name: str) -> None:
    """What each filter flies with random parameters and choices of constraints."""
    found: dict[str, Any] = {}
    for number, flown in enumerate(of_settings(14, BUILT[name])):
        if flown is None:
            found[str(number)] = [0.0]
            continue
        run, state, values = flown
        memory: list[Any] = [None]

        def step(state: RelativeState, desired: FloatArray, run: Any = run, memory: list[Any] = memory) -> Any:
            if isinstance(run, TeamFilter):
                others = np.roll(state.position, 1, axis=0), np.roll(state.velocity, 1, axis=0)
                return filtered_first(run, state, desired, *(array[:, None] for array in others))
            if not isinstance(run, BackupFilter) or run.tracker is None:
                return run(state, desired)
            if memory[0] is None:
                memory[0] = run.memory(len(state))
            result, memory[0] = run.track(state, desired, memory[0])
            memory.append(one_number(memory[0]).sum())
            return result

        found[str(number)] = [*sums(step, state, values), *memory[1:]]
    assert sum(len(values) > 1 for values in found.values()) > SETTINGS // 3
    check_record(RECORD, f"settings, {name}", found, found)


@pytest.mark.parametrize("bounds", [None, BOUNDS], ids=["exact", "disturbed"])
def test_random_settings_of_a_team(bounds: DisturbanceBounds | None) -> None:
    found: dict[str, Any] = {}

    def build(values: dict[str, float], names: tuple[str, ...]) -> TeamFilter:
        return TeamFilter(values, [*names, "deputy_collision", "deputy_PSM"], disturbance=bounds)

    for number, flown in enumerate(of_settings(15, build)):
        found[str(number)] = [0.0]
        if flown is None:
            continue
        run, state, values = flown
        shape, plan, tracks = (len(state) // 3, 3, 3), None, None
        p, v = (array[: shape[0] * 3].reshape(shape) for array in (state.position, state.velocity))
        sun, fixed = state.sun_angle[: shape[0]], np.random.default_rng(number).random(shape[:2]) < 0.1
        results = []
        for k in range(8):
            desired = wanted(RelativeState(p.reshape(-1, 3), v.reshape(-1, 3), np.repeat(sun, 3)), k, values["u_max"])
            result = run(TeamState(p, v, sun, fixed), desired.reshape(shape), plan, tracks)
            results.append(result)
            plan, tracks = result.plan, result.tracks
            p, v = p.reshape(-1, 3).copy(), v.reshape(-1, 3).copy()
            control = np.ascontiguousarray(result.control.reshape(-1, 3))
            propagate(p, v, control, *transition(values["n"], values["m"], values["step_size"]), p, v)
            p, v, sun = p.reshape(shape), v.reshape(shape), sun + values["n"] * values["step_size"]
        kept = noted(iter(results))
        found[str(number)] = np.concatenate([np.ravel(kept[key]) for key in (*SUMS[:3], "infeasible")])
    assert sum(len(values) > 1 for values in found.values()) > SETTINGS // 3
    check_record(RECORD, f"settings of a team, {bounds is not None}", found, found)
