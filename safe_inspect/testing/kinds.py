"""Checks for each kind of plugin: its inputs and its results."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

import numpy as np

from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.dones.shared import SharedDoneFunction
from safe_inspect.glues.base import ActionGlue, Bounds, Glue, ObservationGlue
from safe_inspect.glues.normalizers import Normalizer
from safe_inspect.metrics.base import BaseMetric, Metric, Reduce, TeamMetric
from safe_inspect.platforms.base import Controller, Part, Platform, Sensor
from safe_inspect.rewards.base import Reward
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.simulators.row_plugin import RowPlugin
from safe_inspect.simulators.view import Step, View
from safe_inspect.testing.calls import (
    Call,
    Check,
    SampleParts,
    Shape,
    check_alone,
    check_bounds,
    check_call,
    each_team,
    each_world,
    spread,
)
from safe_inspect.testing.constraints import check_constraint
from safe_inspect.testing.rendezvous import RENDEZVOUS_CHECKS
from safe_inspect.testing.report import Report
from safe_inspect.testing.samples import ROWS, sample_spec, sample_states, sample_team_steps
from safe_inspect.testing.simulation import SIMULATION_CHECKS
from safe_inspect.testing.teams import TEAM_CHECKS, check_shared_done


def _check_reward(plugin: Reward, parts: SampleParts, report: Report) -> None:
    """Check a reward: it must return float (R,)."""
    for step in each_world(plugin, parts, report):
        check_call(Call("the reward", plugin, {"step": step}), report)
        _check_row_kernel(plugin, step, report)


def _check_done(plugin: DoneFunction | SharedDoneFunction, parts: SampleParts, report: Report) -> None:
    """Check a done function: it must return bool (R,) and have a status that ends an episode; or one for all agents."""
    if isinstance(plugin, SharedDoneFunction):
        check_shared_done(plugin, parts, report)
        return
    status = getattr(plugin, "status", None)
    report.expect(
        status in (DoneStatus.WIN, DoneStatus.LOSE, DoneStatus.DRAW),
        "status",
        f"the class attribute `status` is {status!r}",
        "set it to DoneStatus.WIN, DoneStatus.LOSE or DoneStatus.DRAW",
    )
    for step in each_world(plugin, parts, report):
        check_call(Call("the done function", plugin, {"step": step}, Shape((), "b")), report)
        _check_row_kernel(plugin, step, report)
        _check_memory(plugin, step, "done function", parts, report)


def _check_row_kernel(plugin: RowPlugin, seen: View | Step, report: Report) -> None:
    """Check that a row kernel gives the same values as a batch call that is defined as well."""
    view = seen.after if isinstance(seen, Step) else seen
    if type(plugin).__call__ is RowPlugin.call_rows:
        return  # The batch call uses the kernel.
    with report.attempt("the row kernel"):
        if plugin.row(view.world, view.group) is not None:
            report.expect(
                plugin.call_rows(seen).tobytes() == np.asarray(plugin(seen)).tobytes(),  # type: ignore[operator]
                "row kernel",
                "`row` gives other values than `__call__`",
                "define one of them; or let `row` return None where the batch is called",
            )


def _check_part(plugin: Part, parts: SampleParts, report: Report) -> None:
    """Check a part of a platform: a sensor or a controller."""
    if isinstance(plugin, Sensor):
        _check_sensor(plugin, parts, report)
    elif isinstance(plugin, Controller):
        _check_controller(plugin, report)
    else:
        report.add(
            "part", f"{type(plugin).__name__} is neither a sensor nor a controller", "extend Sensor or Controller"
        )


def _check_sensor(plugin: Sensor, parts: SampleParts, report: Report) -> None:
    size = plugin.size
    report.expect(
        len(set(plugin.element_names)) == size > 0,
        "elements",
        f"the names of its elements (`elements`, or `element_names`) are {plugin.element_names}",
        "name every element of the reading once",
    )
    shape = Shape((size,), "f", f"(R, {size})")
    for step in each_world(plugin, parts, report):
        reading = check_call(Call("the sensor", plugin, {"the state": step.after}, shape), report)
        if reading is not None:
            low, high = plugin.limits
            check_bounds(reading, np.full(size, low), np.full(size, high), "the reading", "the sensor", report)
        _check_row_kernel(plugin, step.after, report)
        _check_memory(plugin, step, "sensor", parts, report)


def _check_memory(plugin: DoneFunction | Sensor, step: Step, what: str, parts: SampleParts, report: Report) -> None:
    """Check that a plugin's memory of an environment, if it has one, does not depend on the other environments."""
    if plugin.memory(step.after.world):
        check_alone(
            sample_spec(plugin, parts=parts, deputies=step.after.group.size),
            lambda flown: {"": plugin(flown.step.after) if isinstance(plugin, Sensor) else plugin(flown.step)},
            f"the {what} gives another value alone than in a batch",
            "let `remember` compute each row from itself, and draw from `view.state.key` alone",
            report,
        )


def _check_controller(plugin: Controller, report: Report) -> None:
    low, high = plugin.limits
    right = isinstance(low, np.ndarray) and low.shape == high.shape == (plugin.size,) and bool((low < high).all())
    remedy = "return two arrays of shape (size,), the first below the second"
    if not report.expect(right, "limits", f"the limits are {low} and {high}", remedy):
        return
    size = plugin.control_size
    what = "(R, 3), thrust [N]" if size == 3 else f"(R, {size}), control [N, N m]"
    values = {"the values": spread(low, high)}
    check_call(Call("the controller", plugin, values, Shape((size,), "f", what)), report)


def _check_normalizer(plugin: Normalizer, parts: SampleParts, report: Report) -> None:
    """Check a normaliser: float (R, k), in both directions."""
    sizes = [size for size in range(1, 17) if _fits(plugin, size)]
    if not report.expect(sizes, "check", "`check` accepts no number of elements from 1 to 16", "accept the right one"):
        return
    size = 3 if 3 in sizes else sizes[0]
    low, high = -np.arange(1.0, size + 1.0), 2.0 * np.arange(1.0, size + 1.0)
    low.flags.writeable = high.flags.writeable = False
    values, shape = spread(low, high), Shape((size,), "f", "(R, k)")
    normal = check_call(
        Call("the normaliser", lambda given: plugin(given, low, high), {"the values": values}, shape), report
    )
    if normal is None:
        return
    back = check_call(
        Call("`inverse`", lambda given: plugin.inverse(given, low, high), {"the values": normal}, shape), report
    )
    report.expect(
        back is None or np.allclose(back, values, rtol=1e-9, atol=1e-12),
        "inverse",
        "`inverse` does not give the values back",
        "let inverse(normalizer(x)) be x for every x within the bounds",
    )


def _fits(plugin: Normalizer, size: int) -> bool:
    try:
        plugin.check(size, -np.ones(size), np.ones(size))
    except ValueError:
        return False
    return True


def _check_platform(plugin: Platform, parts: SampleParts, report: Report) -> None:
    """Check a platform: it must return the names of its parts, or raise ValueError if they do not fit it."""
    own = tuple(sample_spec().agents[0].parts.values())
    with report.attempt("the platform"):
        try:
            names = plugin(own)
        except ValueError:
            own = ()
            names = plugin(own)
        wanted = tuple(part.part_name for part in own)
        report.expect(names == wanted, "parts", f"the platform returned {names}", f"return the parts' names, {wanted}")


def _check_glue(plugin: Glue, parts: SampleParts, report: Report) -> None:
    """Check a glue: its names and bounds, and its part of the observation (R, size) or its thrust (R, 3)."""
    named = sample_spec(plugin, parts=parts).agents[0].parts
    bounds: Bounds | None = None
    with report.attempt("`names` or `bounds`"):
        names, bounds = plugin.names(named), plugin.bounds(named)
    if bounds is None:
        return
    size = len(names)
    low, high = bounds
    right = all(isinstance(bound, np.ndarray) and bound.shape == (size,) for bound in bounds)
    remedy = f"return two arrays of shape ({size},), one number for each of the names {names}"
    if not report.expect(right, "bounds", f"the bounds are {low} and {high}", remedy):
        return
    report.expect((low <= high).all(), "bounds", f"a lower bound is above the upper: {low}, {high}", "swap them")
    report.expect(len(set(names)) == size, "names", f"a name occurs twice in {names}", "name every element once")
    if isinstance(plugin, ObservationGlue):
        shape = Shape((size,), "f", f"(R, {size})")
        for step in each_world(plugin, parts, report):
            values = check_call(Call("the glue", plugin, {"the state": step.after}, shape), report)
            if values is not None:
                check_bounds(values, low, high, "the observation", "`bounds`", report)
    elif isinstance(plugin, ActionGlue):
        actions = {"the action": spread(low, high) if size else np.zeros((ROWS, 0)), "the parts": named}
        check_call(Call("the glue", plugin, actions, Shape((3,), "f", "(R, 3), thrust [N]")), report)
        if isinstance(plugin, SafetyGlue):
            shape = Shape((), "b", "(R,) for each constraint")
            check_call(Call("`refusals`", plugin.refusals, {"the states": sample_states()}, shape), report)
    else:
        report.add("glue", f"{type(plugin).__name__} is neither kind of glue", "extend ObservationGlue or ActionGlue")


def _check_metric(plugin: BaseMetric, parts: SampleParts, report: Report) -> None:
    """Check a metric: float (R,) or (N,), NaN allowed; a unit, a reduction, and a label."""
    reduce = getattr(plugin, "reduce", None)
    report.expect(
        reduce in get_args(Reduce),
        "reduce",
        f"the class attribute `reduce` is {reduce!r}",
        f"set it to one of {', '.join(get_args(Reduce))}",
    )
    for name in ("unit", "label"):
        value = getattr(plugin, name, None)
        right = isinstance(value, str) and value != ""
        report.expect(right, name, f"its `{name}` is {value!r}", "give a text; the unit of a pure number is '-'")
    if isinstance(plugin, Metric):
        _check_own(plugin, parts, report)
    elif isinstance(plugin, TeamMetric):
        _check_team(plugin, parts, report)
    else:
        report.add("base", f"{type(plugin).__name__} is not a metric of agents or teams", "extend Metric or TeamMetric")


def _check_own(plugin: Metric, parts: SampleParts, report: Report) -> None:
    def measure(step: Step) -> Any:
        return _without_nan(plugin(step))

    def conclude(step: Step) -> Any:
        some, none = plugin(step), np.full(step.after.num_rows, np.nan)
        return np.asarray(_without_nan(plugin.conclude(some, step)) + _without_nan(plugin.conclude(none, step)))

    for step in each_world(plugin, parts, report):
        check_call(Call("the metric", measure, {"step": step}), report)
        if type(plugin).conclude is not Metric.conclude:
            check_call(Call("`conclude`", conclude, {"step": step}), report)


def _check_team(plugin: TeamMetric, parts: SampleParts, report: Report) -> None:
    for deputies in each_team(plugin, report):
        step = replace(sample_team_steps(None, ROWS, parts=parts, deputies=deputies), fired={}, has={})
        call = Call("the metric", lambda given: _without_nan(plugin(given)), {"step": step}, Shape((), "f", "(N,)"))
        check_call(call, report)


def _without_nan(value: Any) -> Any:
    """Replace NaN, which means that there is no value, by a number; infinity remains and is a breach."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        return np.where(np.isnan(value), -1.2345, value)
    return value


#: The check of each kind of plugin.
CHECKS: dict[str, Check] = {
    "constraint": check_constraint,
    "done": _check_done,
    "glue": _check_glue,
    "metric": _check_metric,
    "normalizer": _check_normalizer,
    "part": _check_part,
    "platform": _check_platform,
    "reward": _check_reward,
    **RENDEZVOUS_CHECKS,
    **SIMULATION_CHECKS,
    **TEAM_CHECKS,
}
