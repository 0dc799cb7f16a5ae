"""What the ends of a cell certify for each constraint, against samples of the exact motion within it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.rta.backup.closed_motion import _cell, _node
from safe_inspect.rta.backup.half_spaces import further_uncertain
from safe_inspect.rta.backup.holds import arc_cell
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.backup.sequences import uncertain, uncertain_closed
from safe_inspect.rta.constraints import Constraint, ConstraintValues, RelativeState, constraint_set
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.rows import Margins, node
from safe_inspect.rta.constraints.sets import CERTIFIED, NAMES, PSM

from ..golden.records import check_record

PARAMETERS = ConstraintParameters()
N, MASS = float(PARAMETERS.n), float(PARAMETERS.m)
NONE = Margins(0.0, 0.0, 0.0)
ARCS = [code for code in range(len(CERTIFIED)) if code != PSM]
CLOSED = [code for code in ARCS if CERTIFIED[code].kernels.closed_uncertain is not None]
SAMPLES, CELLS = 24, 3000
#: What the samples may be over the limit by rounding, and by how much a short cell may refuse what is met.
ROUNDING, NEAR = 1e-9, {"sun": 2e-4}


@njit
def _arc_uncertain(numbers, n, a, sun_a, b, sun_b, w, span):
    return uncertain(numbers, arc_cell(n, node(a, sun_a), node(b, sun_b), w, span), NONE)


@njit
def _closed_uncertain(numbers, n, x, sun, first, last):
    u, w = x[3] / n, x[5] / n
    rho = np.sqrt(4.0 * (x[0] * x[0] + u * u) + x[2] * x[2] + w * w)
    a = _node(n, x, sun, np.cos(first), np.sin(first))
    b = _node(n, x, sun, np.cos(last), np.sin(last))
    return uncertain_closed(numbers, _cell(n, a, b, x[1] - 2.0 * u, rho, last - first), NONE)


@njit
def _arc_margin(numbers, n, a, sun_a, b, sun_b, w, span, unit):
    """Return the largest multiple of the margins `unit` with which a cell is certified; minus infinity: none is."""
    cell, low, high = arc_cell(n, node(a, sun_a), node(b, sun_b), w, span), -1000.0, 1000.0
    for step in range(60):
        middle = low if step == 0 else 0.5 * (low + high)
        refused = uncertain(numbers, cell, Margins(middle * unit[0], middle * unit[1], middle * unit[2])) >= 0
        if step == 0 and refused:
            return -np.inf
        low, high = (low, middle) if refused else (middle, high)
    return low


@njit
def _closed_margin(numbers, n, x, sun, first, last, unit):
    """Return the same for a cell of a closed motion."""
    u, w = x[3] / n, x[5] / n
    rho = np.sqrt(4.0 * (x[0] * x[0] + u * u) + x[2] * x[2] + w * w)
    a = _node(n, x, sun, np.cos(first), np.sin(first))
    b = _node(n, x, sun, np.cos(last), np.sin(last))
    cell, low, high = _cell(n, a, b, x[1] - 2.0 * u, rho, last - first), -1000.0, 1000.0
    for step in range(60):
        middle = low if step == 0 else 0.5 * (low + high)
        refused = uncertain_closed(numbers, cell, Margins(middle * unit[0], middle * unit[1], middle * unit[2])) >= 0
        if step == 0 and refused:
            return -np.inf
        low, high = (low, middle) if refused else (middle, high)
    return low


@njit
def _further_uncertain(m, a, sun_a, b, sun_b, w, span):
    return further_uncertain(m, arc_cell(m.n, node(a, sun_a), node(b, sun_b), w, span), NONE)


class Wall(Constraint, name="TestWall"):
    """Stay on one side of a plane, the farther the faster: a . p + b . v <= 40 m, b in seconds."""

    normal: tuple[float, float, float] = (0.6, -0.64, 0.48)
    lead: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def evaluate(self, state):
        out = ConstraintValues.zeros(len(state))
        out.phi[:] = 40.0 - state.position @ np.array(self.normal) - state.velocity @ np.array(self.lead)
        return out

    @staticmethod
    def half_space(p, x, d):
        for k in range(6):
            d[k] = -p[k]
        return -40.0

    def half_space_parameters(self):
        return (*self.normal, *self.lead)


def flown(state, control, time):
    p, v = state.position.copy(), state.velocity.copy()
    propagate(p, v, np.ascontiguousarray(control), *transition(N, MASS, time), p, v)
    return RelativeState(p, v, state.sun_angle + N * time)


def drawn(name, seed):
    """Return states of which many meet the constraint narrowly."""
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(2, CELLS, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    far = {"r_max": (700.0, 800.0), "chief_collision": (10.0, 20.0)}.get(name, (10.0, 120.0))
    ranges = generator.uniform(*far, (CELLS, 1))
    fast = {"x_vel": 1.2, "y_vel": 1.2, "z_vel": 1.2}.get(name, 0.3)
    angle = generator.uniform(0.0, 2.0 * np.pi, CELLS)
    position = ranges * directions[0]
    if name == "sun":  # near the cone, which opens away from the sun
        axis = np.stack((-np.cos(angle), np.sin(angle), np.zeros(CELLS)), axis=-1)
        position = ranges * axis + ranges * generator.uniform(0.3, 1.2, (CELLS, 1)) * directions[0]
    return RelativeState(position, fast * directions[1] * generator.uniform(size=(CELLS, 1)), angle), generator


def row(state, i):
    angle = float(state.sun_angle[i])
    return (*state.position[i].tolist(), *state.velocity[i].tolist()), (float(np.cos(angle)), float(np.sin(angle)))


def check(name, certified, phi, short):
    """Hold what was certified against the least of the samples between the ends, shape (SAMPLES + 1, cells).

    Returns:
        How many cells were refused whose ends are safe.
    """
    asked, least = np.minimum(phi[0], phi[-1]) >= 0.0, phi.min(axis=0)
    assert asked.sum() > CELLS // 10
    assert (least[certified & asked] >= -ROUNDING).all()
    if short:
        assert certified[asked & (least > NEAR.get(name, 1e-3))].all()
    return int((~certified & asked).sum())


@pytest.mark.parametrize("code", ARCS, ids=[NAMES[code] for code in ARCS])
def test_a_certified_cell_of_an_arc_is_safe_within_and_a_short_one_is_certified(code):
    name = NAMES[code]
    constraints = constraint_set(PARAMETERS, [name])
    numbers = tuple(constraint.row_numbers(N, constraints) for constraint in CERTIFIED)
    phi_of = constraints[name].phi
    state, generator = drawn(name, code)
    control = generator.uniform(-1.0, 1.0, (CELLS, 3)) * generator.choice([0.0, 0.02, 1.0], (CELLS, 1))
    refused = 0
    for span in (0.5, 10.0, 60.0, 300.0):
        phi = np.array([phi_of(flown(state, control, span * k / SAMPLES)) for k in range(SAMPLES + 1)])
        last = flown(state, control, span)
        certified = np.array(
            [
                _arc_uncertain(numbers, N, *row(state, i), *row(last, i), tuple((control[i] / MASS).tolist()), span) < 0
                for i in range(CELLS)
            ]
        )
        refused += check(name, certified, phi, span < 1.0)
    assert refused > 10


@pytest.mark.parametrize("code", CLOSED, ids=[NAMES[code] for code in CLOSED])
def test_a_certified_cell_of_a_closed_motion_is_safe_within_and_a_short_one_is_certified(code):
    name = NAMES[code]
    constraints = constraint_set(PARAMETERS, [name])
    numbers = tuple(constraint.row_numbers(N, constraints) for constraint in CERTIFIED)
    phi_of = constraints[name].phi
    state, _ = drawn(name, 10 + code)
    slow = np.minimum(1.0, N * np.linalg.norm(state.position, axis=-1, keepdims=True) / 0.3)
    velocity = state.velocity * (1.0 if name == "rel_vel" else slow)
    velocity[:, 1] = -2.0 * N * state.position[:, 0]
    state, rest = RelativeState(state.position, velocity, state.sun_angle), np.zeros((CELLS, 3))
    refused = 0
    for first, angle in ((0.0, 1e-3), (0.0, 0.1), (2.0, 2.0 * np.pi / 16)):
        times = (first + angle * np.linspace(0.0, 1.0, SAMPLES + 1)) / N
        phi = np.array([phi_of(flown(state, rest, time)) for time in times])
        certified = np.array(
            [_closed_uncertain(numbers, N, *row(state, i), first, first + angle) < 0 for i in range(CELLS)]
        )
        refused += check(name, certified, phi, angle < 1e-2)
    assert refused > 10


@pytest.mark.parametrize("code", ARCS, ids=[NAMES[code] for code in ARCS])
def test_the_margin_that_a_cell_certifies(code):
    """Against a record, because the samples allow other bounds: of long cells, in which the bounds are a large part."""
    name = NAMES[code]
    constraints = constraint_set(PARAMETERS, [name])
    numbers = tuple(constraint.row_numbers(N, constraints) for constraint in CERTIFIED)
    unit = (0.0, 1.0, 0.0) if name.endswith("vel") else (1.0, 0.0, 0.0)
    state, generator = drawn(name, 20 + code)
    control = generator.uniform(-1.0, 1.0, (CELLS, 3)) * generator.choice([0.0, 0.02, 1.0], (CELLS, 1))
    found = {}
    for span in (10.0, 60.0, 300.0):
        last = flown(state, control, span)
        found[f"arc of {span} s"] = [
            _arc_margin(numbers, N, *row(state, i), *row(last, i), tuple((control[i] / MASS).tolist()), span, unit)
            for i in range(40)
        ]
    unit = (0.0, 0.0, 1.0) if name == "chief_collision" else unit
    for first, angle in ((0.0, 0.1), (2.0, 2.0 * np.pi / 16), (4.0, 1.0)) if code in CLOSED else ():
        found[f"closed motion from {first}"] = [
            _closed_margin(numbers, N, *row(state, i), first, first + angle, unit) for i in range(40)
        ]
    check_record(Path(__file__).with_name("certificates.json"), f"cells: {name}", found)


class Moving(Constraint, name="TestMoving"):
    """Move at `least` or more; the half-space of velocities is normal to the present one."""

    least: float = 0.2

    def evaluate(self, state):
        out = ConstraintValues.zeros(len(state))
        out.phi[:] = state.speed - self.least
        return out

    def half_space_parameters(self):
        return (self.least,)

    @staticmethod
    def half_space(p, x, d):
        speed = (x[3] * x[3] + x[4] * x[4] + x[5] * x[5]) ** 0.5
        for k in range(3):
            d[k], d[3 + k] = 0.0, x[3 + k] / speed
        return p[0]


def test_a_short_cell_is_certified_by_the_half_space_in_its_middle():
    """One that turns with the velocity certifies nothing near the limit, unless it is that of the cell itself."""
    run = BackupFilter(names=[Moving()])
    state, generator = drawn("moving", 3)
    way = generator.normal(size=(CELLS, 3))
    speed = 0.2 * (1.0 + generator.choice([-1e-3, 1e-3, 3e-3], (CELLS, 1)))
    state = RelativeState(state.position, speed * way / np.linalg.norm(way, axis=1, keepdims=True), state.sun_angle)
    last = flown(state, np.zeros((CELLS, 3)), 0.2)
    certified = np.array(
        [_further_uncertain(run._model, *row(state, i), *row(last, i), (0.0, 0.0, 0.0), 0.2) < 0 for i in range(CELLS)]
    )
    np.testing.assert_array_equal(certified, speed[:, 0] > 0.2)


@pytest.mark.parametrize("lead", [(0.0, 0.0, 0.0), (20.0, -30.0, 10.0)], ids=["position", "velocity"])
def test_a_certified_cell_of_a_half_space_is_safe_within_and_a_short_one_is_certified(lead):
    wall = Wall(lead=lead)
    run = BackupFilter(names=[wall])  # which keeps the kernels that its model has the addresses of
    model = run._model
    state, generator = drawn("wall", 7)
    state = RelativeState(0.5 * state.position, state.velocity, state.sun_angle)
    control = generator.uniform(-1.0, 1.0, (CELLS, 3)) * generator.choice([0.0, 0.005, 0.02], (CELLS, 1))
    refused = 0
    for span in (0.5, 10.0, 60.0, 300.0):
        phi = np.array([wall.phi(flown(state, control, span * k / SAMPLES)) for k in range(SAMPLES + 1)])
        last = flown(state, control, span)
        certified = np.array(
            [
                _further_uncertain(model, *row(state, i), *row(last, i), tuple((control[i] / MASS).tolist()), span) < 0
                for i in range(CELLS)
            ]
        )
        refused += check("wall", certified, phi, span < 1.0)
    assert refused


@njit
def _numbers_of_cell(n, a, sun_a, b, sun_b, w, span):
    cell = arc_cell(n, node(a, sun_a), node(b, sun_b), w, span)
    return cell.acceleration_a, cell.acceleration_b, cell.eighth, cell.k, cell.reach


@njit
def _with_margin(m, a, sun_a, b, sun_b, w, span, length):
    cell = arc_cell(m.n, node(a, sun_a), node(b, sun_b), w, span)
    return further_uncertain(m, cell, Margins(length, 0.0, 0.0)) < 0


@pytest.mark.parametrize("span", [60.0, 300.0, 900.0])
def test_a_half_space_is_certified_up_to_the_margin_that_its_bound_leaves(span):
    """The bound a second time: second and fourth derivatives of a . p, and three times that bound for b . v."""
    wall = Wall(lead=(20.0, -30.0, 10.0))
    run = BackupFilter(names=[wall])
    state, generator = drawn("wall", 9)
    control = generator.uniform(-1.0, 1.0, (CELLS, 3)) * 0.005
    last, dips = flown(state, control, span), 0
    normal, lead = np.array(wall.normal), np.array(wall.lead)
    for i in range(60):
        cell = *row(state, i), *row(last, i), tuple((control[i] / MASS).tolist()), span
        first, second, eighth, k, reach = _numbers_of_cell(N, *cell)
        curve = max(-normal @ first, -normal @ second)
        dip = eighth * curve + 6.0 * k * k * reach * np.linalg.norm(normal) / N + 3.0 * k * reach * np.linalg.norm(lead)
        ends = [40.0 - s.position[i] @ normal - s.velocity[i] @ lead for s in (state, last)]
        x = np.linspace(0.0, 1.0, 20001)
        least = (ends[0] + x * (ends[1] - ends[0]) - max(0.0, dip) * 4.0 * x * (1.0 - x)).min()
        dips += dip > 0.0
        assert _with_margin(run._model, *cell, least - 1e-6 * max(1.0, abs(least)))
        assert not _with_margin(run._model, *cell, least + 1e-6 * max(1.0, abs(least)))
    assert dips > 10
