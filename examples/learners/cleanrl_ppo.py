"""PPO in one file, in the style of CleanRL, on the batch: ``python examples/learners/cleanrl_ppo.py``."""

import argparse
import time

import numpy as np
import torch
from torch import nn
from torch.distributions import Normal

import safe_inspect

TASK = "safe_inspect/TranslationalInspectionSeed-v0"
GAMMA, LAMBDA, CLIP, EPOCHS, MINIBATCHES = 0.999, 0.95, 0.2, 4, 8


def net(inputs: int, outputs: int, gain: float) -> nn.Sequential:
    """Return two hidden layers with orthogonal weights."""
    layers = [nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)]
    for layer in layers[::2]:
        nn.init.orthogonal_(layer.weight, gain if layer is layers[-1] else 2**0.5)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(*layers)


def main(steps: int, num_envs: int, rollout: int) -> None:
    """Train, and print the mean share of points inspected in the episodes that end."""
    torch.manual_seed(1)
    envs = safe_inspect.make_vec(TASK, num_envs, autoreset_mode="SameStep")
    observation, _ = envs.reset(seed=1)
    size, count = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]
    actor, critic = net(size, count, 0.01), net(size, 1, 1.0)
    spread = nn.Parameter(torch.full((count,), -1.0))
    parameters = [*actor.parameters(), *critic.parameters(), spread]
    adam = torch.optim.Adam(parameters, lr=3e-4, eps=1e-5)
    began = time.time()
    for update in range(max(steps // (num_envs * rollout), 1)):
        kept, shares = [], []
        for _ in range(rollout):
            seen = torch.from_numpy(observation)
            with torch.no_grad():
                policy = Normal(actor(seen), spread.exp())
                action = policy.sample()
                value, log = critic(seen)[:, 0], policy.log_prob(action).sum(1)
            observation, reward, terminated, truncated, infos = envs.step(action.numpy())
            bonus = np.zeros(num_envs, dtype=np.float32)
            if "final_obs" in infos:
                shares += infos["final_info"]["inspected_fraction"][infos["_final_obs"]].tolist()
                if truncated.any():  # the time limit is no end of the task: its value is bootstrapped
                    last = torch.from_numpy(np.stack(infos["final_obs"][truncated]))
                    with torch.no_grad():
                        bonus[truncated] = GAMMA * critic(last)[:, 0].numpy()
            over = torch.from_numpy((terminated | truncated).astype(np.float32))
            kept.append((seen, action, log, value, torch.from_numpy(reward.astype(np.float32) + bonus), over))
        seen, action, log, value, reward, over = (torch.stack(items) for items in zip(*kept, strict=True))
        with torch.no_grad():
            following = critic(torch.from_numpy(observation))[:, 0]
        advantage, running = torch.zeros_like(reward), torch.zeros(num_envs)
        for index in reversed(range(rollout)):
            delta = reward[index] + GAMMA * following * (1 - over[index]) - value[index]
            running = delta + GAMMA * LAMBDA * (1 - over[index]) * running
            advantage[index], following = running, value[index]
        target = (advantage + value).reshape(-1)
        seen, action = seen.reshape(-1, size), action.reshape(-1, count)
        log, advantage = log.reshape(-1), advantage.reshape(-1)
        for _ in range(EPOCHS):
            for rows in torch.randperm(len(log)).chunk(MINIBATCHES):
                policy = Normal(actor(seen[rows]), spread.exp())
                ratio = (policy.log_prob(action[rows]).sum(1) - log[rows]).exp()
                gain = (advantage[rows] - advantage[rows].mean()) / (advantage[rows].std() + 1e-8)
                surrogate = torch.min(gain * ratio, gain * ratio.clamp(1 - CLIP, 1 + CLIP)).mean()
                loss = 0.5 * (critic(seen[rows])[:, 0] - target[rows]).square().mean() - surrogate
                adam.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(parameters, 0.5)
                adam.step()
        done, share = (update + 1) * num_envs * rollout, 100 * np.mean(shares) if shares else float("nan")
        rate = done / (time.time() - began)
        print(f"steps {done:7,}  episodes {len(shares):4}  inspected {share:3.0f} %  {rate:,.0f} steps/s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=164_000)
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--rollout", type=int, default=128, help="steps of each environment for an update")
    arguments = parser.parse_args()
    main(arguments.steps, arguments.num_envs, arguments.rollout)
