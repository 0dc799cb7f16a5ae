"""RLlib's episodes that hold a rollout's arrays and become whole when somebody asks for more than these.

To make one costs as much as sixteen steps of its environment, and this package's learner wants the arrays alone.
"""

from __future__ import annotations

import copyreg
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from ray.rllib.core.columns import Columns
from ray.rllib.env.multi_agent_episode import MultiAgentEpisode
from ray.rllib.env.single_agent_episode import SingleAgentEpisode
from ray.rllib.utils.metrics import WEIGHTS_SEQ_NO

from safe_inspect.types import AnyArray

#: Name among RLlib's outputs of a module of the control steps of each decision.
DECISION_STEPS = "decision_steps"
#: Observation and action space of an agent.
Spaces = tuple[Any, Any]


@dataclass(slots=True)
class EpisodePart:
    """T steps, or decisions, of one agent within one episode.

    Attributes:
        observations: At the beginning of each step and behind the last, shape (T + 1, O).
        final: Stands in the place of the last observation, shape (O,); None: it stands there already.
        actions: Shape (T, A).
        inputs: Inputs of the action distribution, shape (T, I); None: the actions were drawn without a policy.
        log_probabilities: Of the actions, shape (T,); None as above.
        rewards: Shape (T,).
        terminated: Whether the task ended with the last step.
        weights: Number of the weights that flew it; None: unknown.
        steps: Control steps of each decision, where the rows are decisions, shape (T,); None: one each.
    """

    observations: AnyArray
    final: AnyArray | None
    actions: AnyArray
    inputs: AnyArray | None
    log_probabilities: AnyArray | None
    rewards: AnyArray
    terminated: bool
    weights: float | None
    steps: AnyArray | None = None

    def __len__(self) -> int:
        return len(self.rewards)

    @property
    def whole_observations(self) -> AnyArray:
        """All observations in one array, shape (T + 1, O)."""
        if self.final is None:
            return self.observations
        return np.concatenate((self.observations[:-1], self.final[None]))


class _Lazy:
    """What both kinds of episode do alike: attributes that are missing are made, all at once."""

    __slots__ = ()
    _kind: type

    def _make(self) -> None:
        raise NotImplementedError

    def __getattr__(self, name: str) -> Any:
        if name not in _slots(self._kind):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        known = {key: value for key, value in self._known().items() if key in _slots(self._kind)}
        self._make()
        for key, value in known.items():  # what somebody has set meanwhile holds
            setattr(self, key, value)
        return object.__getattribute__(self, name)

    def __reduce__(self) -> Any:
        # Typeshed does not know copyreg.__newobj__, pickle's way to make an object without calling __init__.
        return copyreg.__newobj__, (type(self),), (None, self._known())  # type: ignore[attr-defined]

    def _known(self) -> dict[str, Any]:
        """Return the attributes that are there."""
        found = {}
        for name in _slots(type(self)):
            try:
                found[name] = object.__getattribute__(self, name)
            except AttributeError:
                continue
        return found


def _slots(kind: type) -> frozenset[str]:
    if kind not in _SLOTS:
        _SLOTS[kind] = frozenset(name for one in kind.__mro__ for name in getattr(one, "__slots__", ()))
    return _SLOTS[kind]


_SLOTS: dict[type, frozenset[str]] = {}


class RolloutEpisode(_Lazy, SingleAgentEpisode):  # type: ignore[misc]
    """A stretch of one agent's episode.

    Args:
        part: Its steps.
        name: Identity of the episode.
        spaces: The agent's spaces.
        begun: Steps of the episode before these.
        truncated: Whether a limit of time ended the episode with the last step.
        owner: The agent, its policy and the identity of the whole episode, where there are several agents.

    Attributes:
        part: Its steps as arrays; None when it has become whole, so that somebody may have changed it.
    """

    __slots__ = ("_begun", "_spaces", "part")
    _kind = SingleAgentEpisode

    def __init__(
        self,
        part: EpisodePart,
        name: str,
        spaces: Spaces,
        begun: int,
        truncated: bool,
        owner: tuple[Any, Any, Any] = (None, None, None),
    ) -> None:
        self.part: EpisodePart | None = part
        self._spaces, self._begun = spaces, begun
        self.id_ = name
        self.agent_id, self.module_id, self.multi_agent_episode_id = owner
        self.is_terminated, self.is_truncated = part.terminated, truncated

    def __len__(self) -> int:
        return SingleAgentEpisode.__len__(self) if self.part is None else len(self.part)

    def _make(self) -> None:
        part, (observation_space, action_space) = self.part, self._spaces
        assert part is not None, "it becomes whole once"
        actions: Any = part.actions
        if np.issubdtype(action_space.dtype, np.integer):
            actions = actions.astype(action_space.dtype)
        outputs = {} if part.weights is None else {WEIGHTS_SEQ_NO: np.full(len(part), part.weights)}
        if part.inputs is not None and part.log_probabilities is not None:
            outputs |= {Columns.ACTION_DIST_INPUTS: part.inputs, Columns.ACTION_LOGP: part.log_probabilities}
        if part.steps is not None:
            outputs[DECISION_STEPS] = part.steps
        observations: Any = part.whole_observations
        rewards: Any = part.rewards
        SingleAgentEpisode.__init__(
            self,
            self.id_,
            observations=observations,
            observation_space=observation_space,
            infos=[{}] * (len(part) + 1),
            actions=actions,
            action_space=action_space,
            rewards=rewards,
            extra_model_outputs=outputs,
            t_started=self._begun,
            len_lookback_buffer=0,
        )
        self.part = None  # else the arrays would travel twice


class RolloutTeamEpisode(_Lazy, MultiAgentEpisode):  # type: ignore[misc]
    """A stretch of an episode of several agents.

    Args:
        parts: The stretches of its agents, all of which begin with it.
        name: Identity of the episode.
        steps: Steps of the episode before it, and behind its last step.
        done: Whether the episode ended, by the task itself or by a limit of time.
        spaces: The spaces of each agent.
        modules: The policy of each agent that may act.
        mapping: RLlib's function from agent to policy.
    """

    __slots__ = ("_mapping", "_modules", "_spaces")
    _kind = MultiAgentEpisode

    def __init__(
        self,
        parts: dict[str, RolloutEpisode],
        name: str,
        steps: tuple[int, int],
        done: tuple[bool, bool],
        spaces: Mapping[str, Spaces],
        modules: Mapping[Any, str],
        mapping: Any,
    ) -> None:
        self._spaces, self._modules, self._mapping = spaces, modules, mapping
        self.id_ = name
        self.env_t_started, self.env_t = steps
        self.is_terminated, self.is_truncated = done
        self.agent_episodes: dict[Any, SingleAgentEpisode] = dict(parts)

    def _make(self) -> None:
        begun = self.env_t_started
        observation_space: Any = {agent: pair[0] for agent, pair in self._spaces.items()}
        action_space: Any = {agent: pair[1] for agent, pair in self._spaces.items()}
        parts = self.agent_episodes
        MultiAgentEpisode.__init__(
            self,
            self.id_,
            observation_space=observation_space,
            action_space=action_space,
            env_t_started=begun,
            agent_t_started=dict.fromkeys(self._modules, begun),
            agent_module_ids=dict(self._modules),
            agent_to_module_mapping_fn=self._mapping,
        )
        for agent, part in parts.items():
            self.env_t_to_agent_t[agent].extend(range(begun, begun + len(part) + 1))


def part_of_episode(episode: Any) -> EpisodePart:
    """Return the steps of an episode of one agent, as arrays."""
    if isinstance(episode, RolloutEpisode) and episode.part is not None:
        part = episode.part
        return part if part.terminated == episode.is_terminated else replace(part, terminated=episode.is_terminated)
    outputs = episode.extra_model_outputs
    weights, steps = outputs.get(WEIGHTS_SEQ_NO), outputs.get(DECISION_STEPS)
    return EpisodePart(
        _data(episode.observations),
        None,
        _data(episode.actions),
        _data(outputs[Columns.ACTION_DIST_INPUTS]),
        _data(outputs[Columns.ACTION_LOGP]),
        _data(episode.rewards),
        bool(episode.is_terminated),
        None if weights is None else float(_data(weights).mean()),
        None if steps is None else _data(steps),
    )


def _data(buffer: Any) -> AnyArray:
    """Return the data of one of RLlib's buffers without what it keeps of the time before."""
    return np.asarray(buffer.data[buffer.lookback :])
