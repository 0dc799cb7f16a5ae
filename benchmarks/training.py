"""How fast is a whole training, and how near to a plain loop in PyTorch?

    python benchmarks/training.py --iterations 8 --json training.json
    python benchmarks/training.py --small-thrust --steps 800000 seed=1    # how the returns grow

The shipped experiment trains with this package's learner and with RLlib's own, both with the batched runner. It is
compared with a plain PPO loop in PyTorch on the same environment, with the same networks, batch, epochs and
minibatches. They take turns, an iteration each, so that the ratios hold on a machine that does other things as well.
Overrides of the experiment follow as ``key=value``; the loop knows batches, minibatches, epochs and learning rate.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch

from safe_inspect.config.experiment import Experiment, load_experiment
from safe_inspect.environments import BatchedEnvironment
from safe_inspect.errors import SafeInspectError

CONFIGURATION = "configs/translational-inspection/experiment-seed.yml"
#: A task that a policy learns within minutes: thrust of up to 0.1 N, which a fresh policy hardly uses.
SMALL_THRUST = (
    "configs/translational-inspection/experiment.yml",
    [
        "lr=3.0e-4",
        "entropy_coeff=0.0",
        "train_batch_size_per_learner=4096",
        "minibatch_size=512",
        "num_epochs=10",
        *(
            override
            for place, axis in enumerate("XYZ")
            for override in (
                f"RTAGlueCWHInspection1v1.wrapped.{place}="
                f"{{functor: ControllerGlue, config: {{controller: {axis} Thrust}}}}",
                f"blue0_ctrl.config.config.parts.{place}.config.properties="
                f"{{name: {axis.lower()}_thrust, low: -0.1, high: 0.1}}",
            )
        ),
    ],
)
WARM_UP = 2


class PlainLoop:
    """PPO in plain PyTorch: the yardstick.

    Args:
        experiment: The experiment.
        settings: RLlib's settings of it.
        module: RLlib's module of the policy, whose weights its nets begin with.
    """

    def __init__(self, experiment: Experiment, settings: dict[str, Any], module: Any) -> None:
        self.settings = settings
        self.envs = settings["num_envs_per_env_runner"]
        self.steps = -(-settings["train_batch_size_per_learner"] // self.envs)
        self.environment = BatchedEnvironment(experiment.spec, self.envs, seed=int(settings["seed"]))
        sizes = (self.environment.observation_layout.size, *settings["model_config"]["fcnet_hiddens"])
        self.width = self.environment.action_layout.size
        torch.manual_seed(int(settings["seed"]))
        layout = self.environment.action_layout
        self.low, self.high = (torch.from_numpy(bound.astype(np.float32)) for bound in (layout.low, layout.high))
        self.policy, self.value = self._net(sizes, 2 * self.width), self._net(sizes, 1)
        self._copy(self.policy, module.encoder.actor_encoder, module.pi)
        self._copy(self.value, module.encoder.critic_encoder, module.vf)
        self.parameters = [*self.policy.parameters(), *self.value.parameters()]
        self.optimiser = torch.optim.Adam(self.parameters, lr=settings["lr"], fused=True)
        self.observation = torch.from_numpy(self.environment.reset()[:, 0].astype(np.float32))
        self.returns: list[float] = []
        self._return = np.zeros(self.envs)

    @staticmethod
    def _net(sizes: tuple[int, ...], out: int) -> torch.nn.Sequential:
        layers: list[torch.nn.Module] = []
        for before, after in pairwise(sizes):
            layers += [torch.nn.Linear(before, after), torch.nn.Tanh()]
        return torch.nn.Sequential(*layers, torch.nn.Linear(sizes[-1], out))

    @staticmethod
    def _copy(net: torch.nn.Sequential, *parts: torch.nn.Module) -> None:
        theirs = [parameter for part in parts for parameter in part.parameters()]
        with torch.no_grad():
            for parameter, other in zip(net.parameters(), theirs, strict=True):
                parameter.copy_(other)

    def distribution(self, observations: torch.Tensor) -> torch.distributions.Normal:
        """Return the distribution of the actions."""
        mean, log_std = self.policy(observations).chunk(2, dim=-1)
        return torch.distributions.Normal(mean, log_std.exp(), validate_args=False)

    def __call__(self) -> int:
        """Sample a batch and learn from it; return its number of steps."""
        with torch.no_grad():
            batch = self._sample()
        self._learn(*batch)
        return self.steps * self.envs

    def _sample(self) -> tuple[torch.Tensor, ...]:
        shape = (self.steps, self.envs)
        observations = torch.empty((*shape, self.observation.shape[1]))
        actions, density = torch.empty((*shape, self.width)), torch.empty(shape)
        rewards, over, after = torch.empty(shape), torch.zeros(shape), torch.zeros(shape)
        for t in range(self.steps):
            observations[t] = self.observation
            distribution = self.distribution(self.observation)
            actions[t] = distribution.sample()
            density[t] = distribution.log_prob(actions[t]).sum(-1)
            step = self.environment.step(actions[t].clamp(self.low, self.high).numpy()[:, None])
            rewards[t] = torch.from_numpy(step.reward[:, 0])
            observation = torch.from_numpy(step.observation[:, 0].astype(np.float32))
            self._return += step.reward[:, 0]
            ended = np.flatnonzero(step.done[:, 0])
            if len(ended):
                bootstrap = torch.from_numpy(step.truncated[ended, 0].astype(np.float32))
                after[t, ended] = self.value(observation[ended])[:, 0] * bootstrap
                over[t, ended] = 1.0
                self.returns += self._return[ended].tolist()
                self._return[ended] = 0.0
                observation[ended] = torch.from_numpy(self.environment.reset(ended)[:, 0].astype(np.float32))
            self.observation = observation
        values = self.value(torch.cat((observations, self.observation[None])))[..., 0]
        gamma, factor = self.settings["gamma"], self.settings["lambda"]
        advantages, advantage = torch.empty(shape), torch.zeros(self.envs)
        for t in reversed(range(self.steps)):
            flies = 1.0 - over[t]
            delta = rewards[t] + gamma * (flies * values[t + 1] + after[t]) - values[t]
            advantage = delta + gamma * factor * flies * advantage
            advantages[t] = advantage
        targets = advantages + values[:-1]
        advantages = (advantages - advantages.mean()) / advantages.std()
        return tuple(part.flatten(0, 1) for part in (observations, actions, density, advantages, targets))

    def _learn(self, observations: Any, actions: Any, density: Any, advantages: Any, targets: Any) -> None:
        settings, rows = self.settings, len(density)
        clip, coefficient = settings.get("clip_param", 0.2), settings.get("vf_loss_coeff", 1.0)
        for _ in range(settings["num_epochs"]):
            for indices in torch.randperm(rows).split(settings["minibatch_size"]):
                distribution = self.distribution(observations[indices])
                ratio = (distribution.log_prob(actions[indices]).sum(-1) - density[indices]).exp()
                weight = advantages[indices]
                surrogate = torch.min(weight * ratio, weight * ratio.clamp(1.0 - clip, 1.0 + clip)).mean()
                error = (self.value(observations[indices])[:, 0] - targets[indices]).pow(2).mean()
                entropy = distribution.entropy().sum(-1).mean()
                loss = -surrogate + coefficient * error - settings.get("entropy_coeff", 0.0) * entropy
                self.optimiser.zero_grad(set_to_none=True)
                loss.backward()
                self.optimiser.step()

    def episode_return(self) -> float:
        """Return the mean of the last hundred episodes."""
        return float(np.mean(self.returns[-100:])) if self.returns else float("nan")


class RLlibTraining:
    """The shipped experiment through RLlib, without Tune.

    Args:
        experiment: The experiment.
        more: Settings over those of the experiment.
    """

    def __init__(self, experiment: Experiment, **more: Any) -> None:
        from safe_inspect.experiments.learning.algorithm import build_config, register_environments
        from safe_inspect.experiments.settings.policies import environment_settings
        from safe_inspect.experiments.settings.translation import translate_rllib

        rllib = translate_rllib({**experiment.rllib, **more})
        register_environments()
        config = build_config(rllib, environment_settings(experiment.resolved, rllib.settings))
        self.settings = rllib.settings
        self.algorithm = config.build_algo()
        self._steps = 0
        self._result: dict[str, Any] = {}

    def __call__(self) -> int:
        """Train for an iteration; return the number of steps."""
        self._result = self.algorithm.train()
        before, self._steps = self._steps, int(self._result["num_env_steps_sampled_lifetime"])
        return self._steps - before

    def module(self) -> Any:
        """Return the policy's module, which the learner trains."""
        learner: Any = self.algorithm.learner_group._learner
        (module,) = (module.unwrapped() for _, module in learner.module.items())
        return module

    def episode_return(self) -> float:
        """Return the mean of the last hundred episodes."""
        return float(self._result["env_runners"].get("episode_return_mean", float("nan")))


def contestants(experiment: Experiment, everybody: bool) -> dict[str, Any]:
    """Return who trains: the plain loop and this package's learner, or everybody; all begin with the same weights."""
    fast = RLlibTraining(experiment, learner="fast")
    found = {
        "plain PyTorch loop": PlainLoop(experiment, fast.settings, fast.module()),
        "fast learner": fast,
    }
    if everybody:
        found["fast learner, one thread"] = RLlibTraining(experiment, learner="fast", learner_threads=1)
        found["stock learner"] = RLlibTraining(experiment, learner="stock")
    return found


def race(runs: dict[str, Any], iterations: int) -> dict[str, dict[str, list[float]]]:
    """Train everybody in turns.

    Returns:
        For each the steps per second of the clock and of the processors in each measured iteration, and in all
        iterations the steps so far and the mean return of the last hundred episodes.
    """
    found: dict[str, dict[str, list[float]]] = {
        name: {"clock": [], "processor": [], "steps": [], "return": []} for name in runs
    }
    for iteration in range(WARM_UP + iterations):
        for name, run in runs.items():
            clock, processor = time.perf_counter(), time.process_time()
            steps = run()
            clock, processor = time.perf_counter() - clock, time.process_time() - processor
            rates = found[name]
            if iteration >= WARM_UP:
                rates["clock"].append(steps / clock)
                rates["processor"].append(steps / processor)
            rates["steps"].append(steps + (rates["steps"][-1] if rates["steps"] else 0))
            rates["return"].append(run.episode_return())
    return found


def machine() -> dict[str, Any]:
    """Describe where this runs."""
    return {
        "processor": platform.processor() or platform.machine(),
        "processors": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2),
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numpy": np.__version__,
    }


def table(figures: dict[str, dict[str, Any]]) -> str:
    """Return a line for each who trained."""
    rows = [("", "steps/s", "best", "ratio", "steps/processor s", "ratio", "return")]
    for name, figure in figures.items():
        rows.append(
            (
                name,
                f"{figure['steps_per_second']:,.0f}",
                f"{figure['best_steps_per_second']:,.0f}",
                f"{figure['ratio']:.2f}",
                f"{figure['steps_per_processor_second']:,.0f}",
                f"{figure['processor_ratio']:.2f}",
                f"{figure['return']:.3f}",
            )
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)


def curves(found: dict[str, dict[str, list[float]]], points: int = 10) -> str:
    """Return the returns along the training, a line for each who trained."""
    longest = next(iter(found.values()))["steps"]
    shown = [round((len(longest) - 1) * (point + 1) / points) for point in range(points)]
    lines = ["return after".rjust(26) + "".join(f"{longest[index]:>10,.0f}" for index in shown)]
    for name, rates in found.items():
        lines.append(name.rjust(26) + "".join(f"{rates['return'][index]:>10.3f}" for index in shown))
    return "\n".join(lines)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cfg", default=CONFIGURATION)
    parser.add_argument("--small-thrust", action="store_true", help="a task that is learned within minutes")
    parser.add_argument("--iterations", type=int, default=8, help="measured iterations of each")
    parser.add_argument("--steps", type=int, help="train plain loop and learner for so many steps instead")
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    parser.add_argument("overrides", nargs="*")
    arguments = parser.parse_args(argv)
    torch.set_num_threads(1)
    try:
        cfg, overrides = SMALL_THRUST if arguments.small_thrust else (arguments.cfg, [])
        experiment = load_experiment(cfg, [*overrides, *arguments.overrides])
    except SafeInspectError as error:
        print(error, file=sys.stderr)
        return 2
    from local_ray import local_ray

    with local_ray():
        runs = contestants(experiment, everybody=not arguments.steps)
        batch = runs["fast learner"].settings["train_batch_size_per_learner"]
        iterations = -(-arguments.steps // batch) if arguments.steps else arguments.iterations
        found = race(runs, iterations)
    yardstick = found["plain PyTorch loop"]
    figures = {}
    for name, rates in found.items():
        pairs = {
            kind: [mine / its for mine, its in zip(rates[kind], yardstick[kind], strict=True)]
            for kind in ("clock", "processor")
        }
        figures[name] = {
            "steps_per_second": statistics.median(rates["clock"]),
            "best_steps_per_second": max(rates["clock"]),
            "ratio": statistics.median(pairs["clock"]),
            "steps_per_processor_second": statistics.median(rates["processor"]),
            "processor_ratio": statistics.median(pairs["processor"]),
            "return": runs[name].episode_return(),
        }
    print(f"{machine()}\n{iterations} iterations of each, medians; ratios to the plain loop, turn by turn\n")
    print(table(figures))
    if arguments.steps:
        print("\n" + curves(found))
    if arguments.json:
        content = {"machine": machine(), "iterations": iterations, "figures": figures, "rates": found}
        arguments.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
