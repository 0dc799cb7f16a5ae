from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from pydantic import ValidationError

from safe_inspect.plugins.registry import registry
from safe_inspect.rta.constraints import Constraint, ConstraintParameters, ConstraintValues, constraint_set
from safe_inspect.rta.constraints.ranges import ChiefCollision, MaximumRange, PassivelySafeManoeuvre
from safe_inspect.rta.constraints.speeds import RelativeSpeedLimit
from safe_inspect.rta.constraints.sun_cone import SunKeepOut

NAMES = ["chief_collision", "rel_vel", "sun", "r_max", "PSM", "x_vel", "y_vel", "z_vel"]
PEER = {
    "step_size": 10.0,
    "collision_radius": 15.0,
    "v0": 0.3,
    "v0_distance": 12.0,
    "v1_coef": 3.0,
    "n": 0.001,
    "r_max": 500.0,
}


def test_the_parameters_reach_their_constraints():
    built = constraint_set({**PEER, "fov": "90 deg", "vel_limit": 2.0, "psm_horizon": "2 h", "m": 10.0}, NAMES)
    assert list(built) == NAMES
    a = 1.0 / 10.0 - 3 * 0.001**2 * 500.0 - 2 * 0.001 * min(2.0, 0.3 + 3 * 0.001 * 500.0)
    assert built["chief_collision"] == ChiefCollision(collision_radius=15.0, max_acceleration=a)
    assert built["r_max"] == MaximumRange(r_max=500.0, max_acceleration=a)
    assert built["rel_vel"] == RelativeSpeedLimit(v0=0.3, v0_distance=12.0, v1=0.003)
    assert built["sun"] == SunKeepOut(fov=math.pi / 2, max_acceleration=a, mean_motion=0.001)
    assert built["PSM"] == PassivelySafeManoeuvre(collision_radius=15.0, mean_motion=0.001, horizon=7200.0)
    assert [built[f"{axis}_vel"].vel_limit for axis in "xyz"] == [2.0] * 3
    assert [built[f"{axis}_vel"].axis() for axis in "xyz"] == [0, 1, 2]


def test_the_defaults_of_the_classes_are_those_of_the_task():
    for name, constraint in constraint_set({}).items():
        assert constraint == registry.get("constraint", name)(), name
        assert type(constraint).model_validate_json(constraint.model_dump_json()) == constraint


def test_the_names_choose_and_order():
    assert list(constraint_set(ConstraintParameters(), ["sun", "PSM"])) == ["sun", "PSM"]
    assert constraint_set(PEER, []) == {}


def test_an_unknown_name_says_the_nearest():
    with pytest.raises(ValueError, match="did you mean `chief_collision`"):
        constraint_set(PEER, ["chief_colision"])
    with pytest.raises(ValueError, match="twice"):
        constraint_set(PEER, ["sun", "sun"])
    with pytest.raises(ValueError, match="a list"):
        constraint_set(PEER, "sun")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"colision_radius": 10.0}, "did you mean `collision_radius`"),
        ({"r_max": 15.0}, "r_max 15.0 m does not exceed collision_radius 15.0 m"),
        ({"r_max": 5.0}, "no position is safe"),
        ({"v0_distance": 600.0}, "must be below r_max"),
        ({"v0_distance": 400.0}, "negative at the collision radius"),
        ({"u_max": -1.0}, "u_max"),
        ({"n": 0.0}, "n: "),
        ({"fov": "200 deg"}, "fov"),
        ({"step_size": 0.0}, "step_size"),
        ({"m": float("nan")}, "m: "),
        ({"collision_radius": "10 s"}, "not a unit of length"),
    ],
)
def test_impossible_and_contradicting_parameters_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        constraint_set({**PEER, **change}, NAMES)


def test_all_mistakes_are_named_at_once():
    with pytest.raises(ValueError, match="n: ") as caught:
        constraint_set({**PEER, "n": -1.0, "v0": -1.0, "velocity": 1.0}, NAMES)
    assert "v0: " in str(caught.value)
    assert "'velocity'" in str(caught.value)


def test_a_constraint_is_frozen_and_takes_no_unknown_field():
    with pytest.raises(ValidationError):
        ChiefCollision().collision_radius = 3.0
    with pytest.raises(ValidationError):
        ChiefCollision(radius=3.0)
    with pytest.raises(ValidationError):
        SunKeepOut(fov="180 deg")


def test_a_constraint_of_ones_own_is_one_method(draw):
    class AboveThePlane(Constraint, name="above_the_plane_of_this_test"):
        def evaluate(self, state):
            found = ConstraintValues.zeros(len(state))
            found.phi[:] = found.h[:] = state.position[:, 2]
            found.gradient[:, 2] = 1.0
            return found

    state = draw(15, 10)
    built = constraint_set(PEER, ["above_the_plane_of_this_test"])["above_the_plane_of_this_test"]
    np.testing.assert_array_equal(built(state), state.position[:, 2])
    np.testing.assert_array_equal(built.evaluate(state).rate, 0.0)
    registry._classes["constraint"].pop("above_the_plane_of_this_test")


def test_building_the_constraints_waits_for_no_compiler():
    code = (
        "import sys; from safe_inspect.rta.constraints import ConstraintParameters; "
        "from safe_inspect.rta.constraints.ranges import ChiefCollision; "
        "from safe_inspect.rta.constraints.sun_cone import SunKeepOut; "
        "ChiefCollision.from_parameters(ConstraintParameters()), SunKeepOut(); "
        "sys.exit('numba' in sys.modules or 'scipy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_constraint_says_the_unit_of_its_phi_and_whether_it_looks_at_two_deputies():
    units = {
        "chief_collision": "m", "rel_vel": "m/s", "sun": "rad", "r_max": "m", "PSM": "m", "x_vel": "m/s",
        "y_vel": "m/s", "z_vel": "m/s", "deputy_collision": "m", "deputy_PSM": "m",
    }  # fmt: skip
    for name, unit in units.items():
        cls = registry.get("constraint", name)
        assert (cls.unit, cls.pair) == (unit, name.startswith("deputy_")), name
    for name, cls in registry.items("constraint"):
        assert name in units or not cls.__module__.startswith("safe_inspect."), f"what is the unit of {name}?"
