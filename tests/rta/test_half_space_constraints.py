"""Constraints of other packages that the certifying filters keep, each by a half-space at a state."""

from __future__ import annotations

import pickle
from typing import ClassVar

import numpy as np
import pytest
from admissible import admissible

from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.errors import PluginValueError
from safe_inspect.metrics import SmallestPhi
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import NAMES, Constraint, ConstraintValues, RelativeState, constraint_set
from safe_inspect.rta.constraints.rows import Margins
from safe_inspect.rta.constraints.sets import name_of
from safe_inspect.rta.inspection import RTAGlueCWHInspection1v1
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState
from safe_inspect.testing import ContractError, check_plugin

N, MASS, DT = 0.001027, 12.0, 10.0
PERIOD = 2.0 * np.pi / N


class Plane(Constraint, name="TestPlane"):
    """Stay where n . p <= offset.

    Attributes:
        name: Its name among others.
        normal: Any vector n.
        offset: The offset, in units of n . p.
    """

    unit: ClassVar[str] = "m"

    name: str = "plane"
    normal: tuple[float, float, float] = (0.6, 0.8, 0.0)
    offset: float = 45.0

    def evaluate(self, state):
        out, n = ConstraintValues.zeros(len(state)), np.array(self.normal)
        out.phi[:] = self.offset - state.position @ n
        out.h[:] = out.phi
        out.gradient[:, :3] = -n
        return out

    @staticmethod
    def half_space(p, x, d):
        d[0], d[1], d[2] = -p[0], -p[1], -p[2]
        return -p[3]

    def half_space_parameters(self):
        return (*self.normal, self.offset)


class Obstacle(Constraint, name="TestObstacle"):
    """Stay out of a ball next to the chief.

    Attributes:
        centre: Its centre [m].
        radius: Its radius [m].
    """

    centre: tuple[float, float, float] = (45.0, 30.0, 0.0)
    radius: float = 30.0

    def evaluate(self, state):
        out = ConstraintValues.zeros(len(state))
        away = state.position - np.array(self.centre)
        out.phi[:] = np.sqrt((away**2).sum(axis=1)) - self.radius
        out.h[:] = out.phi
        out.gradient[:, :3] = away / np.sqrt((away**2).sum(axis=1, keepdims=True))
        return out

    @staticmethod
    def half_space(p, x, d):
        """Write the direction from the centre to the state: beyond the tangent plane is outside the ball."""
        size = ((x[0] - p[0]) ** 2 + (x[1] - p[1]) ** 2 + (x[2] - p[2]) ** 2) ** 0.5
        need = p[3]
        for i in range(3):
            d[i] = (x[i] - p[i]) / size
            need += d[i] * p[i]
        return need

    def half_space_parameters(self):
        return (*self.centre, self.radius)


class Approach(Constraint, name="TestApproach"):
    """Bound v_x by a line over x: v_x <= 0.02 m/s + 0.001 /s (60 m - x)."""

    def evaluate(self, state):
        out = ConstraintValues.zeros(len(state))
        out.phi[:] = 0.02 + 0.001 * (60.0 - state.position[:, 0]) - state.velocity[:, 0]
        out.h[:] = out.phi
        out.gradient[:, 0], out.gradient[:, 3] = -0.001, -1.0
        return out

    @staticmethod
    def half_space(p, x, d):
        d[0], d[3] = -0.001, -1.0
        return -0.08


class Broken(Constraint, name="TestNotANumber"):
    """Nothing is known to be safe."""

    def evaluate(self, state):
        return ConstraintValues.zeros(len(state))

    @staticmethod
    def half_space(p, x, d):
        d[0] = 1.0
        return np.nan


class Uncompilable(Constraint, name="TestUncompilable"):
    """What no row kernel can do."""

    shared: ClassVar[dict[str, float]] = {}

    def evaluate(self, state):
        return ConstraintValues.zeros(len(state))

    @staticmethod
    def half_space(p, x, d):
        return {"need": object()}["need"]


KINDS = [Plane(), Obstacle(), Approach()]
IDS = [kind.registered_name for kind in KINDS]


def drawn(seed, rows, nearest=12.0, farthest=110.0, fastest=0.25):
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(2, rows, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return RelativeState(
        directions[0] * generator.uniform(nearest, farthest, (rows, 1)),
        directions[1] * generator.uniform(0.0, fastest, (rows, 1)), generator.uniform(0.0, 2.0 * np.pi, rows),
    )  # fmt: skip


def flown(state, control, time):
    p, v = state.position.copy(), state.velocity.copy()
    propagate(p, v, np.ascontiguousarray(control), *transition(N, MASS, time), p, v)
    return RelativeState(p, v, state.sun_angle + N * time)


def test_the_order_of_further_constraints_does_not_matter():
    """Each of several further constraints cuts the thrusts, whatever its place is."""
    planes = [
        Plane(name=f"plane{k}", normal=normal, offset=45.0)
        for k, normal in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    ]
    state, rng = drawn(5, 900, nearest=35.0, farthest=60.0, fastest=0.4), np.random.default_rng(6)
    desired = rng.uniform(-1.0, 1.0, (900, 3))
    found = []
    for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0)):
        result = BackupFilter({}, [planes[k] for k in order])(state, desired.copy())
        found.append((result.control, [result.active >> order.index(k) & 1 for k in range(3)]))
    assert all(0.05 < active.mean() < 0.9 for active in found[0][1]), "every plane acts on some of the thrusts"
    for control, active in found[1:]:
        np.testing.assert_allclose(control, found[0][0], atol=1e-6)
        np.testing.assert_array_equal(active, found[0][1])


@pytest.mark.parametrize("constraint", KINDS, ids=IDS)
def test_the_half_space_is_the_constraint(constraint):
    """d.x >= need exactly where phi >= 0, and every state with d.y >= need is safe."""
    state, others = drawn(0, 300), drawn(1, 300)
    x, y = np.hstack((state.position, state.velocity)), np.hstack((others.position, others.velocity))
    phi, other_phi = constraint.phi(state), constraint.phi(others)
    assert 10 < (phi < 0.0).sum() < 290
    for i in range(300):
        d = np.zeros(6)
        need = type(constraint).half_space(constraint.half_space_parameters(), x[i], d)
        assert d @ x[i] - need == pytest.approx(phi[i], abs=1e-9)
        assert (other_phi[y @ d >= need] >= -1e-9).all()


@pytest.mark.parametrize("constraint", KINDS, ids=IDS)
def test_holds_are_certified_as_dense_samples_say(constraint):
    from safe_inspect.rta.backup.holds import hold
    from safe_inspect.rta.backup.sequences import SAFE

    run, state = BackupFilter({}, [constraint]), drawn(2, 1500, fastest=0.5)
    control = np.random.default_rng(3).uniform(-0.5, 0.5, (1500, 3))
    least = np.min([constraint.phi(flown(state, control, time)) for time in np.linspace(0.0, DT, 81)], axis=0)
    cells, where, margins = np.empty((64, 4), np.int64), np.empty(2, np.int64), Margins(1e-3, 1e-5, 1e-3)
    model = run._model
    safe = np.array(
        [
            hold(model, (*state.position[i], *state.velocity[i]), (1.0, 0.0), control[i], margins, cells, where) == SAFE
            for i in range(1500)
        ]
    )  # fmt: skip
    assert 30 < safe.sum() < 1470
    assert (least[safe] >= 0.0).all()
    assert safe[least > 0.02].all()


def test_each_of_several_constraints_is_kept():
    from safe_inspect.rta.backup.holds import hold
    from safe_inspect.rta.backup.sequences import SAFE

    planes = [Plane(name=str(axis), normal=tuple(np.eye(3)[axis]), offset=20.0) for axis in range(3)]
    model, state = BackupFilter({}, planes)._model, drawn(2, 600, fastest=0.5)
    control = np.random.default_rng(3).uniform(-0.5, 0.5, (600, 3))
    least = np.array([[plane.phi(flown(state, control, t)) for t in np.linspace(0.0, DT, 81)] for plane in planes])
    cells, where, margins = np.empty((64, 4), np.int64), np.empty(2, np.int64), Margins(1e-3, 1e-5, 1e-3)
    safe = np.array(
        [
            hold(model, (*state.position[i], *state.velocity[i]), (1.0, 0.0), control[i], margins, cells, where) == SAFE
            for i in range(600)
        ]
    )  # fmt: skip
    for axis in range(3):
        others = np.delete(least, axis, axis=0).min(axis=(0, 1))
        assert not safe[(least[axis].min(axis=0) < 0.0) & (others > 0.1)].any()
    assert safe[least.min(axis=(0, 1)) > 0.1].all()


@pytest.mark.parametrize("constraint", KINDS, ids=IDS)
def test_closed_motions_are_certified_as_dense_samples_say(constraint):
    from safe_inspect.rta.backup.closed_motion import NODE_STACK, closed_motion
    from safe_inspect.rta.backup.sequences import SAFE

    run, state = BackupFilter({}, [constraint]), drawn(4, 400, farthest=90.0, fastest=0.05)
    state.velocity[:, 1] = -2.0 * N * state.position[:, 0]
    zero = np.zeros((400, 3))
    least = np.min([constraint.phi(flown(state, zero, time)) for time in np.linspace(0.0, PERIOD, 1501)], axis=0)
    work, weak, model, margins = np.empty(NODE_STACK), np.zeros(2, np.int64), run._model, Margins(1e-3, 1e-5, 1e-3)
    safe = np.array(
        [
            closed_motion(model, (*state.position[i], *state.velocity[i]), (1.0, 0.0), margins, work, weak) == SAFE
            for i in range(400)
        ]
    )
    assert 20 < safe.sum() < 380
    assert (least[safe] >= 0.0).all()
    assert safe[least > 0.02].all()


@pytest.mark.parametrize("constraint", KINDS, ids=IDS)
def test_nothing_is_broken_under_adversaries(constraint):
    run = BackupFilter({}, (*NAMES, constraint))
    state = drawn(5, 1200, nearest=40.0)
    state = state[np.flatnonzero((run.phi(state) >= 0.0).all(axis=1) & run.recoverable(state))[:96]]
    assert len(state) == 96
    target = {"TestPlane": [60.0, 80.0, 0.0], "TestObstacle": [45.0, 30.0, 0.0], "TestApproach": [500.0, 0.0, 0.0]}
    generator, least, refused = np.random.default_rng(6), np.full(len(run.names), np.inf), 0
    for _ in range(60):
        to = np.array(target[constraint.registered_name]) - state.position
        want = to / np.linalg.norm(to, axis=1, keepdims=True)
        want[::3] = generator.choice([-1.0, 1.0], (32, 3))
        result = run(state, want)
        assert not result.infeasible.any()
        refused += (result.active >> (len(run.names) - 1) & 1).sum()
        for time in (2.5, 5.0, 7.5, DT):
            least = np.minimum(least, run.phi(flown(state, result.control, time)).min(axis=0))
        state = flown(state, result.control, DT)
    assert (least >= 0.0).all()
    assert refused > 60  # the constraint was in the way, and is named


def test_the_way_back_leads_out_of_a_forbidden_region():
    run = BackupFilter({}, (*NAMES, Plane()))
    state = drawn(7, 400, nearest=40.0, fastest=0.05)
    state = state[
        np.flatnonzero((state.position @ [0.6, 0.8, 0.0] > 47.0) & (run.phi(state)[:, :-1] >= 0.0).all(axis=1))
    ]
    assert len(state) > 20
    assert run(state, np.zeros((len(state), 3))).infeasible.all()
    before = run.phi(state)[:, -1]
    for _ in range(60):
        state = flown(state, run(state, np.zeros((len(state), 3))).control, DT)
    assert (run.phi(state)[:, -1] > before).all()
    assert (run.phi(state)[:, -1] >= 0.0).mean() > 0.9


def test_several_of_one_class_are_used_together():
    walls = [Plane(name=f"wall {i}", normal=normal, offset=80.0) for i, normal in enumerate(np.eye(3).tolist())]
    run = BackupFilter({}, (*NAMES, *walls))
    assert run.names[8:] == ("wall 0", "wall 1", "wall 2")
    state = drawn(8, 300, nearest=40.0, farthest=90.0, fastest=0.05)
    state = state[np.flatnonzero(run.recoverable(state))[:40]]
    result = run(state, np.tile([0.0, 0.0, 1.0], (40, 1)))
    assert (run.phi(flown(state, result.control, DT)) >= 0.0).all()
    with pytest.raises(ValueError, match="'plane' is given twice"):
        BackupFilter({}, [Plane(), Plane(offset=3.0)])


def test_the_joint_filter_keeps_it_too():
    plane = Plane()
    state = drawn(9, 400, nearest=40.0, fastest=0.1)
    alone = BackupFilter({}, (*NAMES, plane))
    good = state[np.flatnonzero((alone.phi(state) >= 0.0).all(axis=1) & alone.recoverable(state))[:40]]
    team = TeamFilter({}, (*NAMES, "deputy_collision", plane))
    both = TeamState(
        good.position.reshape(20, 2, 3), good.velocity.reshape(20, 2, 3), good.sun_angle.reshape(20, 2)[:, 0]
    )  # fmt: skip
    both = both[team.recoverable(both)]
    assert len(both) > 5
    for _ in range(12):
        joint = team(both, np.broadcast_to([0.6, 0.8, 0.0], both.position.shape))
        assert not joint.infeasible.any()
        p, v = (np.ascontiguousarray(array.reshape(-1, 3)) for array in (both.position, both.velocity))
        propagate(p, v, np.ascontiguousarray(joint.control.reshape(-1, 3)), *transition(N, MASS, DT), p, v)
        both = TeamState(p.reshape(-1, 2, 3), v.reshape(-1, 2, 3), both.sun_angle + N * DT)
        assert all((phi >= 0.0).all() for phi in team.phi(both).values())
    assert (joint.active >> team.names.index("plane") & 1).any()


def test_a_row_does_not_depend_on_its_batch():
    run, state = BackupFilter({}, (*NAMES, Obstacle())), drawn(10, 40)
    want = np.random.default_rng(11).uniform(-1.0, 1.0, (40, 3))
    whole = run(state, want).control
    for i in range(40):
        np.testing.assert_array_equal(run(state[i : i + 1], want[i : i + 1]).control[0], whole[i])


def test_a_filter_with_its_kernels_can_be_pickled():
    run, state = BackupFilter({}, (*NAMES, Obstacle())), drawn(12, 20)
    want = np.ones((20, 3))
    copy = pickle.loads(pickle.dumps(run))
    np.testing.assert_array_equal(copy(state, want).control, run(state, want).control)


def test_what_is_not_a_number_is_not_safe():
    run, state = BackupFilter({}, (*NAMES, Broken())), drawn(13, 20)
    assert not run.recoverable(state).any()
    assert not admissible(run, state, np.zeros((20, 3))).any()


def test_a_kernel_that_does_not_compile_is_named():
    run = BackupFilter({}, [Uncompilable()])
    text = r"Uncompilable\.half_space \(.*\.py:\d+\) does not compile as a row kernel"
    with pytest.raises(PluginValueError, match=text):
        run.recoverable(drawn(14, 1))
    with pytest.raises(ContractError, match=text):
        check_plugin(Uncompilable)


def test_the_glue_takes_a_constraint_with_its_fields():
    glue = RTAGlueCWHInspection1v1(
        enabled=True,
        constraints=("r_max", {"functor": "TestPlane", "config": {"offset": 30.0}}),  # type: ignore[arg-type]
    )
    states = {"position": np.array([[45.0, 0.0, 0.0], [90.0, 0.0, 0.0]]), "velocity": np.zeros((2, 3))}
    found = glue.safety({**states, "sun_angle": np.zeros(2)})
    assert list(found) == ["r_max", "plane"]
    np.testing.assert_allclose(found["plane"], [3.0, -24.0])
    assert glue.units == {"r_max": "m", "plane": "m"}
    metric = SmallestPhi(constraint=glue.constraints[1])
    assert (metric.label, metric.unit) == ("phi plane", "m")
    again = RTAGlueCWHInspection1v1.model_validate(glue.model_dump(mode="json"))
    assert list(map(name_of, again.constraints)) == ["r_max", "plane"]
    assert again.constraints[1].offset == 30.0


def test_fields_that_are_not_given_come_from_the_parameters_of_the_task():
    from safe_inspect.rta.constraints.ranges import ChiefCollision

    built = constraint_set({"collision_radius": 12.0}, [ChiefCollision(max_acceleration=0.01)])["chief_collision"]
    assert built == ChiefCollision(collision_radius=12.0, max_acceleration=0.01)


@pytest.mark.parametrize(("count", "fits"), [(52, True), (53, False)])
def test_at_most_52_constraints_of_others_are_kept(count, fits):
    planes = [Plane(name=f"plane {index}") for index in range(count)]
    if fits:
        assert len(BackupFilter({}, planes).constraints) == count
        return
    with pytest.raises(ValueError, match="supports at most 52 constraints in addition to chief_collision, "):
        BackupFilter({}, planes)
