"""What each safety filter flies, refuses and remembers on flights near the limits, against a record.

Other tests say that nothing is broken and that thrusts are near the best ones; a search whose constants differ may pass
these. A change that is meant to change thrusts has to update the record:

    RECORD_RESULTS=1 python -m pytest -n 0 tests/rta/test_recorded_filters.py
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from admissible import admissible

from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import NAMES, Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.continuous import ContinuousFilter
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState
from safe_inspect.types import FloatArray

from ..golden.records import check_record
from .coasting_others import among_coasting, filtered_first
from .limit_flights import (
    BOUNDS,
    CLOSE,
    DT,
    FAR,
    LOST,
    NEAR,
    ROWS,
    SHOWN_ROWS,
    STEPS,
    SUMS,
    TEAMS,
    N,
    drawn,
    flight,
    flown,
    noted,
    one_number,
)  # fmt: skip

RECORD = Path(__file__).with_name("filters.json")


class Ball(Constraint, name="TestRecordedBall"):
    """Stay out of a ball next to the chief, and slower than a line over y allows."""

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return how far out a deputy is."""
        out = ConstraintValues.zeros(len(state))
        out.phi[:] = np.linalg.norm(state.position - np.array([45.0, 30.0, 0.0]), axis=1) - 20.0
        out.phi[:] -= 30.0 * state.velocity[:, 1]
        return out

    @staticmethod
    def half_space(p: Any, x: Any, d: Any) -> float:
        """Write the direction from the centre, and the speed's."""
        size = ((x[0] - 45.0) ** 2 + (x[1] - 30.0) ** 2 + x[2] ** 2) ** 0.5
        d[0], d[1], d[2], d[4] = (x[0] - 45.0) / size, (x[1] - 30.0) / size, x[2] / size, -30.0
        return 20.0 + d[0] * 45.0 + d[1] * 30.0


class Plane(Constraint, name="TestRecordedPlane"):
    """Stay on one side of a plane."""

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return how far from the plane a deputy is."""
        out = ConstraintValues.zeros(len(state))
        out.phi[:] = state.position @ np.array([0.0, 0.6, 0.8]) + 40.0
        return out

    @staticmethod
    def half_space(p: Any, x: Any, d: Any) -> float:
        """Write the normal."""
        d[1], d[2] = 0.6, 0.8
        return -40.0


def check(name: str, found: dict[str, Any]) -> None:
    """Compare arrays with their record."""
    check_record(RECORD, name, found, SUMS)


@pytest.mark.parametrize(("name", "where"), {"close": CLOSE, "near": NEAR, "far": FAR, "lost": LOST}.items())
def test_the_backup_filter(name: str, where: tuple[float, float, float]) -> None:
    check(f"backup, {name}", noted(flight(BackupFilter(), where, 1)))


@pytest.mark.parametrize(
    ("name", "run", "mass"),
    [
        ("the plan itself", BackupFilter(intervention="backup"), 12.0),
        ("weak thrusters", BackupFilter({"m": 60.0, "u_max": 0.6}), 60.0),
        ("two constraints", BackupFilter(names=["chief_collision", "r_max"]), 12.0),
        ("a further constraint", BackupFilter(names=[*NAMES, Ball()]), 12.0),
        ("two further constraints", BackupFilter(names=[Ball(), Plane()]), 12.0),
    ],
)
def test_other_backup_filters(name: str, run: BackupFilter, mass: float) -> None:
    check(f"backup, {name}", noted(flight(run, NEAR, 2, mass, float(run.parameters.u_max))))


@pytest.mark.parametrize("name", ["backup", "tube", "weak"])
def test_plans(name: str) -> None:
    """Thrusts of plans with the whole margins and with half of them, and small thrusts that are flown unchanged."""
    run = {
        "backup": BackupFilter(),
        "tube": BackupFilter(None, NAMES, disturbance=BOUNDS),
        "weak": BackupFilter({"m": 60.0, "u_max": 0.6}),
    }[name]
    state = drawn(3, 60, (10.5, 120.0, 0.4))
    found, thrust = run.plans(state)
    half, _ = run.plans(state, 0.5)
    small = np.random.default_rng(4).uniform(-0.1, 0.1, (60, 3))
    assert 10 < found.sum() < 60
    arrays = {"found": found, "half": half, "admissible": admissible(run, state, small)}
    check(f"plans, {name}", arrays | {"recoverable": run.recoverable(state), "thrust": one_number(thrust)})


@pytest.mark.parametrize(("name", "where"), {"near": NEAR, "far": FAR}.items())
def test_the_tube_filter(name: str, where: tuple[float, float, float]) -> None:
    run = BackupFilter(None, NAMES, disturbance=BOUNDS)
    memory = [run.memory(ROWS)]
    noise = np.random.default_rng(5).uniform(-0.005, 0.005, (STEPS, 2, ROWS, 3)) * np.array([1.0, 0.01])[:, None, None]

    def step(state: RelativeState, desired: FloatArray) -> Any:
        error = noise[len(memory) - 1]
        estimate = RelativeState(state.position + error[0], state.velocity + error[1], state.sun_angle)
        result, after = run.track(estimate, desired, memory[-1])
        memory.append(after)
        return result

    found = noted(flight(step, where, 6))
    found["sum of memory"] = [one_number(one_number(after)) for after in memory]
    check(f"tube, {name}", found | {"memory": one_number(memory[-1][:SHOWN_ROWS])})


@pytest.mark.parametrize("infeasible", ["least_violating", "pass"])
def test_the_continuous_filter(infeasible: Any) -> None:
    run = ContinuousFilter(infeasible=infeasible)
    found = noted(flight(run, CLOSE, 8)) if infeasible == "pass" else noted(flight(run, LOST, 9))
    check(f"continuous, {infeasible}", found)


def team(seed: int, teams: int, coasting: bool) -> TeamState:
    """Return three deputies near each other, of which one may coast."""
    state, generator = drawn(seed, 3 * teams, (15.0, 60.0, 0.15)), np.random.default_rng(seed)
    middle = np.repeat(drawn(seed + 1, teams, (25.0, 80.0, 0.1)).position, 3, axis=0)
    position = np.where(generator.random((3 * teams, 1)) < 0.5, state.position, middle + 0.3 * state.position)
    fixed = np.zeros((teams, 3), np.bool_)
    fixed[:, 1] = coasting
    return TeamState(position.reshape(teams, 3, 3), state.velocity.reshape(teams, 3, 3), state.sun_angle[:teams], fixed)


@pytest.mark.parametrize(
    ("name", "run", "coasting"),
    [
        ("all act", TeamFilter(), False),
        ("one coasts", TeamFilter(), True),
        ("disturbed", TeamFilter(disturbance=BOUNDS), False),
        ("disturbed, one coasts", TeamFilter(disturbance=BOUNDS), True),
        ("passive safety", TeamFilter(names=[*NAMES, "deputy_collision", "deputy_PSM"]), False),
    ],
)
def test_the_team_filter(name: str, run: TeamFilter, coasting: bool) -> None:
    state, found, plan, tracks = team(10, TEAMS, coasting), [], None, None
    kept_tracks = []
    kept, thrust, plans = run.plans(state)
    for step in range(STEPS):
        p = state.position
        ways = np.stack((np.roll(p, 1, axis=1) - p, p.mean(axis=1, keepdims=True) - p, -p, p))
        ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
        desired = 1.5 * ways[(np.arange(TEAMS) + step // 3) % 4, np.arange(TEAMS)]
        result = run(state, desired, plan, tracks)
        found.append(result)
        plan, tracks = result.plan, result.tracks
        kept_tracks.append(0.0 if tracks is None else one_number(one_number(tracks).ravel()))
        rows = RelativeState(p.reshape(-1, 3), state.velocity.reshape(-1, 3), np.zeros(3 * TEAMS))
        after = flown(rows, result.control.reshape(-1, 3), 12.0)
        state = TeamState(
            after.position.reshape(p.shape), after.velocity.reshape(p.shape), state.sun_angle + N * DT, state.fixed
        )  # fmt: skip
    small = np.random.default_rng(11).uniform(-0.05, 0.05, p.shape) * ~state.fixed[..., None]
    arrays = noted(iter(found)) | {"kept": kept, "first": one_number(thrust), "plans": plans, "plan": plan}
    arrays |= {"recoverable": run.recoverable(state), "admissible": admissible(run, state, small)}
    arrays["sum of tracks"] = kept_tracks
    check(f"team, {name}", arrays if tracks is None else arrays | {"tracks": one_number(tracks)})


def test_one_deputy_among_others_that_coast() -> None:
    run, others = TeamFilter(None, (*NAMES, "deputy_collision")), drawn(12, 2 * ROWS, (15.0, 40.0, 0.05))
    p, v = others.position.reshape(ROWS, 2, 3), others.velocity.reshape(ROWS, 2, 3)
    p = drawn(13, ROWS, NEAR).position[:, None] + 0.5 * p
    found = noted(flight(lambda state, desired: filtered_first(run, state, desired, p, v), NEAR, 13))
    kept = run.recoverable(among_coasting(drawn(13, ROWS, NEAR), p, v))
    check("decentralised", found | {"recoverable": kept})
