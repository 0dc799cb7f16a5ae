"""Construction of a `ResetPlan` from the reset parameters, with the checks that involve several of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from pydantic_core import PydanticCustomError

from safe_inspect.config.loading.located import Place
from safe_inspect.config.models import ENVIRONMENT_PATH, EntityConfig, ExperimentConfig
from safe_inspect.config.report import functor_problems
from safe_inspect.dynamics.base import Dynamics
from safe_inspect.errors import did_you_mean
from safe_inspect.plugins.registry import registry
from safe_inspect.rta.rejection_sampler import RejectionSampler, check_parameters
from safe_inspect.simulators.component import Component
from safe_inspect.simulators.resets.initializers import PositionVelocityInitializer, RejectionSamplerInitializer
from safe_inspect.simulators.resets.parameters import Parameter, ScalarParameter, SimAttributeAccessor
from safe_inspect.simulators.resets.plan import BodyReset, EnvironmentDraw, ResetPlan

_RESET = "simulator_reset_parameters"
_STATES = ("position", "velocity")


def reset_plan(config: ExperimentConfig, root: Place) -> ResetPlan:
    """Return the plan of a reset: the distribution of initial states.

    Args:
        config: The validated models.
        root: Position of the whole configuration.
    """
    drawn, place = config.environment.simulator_reset_parameters, root.at(*ENVIRONMENT_PATH, _RESET)
    parameters: dict[str, Parameter] = dict(drawn.__pydantic_extra__ or {})
    dynamics, components = config.environment.simulator.compose()
    read = [component.parameters for component in components]
    read += [{name: unit} for name, unit in dynamics.parameters.items()]
    _check_parameters(parameters, read, place)
    for plugin in (dynamics, *components):
        _check_ranges(plugin, parameters, place)
    entities: dict[str, BodyReset] = {}
    environment: dict[str, EnvironmentDraw] = {}
    platforms = {entry.name for entry in config.platform_config}
    for name, entity in drawn.additional_entities.items():
        where = place.at("additional_entities", name)
        if entity.entity_class is not None:
            for item in _drawn_for(entity.entity_class, entity, parameters, where):
                if item.name in environment:
                    where.report(f"there is more than one {entity.entity_class}; remove one of them")
                environment[item.name] = item
        elif entity.initializer is None and entity.platform is None:
            where.report("a body needs a `platform` or an `initializer`, a component needs an `entity_class`")
        else:
            if name in platforms:
                where.report(f"a platform is also named {name!r}; give the body another name")
            entities[name] = BodyReset(entity.initializer or PositionVelocityInitializer(), entity.config)
            _check_body(entities[name], parameters, where)
    deputies: dict[str, BodyReset] = {}
    for index, agent in enumerate(config.agent_config):
        begin = agent.body.simulator_reset_parameters
        body = BodyReset(begin.initializer, begin.config)
        _check_body(body, parameters, root.at("agent_config", index, "config", "config", _RESET))
        deputies |= dict.fromkeys(agent.platforms[:1], body)
    takers = [taken for body in (*deputies.values(), *entities.values()) for taken in body.parameters.values()]
    takers += [*parameters.values(), *(item.parameter for item in environment.values())]
    known = {_source(accessor)[0] for accessor in _accessors(takers)}.union(*read)
    for name in parameters:
        if name not in known:
            hint = _user_of(name) or did_you_mean(name, known)
            place.report(f"nothing uses the reset parameter {name!r}; {hint}", name)
    return ResetPlan(parameters, deputies, entities, tuple(environment.values()))


def _check_ranges(plugin: Dynamics | Component, parameters: Mapping[str, Parameter], place: Place) -> None:
    """Check that the reset parameters that a plugin reads are within its allowed ranges, and have no wrong unit."""
    for name, (low, high) in plugin.allowed.items():
        parameter, symbol = parameters.get(name), plugin.parameters.get(name)
        if not isinstance(parameter, ScalarParameter):
            continue
        if symbol == "" and parameter.symbol:
            place.report(f"{name!r} is a number without a unit; remove `units`", name, "config", "units")
            continue
        least, most = parameter.support or (low, high)
        if not low <= least <= most <= high:
            unit = f" {symbol}" if symbol else ""
            text = f"it is between {least:g} and {most:g}{unit}, but {plugin.registered_name} allows "
            hint = "are `units: deg` missing?" if symbol == "rad" and parameter.units is None else "change one of them"
            place.report(f"{text}{low:g} to {high:g}{unit}; {hint}", name)


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
    parameters: Mapping[str, Parameter], read: Iterable[Mapping[str, str | None]], place: Place
) -> None:  # fmt: skip
    """Check the reset parameters, including that those of a component are either all given or all missing."""
    before: dict[str, Parameter] = {}
    for name, parameter in parameters.items():
        if isinstance(parameter, RejectionSampler):
            for key, inner in parameter.wrapped.items():
                _check_taken(inner, "", before, place.at(name, "wrapped", key))
        elif isinstance(parameter, SimAttributeAccessor):
            _check_source(parameter, before, place.at(name))
        before[name] = parameter
    for units in read:
        given = [name for name in units if name in parameters]
        for name in given:
            _check_taken(parameters[name], units[name], before, place.at(name))
            if len(given) < len(units):
                missing = next(other for other in units if other not in given)
                place.report(f"`{missing}` is also required; add it, or remove this one", name)


def _drawn_for(
    name: str, entity: EntityConfig, parameters: Mapping[str, Parameter], place: Place
) -> Iterator[EnvironmentDraw]:  # fmt: skip
    """Yield the sampled parameters of a component that is listed among the bodies."""
    taken = registry.get("component", name).entity
    for key in [key for key in entity.config if key not in taken]:
        place.report(f"a {name} takes only {' and '.join(f'`{other}`' for other in taken)}", "config", key)
    for key in ("platform", "initializer"):
        if getattr(entity, key) is not None:
            place.report(f"a {name} takes no `{key}`; remove it", key)
    for key, value_taken in taken.items():
        if key not in entity.config:
            place.report(f"a {name} needs `{key}`, which is sampled at a reset")
            continue
        _check_taken(entity.config[key], value_taken.symbol, parameters, place.at("config", key))
        yield EnvironmentDraw(value_taken.value, value_taken.purpose, entity.config[key])


def _check_body(body: BodyReset, parameters: Mapping[str, Parameter], place: Place) -> None:
    """Check that a body's initialiser gets its parameters, and that they determine a position and a velocity."""
    initializer = body.initializer
    try:
        check_parameters(initializer, body.parameters, "config")
    except PydanticCustomError as error:
        for where, text in functor_problems(error):
            place.report(text, *where)
    sources = {
        key: _check_taken(parameter, initializer.parameters[key], parameters, place.at("config", key))
        for key, parameter in body.parameters.items()
        if key in initializer.parameters
    }
    given: Iterable[str] = initializer.gives
    if isinstance(initializer, RejectionSamplerInitializer):
        given = initializer.states
        known = _states(sources.get("init_state"))
        for index, state in enumerate(initializer.states if known else ()):
            if state not in known:
                given = ()
                text = f"the sampler has no state {state!r}; {did_you_mean(state, known)}"
                place.report(text, "initializer", "config", "states", index)
    missing = [state for state in _STATES if state not in given]
    if given and missing:
        text = f"a body needs an initial {' and '.join(missing)}; only {sorted(given)} are given"
        place.report(text, "initializer")


def _check_taken(
    parameter: Parameter, symbol: str | None, parameters: Mapping[str, Parameter], place: Place
) -> Parameter | None:
    """Check that a parameter has the expected kind and unit, and return where its value is sampled.

    Args:
        parameter: A parameter or an accessor to another parameter.
        symbol: SI unit of the expected number, empty for any unit; None if the states of a body are expected.
        parameters: Parameters that an accessor may name.
        place: Position of the parameter.
    """
    source, state, where, named = parameter, "", place, "this"
    if isinstance(parameter, SimAttributeAccessor):
        found = _check_source(parameter, parameters, place)
        if found is None:
            return None
        source, state, where = found, _source(parameter)[1], place.at("config", "attribute_name")
        named = f"`{parameter.attribute_name}`"
    given = _states(source)
    if symbol is None:
        if state or isinstance(source, ScalarParameter):
            wanted = "expected the states of a body here, such as those of a RejectionSampler"
            where.report(f"{named} is a single value; {wanted}")
    elif state:
        if given.get(state, 1) != 1:
            where.report(f"{named} has {given[state]} elements; expected one number here")
    elif isinstance(source, RejectionSampler):
        where.report(f"{named} is a set of states; expected one number here, such as one of {sorted(given)}")
    elif symbol and source.symbol not in (None, symbol):
        where = where if source is not parameter else place.at("config", "units")
        where.report(f"{named} has the unit {source.symbol}, but {symbol} is required")
    return source


def _check_source(
    accessor: SimAttributeAccessor, parameters: Mapping[str, Parameter], place: Place
) -> Parameter | None:  # fmt: skip
    """Return the reset parameter that an accessor names, which must come before it, or None if there is none."""
    name, state = _source(accessor)
    source, named = parameters.get(name), place.at("config", "attribute_name")
    states = _states(source)
    if source is None:
        named.report(f"there is no reset parameter {name!r}; {did_you_mean(name, parameters)}")
    elif isinstance(source, SimAttributeAccessor):
        named.report(f"{name!r} is an accessor itself; name its own source, `{source.attribute_name}`")
    elif state and state not in states and (states or isinstance(source, ScalarParameter)):
        named.report(f"{name!r} has no state {state!r}; {did_you_mean(state, states)}")
    else:
        return source
    return None


def _states(parameter: Parameter | None) -> Mapping[str, int]:
    """Return the states that a parameter gives, with their sizes; empty if it is not a sampler of states."""
    return parameter.initializer.gives if isinstance(parameter, RejectionSampler) else {}


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
