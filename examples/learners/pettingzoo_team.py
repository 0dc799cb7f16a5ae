"""Step three deputies as a PettingZoo environment: ``python examples/learners/pettingzoo_team.py``."""

import argparse

import safe_inspect

TASK = "safe_inspect/MultiagentTranslationalInspectionSeed-v0"


def main(steps: int) -> None:
    """Step with random actions; put a policy of your own for each agent in their place."""
    env = safe_inspect.make_parallel(TASK)
    _, infos = env.reset(seed=1)
    for agent in env.agents:
        env.action_space(agent).seed(1)
    team_return = 0.0
    for _ in range(steps):
        actions = {agent: env.action_space(agent).sample() for agent in env.agents}
        _, rewards, _, _, infos = env.step(actions)
        team_return += sum(rewards.values())
        if not env.agents:
            break
    seen = max(info["inspected_count"] for info in infos.values())
    print(f"{len(env.possible_agents)} agents, {seen} points inspected, return of the team {team_return:.2f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=300)
    main(parser.parse_args().steps)
