"""Several constraints of one class, distinguished by their names."""

from __future__ import annotations

import pytest

from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import Constraint, ConstraintValues, constraint_set
from safe_inspect.rta.constraints.sets import NAMES, name_of
from safe_inspect.rta.team.safety_filter import TeamFilter


class Side(Constraint, name="NamedSide"):
    """Stay on one side of a plane, y <= limit.

    Attributes:
        limit: The limit [m].
    """

    limit: float = 50.0

    def evaluate(self, state):
        out = ConstraintValues.zeros(len(state))
        out.phi[:] = self.limit - state.position[:, 1]
        return out

    def half_space_parameters(self):
        return (self.limit,)

    @staticmethod
    def half_space(p, x, d):
        d[1] = -1.0
        return -p[0]


HERE = f"{__name__}.Side"


def test_two_of_a_class_have_different_names():
    near, far = Side(name="near"), Side(name="far", limit=90.0)
    found = constraint_set({}, [near, far, Side(), "r_max"])
    assert list(found) == ["near", "far", "NamedSide", "r_max"]
    assert [found[name].limit for name in ("near", "far", "NamedSide")] == [50.0, 90.0, 50.0]
    assert BackupFilter(names=[near, far]).names == ("near", "far")
    assert TeamFilter(names=[near, far, "deputy_collision"]).names == ("near", "far", "deputy_collision")


def test_a_class_is_the_same_by_its_path_and_by_its_name():
    assert name_of(HERE) == name_of("NamedSide") == name_of(Side()) == "NamedSide"
    for again in ("NamedSide", HERE, Side(limit=1.0)):
        with pytest.raises(ValueError, match=r"'NamedSide' is given twice; remove one, or give each a `name`"):
            constraint_set({}, [HERE, again])


@pytest.mark.parametrize("name", NAMES)
def test_the_constraints_of_the_task_keep_their_names(name):
    limit = constraint_set({}, [name])[name]
    with pytest.raises(ValueError, match=rf"the constraint '{name}' cannot have another `name`; remove it"):
        constraint_set({}, [limit.model_copy(update={"name": "far"})])


def test_a_constraint_of_the_task_is_given_once():
    limit = constraint_set({}, ["r_max"])["r_max"]
    with pytest.raises(ValueError, match=r"'r_max' is given twice; remove one$"):
        constraint_set({}, ["r_max", limit])
