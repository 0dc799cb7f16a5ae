"""How does a training grow with the number of runners? A measured curve on this machine, and what a cluster would do.

    python benchmarks/scaling.py [--runners 0 1 2] [--iterations 10] [--json scaling.json]

PPO samples and learns in turns: an iteration of B steps with W runners of r steps/s each lasts

    B / (W r)  +  B s / b  +  B d  +  W w / b  +  B / l,

where s are the bytes of a step on its way through the object store, b the bytes/s of the network, d the learner's
seconds to read a step, w the bytes of the weights and l the steps/s that the learner takes. All but b are measured
here; b is `--bandwidth`.
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import sys
import time
from pathlib import Path
from typing import Any

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"  # before NumPy is imported

from algorithms import SINGLE, TEAM, configure, start_ray  # noqa: E402
from machine import machine  # noqa: E402
from sampling import calm  # noqa: E402

CLUSTER = (1, 2, 4, 8, 16, 32, 64, 128)


def train(cfg: Path, runners: int, iterations: int) -> dict[str, float]:
    """Train a few iterations and return the steps/s end to end, and the seconds of a step in each part."""
    algorithm = configure(cfg, num_env_runners=runners).build_algo()
    update, learning = algorithm.learner_group.update, 0.0

    def timed(*arguments: Any, **keywords: Any) -> Any:
        nonlocal learning
        begin = time.perf_counter()
        told = update(*arguments, **keywords)
        learning += time.perf_counter() - begin
        return told

    algorithm.learner_group.update = timed
    try:
        before = algorithm.train()["num_env_steps_sampled_lifetime"]
        begin, learning = time.perf_counter(), 0.0
        for _ in range(iterations):
            result = algorithm.train()
        spent = time.perf_counter() - begin
        steps = int(result["num_env_steps_sampled_lifetime"]) - int(before)
        return {"runners": runners, "steps_per_second": steps / spent, "learning_share": learning / spent}
    finally:
        algorithm.stop()


def constants(cfg: Path, seconds: float) -> dict[str, float]:
    """Return the rates and sizes of the model: r, s, d and w."""
    config = configure(cfg, num_env_runners=0)
    from ray.rllib.env.multi_agent_env_runner import MultiAgentEnvRunner
    from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner

    stock = MultiAgentEnvRunner if config.is_multi_agent else SingleAgentEnvRunner
    runner = (config.env_runner_cls or stock)(config=config)
    calm(runner)
    runner.sample(num_timesteps=4000, random_actions=False)
    steps, begin = 0, time.process_time()
    while (spent := time.process_time() - begin) < seconds:
        episodes = runner.sample(num_timesteps=4000, random_actions=False)
        steps += 4032  # 63 steps of 64 environments
    packed = pickle.dumps(episodes, protocol=5)
    begin, count = time.process_time(), 5
    for _ in range(count):
        pickle.loads(packed)
    reading = (time.process_time() - begin) / count / 4032
    weights = len(pickle.dumps(runner.module.get_state(), protocol=5))
    return {
        "runner_steps_per_second": steps / spent,
        "bytes_per_step": len(packed) / 4032,
        "reading_seconds_per_step": reading,
        "bytes_of_weights": weights,
    }


def predict(batch: int, runners: int, found: dict[str, float], learner: float, bandwidth: float) -> float:
    """Return the steps/s of a cluster of so many runners, by the formula in this file's first lines."""
    seconds = batch / (runners * found["runner_steps_per_second"])
    seconds += batch * found["bytes_per_step"] / bandwidth
    seconds += batch * found["reading_seconds_per_step"]
    seconds += runners * found["bytes_of_weights"] / bandwidth
    return batch / (seconds + batch / learner)


def measure(runners: list[int], iterations: int, seconds: float, bandwidth: float, batch: int) -> dict[str, Any]:
    """Return the measured curves and the predicted ones, of one deputy and of three."""
    start_ray(processors=max(runners) + 2)
    report: dict[str, Any] = {"machine": machine(), "bandwidth": bandwidth, "tasks": {}}
    for name, cfg in (("one deputy", SINGLE), ("three deputies", TEAM)):
        curve = [train(cfg, count, iterations) for count in runners]
        found = constants(cfg, seconds)
        alone = curve[0]
        learner = alone["steps_per_second"] / max(alone["learning_share"], 1e-9)
        report["tasks"][name] = {
            "measured": curve,
            "constants": found,
            "learner_steps_per_second": learner,
            "predicted": {
                str(size): [predict(size, count, found, learner, bandwidth) for count in CLUSTER]
                for size in (4000, batch)
            },
        }
    return report


def show(report: dict[str, Any]) -> None:
    """Print the report."""
    print("  ".join(f"{key} {value}" for key, value in report["machine"].items()))
    for name, task in report["tasks"].items():
        print(f"\n{name}")
        for row in task["measured"]:
            share = 100 * row["learning_share"]
            print(f"  {row['runners']} remote runners: {row['steps_per_second']:,.0f} steps/s, {share:.0f} % learning")
        found = task["constants"]
        print(
            f"  a runner {found['runner_steps_per_second']:,.0f} steps/s, a step {found['bytes_per_step']:.0f} bytes "
            f"and {1e6 * found['reading_seconds_per_step']:.2f} us to read, the weights "
            f"{found['bytes_of_weights']:,.0f} bytes, the learner {task['learner_steps_per_second']:,.0f} steps/s"
        )
        print(f"  predicted, {report['bandwidth'] / 1e9:g} GB/s:" + "".join(f"{count:>9}" for count in CLUSTER))
        for size, rates in task["predicted"].items():
            print(f"    batch {size:>7} steps/s" + " " * 7 + "".join(f"{rate:>9,.0f}" for rate in rates))


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runners", type=int, nargs="+", default=[0, 1, 2], help="numbers of remote runners")
    parser.add_argument("--iterations", type=int, default=10, help="iterations for each point of the curve")
    parser.add_argument("--seconds", type=float, default=5.0, help="time to measure a runner")
    parser.add_argument(
        "--bandwidth", type=float, default=1.25e9, help="of the network [bytes/s]; 10 Gbit/s unless given"
    )
    parser.add_argument("--batch", type=int, default=64_000, help="a larger batch to predict as well")
    parser.add_argument("--json", type=Path, help="write the report to this file")
    arguments = parser.parse_args(argv)
    report = measure(arguments.runners, arguments.iterations, arguments.seconds, arguments.bandwidth, arguments.batch)
    show(report)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
