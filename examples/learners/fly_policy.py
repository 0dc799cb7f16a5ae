"""Fly a trained policy of the package in a loop: ``python examples/learners/fly_policy.py``."""

import argparse

import safe_inspect


def main(episodes: int) -> None:
    """Fly episodes one after the other and print how each ended."""
    policy = safe_inspect.load_policy("translational-inspection")
    env = policy.make()
    for episode in range(episodes):
        observation, info = env.reset(seed=1000 if episode == 0 else None)
        over, steps = False, 0
        while not over:
            observation, _, terminated, truncated, info = env.step(policy.predict(observation))
            over, steps = terminated or truncated, steps + 1
        print(f"episode {episode}: {info['status']} after {steps} steps, delta-v {info['delta_v']:.3f} m/s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=3)
    main(parser.parse_args().episodes)
