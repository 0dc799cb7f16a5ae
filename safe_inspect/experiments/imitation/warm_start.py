"""`warm_start`: policies clone their teachers before a training, into checkpoints with which they begin."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TextIO

import torch

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.facades.spaces import action_space, box
from safe_inspect.environments.registration import build_spec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.adapters.algorithm import environment_settings
from safe_inspect.experiments.adapters.environment import stream_seed
from safe_inspect.experiments.imitation.cloning import clone, fit_values, sampling
from safe_inspect.experiments.imitation.demonstrations import FlownRound, Steps, fly_round
from safe_inspect.experiments.modules.fresh_policy import policy_spec
from safe_inspect.experiments.modules.policy_info import policy_texts
from safe_inspect.experiments.runs.checkpoints import MODULES, SINGLE, Checkpoint, read_checkpoint, seal_checkpoint
from safe_inspect.experiments.sampling.sampler import AgentSlot, agent_slots
from safe_inspect.experiments.settings.imitation import IMITATION, Imitation
from safe_inspect.experiments.settings.key_tables import TranslatedSettings
from safe_inspect.experiments.settings.policies import PolicySettings
from safe_inspect.outputs import new_folder

#: Parts the seeds of the rounds from those of the training.
_FIRST_ROUND = 1_000_003


@dataclass(frozen=True)
class _Pupil:
    """A policy that learns: its module, its teacher's settings and the discount of its returns."""

    module: Any
    settings: Imitation
    gamma: float


def warm_start(
    experiment: Mapping[str, Any],
    rllib: TranslatedSettings,
    policies: Mapping[str, PolicySettings],
    folder: Path,
    stream: TextIO,
) -> tuple[TranslatedSettings, Mapping[str, PolicySettings]]:
    """Clone the teachers of a trial; return its settings with what its policies begin with.

    What an earlier attempt has finished in the folder stands.

    Args:
        experiment: The resolved experiment.
        rllib: Settings of the algorithm.
        policies: The policies by name where there are several agents.
        folder: Takes a checkpoint for each policy that has a teacher.
        stream: Where progress goes.

    Raises:
        SafeInspectError: A teacher's thrust is no action of the policy, or it cannot fly the task.
    """
    wanted = _wanted(rllib, policies)
    if not wanted:
        return rllib, policies
    folder = folder.absolute()
    if not all(_is_finished(folder / name) for name in wanted):
        threads = torch.get_num_threads()
        torch.set_num_threads(int(rllib.settings["torch_num_threads"]))  # many wait for each other on small nets
        try:
            _imitate(experiment, rllib, policies, wanted, folder, stream)
        finally:
            torch.set_num_threads(threads)
    begun = {name: str(folder / name) for name in wanted}
    if not policies:
        return replace(rllib, settings=_beginning_with(rllib.settings, begun[SINGLE])), policies
    return rllib, {
        name: replace(policy, settings=_beginning_with(policy.settings, begun[name])) if name in begun else policy
        for name, policy in policies.items()
    }


def _wanted(rllib: TranslatedSettings, policies: Mapping[str, PolicySettings]) -> dict[str, Mapping[str, Any]]:
    """Return the settings of each policy that has a teacher, by its name."""
    found = {name: {**rllib.settings, **policy.settings} for name, policy in policies.items() if policy.trains}
    for name, settings in found.items():
        settings["model_config"] = {
            **rllib.settings["model_config"], **policies[name].settings.get("model_config", {})
        }  # fmt: skip
    found = found if policies else {SINGLE: rllib.settings}
    return {name: settings for name, settings in found.items() if settings.get(IMITATION)}


def _beginning_with(settings: Mapping[str, Any], folder: str) -> dict[str, Any]:
    return {**settings, "model_config": {**settings.get("model_config", {}), "initial_weights": folder}}


def _is_finished(folder: Path) -> bool:
    try:
        read_checkpoint(folder)
    except CheckpointError:
        return False
    return True


def _imitate(
    experiment: Mapping[str, Any],
    rllib: TranslatedSettings,
    policies: Mapping[str, PolicySettings],
    wanted: Mapping[str, Mapping[str, Any]],
    folder: Path,
    stream: TextIO,
) -> None:
    seed = int(rllib.settings.get("seed") or 0)
    torch.manual_seed(seed)
    generator = torch.Generator().manual_seed(seed)
    spec = build_spec(experiment)
    lessons = {name: Imitation.model_validate(settings[IMITATION]) for name, settings in wanted.items()}
    by_agent = {agent: policy.name for policy in policies.values() for agent in policy.agents}
    policy_of: Callable[[str], str] = by_agent.__getitem__ if policies else lambda agent: SINGLE
    taught = replace(
        spec,
        agents=tuple(
            replace(agent, teacher=lessons[policy_of(agent.name)].teacher)
            if agent.scripted_policy is None and policy_of(agent.name) in lessons
            else agent
            for agent in spec.agents
        ),
    )
    small = TeamEnvironment(taught, 1, seed=seed)
    slots = agent_slots(small, policy_of)
    texts = policy_texts(environment_settings(experiment, rllib.settings), policies)
    modules = {
        name: _module(name, small, slots, settings, rllib.settings["algorithm"], texts.get(name, {}))
        for name, settings in _all(rllib, policies).items()
    }
    pupils = {name: _Pupil(modules[name], lessons[name], float(settings["gamma"])) for name, settings in wanted.items()}
    _learn(taught, slots, modules, pupils, seed, generator, stream)
    for name, pupil in pupils.items():
        with new_folder(folder / name, "train", force=True, hint="move it away") as work:
            (work / MODULES).mkdir(parents=True)
            pupil.module.save_to_path(work / MODULES / name)
            seal_checkpoint(Checkpoint(work, 0, 0, 0.0, ""))


def _all(rllib: TranslatedSettings, policies: Mapping[str, PolicySettings]) -> dict[str, Mapping[str, Any]]:
    """Return the settings of the nets of every policy that flies."""
    if not policies:
        return {SINGLE: rllib.settings["model_config"]}
    return {
        name: {**rllib.settings["model_config"], **policy.settings.get("model_config", {})}
        for name, policy in policies.items()
    }


def _module(
    name: str,
    environment: TeamEnvironment,
    slots: tuple[AgentSlot, ...],
    model: Mapping[str, Any],
    algorithm: str,
    info: Mapping[str, str],
) -> Any:
    """Return a fresh module of a policy."""
    group = environment.acting[next(slot.group for slot in slots if slot.policy == name)]
    spec = policy_spec(model, algorithm, info)
    spec.observation_space, spec.action_space = box(group.observation_layout), action_space(group.action_layout)
    return spec.build()


def _learn(
    spec: EnvironmentSpec,
    slots: tuple[AgentSlot, ...],
    modules: Mapping[str, Any],
    pupils: Mapping[str, _Pupil],
    seed: int,
    generator: torch.Generator,
    stream: TextIO,
) -> None:
    """Fly the rounds and let the pupils learn from each."""
    rounds = max(pupil.settings.rounds for pupil in pupils.values())
    episodes = max(pupil.settings.episodes for pupil in pupils.values())
    gamma = next(iter(pupils.values())).gamma
    flying = {name: sampling(module, generator) for name, module in modules.items()}
    known: dict[str, list[Steps]] = {name: [] for name in pupils}
    for number in range(rounds + 1):
        environment = TeamEnvironment(spec, episodes, seed=stream_seed(seed, _FIRST_ROUND + number))
        acting = {name: act for name, act in flying.items() if number or name not in pupils}
        taught = tuple(pupils) if number < rounds else ()
        found = fly_round(environment, slots, acting, taught, gamma)
        losses = {}
        for name, pupil in pupils.items():
            if number < rounds:
                known[name].append(found.steps[name])
                losses[name] = clone(pupil.module, Steps.join(known[name]), pupil.settings, generator)
            else:
                losses[name] = fit_values(pupil.module, found.steps[name], pupil.settings, generator)
        _print(found, number, rounds, losses, stream)


def _print(found: FlownRound, number: int, rounds: int, losses: Mapping[str, float], stream: TextIO) -> None:
    """Print what the pilots of a round have reached and what the pupils have learned of it."""
    who = "the teacher" if number == 0 else f"the policy after round {number}"
    what = "loss of the clone" if number < rounds else "error of the values"
    numbers = ", ".join(f"{loss:.4g}" for loss in losses.values())
    rate = f"{100.0 * found.success:.1f} % won, {found.delta_v:.3f} m/s"
    title = f"imitation {number + 1}/{rounds}" if number < rounds else "imitation, values"
    print(f"{title}: {who} flies: {rate}; {what} {numbers}", file=stream, flush=True)
