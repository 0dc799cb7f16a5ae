"""Does a training learn? Train, then fly the policy before and after on the same fresh episodes.

    python benchmarks/learning.py --steps 300000 --episodes 100

Overrides of the experiment follow as ``key=value``. The table goes to standard output.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from safe_inspect.config.experiment import load_experiment
from safe_inspect.evaluation.policies import random_policy, zero_thrust
from safe_inspect.evaluation.rollout import rollout
from safe_inspect.experiments.policy import load_policy, untrained_policy
from safe_inspect.experiments.train import TrainingRun, train

CONFIGURATION = "configs/translational-inspection/experiment.yml"
EVALUATION_SEED = 20_000


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cfg", default=CONFIGURATION)
    parser.add_argument("--steps", type=int, default=300_000)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--output", type=Path, default=Path("output"))
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    parser.add_argument("overrides", nargs="*")
    arguments = parser.parse_args()

    experiment = load_experiment(arguments.cfg, arguments.overrides)
    task = experiment.config.config.config
    result = train(
        TrainingRun(
            experiment=experiment.resolved,
            rllib={"algorithm": experiment.algorithm, **experiment.rllib},
            tune={**task.tune_config, "stop": {"num_env_steps_sampled_lifetime": arguments.steps}},
            ray=task.ray_config,
            text=experiment.text,
            name="learning",
            output=arguments.output,
        )
    )
    if result.checkpoint is None:
        print("the training left no checkpoint", file=sys.stderr)
        return 1
    policies = {
        "zero thrust": zero_thrust(),
        "random": random_policy(0),
        "untrained": untrained_policy(result.checkpoint),
        "trained": load_policy(result.checkpoint),
    }
    figures = {}
    print(f"{result.steps} steps in {result.seconds:.0f} s; {arguments.episodes} fresh episodes each, mean (std):")
    for name, policy in policies.items():
        flown = rollout(experiment.spec, policy, arguments.episodes, seed=EVALUATION_SEED)
        figures[name] = {
            "return": flown.returns,
            "inspected fraction": flown.inspected_fraction,
            "success rate": flown.status == 1,
            "delta-v [m/s]": flown.delta_v,
            "steps": flown.length,
        }
        cells = "  ".join(f"{key} {np.mean(array):8.3f} ({np.std(array):.3f})" for key, array in figures[name].items())
        print(f"{name:>12}  {cells}")
    if arguments.json:
        means = {name: {key: float(np.mean(array)) for key, array in table.items()} for name, table in figures.items()}
        content = {"steps": result.steps, "seconds": result.seconds, "mean": means}
        arguments.json.write_text(json.dumps(content, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
