"""The numbers that filters, constraints and audits begin with, against a record.

A change that is meant to change them has to update the record:

    RECORD_RESULTS=1 python -m pytest -n 0 tests/rta/test_recorded_models.py
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.random.streams import Streams
from safe_inspect.rta.adversaries import PUSHES, DisturbanceAdversary, adversarial_thrust, normalised_rows
from safe_inspect.rta.audit import Audit, fly_filtered, grazing_states, settings
from safe_inspect.rta.backup.model import leading_holds
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import NAMES, RelativeState, constraint_set
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.continuous import ContinuousFilter
from safe_inspect.rta.docking import SpeedLimitFilter
from safe_inspect.rta.team.safety_filter import TeamFilter

from ..golden.records import check_record

RECORD = Path(__file__).with_name("models.json")
BOUNDS = DisturbanceBounds(
    velocity=1e-4, position_error=0.01, velocity_error=1e-4, thrust_gain=0.01, thrust_direction=0.01
)
TASKS: dict[str, dict[str, Any]] = {
    "shipped": {},
    "other": {
        "n": 1.5e-3, "m": 40.0, "u_max": 0.7, "step_size": 20.0, "r_max": 500.0, "collision_radius": 7.0, "fov": 1.3,
        "v0": 0.3, "vel_limit": 0.8, "psm_horizon": 300.0,
    },
    "slow": {"m": 150.0, "u_max": 0.2, "step_size": 5.0},
}  # fmt: skip


def drawn(seed: int, rows: int, farthest: float = 900.0, fastest: float = 1.5) -> RelativeState:
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(2, rows, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return RelativeState(
        directions[0] * generator.uniform(1.0, farthest, (rows, 1)),
        directions[1] * generator.uniform(0.0, fastest, (rows, 1)), generator.uniform(0.0, 2.0 * np.pi, rows),
    )  # fmt: skip


def folded(array: Any) -> np.ndarray:
    """Return the shape of an array and a few numbers on which every element of it has its own weight."""
    values = np.asarray(array, np.float64)
    weights = np.cos(np.arange(values.size)[:, None] * np.array([0.37, 1.1]))
    return np.concatenate((values.shape, values.ravel() @ weights)) if values.size > 40 else values


@pytest.mark.parametrize("task", TASKS)
def test_the_numbers_and_tables_of_a_task(task: str) -> None:
    model = BackupFilter(TASKS[task])._model
    found = {name: folded(value) for name, value in model._asdict().items() if name not in ("constraints", "kernels")}
    numbers = [np.ravel(value) for row in model.constraints for value in row]
    found["constraints"] = np.concatenate(numbers)
    check_record(RECORD, f"model, {task}", found | {"leads": leading_holds(ConstraintParameters(**TASKS[task]))})
    some = BackupFilter(TASKS[task], ["rel_vel", "x_vel", "sun"])._model
    numbers = [np.ravel(value) for row in some.constraints for value in row]
    check_record(RECORD, f"model of some, {task}", {"active": some.active, "constraints": np.concatenate(numbers)})


@pytest.mark.parametrize("task", ["shipped", "slow"])
def test_the_tube_of_a_task(task: str) -> None:
    run = BackupFilter(TASKS[task], NAMES, disturbance=BOUNDS)
    team = TeamFilter(TASKS[task], disturbance=BOUNDS)
    found = {"gain": run.tracker.gain, "tube": run.tube, "starting": run.starting}
    found |= {"pairs": team._tables.pair.tube, "starting pairs": team._starts.pair.tube}
    holds = run.tracker.follow((1, 2))
    found["deviations"] = np.concatenate([np.concatenate(hold) for hold in (*holds[:4], holds[50], holds[-1])])
    check_record(RECORD, f"tube, {task}", found)


@pytest.mark.parametrize("name", [*NAMES, "deputy_collision", "deputy_PSM"])
def test_what_a_constraint_says_of_states(name: str) -> None:
    """Its plain quantity, its h with gradient and rate, and what the continuous filter asks by it."""
    for task, fields in TASKS.items():
        constraint = constraint_set(ConstraintParameters(**fields), [name], 6.0)[name]
        values = constraint.evaluate(drawn(1, 24))
        found = {"phi": values.phi, "h": values.h, "gradient": folded(values.gradient), "rate": folded(values.rate)}
        found["bias"] = np.append(constraint.alpha(np.array([-0.5, 0.0, 0.01, 3.0])), constraint.bias)
        check_record(RECORD, f"constraint {name}, {task}", found)


@pytest.mark.parametrize("task", ["shipped", "other"])
def test_the_half_spaces_of_the_continuous_filter(task: str) -> None:
    run, state = ContinuousFilter(TASKS[task]), drawn(2, 16)
    rows, bounds = run.conditions(state, [each.evaluate(state) for each in run.constraints.values()])
    check_record(RECORD, f"filters, {task}", {"rows": folded(rows), "bounds": bounds[:6]})


@pytest.mark.parametrize("bounds", [None, DisturbanceBounds(velocity=1e-5, position_error=1e-3, thrust_gain=1e-3)])
def test_the_filter_of_the_speed_limit_of_docking(bounds: DisturbanceBounds | None) -> None:
    fields = {"step_size": 1.0, "n": 0.001027, "m": 12.0, "u_max": 1.0, "v0": 0.2, "v0_distance": 0.5, "v1_coef": 2.0}
    run = SpeedLimitFilter(ConstraintParameters(**fields, vel_limit=1.0, r_max=400.0), bounds)
    state, wanted = drawn(3, 24, 100.0, 0.3), np.random.default_rng(4).uniform(-2.0, 2.0, (24, 3))
    position, velocity = np.array(state.position), np.array(state.velocity)
    limit = run.phi(position, 0.0 * velocity)
    share = np.linspace(0.97, 1.0, 24)
    velocity *= (share * limit / np.linalg.norm(velocity, axis=1))[:, None]
    found = run(position, velocity, wanted)
    assert found.backup.any()
    assert not found.backup.all()
    numbers = {"limit": limit, "control": found.control, "backup": found.backup, "infeasible": found.infeasible}
    check_record(RECORD, f"speed limit, {bounds is None}", numbers | {"safe": run.is_safe(position, velocity)})


def test_random_settings_and_the_states_that_graze_their_limits() -> None:
    values, chosen, states = [], [], []
    for fields, names in islice(settings(5), 6):
        values += list(fields.values())
        chosen.append(sum(1 << NAMES.index(name) for name in names))
    for names in (NAMES, ("rel_vel",), ("PSM", "y_vel")):
        found = grazing_states(BackupFilter({}, names), np.random.default_rng(6), 3)
        states += [len(found), *found.position.sum(axis=0), *found.velocity.sum(axis=0), found.sun_angle.sum()]
    check_record(RECORD, "settings", {"values": values, "chosen": chosen, "grazing": states})


@pytest.mark.parametrize("disturbed", [False, True])
def test_what_an_audit_counts(disturbed: bool) -> None:
    """On states that are not safe, so that every count and every least quantity says something."""
    run = BackupFilter(None, NAMES, disturbance=BOUNDS) if disturbed else BackupFilter()
    found = Audit()
    fly_filtered(run, drawn(7, 20, 700.0, 0.6), 6, np.random.default_rng(8), found)
    assert found.violations > 0
    counts = [found.starts, found.steps, found.infeasible, found.violations, found.interventions]
    check_record(RECORD, f"audit, {disturbed}", {"counts": counts, "least": list(found.least.values())})
    assert str(Audit(settings=3, steps=1234567)).splitlines() == [
        "settings               3", "refused                0", "starts                 0", "steps          1,234,567",
        "infeasible             0", "violations             0", "interventions           0",
        *(f"least {name:<16}         inf" for name in NAMES),
    ]  # fmt: skip
    before = vars(found).copy()
    fly_filtered(run, drawn(7, 0), 6, np.random.default_rng(8), found)
    assert vars(found) == before


def test_where_disturbances_push() -> None:
    rows, state = 60, drawn(9, 60)
    adversary = DisturbanceAdversary(BOUNDS, rows, np.random.default_rng(10))
    phi = {name: np.random.default_rng(k).uniform(0.0, 10.0, rows) for k, name in enumerate(NAMES) if name != "PSM"}
    numbers = []
    for _ in range(5):
        seen = adversary.estimate(state, phi)
        flown = adversary.flown(np.random.default_rng(11).normal(size=(rows, 3)))
        after = adversary.disturbed(state)
        numbers += [*seen.position.sum(0), *seen.velocity.sum(0), *flown.sum(0), *after.velocity.sum(0)]
        numbers += adversary.direction.sum(axis=1).tolist()
    assert set(adversary.push) == set(range(len(PUSHES)))
    check_record(RECORD, "pushes", {"numbers": numbers})
    np.testing.assert_array_equal(normalised_rows(np.array([[0.0, 0, 0], [0, 3, 4]])), [[0, 0, 0], [0, 0.6, 0.8]])


@pytest.mark.parametrize("lit", [True, False])
def test_the_thrusts_of_adversaries(lit: bool) -> None:
    rows = 12
    position, velocity, sun = np.random.default_rng(12).normal(size=(3, rows, 3))
    offers = SimpleNamespace(view={"sun_direction": None} if lit else {})
    view: Any = SimpleNamespace(
        position=position, velocity=velocity, sun_direction=sun, world=SimpleNamespace(offers=offers),
        range_to=lambda body: np.linalg.norm(position, axis=1),
    )  # fmt: skip
    slots = np.arange(3, 3 + rows)
    for step in (0, 6, 7, 13, 14):
        found = adversarial_thrust(view, step, slots, 4)
        distance = np.linalg.norm(position, axis=1, keepdims=True)
        out = position / distance
        axis = -sun * distance - position if lit else velocity
        axis = axis / (np.linalg.norm(axis, axis=1, keepdims=True) + 1e-9)
        corners = np.where(Streams(4, slots, 0 * slots).uniform("corners", 3, index=step) < 0.5, -1.0, 1.0)
        ways = [-1.8 * out, 1.8 * axis, 1.8 * out, corners, np.sign(velocity) * (-1.0 if step // 7 % 2 == 0 else 1.0)]
        for row in range(rows):
            kind = slots[row] % 6
            expected = np.clip(ways[kind][row], -1.0, 1.0) if kind < 5 else np.zeros(3)
            np.testing.assert_allclose(found[row], expected, atol=1e-12)
