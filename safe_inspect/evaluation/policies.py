"""Policies for `rollout`: functions of observations, and the baselines that trained policies are compared with."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic_core import PydanticCustomError

from safe_inspect.config.messages.messages import functor_mistakes
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.finite_checks import all_finite
from safe_inspect.environments.layout import Layout
from safe_inspect.errors import ArgumentError, SafeInspectError, did_you_mean, not_named
from safe_inspect.plugins.functor import build
from safe_inspect.plugins.registry import registry
from safe_inspect.policies.base import ScriptedPolicy
from safe_inspect.types import AnyArray, FloatArray, IntArray

ObservationRows: TypeAlias = NDArray[np.float32]

#: Maps observations (float32, shape (R, O)) to actions (shape (R, A)). A policy that controls K agents in N
#: environments gets R = N * K rows, ordered by environment. A policy that keeps a state between steps has a method
#: ``begin(flight: Flight)``, which is called before the first step of every batch.
#:
#: If a policy has a method ``decide(observation, rows, step)`` and no true attribute ``recurrent``, `decide` is called
#: instead, and only for the rows whose episode is running and whose action is used in the step. It maps observations
#: (Q, O), with their row indices among the R rows, shape (Q,), to actions (Q, A). `step` counts the steps from 0.
Policy: TypeAlias = Callable[[ObservationRows], AnyArray]

#: Name of each baseline -> name of its scripted policy, which is used with its default values.
BASELINES: Mapping[str, str] = MappingProxyType(
    {"zero-thrust": "ZeroThrust", "random": "RandomThrust", "inspector": "NaturalMotionInspector"}
)


@dataclass(frozen=True)
class Flight:
    """Description of a batch of episodes, passed to a policy before the first step.

    Attributes:
        slots: Global index of the environment slot of each row, shape (R,).
        observation: Layout of the observation.
        action: Layout of the action.
        step_size: Length of a step [s].
        mean_motion: Mean motion of the chief's orbit [rad/s].
        masses: Mass of each deputy [kg], shape (D,).
        deputies: Index of the deputy of each row, shape (R,).
    """

    slots: IntArray
    observation: Layout
    action: Layout
    step_size: float
    mean_motion: float
    masses: FloatArray
    deputies: IntArray


def require_finite_rows(observation: ObservationRows) -> None:
    """Raise an error if observations contain NaN or infinity, for which a policy has no meaningful action.

    Args:
        observation: Observations, shape (R, O).

    Raises:
        ArgumentError: A value is NaN or infinite.
    """
    if not all_finite(observation):
        row, element = np.argwhere(~np.isfinite(observation))[0].tolist()
        raise ArgumentError(
            f"the observations contain NaN or infinity: element {element} of row {row} is {observation[row, element]}; "
            "a policy takes finite numbers only"
        )


def baseline(name: str) -> ScriptedPolicy:
    """Return a baseline, or any scripted policy with its default values, by name.

    Raises:
        SafeInspectError: There is no policy of that name, or it has fields without defaults.
    """
    try:
        plugin = build("policy", BASELINES.get(name, name))
    except PydanticCustomError as error:
        known = {*BASELINES, *(registered for registered, _ in registry.items("policy"))}
        if name not in known and "." not in name:
            raise SafeInspectError(f"no scripted policy {name!r}; {did_you_mean(name, known)}") from None
        raise SafeInspectError(f"scripted policy {name!r}: {functor_mistakes(error)}") from None
    assert isinstance(plugin, ScriptedPolicy), "the registry returns a plugin of the requested kind"
    return plugin


def with_scripted(
    spec: EnvironmentSpec, policy: ScriptedPolicy | str, agents: Iterable[str] | None = None
) -> EnvironmentSpec:
    """Return the task with agents that a scripted policy controls inside the environment.

    Args:
        spec: The task.
        policy: The plugin, or the name of a baseline or of any scripted policy.
        agents: Names of the agents; all agents by default.

    Raises:
        SafeInspectError: There is no such policy or agent, or the policy refers to something that the task does not
            have.
    """
    plugin = baseline(policy) if isinstance(policy, str) else policy
    names = [agent.name for agent in spec.agents]
    chosen = names if agents is None else list(agents)
    for name in chosen:
        if name not in names:
            raise SafeInspectError(f"no agent is named {name!r}; {did_you_mean(name, names)}")
    known = {
        "entity": {*spec.platforms, *spec.reset.entities},
        "platform": set(spec.platforms),
        "points": set(getattr(spec.simulator, "inspection_points_map", ())),
    }
    for field, kind in plugin.references().items():
        value = getattr(plugin, field)
        if value is not None and value not in known.get(kind, {value}):
            raise SafeInspectError(f"the `{field}` of {plugin.registered_name}: {not_named(kind, value, known[kind])}")
    flown = tuple(replace(agent, scripted_policy=plugin) if agent.name in chosen else agent for agent in spec.agents)
    return replace(spec, agents=flown)
