"""PPO with TorchRL's modules, on the batch: ``python examples/learners/torchrl_ppo.py``."""

import argparse

import torch
from tensordict.nn import TensorDictModule
from tensordict.nn.distributions import NormalParamExtractor
from torch import nn
from torchrl.collectors import Collector
from torchrl.envs import GymWrapper
from torchrl.modules import ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

import safe_inspect

TASK = "safe_inspect/TranslationalInspectionSeed-v0"
GAMMA, LAMBDA, EPOCHS, MINIBATCHES = 0.999, 0.95, 4, 8


def net(inputs: int, outputs: int) -> nn.Sequential:
    """Return two hidden layers."""
    return nn.Sequential(nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs))


def main(steps: int, num_envs: int, rollout: int) -> None:
    """Train, and print the reward for each episode that ends."""
    torch.set_num_threads(1)
    torch.manual_seed(1)
    # TorchRL resets by mask, so the batch resets nothing by itself.
    envs = GymWrapper(safe_inspect.make_vec(TASK, num_envs, autoreset_mode="Disabled", seed=1))
    size, count = envs.observation_spec["observation"].shape[-1], envs.action_spec.shape[-1]
    means = TensorDictModule(
        nn.Sequential(net(size, 2 * count), NormalParamExtractor()), in_keys=["observation"], out_keys=["loc", "scale"]
    )
    actor = ProbabilisticActor(
        means, in_keys=["loc", "scale"], distribution_class=TanhNormal, return_log_prob=True, spec=envs.action_spec
    )
    critic = ValueOperator(net(size, 1), in_keys=["observation"])
    advantage = GAE(gamma=GAMMA, lmbda=LAMBDA, value_network=critic, average_gae=True)
    loss = ClipPPOLoss(actor, critic, clip_epsilon=0.2, entropy_coeff=0.0)
    adam = torch.optim.Adam(loss.parameters(), lr=3e-4)
    frames = num_envs * rollout
    collector = Collector(envs, actor, frames_per_batch=frames, total_frames=max(steps // frames, 1) * frames)
    for update, found in enumerate(collector):
        with torch.no_grad():
            advantage(found)
        rows = found.reshape(-1)
        for _ in range(EPOCHS):
            for part in torch.randperm(len(rows)).chunk(MINIBATCHES):
                terms = loss(rows[part])
                adam.zero_grad()
                (terms["loss_objective"] + 0.5 * terms["loss_critic"]).backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                adam.step()
        ends, reward = int(found["next", "done"].sum()), float(found["next", "reward"].sum())
        print(f"steps {(update + 1) * frames:7,}  episodes {ends:4}  reward for one {reward / max(ends, 1):6.3f}")
    collector.shutdown()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=164_000)
    parser.add_argument("--num-envs", type=int, default=64)
    parser.add_argument("--rollout", type=int, default=128, help="steps of each environment for an update")
    arguments = parser.parse_args()
    main(arguments.steps, arguments.num_envs, arguments.rollout)
