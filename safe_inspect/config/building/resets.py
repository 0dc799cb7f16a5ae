"""Construction of a `ResetPlan` from the reset parameters, with the checks that involve several of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from pydantic_core import PydanticCustomError

from safe_inspect.config.messages.report import KeyTuple, ReportProblem
from safe_inspect.config.models.experiment import EntityConfig, ExperimentConfig
from safe_inspect.dynamics.base import Dynamics
from safe_inspect.errors import did_you_mean
from safe_inspect.plugins.registry import registry
from safe_inspect.rta.rejection_sampler import RejectionSampler, check_parameters
from safe_inspect.simulators.component import Component
from safe_inspect.simulators.resets.initializers import PositionVelocityInitializer, RejectionSamplerInitializer
from safe_inspect.simulators.resets.parameters import Parameter, ScalarParameter, SimAttributeAccessor
from safe_inspect.simulators.resets.plan import BodyReset, EnvironmentDraw, ResetPlan

_RESET: KeyTuple = ("config", "config", "env_config", "simulator_reset_parameters")
_STATES = ("position", "velocity")


def reset_plan(config: ExperimentConfig, report: ReportProblem) -> ResetPlan:
    """Return the plan of a reset: the distribution of initial states.

    Args:
        config: The validated models.
        report: Function that is called with the path and the message of every mistake.
    """
    drawn = config.environment.simulator_reset_parameters
    parameters: dict[str, Parameter] = dict(drawn.__pydantic_extra__ or {})
    dynamics, components = config.environment.simulator.compose()
    read = [component.parameters for component in components]
    read += [{name: unit} for name, unit in dynamics.parameters.items()]
    _check_parameters(parameters, read, report)
    for plugin in (dynamics, *components):
        _check_ranges(plugin, parameters, report)
    entities: dict[str, BodyReset] = {}
    environment: dict[str, EnvironmentDraw] = {}
    platforms = {entry.name for entry in config.platform_config}
    for name, entity in drawn.additional_entities.items():
        where = (*_RESET, "additional_entities", name)
        if entity.entity_class is not None:
            for item in _drawn_for(entity.entity_class, entity, parameters, where, report):
                if item.name in environment:
                    report(where, f"there is more than one {entity.entity_class}; remove one of them")
                environment[item.name] = item
        elif entity.initializer is None and entity.platform is None:
            report(where, "a body needs a `platform` or an `initializer`, a component needs an `entity_class`")
        else:
            if name in platforms:
                report(where, f"a platform is also named {name!r}; give the body another name")
            entities[name] = BodyReset(entity.initializer or PositionVelocityInitializer(), entity.config)
            _check_body(entities[name], parameters, where, report)
    deputies: dict[str, BodyReset] = {}
    for index, agent in enumerate(config.agent_config):
        begin = agent.body.simulator_reset_parameters
        body = BodyReset(begin.initializer, begin.config)
        _check_body(body, parameters, ("agent_config", index, "config", "config", _RESET[-1]), report)
        deputies |= dict.fromkeys(agent.platforms[:1], body)
    takers = [taken for body in (*deputies.values(), *entities.values()) for taken in body.parameters.values()]
    takers += [*parameters.values(), *(item.parameter for item in environment.values())]
    used = {_source(accessor)[0] for accessor in _accessors(takers)}
    known = used.union(*read)
    for name in parameters:
        if name not in known:
            hint = _user_of(name) or did_you_mean(name, known)
            report((*_RESET, name), f"nothing uses the reset parameter {name!r}; {hint}")
    return ResetPlan(parameters, deputies, entities, tuple(environment.values()))


def _check_ranges(
    plugin: Dynamics | Component, parameters: Mapping[str, Parameter], report: ReportProblem
) -> None:  # fmt: skip
    """Check that the reset parameters that a plugin reads are within its allowed ranges, and have no wrong unit."""
    for name, (low, high) in plugin.allowed.items():
        parameter, symbol = parameters.get(name), plugin.parameters.get(name)
        if not isinstance(parameter, ScalarParameter):
            continue
        if symbol == "" and parameter.symbol:
            report((*_RESET, name, "config", "units"), f"{name!r} is a number without a unit; remove `units`")
            continue
        least, most = parameter.support or (low, high)
        if not low <= least <= most <= high:
            unit = f" {symbol}" if symbol else ""
            text = (
                f"it is between {least:g} and {most:g}{unit}, but {plugin.registered_name} allows {low:g} to {high:g}"
            )
            hint = "; are `units: deg` missing?" if symbol == "rad" and parameter.units is None else ""
            report((*_RESET, name), f"{text}{unit}{hint or '; change one of them'}")


def _user_of(name: str) -> str:
    """Return which other dynamics or components use a reset parameter of that name; empty if there are none."""
    for _, cls in registry.items("dynamics"):
        if name in cls.parameters:
            return f"the dynamics {cls.registered_name} use it"
    for _, cls in registry.items("component"):
        if name in cls.optional_parameters:
            return f"{cls.registered_name} uses it if {cls.optional_parameters[name]}"
    return ""


def _check_parameters(
    parameters: Mapping[str, Parameter], read: Iterable[Mapping[str, str | None]], report: ReportProblem
) -> None:
    """Check the reset parameters, including that those of a component are either all given or all missing."""
    before: dict[str, Parameter] = {}
    for name, parameter in parameters.items():
        if isinstance(parameter, RejectionSampler):
            for key, inner in parameter.wrapped.items():
                _check_taken(inner, "", before, (*_RESET, name, "wrapped", key), report)
        elif isinstance(parameter, SimAttributeAccessor):
            _check_source(parameter, before, (*_RESET, name), report)
        before[name] = parameter
    for units in read:
        given = [name for name in units if name in parameters]
        for name in given:
            _check_taken(parameters[name], units[name], before, (*_RESET, name), report)
            if len(given) < len(units):
                missing = next(other for other in units if other not in given)
                report((*_RESET, name), f"`{missing}` is also required; add it, or remove this one")


def _drawn_for(
    name: str, entity: EntityConfig, parameters: Mapping[str, Parameter], where: KeyTuple, report: ReportProblem
) -> Iterator[EnvironmentDraw]:
    """Yield the sampled parameters of a component that is listed among the bodies."""
    taken = registry.get("component", name).entity
    for key in [key for key in entity.config if key not in taken]:
        report((*where, "config", key), f"a {name} takes only {' and '.join(f'`{other}`' for other in taken)}")
    for key in ("platform", "initializer"):
        if getattr(entity, key) is not None:
            report((*where, key), f"a {name} takes no `{key}`; remove it")
    for key, told in taken.items():
        if key not in entity.config:
            report(where, f"a {name} needs `{key}`, which is sampled at a reset")
            continue
        _check_taken(entity.config[key], told.symbol, parameters, (*where, "config", key), report)
        yield EnvironmentDraw(told.value, told.purpose, entity.config[key])


def _check_body(body: BodyReset, parameters: Mapping[str, Parameter], where: KeyTuple, report: ReportProblem) -> None:
    """Check that a body's initialiser gets its parameters, and that they determine a position and a velocity."""
    initializer = body.initializer
    try:
        check_parameters(initializer, body.parameters, "config")
    except PydanticCustomError as error:
        for problem in (error.context or {})["errors"]:
            report((*where, *problem["loc"]), problem["msg"])
    sources = {
        key: _check_taken(parameter, initializer.parameters[key], parameters, (*where, "config", key), report)
        for key, parameter in body.parameters.items()
        if key in initializer.parameters
    }
    given: Iterable[str] = initializer.gives
    if isinstance(initializer, RejectionSamplerInitializer):
        given = initializer.states
        source = sources.get("init_state")
        known = source.initializer.gives if isinstance(source, RejectionSampler) else {}
        for index, state in enumerate(initializer.states if known else ()):
            if state not in known:
                given = ()
                place = (*where, "initializer", "config", "states", index)
                report(place, f"the sampler has no state {state!r}; {did_you_mean(state, known)}")
    missing = [state for state in _STATES if state not in given]
    if given and missing:
        text = f"a body needs an initial {' and '.join(missing)}; only {sorted(given)} are given"
        report((*where, "initializer"), text)


def _check_taken(
    parameter: Parameter,
    symbol: str | None,
    parameters: Mapping[str, Parameter],
    where: KeyTuple,
    report: ReportProblem,
) -> Parameter | None:
    """Check that a parameter has the expected kind and unit, and return where its value is sampled.

    Args:
        parameter: A parameter or an accessor to another parameter.
        symbol: SI unit of the expected number, empty for any unit; None if the states of a body are expected.
        parameters: Parameters that an accessor may name.
        where: Path of the parameter.
        report: Function that is called with the path and the message of every mistake.
    """
    source, state, place = parameter, "", where
    if isinstance(parameter, SimAttributeAccessor):
        found = _check_source(parameter, parameters, where, report)
        if found is None:
            return None
        source, state, place = found, _source(parameter)[1], (*where, "config", "attribute_name")
    named = f"`{parameter.attribute_name}`" if isinstance(parameter, SimAttributeAccessor) else "this"
    given = source.initializer.gives if isinstance(source, RejectionSampler) else {}
    if symbol is None:
        if state or isinstance(source, ScalarParameter):
            wanted = "expected the states of a body here, such as those of a RejectionSampler"
            report(place, f"{named} is a single value; {wanted}")
    elif state:
        if given.get(state, 1) != 1:
            report(place, f"{named} has {given[state]} elements; expected one number here")
    elif isinstance(source, RejectionSampler):
        report(place, f"{named} is a set of states; expected one number here, such as one of {sorted(given)}")
    elif symbol and source.symbol not in (None, symbol):
        report(place if source is not parameter else (*where, "config", "units"),
               f"{named} has the unit {source.symbol}, but {symbol} is required")  # fmt: skip
    return source


def _check_source(
    accessor: SimAttributeAccessor, parameters: Mapping[str, Parameter], where: KeyTuple, report: ReportProblem
) -> Parameter | None:
    """Return the reset parameter that an accessor names, which must come before it, or None if there is none."""
    name, state = _source(accessor)
    where = (*where, "config", "attribute_name")
    if name not in parameters:
        report(where, f"there is no reset parameter {name!r}; {did_you_mean(name, parameters)}")
        return None
    source = parameters[name]
    if isinstance(source, SimAttributeAccessor):
        report(where, f"{name!r} is an accessor itself; name its own source, `{source.attribute_name}`")
        return None
    states = source.initializer.gives if isinstance(source, RejectionSampler) else {}
    if state and state not in states and (states or isinstance(source, ScalarParameter)):
        report(where, f"{name!r} has no state {state!r}; {did_you_mean(state, states)}")
        return None
    return source


def _source(accessor: SimAttributeAccessor) -> tuple[str, str]:
    """Return the parameter and the state (may be empty) that an accessor names."""
    name, _, state = accessor.attribute_name.partition(".")
    return name, state


def _accessors(parameters: Iterable[Parameter | None]) -> Iterator[SimAttributeAccessor]:
    for parameter in parameters:
        if isinstance(parameter, SimAttributeAccessor):
            yield parameter
        elif isinstance(parameter, RejectionSampler):
            yield from _accessors(parameter.wrapped.values())
