"""RLlib's algorithms on the small environment, without Tune."""

from __future__ import annotations

import numpy as np
from dummy_environment import ONE
from training_values import MAKER, QUICK

from safe_inspect.config.spec import PolicySpec
from safe_inspect.experiments.settings.policies import read_policies
from safe_inspect.experiments.settings.translation import translate_rllib


def policies_of(team):
    """Return the policies of the dummy's agents."""
    agents_by_policy = {}
    for entry in team:
        for agent, policy in zip(entry["agents"], entry["policies"], strict=True):
            agents_by_policy.setdefault(policy, []).append(agent)
    return [PolicySpec(name, tuple(agents), "PPO", {}) for name, agents in agents_by_policy.items()]


def build(experiment, maker=MAKER, policies=(), **more):
    """Return a configuration of RLlib."""
    from safe_inspect.experiments.learning.algorithm import build_config, register_environments
    from safe_inspect.experiments.settings.policies import environment_settings

    settings = translate_rllib({**QUICK, **more})
    assert not settings.problems
    found, _, problems = read_policies(policies or policies_of(experiment.get("team", ONE)), "PPO")
    assert not problems
    register_environments(maker)
    return build_config(settings, environment_settings(experiment, settings.settings, maker=maker), found)


def parts_of(episodes):
    """Return the single agents' parts of episodes, in RLlib's order."""
    return [part for episode in episodes for part in getattr(episode, "agent_episodes", {"": episode}).values()]


def targets(rewards, values, terminated, gamma, factor):
    """Return the value targets of one piece of an episode by generalised advantage estimation.

    A_t = delta_t + gamma lambda A_(t+1) with delta_t = r_t + gamma V_(t+1) - V_t, and the target is A_t + V_t. After
    a termination V is 0; after a truncation, or where the batch cuts the episode, it is the net's.
    """
    after = np.append(values[1:-1], 0.0 if terminated else values[-1])
    advantage, found = 0.0, np.zeros(len(rewards))
    for t in reversed(range(len(rewards))):
        advantage = rewards[t] + gamma * after[t] - values[t] + gamma * factor * advantage
        found[t] = advantage + values[t]
    return found
