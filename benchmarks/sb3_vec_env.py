"""Speed of Stable-Baselines3's vectors of environments: `DummyVecEnv`, and the batch as `BatchedVecEnv`.

    python benchmarks/sb3_vec_env.py [--envs 8 64 1024] [--seconds 3] [--train 20000]

Each vector steps with random actions in turn, over several rounds; ``--train N`` then trains PPO for N steps on both
with 8 and 64 environments. One Torch thread. Steps of environments for a second of processor time.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"  # before NumPy is imported

import gymnasium  # noqa: E402
import numpy as np  # noqa: E402
import torch  # noqa: E402
from machine import machine  # noqa: E402
from stable_baselines3 import PPO  # noqa: E402
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor  # noqa: E402

from safe_inspect.integrations.stable_baselines3 import BatchedVecEnv  # noqa: E402

TASK = "safe_inspect/TranslationalInspectionSeed-v0"


def rate(envs: Any, seconds: float) -> float:
    """Return steps of environments for a second of processor time."""
    generator, steps = np.random.default_rng(0), 0
    actions = generator.uniform(-0.02, 0.02, (256, envs.num_envs, 3)).astype(np.float32)
    envs.reset()
    begun = time.process_time()
    while time.process_time() - begun < seconds:
        envs.step(actions[steps % 256])
        steps += 1
    return steps * envs.num_envs / (time.process_time() - begun)


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--envs", type=int, nargs="+", default=[8, 64, 1024])
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--train", type=int, default=0, metavar="STEPS")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    print(machine())
    vectors = {"DummyVecEnv x 8": DummyVecEnv([lambda: gymnasium.make(TASK)] * 8)}
    vectors |= {f"BatchedVecEnv x {count}": BatchedVecEnv(TASK, count, seed=1) for count in arguments.envs}
    for vector in vectors.values():
        rate(vector, 0.2)
    found: dict[str, list[float]] = {name: [] for name in vectors}
    for _ in range(arguments.rounds):
        for name, vector in vectors.items():
            found[name].append(rate(vector, arguments.seconds / arguments.rounds))
    first = statistics.median(next(iter(found.values())))
    for name, rates in found.items():
        middle = statistics.median(rates)
        print(f"{name:22} {middle:10,.0f} steps per CPU second {middle / first:8.1f} x")
    if arguments.train:
        both = {
            "DummyVecEnv x 8": (VecMonitor(vectors["DummyVecEnv x 8"]), 512),
            "BatchedVecEnv x 64": (BatchedVecEnv(TASK, 64, seed=1), 64),
        }
        for name, (vector, length) in both.items():
            model = PPO("MlpPolicy", vector, n_steps=length, batch_size=512, gamma=0.999, seed=1, device="cpu")
            begun = time.process_time()
            model.learn(arguments.train)
            spent = time.process_time() - begun
            print(f"{name:22} {model.num_timesteps / spent:10,.0f} steps per CPU second of PPO's training")


if __name__ == "__main__":
    main()
