"""RLlib's episodes with a rollout's arrays, whose other attributes are created when they are first accessed.

Creating a complete episode takes as long as sixteen steps of its environment, and this package's learner needs only the
arrays.
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

#: Name of the control steps of each decision, among RLlib's outputs of a module.
DECISION_STEPS = "decision_steps"
#: Observation and action space of an agent.
Spaces = tuple[Any, Any]


@dataclass(slots=True)
class EpisodePart:
    """T steps, or decisions, of one agent within one episode.

    Attributes:
        observations: Observations at the start of each step and after the last, shape (T + 1, O).
        final: The last observation, which replaces that in `observations`, shape (O,); None to replace nothing.
        actions: Actions, shape (T, A).
        inputs: Inputs of the action distribution, shape (T, I); None if the actions were sampled without a policy.
        log_probabilities: Log probabilities of the actions, shape (T,); None if `inputs` is None.
        rewards: Rewards, shape (T,).
        terminated: Whether the task ended with the last step.
        weights: Sequence number of the weights with which the actions were sampled; None if unknown.
        steps: Number of control steps of each decision, shape (T,); None if each row is one step.
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
    """Common part of both kinds of episode: all missing attributes are created when one of them is first accessed."""

    __slots__ = ()
    _kind: type

    def _make(self) -> None:
        raise NotImplementedError

    def __getattr__(self, name: str) -> Any:
        if name not in _slots(self._kind):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        known = {key: value for key, value in self._known().items() if key in _slots(self._kind)}
        self._make()
        for key, value in known.items():  # attributes that were set before take precedence
            setattr(self, key, value)
        return object.__getattribute__(self, name)

    def __reduce__(self) -> Any:
        # Typeshed lacks copyreg.__newobj__, with which pickle creates an object without calling __init__.
        return copyreg.__newobj__, (type(self),), (None, self._known())  # type: ignore[attr-defined]

    def _known(self) -> dict[str, Any]:
        """Return the attributes that have been set."""
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
    """A part of one agent's episode.

    Args:
        part: Its steps.
        name: Identifier of the episode.
        spaces: The agent's spaces.
        begun: Number of steps of the episode before this part.
        truncated: Whether a time limit ended the episode with the last step.
        owner: The agent, its policy and the identifier of the whole episode, if there are several agents.

    Attributes:
        part: Its steps as arrays; None once all attributes have been created, as they may be changed from then on.
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
        assert part is not None, "the attributes are created only once"
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
        self.part = None  # otherwise the arrays would be pickled twice


class RolloutTeamEpisode(_Lazy, MultiAgentEpisode):  # type: ignore[misc]
    """A part of an episode of several agents.

    Args:
        parts: The parts of its agents, all of which start with it.
        name: Identifier of the episode.
        steps: Numbers of steps of the episode before this part and up to its end.
        done: Whether the episode was terminated by the task, and whether it was truncated by a time limit.
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
    """Return the data of one of RLlib's buffers without its lookback."""
    return np.asarray(buffer.data[buffer.lookback :])
