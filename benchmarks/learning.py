"""Does a training learn? Train, then fly its policies, before and after, and the baselines on the same fresh episodes.

    python benchmarks/learning.py --steps 300000 --episodes 100
    python benchmarks/learning.py --cfg configs/multiagent-translational-inspection/experiment.yml

Overrides of the experiment follow as ``key=value``. A table goes to standard output; with ``--checkpoint`` nothing is
trained, and the policies of that checkpoint are flown.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from safe_inspect.config.experiment import Experiment, load_experiment
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation import BASELINES, Evaluation, baseline, evaluation_table, rollout

CONFIGURATION = "configs/translational-inspection/experiment.yml"
EVALUATION_SEED = 20_000
COLUMNS = ("return", "inspected fraction", "delta-v", "delta-v per deputy", "length", "closest deputies")


def train_for(experiment: Experiment, steps: int, output: Path) -> tuple[Path | None, dict[str, Any]]:
    """Train for so many steps; return the checkpoint, and the steps and seconds that it took."""
    from safe_inspect.experiments.runs.train import train
    from safe_inspect.experiments.runs.training_run import TrainingRun

    task = experiment.config.config.config
    result = train(
        TrainingRun(
            experiment=experiment.resolved,
            rllib={"algorithm": experiment.algorithm, **experiment.rllib},
            tune={**task.tune_config, "stop": {"num_env_steps_sampled_lifetime": steps}},
            ray=task.ray_config,
            text=experiment.text,
            name="learning",
            output=output,
            policies=tuple(experiment.policies.values()),
        )
    )
    return result.checkpoint, {"steps": result.steps, "seconds": result.seconds}


def pilots(experiment: Experiment, load: Callable[[str | None], Any]) -> dict[str, Any]:
    """Return who flies each agent: `load` gives a policy by its name, that of an agent alone for None."""
    policies = experiment.policies.values()
    if sum(len(policy.agents) for policy in policies) == 1:
        return {agent: load(None) for policy in policies for agent in policy.agents}
    loaded = {policy.name: load(policy.name) for policy in policies}
    return {agent: loaded[policy.name] for policy in policies for agent in policy.agents}


def table(figures: dict[str, Evaluation]) -> str:
    """Return mean and standard deviation of the figures, a line for each who flew."""
    names = [name for name in COLUMNS if name in next(iter(figures.values())).team.figures]
    rows = [("", "success", *names)]
    for who, found in figures.items():
        cells = [found.estimates[""][name] for name in names]
        told = (f"{cell.mean:.3f} ({cell.standard_deviation:.3f})" for cell in cells)
        rows.append((who, f"{100.0 * found.team.success_rate:.0f} %", *told))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)


def untrained_policy(checkpoint: Path, policy: str | None) -> Any:
    """Return a policy with the settings of a checkpoint's, but with new random weights."""
    import torch

    from safe_inspect.experiments.modules.policy import TrainedPolicy, trained_policy

    module = trained_policy(checkpoint, policy).module
    arguments, keywords = module.get_ctor_args_and_kwargs()
    torch.manual_seed(0)
    return TrainedPolicy(type(module)(*arguments, **keywords))


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cfg", default=CONFIGURATION)
    parser.add_argument("--steps", type=int, default=300_000)
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--baselines", nargs="*", choices=tuple(BASELINES), default=list(BASELINES))
    parser.add_argument("--checkpoint", type=Path, help="fly the policies of this checkpoint instead of training")
    parser.add_argument("--output", type=Path, default=Path("output"))
    parser.add_argument("--json", type=Path, help="also write the figures to this file")
    parser.add_argument("overrides", nargs="*")
    arguments = parser.parse_args(argv)
    try:
        experiment = load_experiment(arguments.cfg, arguments.overrides)
        took: dict[str, Any] = {}
        checkpoint = arguments.checkpoint
        if checkpoint is None:
            checkpoint, took = train_for(experiment, arguments.steps, arguments.output)
        if checkpoint is None:
            print("the training left no checkpoint", file=sys.stderr)
            return 1
        from safe_inspect.experiments.modules.policy import trained_policy

        fliers = {name: baseline(name) for name in arguments.baselines}
        fliers["untrained"] = pilots(experiment, lambda policy: untrained_policy(checkpoint, policy))
        fliers["trained"] = pilots(experiment, lambda policy: trained_policy(checkpoint, policy))
        figures = {
            who: Evaluation.of(who, rollout(experiment.spec, policies, arguments.episodes, seed=EVALUATION_SEED))
            for who, policies in fliers.items()
        }
    except SafeInspectError as error:
        print(error, file=sys.stderr)
        return 2
    if took:
        print(f"{took['steps']} steps in {took['seconds']:.0f} s")
    print(f"{arguments.episodes} fresh episodes each, mean (standard deviation):\n{table(figures)}\n")
    print(evaluation_table(figures["trained"]))
    if arguments.json:
        content = {**took, "figures": {who: found.as_dict() for who, found in figures.items()}}
        arguments.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
