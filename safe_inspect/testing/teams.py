"""Contract of plugins for several deputies: shared done functions, scripted policies and teams' safety filters."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.dones.shared import SharedDoneFunction
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.policies.base import SCRIPTED_POLICY, ScriptedPolicy, ThrustLimits
from safe_inspect.rta.base import TeamSafety
from safe_inspect.rta.filters import INTERVENTION_THRESHOLD
from safe_inspect.simulators.team import TeamView
from safe_inspect.simulators.view import View
from safe_inspect.testing.calls import (
    Call,
    Check,
    SampleParts,
    Shape,
    check_alone,
    check_call,
    each_team,
    each_world,
    with_deputies,
)
from safe_inspect.testing.report import Report
from safe_inspect.testing.samples import DEPUTIES, ROWS, sample_spec, sample_team_steps
from safe_inspect.types import AnyArray, FloatArray

#: Environments of a sample for slow plugins.
FEW_ROWS = 16


def check_shared_done(plugin: SharedDoneFunction, parts: SampleParts, report: Report) -> None:
    """Check a shared done function: it must return a `DoneStatus` for each environment, int8 (N,)."""
    for deputies in each_team(plugin, report):
        step = sample_team_steps(plugin, ROWS, parts=parts, deputies=deputies)
        shape = Shape((), "i", "(N,), int8")
        given = check_call(Call("the shared done function", plugin, {"step": step}, shape), report)
        unknown = sorted(set([] if given is None else given.tolist()) - {int(status) for status in DoneStatus})
        report.expect(
            not unknown, "status", f"it gave the status {unknown}", "give 0 or a DoneStatus: WIN, LOSE or DRAW"
        )


def _check_policy(plugin: ScriptedPolicy, parts: SampleParts, report: Report) -> None:
    """Check a scripted policy: thrust [N] (R, 3), or the control of a vehicle with attitude [N, N m] (R, 6)."""
    size = 6 if plugin.commands_attitude else 3
    limits = ThrustLimits(np.full(size, -1.0), np.full(size, 1.0))
    for array in (limits.low, limits.high):
        array.flags.writeable = False

    def fly(view: View) -> Any:
        own = [array for key, array in view.writable.memory.items() if key[:2] == (view.group.name, SCRIPTED_POLICY)]
        kept = [array.copy() for array in own]
        view.remembering = SCRIPTED_POLICY
        try:
            return plugin(view, limits)
        finally:  # The policy may write to its memory, but to nothing else.
            for array, value in zip(own, kept, strict=True):
                array[...] = value

    shape = Shape((size,), "f", f"(R, {size}), control [N, N m]" if size > 3 else "(R, 3), thrust [N]")
    for step in each_world(plugin, parts, report, FEW_ROWS):
        check_call(Call("the policy", fly, {"the state": step.after}, shape, rows=FEW_ROWS), report)
        _check_flight(plugin, parts, step.after.group.size, report)


def _check_team_safety(plugin: TeamSafety, parts: SampleParts, report: Report) -> None:
    """Check a team's safety filter: its thrusts [N] (N, D, 3), its flags, and the states that it rejects."""
    for deputies in each_team(plugin, report):
        if plugin.enabled and _remembers_what_it_declares(plugin, deputies, report):
            _check_filter(plugin, parts, deputies, report)
            _check_flight(plugin, parts, deputies, report)
    team = sample_team_steps(None, ROWS).after
    shape = Shape((), "f", "(R,) for each constraint")
    for deputies in range(1, DEPUTIES + 1):
        position, velocity = team.position[:, :deputies], team.velocity[:, :deputies]
        states = {"the states": {"position": position, "velocity": velocity, "sun_angle": team.sun_angle}}
        for name, function, kind in (("refusals", plugin.refusals, "b"), ("safety", plugin.safety, "f")):
            call = Call(with_deputies(f"`{name}`", deputies), function, states, replace(shape, kind=kind))
            check_call(call, report)


def _remembers_what_it_declares(plugin: TeamSafety, deputies: int, report: Report) -> bool:
    environment = TeamEnvironment(sample_spec(plugin, deputies=deputies), 2)
    environment.reset()
    given = plugin(np.zeros((2, deputies, 3)), environment.team())
    unknown = sorted(set(given.memory) - set(plugin.memory(environment.simulation.world)))
    return report.expect(
        not unknown, "memory", f"it remembers {unknown}, which it has not declared", "declare it in `memory`"
    )


def _check_filter(plugin: TeamSafety, parts: SampleParts, deputies: int, report: Report) -> None:
    sample = sample_team_steps(plugin, FEW_ROWS, parts=parts, deputies=deputies).after
    desired = np.random.default_rng(3).uniform(-1.0, 1.0, (FEW_ROWS, deputies, 3))

    def run(thrust: FloatArray, team: TeamView) -> dict[str, AnyArray]:
        given = plugin(thrust, team)
        found = {name: getattr(given, name) for name in ("control", "intervening", "infeasible", "backup")}
        return {**found, **{f"memory {name}": array for name, array in given.memory.items()}}

    shapes = {
        "control": Shape((deputies, 3), "f", "(N, D, 3), thrust [N]"),
        "intervening": Shape((deputies,), "b", "(N, D)"),
        "infeasible": Shape((), "b", "(N,)"),
        "backup": Shape((), "b", "(N,)"),
    }
    for name, spec in plugin.memory(sample.world).items():
        shapes[f"memory {name}"] = Shape(spec.shape, np.dtype(spec.dtype).kind, f"(N, ...) with {spec.shape} behind N")
    arguments = {"the desired thrust": desired, "the state": sample}
    found = check_call(Call("the filter", run, arguments, Shape(None, ""), shapes, FEW_ROWS), report)
    if found is not None:
        changed = ((found["control"] - desired) ** 2).sum(axis=-1) > INTERVENTION_THRESHOLD**2
        wrong = (changed != found["intervening"]) & (sample.finished == 0)
        report.expect(
            not wrong.any(),
            "intervening",
            f"`intervening` is wrong for {int(wrong.sum())} of {wrong.size} deputies",
            f"set it where the thrust differs from the desired one by more than {INTERVENTION_THRESHOLD} N",
        )


def _check_flight(plugin: ScriptedPolicy | TeamSafety, parts: SampleParts, deputies: int, report: Report) -> None:
    """Check that an environment evolves identically alone and in a batch, including the memory of the plugin."""
    check_alone(
        sample_spec(plugin, parts=parts, deputies=deputies),
        lambda flown: {"control": flown.step.control, **flown.step.after.state.arrays},
        with_deputies("a deputy moves differently alone than in a batch", deputies),
        "compute each row from itself, remember in declared arrays alone, and draw from `state.key` alone",
        report,
    )


TEAM_CHECKS: dict[str, Check] = {"policy": _check_policy, "rta": _check_team_safety}
