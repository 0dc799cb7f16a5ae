"""What the test kit calls a plugin of each kind with: the rows, their order and their values."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from safe_inspect.dones import DoneFunction, DoneStatus, SharedDoneFunction
from safe_inspect.dynamics import NO_DISTURBANCE
from safe_inspect.glues import ActionGlue, Normalizer, ObservationGlue
from safe_inspect.metrics import Metric, TeamMetric
from safe_inspect.platforms import Controller, Sensor
from safe_inspect.platforms.base import Platform
from safe_inspect.policies import ScriptedPolicy
from safe_inspect.rewards import Reward
from safe_inspect.rta.base import SafetyGlue, TeamFiltered, TeamSafety
from safe_inspect.rta.constraints import Constraint, ConstraintValues
from safe_inspect.simulators import Component, Initializer, Parameter, RunningComponent
from safe_inspect.testing import check_plugin

from .given import Calls
from .making import made
from .reports import assert_recorded

pytestmark = pytest.mark.usefixtures("clean_registry")


def _rows(step: Any) -> Any:
    return np.ones(len(step.control))


def _no_thrust(view: Any, limits: Any) -> Any:
    return np.zeros((view.num_rows, len(limits.low)))


def _braking(state: Any) -> ConstraintValues:
    height, speed = state.position[:, 2], state.velocity[:, 2]
    gradient = np.zeros((len(state), 6))
    gradient[:, 2], gradient[:, 5] = -1.0, -np.abs(speed) / 0.08
    h = 300.0 - height - speed * np.abs(speed) / 0.16
    return ConstraintValues(300.0 - height, h, gradient, np.zeros(len(state)))


def _filtered(desired: Any, team: Any) -> TeamFiltered:
    nobody = np.zeros(len(desired), dtype=np.bool_)
    return TeamFiltered(
        control=desired.copy(),
        intervening=np.zeros(desired.shape[:2], dtype=np.bool_),
        infeasible=nobody,
        backup=nobody,
    )


def _none(states: Any) -> Any:
    return {"none": np.zeros(len(states["sun_angle"]), dtype=np.bool_)}


def _safe(states: Any) -> Any:
    return {"none": np.ones(len(states["sun_angle"]))}


def _states(values: Any) -> Any:
    return {"position": np.stack([values["x"], values["v"], values["a"]], axis=-1)}


class _Running(RunningComponent):
    def __init__(self, calls: Calls) -> None:
        self._calls = calls

    def step(self, state: Any, running: Any) -> None:
        self._calls.note("step", state["position"], state["velocity"], running)


LOW, HIGH = np.array([-1.0, -0.5]), np.array([1.0, np.inf])
KINDS = {
    "reward": lambda calls: made(Reward, __call__=calls.spied(_rows)),
    "done": lambda calls: made(
        DoneFunction, status=DoneStatus.WIN, __call__=calls.spied(lambda step: step.after.time > 90.0)
    ),
    "shared done": lambda calls: made(
        SharedDoneFunction, __call__=calls.spied(lambda step: np.where(step.after.step > 5, 3, 0).astype(np.int8))
    ),
    "sensor": lambda calls: made(
        Sensor, elements=("x",), __call__=calls.spied(lambda view: view.position[:, :1].copy())
    ),
    "controller": lambda calls: made(
        Controller, limits=property(lambda self: (LOW, HIGH)),
        __call__=calls.spied(lambda values: np.zeros((len(values), 3))),
    ),
    "observation": lambda calls: made(
        ObservationGlue, names=calls.spied(lambda parts: ("x",), "names"),
        bounds=calls.spied(lambda parts: (-1e9 * np.ones(1), 1e9 * np.ones(1)), "bounds"),
        __call__=calls.spied(lambda view: view.position[:, :1].copy()),
    ),
    "action": lambda calls: made(
        ActionGlue, names=lambda self, parts: ("x", "y"), bounds=lambda self, parts: (LOW, HIGH),
        __call__=calls.spied(lambda action, parts: np.zeros((len(action), 3))),
    ),
    "safety": lambda calls: made(
        SafetyGlue, refusals=calls.spied(_none, "refusals"), safety=calls.spied(_safe, "safety"),
        filter=calls.spied(lambda desired, view: None, "filter"),
    ),
    "normaliser": lambda calls: made(
        Normalizer, __call__=calls.spied(lambda values, low, high: (values - low) / (high - low)),
        inverse=calls.spied(lambda values, low, high: low + values * (high - low), "inverse"),
    ),
    "platform": lambda calls: made(
        Platform, __call__=calls.spied(lambda parts: tuple(part.part_name for part in parts))
    ),
    "metric": lambda calls: made(
        Metric, reduce="sum", __call__=calls.spied(lambda step: step.after.time.copy()),
        conclude=calls.spied(lambda value, step: value + step.after.time, "conclude"),
    ),
    "team metric": lambda calls: made(
        TeamMetric, reduce="last", __call__=calls.spied(lambda step: 1.0 * step.after.step)
    ),
    "parameter": lambda calls: made(Parameter, __call__=calls.spied(lambda draw: draw.streams.uniform("x")[:, 0])),
    "initialiser": lambda calls: made(
        Initializer, parameters={"x": "m", "v": "m/s", "a": "rad", "n": "", "whole": None}, gives=("position",),
        __call__=calls.spied(_states),
    ),
    "constraint": lambda calls: made(
        Constraint, evaluate=calls.spied(_braking, "evaluate"), h=calls.spied(lambda state: _braking(state).h, "h")
    ),
    "policy": lambda calls: made(ScriptedPolicy, __call__=calls.spied(_no_thrust)),
    "policy of a vehicle that turns": lambda calls: made(
        ScriptedPolicy, commands_attitude=True, __call__=calls.spied(_no_thrust)
    ),
    "filter of a team": lambda calls: made(
        TeamSafety, __call__=calls.spied(_filtered), refusals=calls.spied(_none, "refusals"),
        safety=calls.spied(_safe, "safety"),
    ),
    "component": lambda calls: made(
        Component, __call__=calls.spied(lambda world, num_envs: _Running(calls)),
        disturbance_bounds=calls.spied(lambda limits: NO_DISTURBANCE, "disturbance_bounds"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_a_plugin_is_called_with_what_is_on_record(kind: str) -> None:
    calls = Calls()
    check_plugin(KINDS[kind](calls))
    assert_recorded(calls.text())
