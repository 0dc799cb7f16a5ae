"""Sampling speed of RLlib: the batched runner and the stock one, on the real environment with the shipped networks.

    python benchmarks/sampling.py [--envs 64 256] [--seconds 10] [--json sampling.json]

One process, one Torch thread. The policies are set calm, to a standard deviation of 0.02 N, so that episodes last as
long as those of a trained policy; `--early` leaves them as they begin, when some episode ends in nearly every step.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"  # before NumPy is imported

import numpy as np  # noqa: E402
from algorithms import SINGLE, TEAM, configure, start_ray  # noqa: E402
from machine import machine  # noqa: E402

#: Logarithm of the standard deviation of a calm policy's thrust [N].
CALM = -4.0
#: Control steps of each environment in a sample, as in the recipe of the inspection: 16,384 in 256 environments.
_STEPS = 64
CASES = (("one deputy", SINGLE, 1), ("three deputies, a policy each", TEAM, 3))


def calm(runner: Any) -> None:
    """Let a runner's policies thrust little: zero mean, a standard deviation of exp(CALM)."""
    import torch

    module = runner.module
    modules = [module[name] for name in module.keys()] if hasattr(module, "keys") else [module]  # noqa: SIM118
    for one in modules:
        head = list(one.pi.parameters())
        with torch.no_grad():
            for parameter in head:
                parameter.mul_(0.0)
            bias = head[-1]
            bias[len(bias) // 2 :] = CALM


class Case:
    """One runner and the rates found so far."""

    def __init__(self, name: str, cfg: Path, agents: int, kind: str, envs: int, early: bool) -> None:
        self.name, self.agents, self.kind, self.envs = name, agents, kind, envs
        from ray.rllib.env.multi_agent_env_runner import MultiAgentEnvRunner
        from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner

        config = configure(cfg, env_runner=kind, num_envs_per_env_runner=envs, num_env_runners=0)
        stock = MultiAgentEnvRunner if config.is_multi_agent else SingleAgentEnvRunner
        self.runner = (config.env_runner_cls or stock)(config=config)
        if not early:
            calm(self.runner)
        self.per_second: list[float] = []
        self.per_cpu_second: list[float] = []

    def run(self, seconds: float) -> None:
        """Sample for about so many seconds and note the rates of agent-steps."""
        steps, wall, cpu = 0, time.perf_counter(), time.process_time()
        while (spent := time.perf_counter() - wall) < seconds:
            self.runner.sample(num_timesteps=_STEPS * self.envs, random_actions=False)
            steps += _STEPS * self.envs
        cpu = time.process_time() - cpu
        self.per_second.append(steps * self.agents / spent)
        self.per_cpu_second.append(steps * self.agents / cpu)

    def report(self) -> dict[str, Any]:
        """Return what was measured."""
        return {
            "case": self.name,
            "runner": self.kind,
            "num_envs": self.envs,
            "agent_steps_per_second": float(np.median(self.per_second)),
            "agent_steps_per_cpu_second": float(np.median(self.per_cpu_second)),
        }


def measure(envs: list[int], seconds: float, rounds: int, early: bool) -> dict[str, Any]:
    """Measure every case in turns and return the report."""
    start_ray()
    cases = [
        Case(name, cfg, agents, kind, count, early)
        for name, cfg, agents in CASES
        for count in envs
        for kind in ("batched", "stock")
    ]
    for case in cases:
        case.run(min(2.0, seconds))  # compile, and let the episodes drift apart
        case.per_second.clear(), case.per_cpu_second.clear()
    for _ in range(rounds):
        for case in cases:
            case.run(seconds / rounds)
    rows = [case.report() for case in cases]
    stock = {(row["case"], row["num_envs"]): row for row in rows if row["runner"] == "stock"}
    for row in rows:
        base = stock[row["case"], row["num_envs"]]
        row["ratio"] = row["agent_steps_per_cpu_second"] / base["agent_steps_per_cpu_second"]
    return {"machine": machine(), "early": early, "sampling": rows}


def show(report: dict[str, Any]) -> None:
    """Print the report as a table."""
    print("  ".join(f"{key} {value}" for key, value in report["machine"].items()))
    print(f"{'':32}{'runner':10}{'N':>5}{'agent-steps/s':>16}{'per CPU s':>12}{'ratio to stock':>16}")
    for row in report["sampling"]:
        print(
            f"{row['case']:32}{row['runner']:10}{row['num_envs']:>5}{row['agent_steps_per_second']:>16,.0f}"
            f"{row['agent_steps_per_cpu_second']:>12,.0f}{row['ratio']:>16.1f}"
        )


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--envs", type=int, nargs="+", default=[64, 256], help="batch sizes N")
    parser.add_argument("--seconds", type=float, default=10.0, help="time for each case")
    parser.add_argument("--rounds", type=int, default=5, help="turns that the cases take")
    parser.add_argument("--early", action="store_true", help="leave the policies as they begin")
    parser.add_argument("--json", type=Path, help="write the report to this file")
    arguments = parser.parse_args(argv)
    report = measure(arguments.envs, arguments.seconds, arguments.rounds, arguments.early)
    show(report)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
