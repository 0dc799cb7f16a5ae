"""Each way in which what a plugin computes can break the contract of its kind, with the exact words of the report."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from safe_inspect.dones import DoneFunction, DoneStatus, SharedDoneFunction
from safe_inspect.dynamics import DisturbanceBounds
from safe_inspect.glues import ActionGlue, Normalizer, ObservationGlue
from safe_inspect.glues.base import Glue
from safe_inspect.metrics import Metric, TeamMetric
from safe_inspect.metrics.base import BaseMetric
from safe_inspect.platforms import Controller, Sensor
from safe_inspect.platforms.base import Part, Platform
from safe_inspect.rewards import Reward
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.simulators import Component, Parameter, RunningComponent
from safe_inspect.simulators.simulator import ComposedSimulator
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.tasks.bounded_disturbance import BoundedDisturbance
from safe_inspect.testing import check_plugin
from safe_inspect.testing.samples import SampleVehicle

from .making import made
from .reports import breaches

pytestmark = pytest.mark.usefixtures("clean_registry")


def sensor(read: Any, elements: tuple[str, ...] = ("x",), **members: Any) -> type:
    """Return a sensor that reads by a function of the view."""
    return made(Sensor, elements=elements, __call__=lambda self, view: read(view), **members)


def controller(limits: Any, **members: Any) -> type:
    """Return a controller of one value with limits."""
    members = {"__call__": lambda self, values: np.repeat(values, 3, axis=1), **members}
    return made(Controller, limits=property(lambda self: limits), **members)


def glue(base: type, names: Any, low: Any, high: Any, call: Any, **members: Any) -> type:
    """Return a glue with names and bounds."""
    return made(
        base, names=lambda self, parts: names, bounds=lambda self, parts: (low, high),
        __call__=lambda self, *given: call(*given), **members,
    )  # fmt: skip


def metric(base: type, call: Any, **members: Any) -> type:
    """Return a metric."""
    return made(base, **{"reduce": "sum", "__call__": lambda self, step: call(step), **members})


def normalizer(call: Any, inverse: Any, **members: Any) -> type:
    """Return a normaliser."""
    return made(
        Normalizer, __call__=lambda self, *given: call(*given), inverse=lambda self, *given: inverse(*given), **members
    )


def accepts(*sizes: int) -> Any:
    """Return the check of a normaliser of some numbers of elements."""

    def check(self: Any, size: int, low: Any, high: Any) -> None:
        if size not in sizes or not ((low == -1.0).all() and (high == 1.0).all() and len(low) == len(high) == size):
            raise ValueError("no")

    return check


def platform(call: Any) -> type:
    """Return a platform that takes parts by a function."""
    return made(Platform, __call__=lambda self, parts: call(parts))


def remembers(base: type, kind: str, **members: Any) -> type:
    """Return a plugin that adds the number of rows, or the own heights, to what it remembers."""

    def remember(self: Any, seen: Any, name: str) -> None:
        view = getattr(seen, "after", seen)
        view.memory(name, "sum")[:] += 1.0 * view.num_rows if kind == "crowd" else view.position[:, 2]

    return made(base, memory=lambda self, world: {"sum": ArraySpec(())}, remember=remember, **members)


def _flip(values: Any, *_: Any) -> Any:
    return -values


def _is_much(self: Any, step: Any) -> Any:
    return step.after.memory(self.memory_key(step.after), "sum") > 20.0


def modest(**bounds: float) -> Any:
    """Return a disturbance by some bounds, of which it declares a half."""
    half = DisturbanceBounds(**{name: 0.5 * bound for name, bound in bounds.items()})
    whole = BoundedDisturbance(**bounds, distribution="extreme")
    return made(
        Component, __call__=lambda self, world, num_envs: whole(world, num_envs),
        disturbance_bounds=lambda self, limits: half,
    )  # fmt: skip


def refuse(*_: Any) -> Any:
    """Refuse everything."""
    raise ValueError("it does not fit")


class Crowd(Component, name="TestCrowd"):
    """Push a deputy by the number of environments."""

    def __call__(self, world, num_envs):
        """Return the running component."""
        return _RunningCrowd(num_envs)


class _RunningCrowd(RunningComponent):
    def __init__(self, rows):
        self._rows = rows

    def step(self, state, running):
        state["velocity"][:, 0, 1] += 1e-3 * self._rows


ONE, TWO = np.ones(1), np.ones(2)
REFUSED = {
    "reward that is infinite in a row": lambda: made(
        Reward, __call__=lambda self, step: np.where(step.first, np.inf, 0.0)
    ),
    "reward of integers": lambda: made(Reward, __call__=lambda self, step: np.ones(len(step.control), dtype=np.int64)),
    "reward of a list": lambda: made(Reward, __call__=lambda self, step: [1.0] * len(step.control)),
    "done without a status": lambda: made(DoneFunction, __call__=lambda self, step: step.after.time > 90.0),
    "done that remembers the batch": lambda: remembers(
        DoneFunction, "crowd", status=DoneStatus.LOSE, __call__=_is_much
    ),
    "shared done of another status": lambda: made(
        SharedDoneFunction, __call__=lambda self, step: np.where(step.after.step > 5, 9, 0).astype(np.int8)
    ),
    "part that is neither": lambda: made(Part, __call__=refuse),
    "sensor without elements": lambda: sensor(lambda view: view.position[:, :0], ()),
    "sensor of twins": lambda: sensor(lambda view: view.position[:, :2].copy(), ("a", "a")),
    "sensor below its bounds": lambda: sensor(lambda view: view.position[:, 2:].copy(), bounds=(-1.0, np.inf)),
    "sensor above its bounds": lambda: sensor(lambda view: view.position[:, 2:].copy(), bounds=(-np.inf, 1.0)),
    "sensor of too few": lambda: sensor(lambda view: view.position[:, 2:].copy(), ("a", "b")),
    "sensor that remembers the batch": lambda: remembers(
        Sensor,
        "crowd",
        elements=("x",),
        __call__=lambda self, view: view.memory(self.part_name, "sum")[:, None].copy(),
    ),
    "controller with equal limits": lambda: controller((ONE, ONE)),
    "controller with limits of two sizes": lambda: controller((-ONE, TWO)),
    "controller with limits of two shapes": lambda: controller((-ONE[None], ONE[None])),
    "controller of thrust, not of moments": lambda: controller((-ONE, ONE), control_size=property(lambda self: 6)),
    "controller of three moments too many": lambda: controller(
        (-ONE, ONE), __call__=lambda self, values: np.repeat(values, 6, axis=1)
    ),
    "glue of neither kind": lambda: glue(Glue, ("x",), -ONE, ONE, refuse),
    "glue whose bounds fail": lambda: made(
        ObservationGlue, names=lambda self, parts: ("x",), bounds=refuse, __call__=refuse
    ),
    "glue with bounds of two sizes": lambda: glue(ObservationGlue, ("x",), -ONE, TWO, refuse),
    "glue with a list of bounds": lambda: glue(ObservationGlue, ("x",), [-1.0], [1.0], refuse),
    "glue with exchanged bounds": lambda: glue(
        ActionGlue, ("x",), ONE, -ONE, lambda action, parts: np.repeat(action, 3, axis=1)
    ),
    "glue with a name twice": lambda: glue(
        ObservationGlue, ("x", "x"), -1e9 * TWO, 1e9 * TWO, lambda view: view.position[:, :2].copy()
    ),
    "glue out of its bounds": lambda: glue(
        ObservationGlue, ("x",), -ONE, ONE, lambda view: view.position[:, :1].copy()
    ),
    "glue of no thrust": lambda: glue(ActionGlue, (), ONE[:0], ONE[:0], lambda action, parts: action),
    "glue that writes into the action": lambda: glue(
        ActionGlue,
        ("x",),
        -ONE,
        ONE,
        lambda action, parts: np.repeat(np.multiply(action, 2.0, out=action), 3, axis=1),
    ),
    "safety glue that refuses by numbers": lambda: made(
        SafetyGlue, refusals=lambda self, states: {"far": states["position"][:, 0].copy()}, safety=refuse, filter=refuse
    ),
    "normaliser that fits nothing": lambda: normalizer(_flip, _flip, check=accepts()),
    "normaliser that fits too many": lambda: normalizer(_flip, _flip, check=accepts(17)),
    "normaliser with another inverse": lambda: normalizer(_flip, lambda values, *_: values * (-1.0 - 1e-8)),
    "normaliser of another shape": lambda: normalizer(lambda values, *_: values[:, :1].copy(), _flip),
    "normaliser with an inverse of another shape": lambda: normalizer(
        _flip, lambda values, *_: values[:, 0].copy(), check=accepts(2, 5)
    ),
    "platform that loses a part": lambda: platform(lambda parts: tuple(part.part_name for part in parts[1:])),
    "platform that no parts fit": lambda: platform(refuse),
    "platform that fails": lambda: platform(lambda parts: parts[-1].no_such_name),
    "metric without a way to reduce": lambda: metric(Metric, lambda step: step.after.time.copy(), reduce="median"),
    "metric without a unit": lambda: metric(Metric, lambda step: step.after.time.copy(), unit=""),
    "metric with a number as label": lambda: metric(
        Metric, lambda step: step.after.time.copy(), label=property(lambda self: 3)
    ),
    "metric of nobody": lambda: metric(BaseMetric, refuse),
    "metric that is infinite": lambda: metric(Metric, lambda step: np.where(step.first, np.inf, np.nan)),
    "metric of another shape": lambda: metric(Metric, lambda step: step.control),
    "metric that concludes by the batch": lambda: metric(
        Metric, lambda step: step.after.time.copy(), conclude=lambda self, value, step: value - np.nanmean(value)
    ),
    "metric that concludes nothing without a bound": lambda: metric(
        Metric,
        lambda step: step.after.time.copy(),
        conclude=lambda self, value, step: np.where(np.isnan(value), np.inf, value),
    ),
    "metric of a team's members": lambda: metric(TeamMetric, lambda step: step.after.position[:, :, 0].copy()),
    "metric of a team that is infinite with several": lambda: metric(
        TeamMetric, lambda step: np.full(len(step.after.step), np.inf if step.after.position.shape[1] > 1 else 0.0)
    ),
    "metric of a team that ends it": lambda: metric(
        TeamMetric, lambda step: 0.0 * np.multiply(step.status, 2, out=step.status).sum(axis=1)
    ),
    "parameter that is infinite": lambda: made(
        Parameter, __call__=lambda self, draw: draw.streams.uniform("x")[:, 0] / 0.0
    ),
    "parameter of two columns": lambda: made(Parameter, __call__=lambda self, draw: draw.streams.uniform("x", 2)),
    "parameter that is a tumble of quaternions of another length": lambda: made(
        Parameter,
        __call__=lambda self, draw: {
            "orientation": np.full((len(draw.streams), 4), 1.0),
            "angular_velocity": np.zeros((len(draw.streams), 3)),
        },
    ),
    "component whose declaration fails": lambda: made(
        Component, __call__=lambda self, world, num_envs: RunningComponent(), disturbance_bounds=refuse
    ),
    "component that moves more than it says": lambda: modest(velocity=1e-3),
    "component that leans more than it says": lambda: modest(thrust_gain=0.1),
    "component whose position is further off": lambda: modest(position_error=0.1),
    "component whose velocity is further off": lambda: modest(velocity_error=2e-3),
    "simulator of a crowd": lambda: ComposedSimulator(dynamics=SampleVehicle(), components=(Crowd(),)),
}
ACCEPTED = {
    "done that remembers its rows": lambda: remembers(
        DoneFunction, "own", status=DoneStatus.DRAW, __call__=_is_much
    ),
    "controller of moments": lambda: controller(
        (-ONE, ONE), control_size=property(lambda self: 6), __call__=lambda self, values: np.repeat(values, 6, axis=1)
    ),
    "glue without an action": lambda: glue(
        ActionGlue, (), ONE[:0], ONE[:0], lambda action, parts: np.zeros((len(action), 3))
    ),
    "glue with fixed bounds": lambda: glue(
        ObservationGlue, ("x",), ONE, ONE, lambda view: np.ones((view.num_rows, 1))
    ),
    "normaliser of one size": lambda: normalizer(_flip, _flip, check=accepts(16)),
    "normaliser of three among others": lambda: normalizer(_flip, _flip, check=accepts(2, 3)),
    "platform without parts": lambda: platform(lambda parts: refuse() if parts else ()),
    "metric without values": lambda: metric(Metric, lambda step: np.full(len(step.control), np.nan)),
    "metric that concludes": lambda: metric(
        Metric, lambda step: step.after.time.copy(), conclude=lambda self, value, step: 2.0 * value
    ),
    "metric of a team": lambda: metric(TeamMetric, lambda step: 1.0 * step.after.step, unit="s"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_value_is_refused_in_exact_words(name: str) -> None:
    assert breaches(REFUSED[name]())


@pytest.mark.parametrize("name", ACCEPTED)
def test_a_sound_plugin_passes(name: str) -> None:
    check_plugin(ACCEPTED[name]())
