"""Plain controllers that are computed together are bit-identical to each of them alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from safe_inspect.environments import load_spec
from safe_inspect.environments.thrust import Thrusters
from safe_inspect.glues.actions import ControllerGlue
from safe_inspect.glues.normalizers import Normalization
from safe_inspect.platforms.base import Controller
from safe_inspect.platforms.controllers import RateController

ACTIONS = np.concatenate([np.random.default_rng(0).normal(0.0, 1.0, (200, 3)), [[-0.0, 0.0, -2.0], [2.0, -0.0, 0.0]]])


@pytest.fixture(scope="module")
def agent():
    return load_spec("safe_inspect/TranslationalInspectionSeed-v0").agents[0]


def with_controllers(agent, axes, *, normalised=False):
    names = [f"thruster {index}" for index in range(len(axes))]
    limits = [{"name": "thrust", "low": -0.5 - index, "high": 1.0 + index} for index in range(len(axes))]
    parts = {
        name: RateController(name=name, axis=axis, properties=limit)
        for name, axis, limit in zip(names, axes, limits, strict=True)
    }
    glues = tuple(ControllerGlue(controller=name, normalization=Normalization(enabled=normalised)) for name in names)
    return replace(agent, parts=parts, glues=glues)


def one_by_one(agent, actions):
    thrust = np.zeros((len(actions), 3))
    for column, glue in enumerate(agent.action_glues):
        thrust += glue(actions[:, [column]], agent.parts)
    return thrust


@pytest.mark.parametrize("axes", [(0, 1, 2), (2, 0, 1), (1,), (0, 2), (0, 0, 2)])
@pytest.mark.parametrize("normalised", [False, True])
def test_the_thrusts_are_those_of_the_glues_one_by_one(agent, axes, normalised):
    made = with_controllers(agent, axes, normalised=normalised)
    actions = ACTIONS[:, : len(axes)]
    thrusters, expected = Thrusters(made), one_by_one(made, actions)
    found = thrusters(actions)
    assert found.tobytes() == expected.tobytes()  # the sign of zero too
    assert (thrusters.plain is None) == (normalised or len(set(axes)) < len(axes))
    bounds = np.full((2, len(axes)), np.inf) * [[-1.0], [1.0]]
    at_once = thrusters.clipped(actions[:, None], *bounds)
    if thrusters.plain is None:
        assert at_once is None
    else:
        assert at_once[0].tobytes() == actions.tobytes()
        assert at_once[1].tobytes() == expected.tobytes()
    assert np.abs(found).max() > 0.5


@pytest.mark.usefixtures("clean_registry")
def test_a_controller_of_another_class_is_asked_for_every_value(agent):
    class DeadBandController(Controller):
        """Thrust along one axis that small commands do not move.

        Attributes:
            axis: The axis.
        """

        axis: int = 0

        @property
        def limits(self):
            return np.array([-1.0]), np.array([1.0])

        def __call__(self, values):
            share = np.zeros((len(values), 3))
            share[:, self.axis] = np.where(np.abs(values[:, 0]) < 0.3, 0.0, np.clip(values[:, 0], -1.0, 1.0))
            return share

    made = with_controllers(agent, (0, 2))
    parts = {name: DeadBandController(name=name, axis=axis) for name, axis in zip(made.parts, (0, 2), strict=True)}
    made = replace(made, parts=parts)
    actions = ACTIONS[:, :2]
    found = Thrusters(made)(actions)
    assert Thrusters(made).plain is None
    wanted = np.where(np.abs(actions) < 0.3, 0.0, np.clip(actions, -1.0, 1.0))
    np.testing.assert_array_equal(found[:, [0, 2]], wanted)
