"""`load_policy`: a trained policy from any source, for use in your own loop."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import numpy as np

from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.environments.facades.gymnasium_envs import InspectionEnv, InspectionVectorEnv
from safe_inspect.environments.layout import action_layout, observation_layout
from safe_inspect.errors import ArgumentError, KeywordError, SafeInspectError, did_you_mean
from safe_inspect.evaluation.onnx_policy import OnnxPolicy
from safe_inspect.experiments.modules.sources import Wanted, is_scripted, open_candidates
from safe_inspect.types import AnyArray


class LoadedPolicy:
    """A trained policy with its task. A recurrent policy stores the state of each row between calls.

    Attributes:
        spec: The task in which it was trained, with the overrides.
        agent: Name of the agent that it controls.
        recurrent: Whether it has a state.
    """

    def __init__(self, spec: EnvironmentSpec, agent: AgentSpec, policy: Any) -> None:
        self.spec, self.agent = spec, agent.name
        self._policy, self._file = policy, isinstance(policy, OnnxPolicy)
        self.recurrent = bool(policy.recurrent)
        self._rows = 0
        self._size = observation_layout(agent).size
        self._action = action_layout(agent)

    def predict(
        self,
        observation: AnyArray,
        generator: np.random.Generator | None = None,
        episode_start: AnyArray | bool | None = None,
        **unknown: Any,
    ) -> AnyArray:
        """Return the actions for observations.

        By default the action is the mean of a Gaussian policy, the most likely levels of a categorical policy, and both
        of a hurdle policy.

        Args:
            observation: Observations from `make`, `make_vec` or any environment of the task, shape (O,) or (N, O).
            generator: Samples the values that `evaluate` samples: choices, such as whether to burn, but not the size of
                a burn.
            episode_start: Whether the observation is the first of an episode, one bool or one for each row, shape (N,).
                A recurrent policy needs it, and must be called once per step with the rows of all its environments;
                other policies ignore it.
            **unknown: Not accepted.

        Returns:
            Actions for the environment, shape (A,) or (N, A): int64 for levels, otherwise float32.

        Raises:
            ArgumentError: The observations have another shape or are not finite numbers; the policy is recurrent, and
                `episode_start` is missing, or False in rows that the last call did not have; an argument is unknown.
        """
        for name in unknown:
            raise KeywordError(
                f"predict() got an unexpected keyword argument {name!r}; without `generator` it returns the most "
                "likely action, with `generator=numpy.random.default_rng(0)` it samples one"
            )
        try:
            rows = np.asarray(observation, dtype=np.float32)
        except (TypeError, ValueError):
            raise ArgumentError(f"the observations are not an array of numbers: {observation!r:.60}") from None
        if rows.ndim not in (1, 2) or rows.shape[-1] != self._size:
            raise ArgumentError(
                f"the observations have the shape {rows.shape}; expected ({self._size},) or (N, {self._size}), as from "
                "an environment of the policy's own task: `policy.make()`"
            )
        whole = np.atleast_2d(rows)
        if self.recurrent:
            self._begin(episode_start, len(whole))
        if generator is None:
            actions = self._policy.in_task_units(whole) if self._file else np.asarray(self._policy(whole))
        else:
            actions = self._policy.draw(whole, int(generator.integers(2**63)))
        if self._action.choices:
            actions = actions.astype(np.int64)
        else:
            actions = np.clip(actions, self._action.low, self._action.high).astype(np.float32)
        return actions if rows.ndim == 2 else actions[0]

    def _begin(self, episode_start: AnyArray | bool | None, count: int) -> None:
        """Reset the state of a recurrent policy in the rows in which an episode begins."""
        if episode_start is None:
            raise ArgumentError(
                "the policy is recurrent; give `episode_start`, True for each row whose observation is the first of an "
                "episode"
            )
        starts = np.asarray(episode_start)
        if starts.dtype != np.bool_ or starts.shape not in ((), (count,)):
            raise ArgumentError(
                f"`episode_start` has the shape {starts.shape} and the type {starts.dtype}; expected one bool or an "
                f"array of bools of shape ({count},)"
            )
        starts = np.broadcast_to(starts, count)
        if self._rows != count and not starts.all():
            raise ArgumentError(
                f"there are {count} observations, but there were {self._rows} in the last call; `episode_start` must "
                "be True in all rows when their number changes"
            )
        self._policy.reset(None if starts.all() else starts)
        self._rows = count

    def make(self, **kwargs: Any) -> InspectionEnv:
        """Return one environment of the task; see `InspectionEnv`."""
        return InspectionEnv(self.spec, **kwargs)

    def make_vec(self, num_envs: int = 1, **kwargs: Any) -> InspectionVectorEnv:
        """Return N environments of the task that step together; see `InspectionVectorEnv`."""
        return InspectionVectorEnv(self.spec, num_envs, **kwargs)


def load_policy(
    source: str | os.PathLike[str],
    cfg: str | os.PathLike[str] | None = None,
    overrides: Iterable[str] = (),
    *,
    agent: str | None = None,
) -> LoadedPolicy:
    """Return a trained policy.

    Args:
        source: Name of a policy of the package, an ONNX file, a checkpoint's folder, or a run's folder.
        cfg: Experiment file, or id of a task; by default the task in which the policy was trained.
        overrides: ``path.of.keys=value`` for each value of the task to override.
        agent: Name of the agent to control; needed if the agents have different policies.

    Raises:
        CheckpointError: The policy is damaged, of another task, or missing.
        ConfigError: The configuration has mistakes.
        SafeInspectError: The source is a scripted policy, or there is no such agent.
    """
    if not isinstance(source, str | os.PathLike):
        raise ArgumentError(f"a policy is a name, a file or a folder, not {source!r}")
    text = os.fspath(source)
    if is_scripted(text):
        raise SafeInspectError(f"{text}: a scripted policy acts inside the environment; pass it to `rollout`")
    (candidate,) = open_candidates([text], Wanted(cfg, tuple(overrides), sampled=False))
    spec, policies = candidate.experiment.spec, candidate.policies
    outside = {item.name: item for item in spec.agents if item.scripted_policy is None}
    flying = dict(policies) if isinstance(policies, dict) else dict.fromkeys(outside, policies)
    if agent is None and len(set(map(id, flying.values()))) > 1:
        raise SafeInspectError(
            f"{text}: the agents {', '.join(flying)} have different policies; name one of them as `agent`"
        )
    name = next(iter(flying)) if agent is None else agent
    if name not in flying:
        raise SafeInspectError(f"{text}: it controls no agent {name!r}; {did_you_mean(name, flying)}")
    return LoadedPolicy(spec, outside[name], flying[name])
