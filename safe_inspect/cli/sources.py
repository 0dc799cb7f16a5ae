"""`open_candidates`: who is to be evaluated, in which task, from what a user writes on the command line."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import Experiment, build_experiment, load_experiment
from safe_inspect.config.loading.located import LocatedDict
from safe_inspect.config.loading.overrides import apply_overrides
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.policies import BASELINES, baseline
from safe_inspect.evaluation.policy_files.shipped import shipped_policies, shipped_policy
from safe_inspect.evaluation.results.folder import sha256
from safe_inspect.evaluation.rollouts.crew import Policies
from safe_inspect.experiments.modules.sources import DEFAULT_TASK, configuration_of, open_source
from safe_inspect.experiments.runs.checkpoints import SEAL, find_newest
from safe_inspect.plugins.functor import describe
from safe_inspect.plugins.registry import registry
from safe_inspect.task_ids import TASKS, TEAM_TASKS

#: Begins a source that is a policy of the package, as a user writes it.
SHIPPED = "--policy "


@dataclass(frozen=True, eq=False)
class Candidate:
    """Who is to be evaluated.

    Attributes:
        label: Name in tables.
        source: What it is: ``text``, ``kind``, ``path`` and ``sha256``.
        experiment: The experiment in whose task it flies.
        spec: The task as it flies in it, with observations and actions as it wants them.
        policies: Who flies the agents.
    """

    label: str
    source: Mapping[str, Any]
    experiment: Experiment
    spec: EnvironmentSpec
    policies: Policies


@dataclass(frozen=True)
class Wanted:
    """How candidates are to fly.

    Attributes:
        cfg: Experiment file, or id of a shipped task; None: that of each source.
        overrides: ``path.of.keys=value`` for each value that is replaced.
        compute_platform: Which of the task's `rllib_configs` is read.
        sampled: Whether actions are drawn from the policy's distribution; None: those of categorical policies.
        seed: Seed of the draws.
        usual: The experiment for what has none of its own; None: the first of the other sources', or the shipped task.
    """

    cfg: str | None = None
    overrides: Sequence[str] = ()
    compute_platform: str = "local"
    sampled: bool | None = None
    seed: int = 0
    usual: Experiment | None = None

    def load(self, cfg: str | os.PathLike[str]) -> Experiment:
        """Return an experiment with the overrides."""
        tasks = TASKS | TEAM_TASKS
        path = configs_root() / tasks[str(cfg)] if str(cfg) in tasks else cfg
        return load_experiment(path, self.overrides, compute_platform=self.compute_platform)

    def build(self, resolved: Mapping[str, Any], source: str) -> Experiment:
        """Return the experiment of a resolved configuration with the overrides."""
        tree = apply_overrides(LocatedDict(resolved), self.overrides)
        return build_experiment(tree, source, compute_platform=self.compute_platform)


def open_candidates(texts: Iterable[str], wanted: Wanted) -> list[Candidate]:
    """Return who is to be evaluated, in the order in which they are named.

    Args:
        texts: For each a checkpoint's folder, or a run's folder, which stands for its newest checkpoint; an ONNX file;
            the name of a baseline, of any scripted policy or of a policy of the package, the last with or without
            `SHIPPED` before it. A folder of such a name is written ./name.
        wanted: How they are to fly.

    Raises:
        SafeInspectError: A source is missing, damaged or of another task, or the configuration has mistakes.
    """
    texts = [SHIPPED + text if text in shipped_policies() else text for text in texts]
    shipped = {text for text in texts if text.startswith(SHIPPED)}
    scripted = {text for text in texts if text not in shipped and is_scripted(text)}
    opened = {
        text: _open_shipped(text, wanted) if text in shipped else _open_trained(text, wanted)
        for text in texts
        if text not in scripted
    }
    if scripted:
        experiment = _task_of_scripted(wanted, list(opened.values()))
        for text in scripted:
            opened[text] = _open_scripted(text, wanted, experiment)
    return [opened[text] for text in texts]


def is_scripted(text: str) -> bool:
    """Return whether a source is the name of a scripted policy; a folder of that name is written ./name."""
    known = {*BASELINES, *(registered for registered, _ in registry.items("policy"))}
    return text in known or not (os.sep in text or text.endswith(".onnx") or Path(text).exists() or "." not in text)


def _task_of_scripted(wanted: Wanted, others: Sequence[Candidate]) -> Experiment:
    if wanted.cfg is not None:
        return wanted.load(wanted.cfg)
    if wanted.usual is not None:
        return wanted.usual
    return others[0].experiment if others else wanted.load(DEFAULT_TASK)


def _open_scripted(text: str, wanted: Wanted, experiment: Experiment) -> Candidate:
    if wanted.sampled is not None:
        flag = "--sampled" if wanted.sampled else "--mode"
        raise SafeInspectError(f"{text}: {flag} is for trained policies; a scripted one has no distribution")
    plugin = baseline(text)
    digest = hashlib.sha256(json.dumps(describe(plugin), sort_keys=True).encode()).hexdigest()
    source = {"text": text, "kind": "scripted", "path": None, "sha256": digest}
    return Candidate(text, source, experiment, experiment.spec, plugin)


def _open_shipped(text: str, wanted: Wanted) -> Candidate:
    shipped = shipped_policy(text.removeprefix(SHIPPED))
    experiment = wanted.load(shipped.experiment if wanted.cfg is None else wanted.cfg)
    policies = shipped.load(wanted.sampled, wanted.seed)
    spec = experiment.spec
    for policy in {id(policy): policy for policy in policies.values()}.values():
        spec = policy.prepare(spec, [agent for agent, other in policies.items() if other is policy])
    digest = hashlib.sha256("".join(sha256(path) for path in sorted(set(shipped.onnx.values()))).encode()).hexdigest()
    source = {"text": text, "kind": "shipped", "path": str(shipped.folder), "sha256": digest}
    return Candidate(shipped.name, source, experiment, spec, policies)


def _open_trained(text: str, wanted: Wanted) -> Candidate:
    path = Path(text).expanduser()
    if text.endswith(".onnx"):
        return _open_onnx(text, path, wanted)
    folder = _checkpoint(path)
    configuration = configuration_of(folder)
    cfg = wanted.cfg if wanted.cfg is not None else configuration
    experiment = None if cfg is None else wanted.load(cfg)
    spec, policies = open_source(folder if folder.is_dir() else text, wanted.cfg, wanted.overrides)
    assert experiment is not None, "open_source refuses a checkpoint whose task is not known"
    policies = _drawing(policies, wanted)
    run = configuration.parent.name if configuration is not None else folder.absolute().parent.name
    source = {"text": text, "kind": "checkpoint", "path": str(folder.absolute()), "sha256": _hash_of(folder)}
    return Candidate(f"{run}/{folder.name}", source, experiment, spec, policies)


def _checkpoint(path: Path) -> Path:
    """Return a checkpoint's folder; of a run's folder the newest complete checkpoint, where there is one."""
    if path.is_dir() and not (path / SEAL).is_file() and configuration_of(path) is not None:
        found = find_newest(path)
        if found.newest is not None:
            return found.newest.path
    return path


def _open_onnx(text: str, path: Path, wanted: Wanted) -> Candidate:
    from safe_inspect.evaluation.policy_files.onnx_policy import load_onnx

    policy = load_onnx(path, wanted.sampled, wanted.seed)
    experiment = wanted.build(policy.configuration, text) if wanted.cfg is None else wanted.load(wanted.cfg)
    source = {"text": text, "kind": "onnx", "path": str(path.absolute()), "sha256": sha256(path)}
    return Candidate(path.stem, source, experiment, policy.prepare(experiment.spec), policy)


def _drawing(policies: Policies, wanted: Wanted) -> Policies:
    """Return trained policies that draw their actions as is wanted; one that flies several agents stays one."""
    from safe_inspect.experiments.modules.policy import TrainedPolicy

    if not isinstance(policies, Mapping):
        return policies
    drawn = {
        id(policy): TrainedPolicy(policy.module, wanted.sampled, wanted.seed)
        for policy in policies.values()
        if isinstance(policy, TrainedPolicy)
    }
    return {name: drawn.get(id(policy), policy) for name, policy in policies.items()}


def _hash_of(checkpoint: Path) -> str:
    """Return the hash of a checkpoint's files, by name and content, its own seal left out."""
    found = hashlib.sha256()
    for path in sorted(checkpoint.rglob("*")):
        if path.is_file() and not path.name.startswith(SEAL):
            found.update(path.relative_to(checkpoint).as_posix().encode())
            found.update(path.read_bytes())
    return found.hexdigest()
