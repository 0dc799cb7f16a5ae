"""Conditions under which two evaluations are comparable, and the default metrics of a task."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic_core import PydanticCustomError

from safe_inspect import metrics
from safe_inspect.config.loading.loader import parse
from safe_inspect.config.report import functor_mistakes
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.layout import action_layout
from safe_inspect.errors import Location, SafeInspectError
from safe_inspect.metrics import BaseMetric, SmallestPhi
from safe_inspect.platforms.base import Sensor
from safe_inspect.plugins.functor import build, describe
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.sets import constraint_set
from safe_inspect.rta.constraints.sun_cone import SunKeepOut
from safe_inspect.tasks.inspection.sun import leaves_plane

#: Fields of a simulator that affect nothing but rewards.
_PRICES = ("steps_until_update", "delta_v_scale_bounds", "delta_v_scale_step", "inspected_points_update_bounds")


def task_of(spec: EnvironmentSpec) -> dict[str, Any]:
    """Return the part of a task that two evaluations must share to be comparable.

    It consists of the simulator, the step size, the masses of the agents and the end conditions. Observations, actions,
    rewards and safety filters may differ. The initial states of the episodes are compared separately.
    """
    simulator = describe(spec.simulator)
    config = {name: value for name, value in simulator["config"].items() if name not in _PRICES}
    task = {
        "simulator": {**simulator, "config": config},
        "step_size": spec.step_size,
        "agents": [
            {"name": agent.name, "mass": spec.platforms[agent.platform].mass, "dones": _described(agent.dones)}
            for agent in spec.agents
        ],
        "shared_dones": _described(spec.shared_dones),
    }
    plain: dict[str, Any] = json.loads(json.dumps(task, default=str))
    return plain


def price_of(spec: EnvironmentSpec) -> str:
    """Return a short hash of everything that determines the rewards; returns are comparable only if it is the same."""
    simulator = describe(spec.simulator)["config"]
    prices = {name: simulator.get(name) for name in _PRICES}
    rewards = {agent.name: _described(agent.rewards) for agent in spec.agents}
    text = json.dumps([prices, rewards], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _points_of(spec: EnvironmentSpec) -> tuple[str, ...]:
    """Return the names of the bodies that have inspection points."""
    return tuple(getattr(spec.simulator, "inspection_points_map", ()))


def default_metrics(spec: EnvironmentSpec) -> list[BaseMetric]:
    """Return the default metrics of a task: ranges, speed, interventions, coverage, errors and phi of each constraint.

    The constraints are those of the agents' safety glues and of the team filter, with their parameters, whether or not
    these are enabled.
    """
    glues = [glue for agent in spec.agents for glue in agent.action_glues if isinstance(glue, SafetyGlue)]
    usual: list[BaseMetric] = [metrics.Interventions()]
    if any(action_layout(agent).coast is not None for agent in spec.agents):
        usual.append(metrics.Decisions())
    bodies = [name for name in (*_points_of(spec), *spec.reset.entities) if name in spec.reset.entities]
    if bodies:
        usual += [
            cls(entity_name=bodies[0]) for cls in (metrics.SmallestRange, metrics.LargestRange, metrics.LargestSpeed)
        ]
    for name in _points_of(spec)[:1]:
        usual += [
            metrics.TimeToCoverage(inspection_entity_name=name),
            metrics.DeltaVAfterLastPoint(inspection_entity_name=name),
        ]
    found: dict[str, BaseMetric] = {}
    if any(component.estimates for component in spec.simulator.disturbance):
        usual += [metrics.EstimateError(quantity=quantity) for quantity in ("position", "velocity")]
    for agent in spec.agents:
        inaccurate = [part for part in agent.parts.values() if isinstance(part, Sensor) and part.errors is not None]
        for error in [metrics.ReadingError(sensor=part.part_name, symbol=part.symbol) for part in inaccurate]:
            found.setdefault(error.label, error)
    for filtering in (*glues, spec.team_safety):
        for metric in _constraints(filtering) if filtering is not None else ():
            found.setdefault(metric.label, metric)
    if leaves_plane(*spec.simulator.compose()):
        found = {name: one for name, one in found.items() if not isinstance(getattr(one, "constraint", 0), SunKeepOut)}
    several = len(spec.agents) > 1
    return usual + [
        metric
        for metric in found.values()
        if several or not (isinstance(metric, SmallestPhi) and metric.about == "deputies")
    ]


def read_metrics(texts: Iterable[str]) -> list[BaseMetric]:
    """Return the metrics that are named on the command line.

    Args:
        texts: One text per metric: a registered name, a dotted path to a class, or a YAML mapping such as ``{functor:
            TimeToCoverage, config: {fraction: 0.5}}``.

    Raises:
        SafeInspectError: There is no such metric, or its fields are invalid.
    """
    made: list[BaseMetric] = []
    for text in texts:
        try:
            value = parse(text, Location("--metric", 0, text=text)) if text.lstrip().startswith("{") else text
            plugin = build("metric", value)
        except PydanticCustomError as error:
            raise SafeInspectError(f"--metric {text}: {functor_mistakes(error)}") from None
        assert isinstance(plugin, BaseMetric), "the registry returns a plugin of the requested kind"
        made.append(plugin)
    return made


def _constraints(filtering: Any) -> list[SmallestPhi]:
    """Return a metric for each constraint that a filter lists in its field `constraints`, as this package's filters do.

    Other filters give an empty list.
    """
    fields = {name: getattr(filtering, name) for name in type(filtering).model_fields}
    names = fields.get("constraints")
    if not isinstance(names, tuple):
        return []
    given = {name: value for name, value in fields.items() if name in ConstraintParameters.model_fields}
    return [
        SmallestPhi(constraint=constraint, about="deputies" if constraint.pair else "chief")
        for constraint in constraint_set(given, names, fields.get("deputy_radius")).values()
    ]


def _described(items: Iterable[Any]) -> list[Mapping[str, Any]]:
    """Return named functors as mappings, with defaults written out."""
    return [{"name": item.name, **describe(item.functor)} for item in items]


def differences(one: Any, other: Any, path: str = "", missing: Any = None) -> Iterable[tuple[str, Any, Any]]:
    """Yield the paths at which two configurations differ, with both values; that of a missing key is `missing`."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in dict.fromkeys([*one, *other]):
            where = f"{path}.{key}" if path else str(key)
            yield from differences(one.get(key, missing), other.get(key, missing), where, missing)
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for index, pair in enumerate(zip(one, other, strict=True)):
            yield from differences(*pair, f"{path}[{index}]", missing)
    elif one != other:
        yield path, one, other


def differing_keys(one: Any, other: Any) -> list[str]:
    """Return the paths of the keys at which two tasks differ."""
    return [path for path, _, _ in differences(one, other)]
