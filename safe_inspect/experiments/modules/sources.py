"""Policies and their tasks, from the sources that a user gives: `open_candidates` for commands, `load_policy` for code.

Ray and Torch are loaded only for a checkpoint, and onnxruntime only for an ONNX file.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.config.experiment import Experiment, build_experiment, load_experiment
from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.environments.facades.single import InspectionEnv
from safe_inspect.environments.facades.vector import InspectionVectorEnv
from safe_inspect.environments.layout import action_layout, observation_layout
from safe_inspect.errors import ArgumentError, CheckpointError, KeywordError, SafeInspectError, did_you_mean
from safe_inspect.evaluation.episodes import Episodes
from safe_inspect.evaluation.onnx_policy import OnnxPolicy
from safe_inspect.evaluation.policies import BASELINES, Policies, Policy, baseline
from safe_inspect.evaluation.policy_file import check_layout
from safe_inspect.evaluation.results.files import sha256
from safe_inspect.evaluation.results.measuring import check_metrics
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.evaluation.shipped import shipped_policies, shipped_policy
from safe_inspect.evaluation.task import default_metrics, price_of, task_of
from safe_inspect.experiments.modules.checkpoints import (
    SEAL,
    Checkpoint,
    configuration_of,
    known_configuration,
    known_info,
    newest_checkpoint,
    policy_folder,
    read_weights,
)
from safe_inspect.metrics.base import BaseMetric
from safe_inspect.plugins.functor import describe
from safe_inspect.plugins.registry import registry
from safe_inspect.task_ids import ALL_TASKS
from safe_inspect.types import AnyArray

#: The default task of a source that does not name a task.
DEFAULT_TASK = "safe_inspect/TranslationalInspection-v1"
#: Prefix of a source that is a policy of the package, as on the command line.
SHIPPED = "--policy "


@dataclass(frozen=True, eq=False)
class Candidate:
    """A policy, or the policies of several agents, to evaluate.

    Attributes:
        label: Name in tables.
        source: Description of the source: ``text``, ``kind``, ``path`` and ``sha256``.
        experiment: The experiment that defines the task.
        spec: The task, with observations and actions in the form that the policies need.
        policies: One policy for all agents, or one for each agent by the agents' names.
    """

    label: str
    source: Mapping[str, Any]
    experiment: Experiment
    spec: EnvironmentSpec
    policies: Policies

    @property
    def task(self) -> dict[str, Any]:
        """The part of the task that must be equal in evaluations that are compared, see `task_of`."""
        return task_of(self.experiment.spec)

    @property
    def price(self) -> str:
        """A hash of the settings that determine rewards, see `price_of`."""
        return price_of(self.experiment.spec)

    def measured(self, metrics: Sequence[BaseMetric]) -> list[BaseMetric]:
        """Return the given metrics and the default metrics, of which those with a label of a given one are omitted.

        Raises:
            SafeInspectError: A metric names something that the task does not have.
        """
        own = {metric.label for metric in metrics}
        found = [*metrics, *(metric for metric in default_metrics(self.experiment.spec) if metric.label not in own)]
        check_metrics(self.spec, found)
        return found

    def fly(self, episodes: int, seed: int, num_envs: int, **options: Any) -> Episodes:
        """Run episodes; see `rollout`."""
        return rollout(self.spec, self.policies, episodes, seed, num_envs, **options)


@dataclass(frozen=True)
class Wanted:
    """Options with which candidates are opened.

    Attributes:
        cfg: Experiment file, or id of a shipped task; None selects the experiment of each source.
        overrides: ``path.of.keys=value`` for each value to override.
        compute_platform: Name of the task's `rllib_configs` to read.
        sampled: Whether actions are sampled from the policy's distribution; None samples only choices, see
            `TrainedPolicy`.
        seed: Seed of the sampled actions.
        usual: The experiment of a source without an experiment; None selects that of the first other source, or
            `DEFAULT_TASK`.
    """

    cfg: str | os.PathLike[str] | None = None
    overrides: Iterable[str] = ()
    compute_platform: str = "local"
    sampled: bool | None = None
    seed: int = 0
    usual: Experiment | None = None

    def load(self, cfg: str | os.PathLike[str]) -> Experiment:
        """Return an experiment with the overrides."""
        return load_experiment(cfg, self.overrides, compute_platform=self.compute_platform)

    def build(self, resolved: Mapping[str, Any], source: str) -> Experiment:
        """Return the experiment of a resolved configuration with the overrides."""
        return build_experiment(resolved, source, self.overrides, compute_platform=self.compute_platform)


def open_source(
    text: str | os.PathLike[str], cfg: str | os.PathLike[str] | None = None, overrides: Iterable[str] = ()
) -> tuple[EnvironmentSpec, Policies]:
    """Return the task and the policies of its agents; see `open_candidates`."""
    (candidate,) = open_candidates([os.fspath(text)], Wanted(cfg, tuple(overrides)))
    return candidate.spec, candidate.policies


def open_candidates(texts: Iterable[str], wanted: Wanted) -> list[Candidate]:
    """Return the candidates of several sources, in their order.

    Args:
        texts: The sources. Each is a checkpoint's folder; a run's folder, whose newest checkpoint is used; an ONNX
            file; or the name of a baseline, of any scripted policy or of a policy of the package, the last with or
            without the prefix `SHIPPED`. Write ./name for a folder with such a name.
        wanted: Options for all sources.

    Raises:
        CheckpointError: A checkpoint is damaged, of another task, or missing.
        ConfigError: The configuration has mistakes.
        SafeInspectError: There is no such source.
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
        first = wanted.usual or next((candidate.experiment for candidate in opened.values()), None)
        if wanted.cfg is not None or first is None:
            first = wanted.load(DEFAULT_TASK if wanted.cfg is None else wanted.cfg)
        for text in scripted:
            opened[text] = _open_scripted(text, wanted, first)
    return [opened[text] for text in texts]


def is_scripted(text: str) -> bool:
    """Return whether a source is the name of a scripted policy; write ./name for a folder with that name."""
    known = {*BASELINES, *(registered for registered, _ in registry.items("policy"))}
    return text in known or not (os.sep in text or text.endswith(".onnx") or os.path.exists(text) or "." not in text)


def _source(text: str, kind: str, path: Path | None, digest: str) -> dict[str, Any]:
    """Return the description of a source, see `Candidate`."""
    return {"text": text, "kind": kind, "path": None if path is None else str(path), "sha256": digest}


def _open_scripted(text: str, wanted: Wanted, experiment: Experiment) -> Candidate:
    if wanted.sampled is not None:
        flag = "--sampled" if wanted.sampled else "--mode"
        raise SafeInspectError(f"{text}: {flag} is for trained policies; a scripted one has no distribution")
    plugin = baseline(text)
    digest = hashlib.sha256(json.dumps(describe(plugin), sort_keys=True).encode()).hexdigest()
    return Candidate(text, _source(text, "scripted", None, digest), experiment, experiment.spec, plugin)


def _open_shipped(text: str, wanted: Wanted) -> Candidate:
    shipped = shipped_policy(text.removeprefix(SHIPPED))
    experiment = wanted.load(shipped.experiment if wanted.cfg is None else wanted.cfg)
    if importlib.util.find_spec("onnxruntime") is None:  # the package contains the weights for Torch too
        flying = _checkpoint_policies(shipped.checkpoint, experiment.spec, wanted)
        source = _source(text, "shipped", shipped.folder, _checkpoint_hash(shipped.checkpoint))
        return Candidate(shipped.name, source, experiment, experiment.spec, flying)
    policies = shipped.load(wanted.sampled, wanted.seed)
    outside = [agent.name for agent in experiment.spec.controlled]
    distinct = list({id(policy): policy for policy in policies.values()}.values())
    if len(distinct) == 1:  # a single policy may control agents with other names too
        policies = dict.fromkeys(outside, distinct[0])
    missing = [agent for agent in outside if agent not in policies]
    if missing:
        raise CheckpointError(
            f"{shipped.name}: the shipped policies control {', '.join(policies)}, but not {missing[0]!r}; "
            "give the experiment with which they were trained"
        )
    spec = experiment.spec
    for policy in distinct:
        spec = policy.prepare(spec, [agent for agent in outside if policies[agent] is policy])
    digest = hashlib.sha256("".join(sha256(path) for path in sorted(set(shipped.onnx.values()))).encode()).hexdigest()
    source = _source(text, "shipped", shipped.folder, digest)
    return Candidate(shipped.name, source, experiment, spec, {agent: policies[agent] for agent in outside})


def _newest_run(missing: Path) -> str:
    """Return a hint to the newest checkpoint or run in the folder in which one was expected, if there is any."""
    checkpoints = sorted(found.name for found in missing.parent.glob("checkpoint_*"))
    if checkpoints:
        return f"the newest one there is {checkpoints[-1]}"
    runs = [found for found in missing.parent.glob("*") if (found / "run.json").is_file()]
    if runs:
        named = [run for run in runs if run.name.startswith(missing.name)]
        newest = max(named or runs, key=os.path.getmtime)
        return f"did you mean {newest}?" if named else f"the newest run there is {newest}"
    return "give the run folder that a training prints, or a name of `safe-inspect list policies`"


def _open_trained(text: str, wanted: Wanted) -> Candidate:
    path = Path(text).expanduser()
    if os.path.isdir(path):
        return _open_checkpoint(text, newest_checkpoint(path), wanted)
    if path.suffix == ".onnx":
        return _open_onnx(text, path, wanted)
    if path.suffix in (".yml", ".yaml") or text in ALL_TASKS:
        hint = "give it with --cfg, and name a policy, such as inspector"
        raise SafeInspectError(f"{text}: this is an experiment, not a policy; {hint}")
    if os.path.exists(path):
        raise SafeInspectError(f"{text}: this file is not a policy; give the folder of a checkpoint or an ONNX file")
    if os.sep in text:
        raise SafeInspectError(f"{text}: there is no such checkpoint or ONNX file; {_newest_run(path)}")
    known = {*BASELINES, *(registered for registered, _ in registry.items("policy")), *shipped_policies()}
    raise SafeInspectError(
        f"no policy {text!r}: it is neither a checkpoint's folder nor an ONNX file nor the name of one; "
        f"{did_you_mean(text, known)}"
    )


def _open_checkpoint(text: str, folder: Path, wanted: Wanted) -> Candidate:
    Checkpoint.read(folder)
    configuration = configuration_of(folder)
    experiment = wanted.load(known_configuration(folder) if wanted.cfg is None else wanted.cfg)
    policies = _checkpoint_policies(folder, experiment.spec, wanted)
    run = configuration.parent.name if configuration is not None else folder.absolute().parent.name
    source = _source(text, "checkpoint", folder.absolute(), _checkpoint_hash(folder))
    return Candidate(f"{run}/{folder.name}", source, experiment, experiment.spec, policies)


def _open_onnx(text: str, path: Path, wanted: Wanted) -> Candidate:
    from safe_inspect.evaluation.onnx_policy import load_onnx  # loads onnxruntime

    policy = load_onnx(path, wanted.sampled, wanted.seed)
    experiment = wanted.build(policy.info.configuration, text) if wanted.cfg is None else wanted.load(wanted.cfg)
    source = _source(text, "onnx", path.absolute(), sha256(path))
    return Candidate(path.stem, source, experiment, policy.prepare(experiment.spec), policy)


def _checkpoint_hash(checkpoint: Path) -> str:
    """Return the hash of a checkpoint's files, by name and content, without its seal."""
    found = hashlib.sha256()
    for path in sorted(checkpoint.rglob("*")):
        if path.is_file() and not path.name.startswith(SEAL):
            found.update(path.relative_to(checkpoint).as_posix().encode())
            found.update(path.read_bytes())
    return found.hexdigest()


def _checkpoint_policies(path: Path, spec: EnvironmentSpec, wanted: Wanted) -> dict[str, Policy]:
    """Return the policy of each controlled agent; agents with the same policy share one object.

    Raises:
        CheckpointError: The checkpoint is damaged, of another task, or has no policy for an agent.
    """
    chosen = {agent.name: _chosen(path, agent) for agent in spec.controlled}
    for agent in spec.controlled:  # checked before Ray and Torch are loaded
        weights = read_weights(policy_folder(path, chosen[agent.name]))
        check_layout(str(path), known_info(weights.model, str(path)), agent)
    from safe_inspect.experiments.modules.policy import trained_policy  # loads Ray and Torch

    loaded = {
        name: trained_policy(path, name, sampled=wanted.sampled, seed=wanted.seed)
        for name in dict.fromkeys(chosen.values())
    }
    return {agent: loaded[name] for agent, name in chosen.items()}


def _chosen(path: Path, agent: AgentSpec) -> str:
    """Return the name of the checkpoint's policy for an agent: the agent's own policy, or the only one."""
    try:
        return policy_folder(path, usual=agent.policy).name
    except CheckpointError as error:
        known = str(error).partition("; ")[0]
        raise CheckpointError(
            f"{known}, but none is {agent.policy!r}, the policy of the agent {agent.name!r}; "
            "give the experiment with which it was trained"
        ) from None


class LoadedPolicy:
    """A trained policy with its task. A recurrent policy stores the state of each row between calls.

    Attributes:
        spec: The task in which it was trained, with the overrides.
        agent: Name of the agent that it controls.
        recurrent: Whether it has a state.
    """

    def __init__(self, spec: EnvironmentSpec, agent: AgentSpec, policy: Any) -> None:
        self.spec, self.agent = spec, agent.name
        self._policy, self._file = policy, isinstance(policy, OnnxPolicy)
        self.recurrent = bool(policy.recurrent)
        self._rows = 0
        self._size = observation_layout(agent).size
        self._action = action_layout(agent)

    def predict(
        self,
        observation: AnyArray,
        generator: np.random.Generator | None = None,
        episode_start: AnyArray | bool | None = None,
        **unknown: Any,
    ) -> AnyArray:
        """Return the actions for observations.

        By default the action is the mean of a Gaussian policy, the most likely levels of a categorical policy, and both
        of a hurdle policy.

        Args:
            observation: Observations from `make`, `make_vec` or any environment of the task, shape (O,) or (N, O).
            generator: Samples the values that `evaluate` samples: choices, such as whether to burn, but not the size of
                a burn.
            episode_start: Whether the observation is the first of an episode, one bool or one for each row, shape (N,).
                A recurrent policy needs it, and must be called once per step with the rows of all its environments;
                other policies ignore it.
            **unknown: Not accepted.

        Returns:
            Actions for the environment, shape (A,) or (N, A): int64 for levels, otherwise float32.

        Raises:
            ArgumentError: The observations have another shape or are not finite numbers; the policy is recurrent, and
                `episode_start` is missing, or False in rows that the last call did not have; an argument is unknown, or
                `generator` is not a `numpy.random.Generator`.
        """
        if generator is not None and not isinstance(generator, np.random.Generator):
            raise ArgumentError(
                f"`generator` is {generator!r:.60}; give a numpy.random.Generator, such as "
                "`numpy.random.default_rng(0)`, or None for the most likely action"
            )
        for name in unknown:
            raise KeywordError(
                f"predict() got an unexpected keyword argument {name!r}; without `generator` it returns the most "
                "likely action, with `generator=numpy.random.default_rng(0)` it samples one"
            )
        try:
            rows = np.asarray(observation, dtype=np.float32)
        except (TypeError, ValueError):
            raise ArgumentError(f"the observations are not an array of numbers: {observation!r:.60}") from None
        if rows.ndim not in (1, 2) or rows.shape[-1] != self._size:
            raise ArgumentError(
                f"the observations have the shape {rows.shape}; expected ({self._size},) or (N, {self._size}), as from "
                "an environment of the policy's own task: `policy.make()`"
            )
        whole = np.atleast_2d(rows)
        if self.recurrent:
            self._begin(episode_start, len(whole))
        if generator is None:
            actions = self._policy.in_task_units(whole) if self._file else np.asarray(self._policy(whole))
        else:
            actions = self._policy.draw(whole, int(generator.integers(2**63)))
        if self._action.choices:
            actions = actions.astype(np.int64)
        else:
            actions = np.clip(actions, self._action.low, self._action.high).astype(np.float32)
        return actions if rows.ndim == 2 else actions[0]

    def _begin(self, episode_start: AnyArray | bool | None, count: int) -> None:
        """Reset the state of a recurrent policy in the rows in which an episode begins."""
        if episode_start is None:
            raise ArgumentError(
                "the policy is recurrent; give `episode_start`, True for each row whose observation is the first of an "
                "episode"
            )
        starts = np.asarray(episode_start)
        if starts.dtype != np.bool_ or starts.shape not in ((), (count,)):
            raise ArgumentError(
                f"`episode_start` has the shape {starts.shape} and the type {starts.dtype}; expected one bool or an "
                f"array of bools of shape ({count},)"
            )
        starts = np.broadcast_to(starts, count)
        if self._rows != count and not starts.all():
            raise ArgumentError(
                f"there are {count} observations, but there were {self._rows} in the last call; `episode_start` must "
                "be True in all rows when their number changes"
            )
        self._policy.reset(None if starts.all() else starts)
        self._rows = count

    def make(self, **kwargs: Any) -> InspectionEnv:
        """Return one environment of the task; see `InspectionEnv`."""
        return InspectionEnv(self.spec, **kwargs)

    def make_vec(self, num_envs: int = 1, **kwargs: Any) -> InspectionVectorEnv:
        """Return N environments of the task that step together; see `InspectionVectorEnv`."""
        return InspectionVectorEnv(self.spec, num_envs, **kwargs)


def load_policy(
    source: str | os.PathLike[str],
    cfg: str | os.PathLike[str] | None = None,
    overrides: Iterable[str] = (),
    *,
    agent: str | None = None,
) -> LoadedPolicy:
    """Return a trained policy.

    Args:
        source: Name of a policy of the package, an ONNX file, a checkpoint's folder, or a run's folder.
        cfg: Experiment file, or id of a task; by default the task in which the policy was trained.
        overrides: ``path.of.keys=value`` for each value of the task to override.
        agent: Name of the agent to control; needed if the agents have different policies.

    Raises:
        CheckpointError: The policy is damaged, of another task, or missing.
        ConfigError: The configuration has mistakes.
        SafeInspectError: The source is a scripted policy, or there is no such agent.
    """
    if not isinstance(source, str | os.PathLike):
        raise ArgumentError(f"a policy is a name, a file or a folder, not {source!r}")
    text = os.fspath(source)
    if is_scripted(text):
        raise SafeInspectError(f"{text}: a scripted policy acts inside the environment; pass it to `rollout`")
    (candidate,) = open_candidates([text], Wanted(cfg, tuple(overrides), sampled=False))
    spec, policies = candidate.experiment.spec, candidate.policies
    outside = {item.name: item for item in spec.controlled}
    flying = dict(policies) if isinstance(policies, dict) else dict.fromkeys(outside, policies)
    if agent is None and len(set(map(id, flying.values()))) > 1:
        raise SafeInspectError(
            f"{text}: the agents {', '.join(flying)} have different policies; name one of them as `agent`"
        )
    name = next(iter(flying)) if agent is None else agent
    if name not in flying:
        raise SafeInspectError(f"{text}: it controls no agent {name!r}; {did_you_mean(name, flying)}")
    return LoadedPolicy(spec, outside[name], flying[name])
