"""`open_source`: who is to fly, and the task, from what a user writes on the command line.

Ray and Torch are loaded for a checkpoint only, onnxruntime for an ONNX file only.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.environments.registration import load_spec
from safe_inspect.errors import CheckpointError, SafeInspectError, did_you_mean
from safe_inspect.evaluation.policies import BASELINES, Policy, baseline
from safe_inspect.evaluation.policy_files.shipped import shipped_policies, shipped_policy
from safe_inspect.evaluation.policy_files.trained_layout import check_layout
from safe_inspect.evaluation.rollouts.crew import Policies
from safe_inspect.experiments.runs.checkpoints import SEAL, find_newest, policy_folder, read_checkpoint
from safe_inspect.experiments.runs.run_folder import RunFolder
from safe_inspect.plugins.registry import registry

#: The task of a source that has none of its own, when none is given.
DEFAULT_TASK = "safe_inspect/TranslationalInspection-v0"


def open_source(
    text: str | os.PathLike[str], cfg: str | os.PathLike[str] | None = None, overrides: Iterable[str] = ()
) -> tuple[EnvironmentSpec, Policies]:
    """Return the task and who flies its agents.

    Args:
        text: A checkpoint's folder; the folder of a training run, which stands for its newest checkpoint; an ONNX
            file; or the name of a policy that the package ships, of a baseline or of any scripted policy. A name comes
            before a folder of that name, which is written ``./name``.
        cfg: Experiment file, or id of a shipped task. Unless given, a trained policy flies in the task that it was
            trained in, and a scripted one in `DEFAULT_TASK`.
        overrides: ``path.of.keys=value`` for each value that replaces one of the configuration's.

    Returns:
        The task, and what `rollout` takes: one policy for all agents, or a mapping from the
        names of the agents that act from outside to theirs.

    Raises:
        CheckpointError: The checkpoint is damaged, of another task, or there is none.
        ConfigError: The configuration has mistakes.
        SafeInspectError: There is no such source.
    """
    name, path = os.fspath(text), Path(text).expanduser()
    known = {*BASELINES, *(registered for registered, _ in registry.items("policy"))}
    if name in known:  # a folder of that name is written ./name
        return load_spec(cfg or DEFAULT_TASK, overrides), baseline(name)
    if name in shipped_policies():
        return _open_shipped(name, cfg, overrides)
    if path.is_dir():
        return _open_checkpoint(_checkpoint(path), cfg, overrides)
    if path.suffix == ".onnx":
        from safe_inspect.evaluation.policy_files.onnx_policy import load_onnx

        policy = load_onnx(path)
        return policy.prepare(policy.task(overrides) if cfg is None else load_spec(cfg, overrides)), policy
    if path.exists():
        raise SafeInspectError(f"{name}: this file is no policy; give the folder of a checkpoint or an ONNX file")
    if os.sep in name:
        raise SafeInspectError(f"{name}: there is no such checkpoint or ONNX file")
    if "." in name:  # a plugin's class by its dotted path
        return load_spec(cfg or DEFAULT_TASK, overrides), baseline(name)
    hint = did_you_mean(name, {*known, *shipped_policies()})
    raise SafeInspectError(
        f"no policy {name!r}: it is neither a checkpoint's folder nor an ONNX file nor the name of one; {hint}"
    )


def _open_shipped(
    name: str, cfg: str | os.PathLike[str] | None, overrides: Iterable[str]
) -> tuple[EnvironmentSpec, Policies]:
    policies = shipped_policy(name).load()
    first = next(iter(policies.values()))
    spec = first.task(overrides) if cfg is None else load_spec(cfg, overrides)
    outside = [agent.name for agent in spec.agents if agent.pilot is None]
    if len({id(policy) for policy in policies.values()}) == 1:
        return first.prepare(spec), first
    missing = [agent for agent in outside if agent not in policies]
    if missing:
        raise CheckpointError(
            f"{name}: the shipped policies fly {', '.join(policies)}, and none {missing[0]!r}; "
            "give the experiment that they were trained with"
        )
    for policy in {id(policy): policy for policy in policies.values()}.values():
        spec = policy.prepare(spec, [agent for agent in outside if policies[agent] is policy])
    return spec, {agent: policies[agent] for agent in outside}


def _checkpoint(path: Path) -> Path:
    """Return a checkpoint's folder; of a run's folder, or one within it, the newest complete checkpoint."""
    if (path / SEAL).is_file() or path.name.startswith("checkpoint_"):
        return path
    if configuration_of(path) is None:
        raise CheckpointError(
            f"{path}: this is neither a checkpoint nor the folder of a training run; give the folder of either"
        )
    found = find_newest(path)
    if found.newest is None:
        why = found.refused[0] if found.refused else "wait for the first, or give another run"
        raise CheckpointError(f"{path}: the run has no complete checkpoint; {why}")
    return found.newest.path


def configuration_of(checkpoint: str | os.PathLike[str]) -> Path | None:
    """Return the resolved configuration of the run in which a checkpoint lies; None where it lies elsewhere."""
    path = Path(checkpoint).expanduser().absolute()
    for folder in (path, *path.parents):
        configuration = RunFolder(folder).configuration
        if configuration.is_file():
            return configuration
    return None


def _open_checkpoint(
    path: Path, cfg: str | os.PathLike[str] | None, overrides: Iterable[str]
) -> tuple[EnvironmentSpec, Policies]:
    read_checkpoint(path)
    configuration = configuration_of(path)
    task = configuration if cfg is None else cfg
    if task is None:
        raise CheckpointError(
            f"{path}: the checkpoint lies in no folder of a training run, so its task is not known; give it with --cfg"
        )
    spec = load_spec(task, overrides)
    policies: dict[str, Policy] = {}
    loaded: dict[str, Any] = {}
    for agent in spec.agents:
        if agent.pilot is not None:
            continue
        chosen = _chosen(path, agent)
        if chosen not in loaded:
            loaded[chosen] = _load(path, chosen)
        check_layout(str(path), loaded[chosen].info, agent)
        policies[agent.name] = loaded[chosen]
    return spec, policies


def _chosen(path: Path, agent: AgentSpec) -> str:
    """Return the name of the checkpoint's policy that flies an agent: the agent's own, or the only one."""
    try:
        return policy_folder(path, usual=agent.policy).name
    except CheckpointError as error:
        known = str(error).partition("; ")[0]
        raise CheckpointError(
            f"{known}, and none is the {agent.policy!r} of the agent {agent.name!r}; "
            "give the experiment that it was trained with"
        ) from None


def _load(path: Path, name: str) -> Any:
    from safe_inspect.experiments.modules.policy import load_policy  # loads Ray and Torch

    policy = load_policy(path, name)
    if policy.info is None:
        raise CheckpointError(
            f"{path}: the checkpoint does not say what its policy sees and does, so it is not flown; train again"
        )
    return policy
