"""The command ``safe-inspect train``."""

from __future__ import annotations

import argparse
import shlex
import signal
import sys
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from safe_inspect.cli.arguments import add_experiment_arguments, add_option
from safe_inspect.cli.checked_settings import checked_settings
from safe_inspect.config.experiment import Experiment, load_experiment
from safe_inspect.config.learning import placed
from safe_inspect.environments import TeamEnvironment
from safe_inspect.environments.group import AgentGroup
from safe_inspect.errors import ConfigError, SafeInspectError
from safe_inspect.experiments.modules.run_folder import RunFolder
from safe_inspect.experiments.runs.train import train
from safe_inspect.experiments.runs.training_run import TrainingRun
from safe_inspect.experiments.runs.trials import recipes_of, trial_table
from safe_inspect.figures.drawing import save
from safe_inspect.figures.learning_curves import curves_figure
from safe_inspect.rta.base import SafetyGlue, TeamSafety
from safe_inspect.rta.constraints.sets import name_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``train``."""
    add_experiment_arguments(parser, needed=False)
    output = "parent of the run folder (default: output_path of the experiment)"
    add_option(parser, "--output", "FOLDER", output, Path)
    add_option(parser, "--resume", "FOLDER", "continue the training run in this folder", Path)
    dry_run = "validate, build and step the environment, print its layout, and stop; Ray is not started"
    parser.add_argument("--dry-run", action="store_true", help=dry_run)


def run(arguments: argparse.Namespace) -> int:
    """Train a policy; the same as python -m safe_inspect.train_rl.

    Progress, checkpoints, progress.csv and TensorBoard logs go to a new run folder.

    Example:
        safe-inspect train configs/docking/experiment-recipe.yml lr=1e-4
    """
    cfg = arguments.cfg
    if cfg is None and arguments.resume is not None:
        cfg = RunFolder.open(arguments.resume).configuration
    if cfg is None:
        raise ConfigError("no experiment: give an experiment file with --cfg, or an earlier run's folder with --resume")
    experiment = load_experiment(cfg, arguments.overrides, compute_platform=arguments.compute_platform)
    checked_settings(experiment)
    if arguments.dry_run:
        print(_dry_run(experiment))
        return 0
    task = experiment.config.config.config
    try:
        result = train(
            TrainingRun(
                experiment=experiment.resolved,
                rllib={"algorithm": experiment.algorithm, **experiment.rllib},
                tune=task.tune_config,
                ray=task.ray_config,
                text=experiment.text,
                name=task.env_config.TrialName,
                output=arguments.output or Path(task.env_config.output_path),
                resume=arguments.resume,
                command=[sys.executable, "-m", "safe_inspect.train_rl", *sys.argv[1:]],
                policies=tuple(experiment.policies.values()),
            )
        )
    except ConfigError as error:
        raise ConfigError(placed(experiment, error.problems)) from None
    print(_closing(result))
    return 128 + signal.SIGINT if result.interrupted else 0


def _dry_run(experiment: Experiment, steps: int = 20) -> str:
    """Build the experiment's environment, step it with random actions and describe it."""
    import numpy as np

    environment = TeamEnvironment(experiment.spec, num_envs=4)
    environment.reset()
    generator = np.random.default_rng(0)
    for _ in range(steps):
        actions = [group.action_layout.draw(generator, (4, group.size)) for group in environment.acting]
        over = environment.step(actions).over
        if over.any():
            environment.reset(np.flatnonzero(over))
    lines = [f"{experiment.source}: built and stepped {steps} times, one action for {experiment.spec.step_size:g} s"]
    lines += [f"disturbance: {one.registered_name}, {_fields(one)}" for one in experiment.spec.simulator.disturbance]
    for group in environment.groups:
        lines += _describe(group)
    shared = ", ".join(named.name for named in experiment.spec.shared_dones)
    if shared:
        lines.append(f"dones of all agents: {shared}")
    team = experiment.spec.team_safety
    if team is not None and team.enabled:
        lines.append(f"safety filter of all agents: {_named(team)}")
    for policy in experiment.policies.values():
        how = f"trained by {policy.algorithm}" if policy.trains else f"not trained, from {policy.checkpoint}"
        lines.append(f"policy {policy.name} of {', '.join(policy.agents)}: {how}")
    return "\n".join(lines)


def _describe(group: AgentGroup) -> list[str]:
    """Describe a group of agents."""
    agent = group.agent
    terms = ", ".join(named.name for named in agent.rewards)
    ends = ", ".join(named.name for named in agent.dones)
    head = f"agent {agent.name} on {agent.platform}" if group.size == 1 else f"agents {', '.join(group.agents)}"
    if group.scripted:
        lines = [f"{head}, flown by {type(agent.scripted_policy).__name__}"]
    else:
        observation, action = group.observation_layout, group.action_layout
        lines = [head, f"observation, {observation.size} elements:", str(observation)]
        lines += [f"action, {action.size} elements:", str(action)]
    safety = "none" if agent.safety_filter is None else _named(agent.safety_filter)
    return [*lines, f"rewards: {terms}", f"dones: {ends}", f"safety filter: {safety}"]


def _fields(plugin: BaseModel) -> str:
    """Return the fields that differ from their defaults."""
    given = plugin.model_dump(exclude_defaults=True).items()
    return ", ".join(f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}" for name, value in given)


def _named(safety: SafetyGlue | TeamSafety) -> str:
    """Return the name of a safety filter, its method, and its constraints."""
    method, constraints = getattr(safety, "method", None), getattr(safety, "constraints", ())
    named = safety.registered_name + (f", {method}" if method else "")
    named += f", keeps {', '.join(map(name_of, constraints))}" if constraints else ""
    withstood = getattr(safety, "disturbance", None)
    return named if withstood is None else f"{named}, under {_fields(withstood)}"


def _closing(result: Any) -> str:
    state = "interrupted" if result.interrupted else "finished"
    if result.trials:
        lines = [f"{state}: {len(result.trials)} trials, {result.steps} steps, {result.seconds:.0f} s"]
        lines += trial_table(result.trials)
        lines.append(f"trials:      {result.trials[0].folder.parent}")
    else:
        iterations = f"{result.iteration} iteration{'s' * (result.iteration != 1)}"
        lines = [f"{state} after {iterations}, {result.steps} steps, {result.seconds:.0f} s"]
    if result.checkpoint is not None:
        lines.append(f"checkpoint:  {result.checkpoint}")
    if result.best is not None:
        lines.append(f"the best:    {result.best}")
    drawn = _draw_curve(result.folder)
    if drawn:
        lines.append(f"curves:      {drawn}")
    if result.checkpoint is not None and not result.trials:
        lines.append(f"evaluate:    safe-inspect evaluate {shlex.quote(str(result.folder))}")
    lines.append(f"TensorBoard: tensorboard --logdir {shlex.quote(str(result.folder))}")
    if result.interrupted:
        lines.append(f"continue:    python -m safe_inspect.train_rl --resume {shlex.quote(str(result.folder))}")
    return "\n".join(lines)


def _draw_curve(folder: Path) -> Path | None:
    """Draw the learning curve, or those of a search's trials; skip it without matplotlib or without an iteration."""
    target, progress = folder / "learning_curve.png", folder / "progress.csv"
    try:
        save(curves_figure({folder.name: [progress]} if progress.is_file() else recipes_of([folder])), target)
    except SafeInspectError:
        return None
    return target
