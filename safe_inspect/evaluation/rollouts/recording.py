"""`record_episode`: runs and records one episode, given its number, without those before it."""

from __future__ import annotations

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.evaluation.rollouts.dispatch import Policies, assign
from safe_inspect.evaluation.rollouts.rollout import fly_batch
from safe_inspect.evaluation.trajectory import Trajectory


def record_episode(spec: EnvironmentSpec, policies: Policies, episode: int = 0, seed: int = 0) -> Trajectory:
    """Return the episode that `rollout` with this seed runs in the environment slot `episode`.

    Args:
        spec: The task.
        policies: The policies; see `safe_inspect.evaluation.rollouts.rollout`.
        episode: Number of the episode, from 0.
        seed: Seed of the run.

    Raises:
        SafeInspectError: An agent has no policy, a policy has no agent, or one policy controls agents that differ.
    """
    spec, flying = assign(spec, policies)
    environment = TeamEnvironment(spec, 1, seed=seed, first_slot=episode)
    return fly_batch(environment, flying, first_slot=episode, recorded=1)[1][0]
