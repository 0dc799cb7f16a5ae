"""`load_policy`: a trained policy from any source, to fly in a loop of one's own."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import numpy as np

from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.environments.facades.single import InspectionEnv
from safe_inspect.environments.facades.vector import InspectionVectorEnv
from safe_inspect.environments.layout import action_layout, observation_layout
from safe_inspect.errors import ArgumentError, SafeInspectError, did_you_mean
from safe_inspect.evaluation.policy_files.onnx_policy import OnnxPolicy
from safe_inspect.experiments.modules.sources import Wanted, is_scripted, open_candidates
from safe_inspect.types import AnyArray


class LoadedPolicy:
    """A trained policy and the task in which it flies. It keeps nothing from step to step.

    Attributes:
        spec: The task as it was trained in it, with the overrides.
        agent: Name of the agent that it flies.
    """

    def __init__(self, spec: EnvironmentSpec, agent: AgentSpec, policy: Any) -> None:
        self.spec, self.agent = spec, agent.name
        self._policy, self._file = policy, isinstance(policy, OnnxPolicy)
        self._size = observation_layout(agent).size
        self._action = action_layout(agent)

    def predict(self, observation: AnyArray, generator: np.random.Generator | None = None) -> AnyArray:
        """Return the action: the mean of a Gaussian policy, the likeliest levels of a categorical, both of a hurdle.

        Args:
            observation: Observations as `make`, `make_vec` or any environment of the task gives them, shape (O,) or
                (N, O).
            generator: Draws what `evaluate` draws: choices, such as whether to burn, but not the size of a burn.

        Returns:
            Actions that the environment takes, shape (A,) or (N, A): int64 where they are levels, else float32.

        Raises:
            ArgumentError: The observations have another shape, or are no numbers.
        """
        try:
            rows = np.asarray(observation, dtype=np.float32)
        except (TypeError, ValueError):
            raise ArgumentError(f"the observations are no array of numbers: {observation!r:.60}") from None
        if rows.ndim not in (1, 2) or rows.shape[-1] != self._size:
            raise ArgumentError(
                f"the observations have the shape {rows.shape}; ({self._size},) or (N, {self._size}) is wanted"
            )
        whole = np.atleast_2d(rows)
        if generator is None:
            actions = self._policy.in_task_units(whole) if self._file else np.asarray(self._policy(whole))
        else:
            actions = self._policy.draw(whole, int(generator.integers(2**63)))
        if self._action.choices:
            actions = actions.astype(np.int64)
        else:
            actions = np.clip(actions, self._action.low, self._action.high).astype(np.float32)
        return actions if rows.ndim == 2 else actions[0]

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
        cfg: Experiment file, or id of a task; the one that the policy was trained in unless given.
        overrides: ``path.of.keys=value`` for each value that replaces one of the task's.
        agent: Name of the agent that it is to fly; needed where several agents have policies of their own.

    Raises:
        CheckpointError: The policy is damaged, of another task, or there is none.
        ConfigError: The configuration has mistakes.
        SafeInspectError: The source is a scripted policy, or there is no such agent.
    """
    if not isinstance(source, str | os.PathLike):
        raise ArgumentError(f"a policy is a name, a file or a folder, not {source!r}")
    text = os.fspath(source)
    if is_scripted(text):
        raise SafeInspectError(f"{text}: a scripted policy flies inside the environment; give it to `rollout`")
    (candidate,) = open_candidates([text], Wanted(cfg, tuple(overrides), sampled=False))
    spec, policies = candidate.experiment.spec, candidate.policies
    outside = {item.name: item for item in spec.agents if item.scripted_policy is None}
    flying = dict(policies) if isinstance(policies, dict) else dict.fromkeys(outside, policies)
    if agent is None and len(set(map(id, flying.values()))) > 1:
        raise SafeInspectError(
            f"{text}: the agents {', '.join(flying)} have policies of their own; name one as `agent`"
        )
    name = next(iter(flying)) if agent is None else agent
    if name not in flying:
        raise SafeInspectError(f"{text}: it flies no agent {name!r}; {did_you_mean(name, flying)}")
    policy: Any = flying[name]
    if getattr(policy, "recurrent", False):
        raise SafeInspectError(f"{text}: the policy is recurrent, and `predict` keeps nothing; fly it with `evaluate`")
    return LoadedPolicy(spec, outside[name], policy)
