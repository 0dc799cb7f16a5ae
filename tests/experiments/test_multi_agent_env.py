"""RLlib's own environment of several agents, as its users take it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from dummy_environment import TEAM
from training_values import MAKER

from safe_inspect.config.experiment import load_experiment

pytestmark = pytest.mark.ray

EXPERIMENT = Path(__file__).parents[2] / "configs" / "multiagent-translational-inspection" / "experiment-seed.yml"


def dummy(**experiment):
    from safe_inspect.experiments.sampling.environment import TeamMultiAgentEnv

    return TeamMultiAgentEnv({"experiment": {"team": TEAM, **experiment}, "seed": 3, "maker": MAKER})


def test_rllib_accepts_it():
    from ray.rllib.utils.pre_checks.env import check_multiagent_environments

    from safe_inspect.experiments.sampling.environment import TeamMultiAgentEnv

    config = {"experiment": load_experiment(EXPERIMENT).resolved, "seed": 7}
    env, again = TeamMultiAgentEnv(config), TeamMultiAgentEnv(config)
    check_multiagent_environments(env)
    assert env.agents == env.possible_agents == ["blue0_ctrl", "blue1_ctrl", "blue2_ctrl"]
    first, second = TeamMultiAgentEnv(config).reset()[0], again.reset()[0]
    for agent, observation in first.items():
        assert env.observation_spaces[agent].contains(observation)
        np.testing.assert_array_equal(observation, second[agent])


def test_an_agent_that_has_ended_appears_no_more():
    env = dummy(drift=0.03)
    early = 0
    for _ in range(8):
        observations, infos = env.reset()
        assert set(observations) == set(infos) == {"red", "blue", "green"}
        flying, over = set(observations), False
        returns = dict.fromkeys(flying, 0.0)
        while not over:
            assert set(env.agents) == flying
            actions = {agent: np.full(3, 0.2, np.float32) for agent in flying}
            observations, rewards, terminated, truncated, infos = env.step(actions)
            assert set(observations) == set(rewards) == set(infos) == flying
            for agent, reward in rewards.items():
                returns[agent] += reward
            over = terminated["__all__"] or truncated["__all__"]
            ended = {agent for agent in flying if terminated.get(agent) or truncated.get(agent)}
            early += bool(ended) and not over
            flying -= ended
        report = env.reports[0]
        assert report["return"] == pytest.approx(sum(returns.values()))
        assert {agent: report[f"agents/{agent}/return"] for agent in returns} == pytest.approx(returns)
    assert early


def test_the_slots_of_a_runner():
    from safe_inspect.experiments.sampling.environment import first_slot

    placed, plain = dummy(), dummy()
    placed.place(first_slot(2, 4) + 1, evaluation=False)
    assert placed.reset()[0]["red"][2] == 5
    assert plain.reset()[0]["red"][2] == 0
