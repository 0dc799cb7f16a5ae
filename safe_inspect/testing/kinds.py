"""Checks for each kind of plugin: its inputs and its results."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.glues.normalizers import Normalizer
from safe_inspect.platforms.base import Controller, Part, Platform, Sensor
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rewards.base import Reward
from safe_inspect.simulators.row_terms.plugin import RowPlugin
from safe_inspect.simulators.view import Step, View
from safe_inspect.testing.calls import Call, Inputs, Shape, check_call
from safe_inspect.testing.constraints import check_constraint
from safe_inspect.testing.flights import fly_twice
from safe_inspect.testing.glues import check_glue
from safe_inspect.testing.metrics import check_metric
from safe_inspect.testing.rendezvous import RENDEZVOUS_KINDS, check_rendezvous
from safe_inspect.testing.report import Report
from safe_inspect.testing.samples import sample_spec
from safe_inspect.testing.simulation import (
    check_component,
    check_dynamics,
    check_initializer,
    check_parameter,
    check_simulator,
)
from safe_inspect.testing.teams import SampleParts, check_policy, check_shared_done, check_team_safety
from safe_inspect.testing.values import ROWS, call_of_step, call_of_view, check_bounds, each_world, spread
from safe_inspect.types import AnyArray


def check_reward(plugin: Reward, parts: SampleParts, report: Report) -> None:
    """Check a reward: it must return float (R,)."""
    for step in each_world(plugin, parts, report):
        check_call(call_of_step("the reward", plugin, step, Shape()), report)
        _check_row_kernel(plugin, step, report)


def check_done(plugin: DoneFunction, parts: SampleParts, report: Report) -> None:
    """Check a done function: it must return bool (R,) and have a status that ends an episode."""
    status = getattr(plugin, "status", None)
    report.expect(
        status in (DoneStatus.WIN, DoneStatus.LOSE, DoneStatus.DRAW),
        "status",
        f"the class attribute `status` is {status!r}",
        "set it to DoneStatus.WIN, DoneStatus.LOSE or DoneStatus.DRAW",
    )
    for step in each_world(plugin, parts, report):
        check_call(call_of_step("the done function", plugin, step, Shape((), "b", "(R,)")), report)
        _check_row_kernel(plugin, step, report)
        if plugin.memory(step.after.world):
            spec = sample_spec(plugin, parts=parts, deputies=step.after.group.size)
            _check_memory(lambda one: plugin(one), "done function", spec, report)


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


def check_part(plugin: Part, parts: SampleParts, report: Report) -> None:
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
        reading = check_call(call_of_view("the sensor", plugin, step, shape), report)
        if reading is not None:
            low, high = plugin.limits
            check_bounds(reading, np.full(size, low), np.full(size, high), "the reading", "the sensor", report)
        _check_row_kernel(plugin, step.after, report)
        if plugin.memory(step.after.world):
            spec = sample_spec(plugin, parts=parts, deputies=step.after.group.size)
            _check_memory(lambda one: plugin(one.after), "sensor", spec, report)


def _check_memory(call: Callable[[Step], AnyArray], what: str, spec: EnvironmentSpec, report: Report) -> None:
    """Check that a plugin's memory of an environment does not depend on the other environments."""
    for together, alone in fly_twice(spec):
        if call(together.step).tobytes() != call(alone.step).tobytes():
            report.add(
                "row-wise",
                f"after {alone.step.after.step[0]} steps the {what} gives another value alone than in a batch",
                "let `remember` compute each row from itself, and draw from `view.state.key` alone",
            )
            return


def _check_controller(plugin: Controller, report: Report) -> None:
    low, high = plugin.limits
    right = isinstance(low, np.ndarray) and low.shape == high.shape == (plugin.size,) and bool((low < high).all())
    remedy = "return two arrays of shape (size,), the first below the second"
    if not report.expect(right, "limits", f"the limits are {low} and {high}", remedy):
        return
    values = spread(low, high, ROWS)

    def make(rows: AnyArray) -> Inputs:
        given = values[rows].copy()
        return Inputs((given,), {"the values": given})

    size = plugin.control_size
    what = "(R, 3), thrust [N]" if size == 3 else f"(R, {size}), control [N, N m]"
    check_call(Call("the controller", plugin, make, ROWS, Shape((size,), "f", what)), report)


def check_normalizer(plugin: Normalizer, parts: SampleParts, report: Report) -> None:
    """Check a normaliser: float (R, k), in both directions."""
    sizes = [size for size in range(1, 17) if _fits(plugin, size)]
    if not report.expect(sizes, "check", "`check` accepts no number of elements from 1 to 16", "accept the right one"):
        return
    size = 3 if 3 in sizes else sizes[0]
    low, high = -np.arange(1.0, size + 1.0), 2.0 * np.arange(1.0, size + 1.0)
    values = spread(low, high, ROWS)

    def make_from(array: AnyArray) -> Callable[[AnyArray], Inputs]:
        def make(rows: AnyArray) -> Inputs:
            arguments = (array[rows].copy(), low.copy(), high.copy())
            return Inputs(arguments, dict(zip(("the values", "`low`", "`high`"), arguments, strict=True)))

        return make

    shape = Shape((size,), "f", "(R, k)")
    normal = check_call(Call("the normaliser", plugin, make_from(values), ROWS, shape), report)
    if normal is None:
        return
    back = check_call(Call("`inverse`", plugin.inverse, make_from(normal.copy()), ROWS, shape), report)
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


def check_platform(plugin: Platform, parts: SampleParts, report: Report) -> None:
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


CHECKS: dict[str, Callable[[Any, SampleParts, Report], None]] = {
    "component": check_component,
    "constraint": check_constraint,
    "done": check_done,
    "dynamics": check_dynamics,
    "glue": check_glue,
    "initializer": check_initializer,
    "metric": check_metric,
    "normalizer": check_normalizer,
    "parameter": check_parameter,
    "part": check_part,
    "platform": check_platform,
    "policy": check_policy,
    "reward": check_reward,
    "rta": check_team_safety,
    "shared_done": check_shared_done,
    "simulator": check_simulator,
    **dict.fromkeys(RENDEZVOUS_KINDS, check_rendezvous),
}


def check_behaviour(plugin: Plugin, parts: SampleParts, report: Report) -> None:
    """Check the results of a plugin; there is no check for a kind that is not part of this package."""
    check = CHECKS.get(plugin.kind)
    if check is not None:
        check(plugin, parts, report)
