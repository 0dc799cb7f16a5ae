"""The command ``safe-inspect bounds``."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from safe_inspect.config.building.disturbances import disturbances, kept_by, required
from safe_inspect.config.experiment import Experiment, load_experiment
from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.errors import ConfigError, Problem
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.tasks.inspection.sun import leaves_plane

#: Paths of the mistakes that say why a filter cannot be enabled.
_REFUSED = re.compile(r"(.*)\.config\.(disturbance(\.\w+)?|enabled|constraints)")
_COLUMNS = {
    "velocity": "velocity [m/s]", "position_error": "position [m]", "velocity_error": "velocity error [m/s]",
    "thrust_gain": "thrust [-]", "thrust_direction": "direction [rad]",
}  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Print what disturbs the motion that the safety filter assumes, and whether that is tolerated.

    Orbits, thrusters and estimates declare bounds, which are added up; exits with 1 if the filter needs more.

    Example:
        safe-inspect bounds configs/translational-inspection/experiment-burn-and-coast-orbits.yml
    """
    experiment, problems = _load(arguments)
    refused = {problem.path.partition(".")[0] for problem in problems}
    found = list(_filters(experiment))
    if not found:
        raise ConfigError(f"{arguments.cfg}: there is no safety filter; wrap the controllers in one")
    used = [each for each in found if each[2].enabled or each[0] in refused] or found
    tolerated = []
    for number, (_, name, plugin) in enumerate(used):
        print("\n" * (number > 0), end="")
        tolerated.append(_print_filter(experiment, name, plugin))
    printed = re.compile("disturbance|circular orbit")
    others = [problem for problem in problems if not printed.search(f"{problem.path} {problem.message}")]
    for problem in others:
        print(f"it is also refused: {problem}")
    return 0 if all(tolerated) and not others else 1


def _load(arguments: argparse.Namespace) -> tuple[Experiment, Sequence[Problem]]:
    """Return the experiment, with the filters disabled that are refused, and why they are."""
    load = partial(load_experiment, arguments.cfg, compute_platform=arguments.compute_platform)
    try:
        return load(arguments.overrides), ()
    except ConfigError as error:
        matches = [_REFUSED.fullmatch(problem.path) for problem in error.problems]
        if not all(matches):
            raise
        paths = dict.fromkeys(match[1] for match in matches if match)
        disabled = [path.replace("[", ".").replace("]", "") + ".config.enabled=False" for path in paths]
        try:
            return load([*arguments.overrides, *disabled]), error.problems
        except ConfigError:  # the mistake is not one of a filter
            raise error from None


def _filters(experiment: Experiment) -> Iterator[tuple[str, str, Any]]:
    """Yield the first key of the path of each filter, its agent or "the team", and the filter; equal ones once."""
    seen: list[Any] = []
    for index, agent in enumerate(experiment.spec.agents):
        for glue in agent.action_glues:
            if isinstance(glue, SafetyGlue) and glue not in seen:
                seen.append(glue)
                yield f"agent_config[{index}]", agent.name, glue
    if experiment.spec.team_safety is not None:
        yield "config", "the team", experiment.spec.team_safety


def _print_filter(experiment: Experiment, name: str, plugin: Any) -> bool:
    """Print the disturbances for a filter; return whether it tolerates them."""
    spec, mass, thrust = experiment.spec, getattr(plugin, "m", 1.0), getattr(plugin, "u_max", 0.0)
    found = disturbances(spec.simulator, plugin, spec.step_size, mass, thrust)
    limits, bounds = found.limits, getattr(plugin, "disturbance", None)
    print(
        f"{name}, {plugin.registered_name}: in a step of {limits.step_size:g} s, within {limits.distance:g} m and "
        f"{limits.speed:.3g} m/s, {mass:g} kg"
    )
    rows = [(part, each) for part, each in found.bounds.items() if each is None or any(each.bounds)]
    rows += [("total", found.total), ("filter", bounds or DisturbanceBounds())]
    width = max(len(part) for part, _ in rows)
    print("  ".join([" " * width, *_COLUMNS.values()]))
    for part, each in rows:
        cells = ["no bound" if each is None else f"{getattr(each, field):.3g}" for field in _COLUMNS]
        lined = [cell.rjust(len(title)) for cell, title in zip(cells, _COLUMNS.values(), strict=True)]
        print("  ".join([part.ljust(width), *lined]))
    exceeded = (bounds or DisturbanceBounds()).exceeded(found.total)
    if found.unknown:
        print(f"{' and '.join(found.unknown)}: no bound, so the filter can give no guarantee")
    elif exceeded:
        print(f"the filter needs `disturbance: {{{required(found.total)}}}`")
    else:
        print("the filter tolerates this")
    if "sun" in kept_by(plugin) and leaves_plane(*spec.simulator.compose()):
        print("the constraint `sun` needs a circular orbit and a sun in its plane: `constraints: {sun: !remove }`")
        return False
    return not exceeded and not found.unknown
