"""Comparison of an exported policy with the checkpoint. Importing this module loads Ray and Torch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from ray.rllib.core.columns import Columns

from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.environments.layout import action_layout
from safe_inspect.evaluation.onnx_policy import OnnxPolicy
from safe_inspect.evaluation.policies import with_scripted
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.experiments.modules.policy import TrainedPolicy
from safe_inspect.glues.actions import CoastGlue, ControllerGlue, DiscreteControllerGlue
from safe_inspect.glues.base import controller_of, sensor_of
from safe_inspect.glues.observations import ObserveSensor
from safe_inspect.types import AnyArray, FloatArray

#: Largest accepted difference, relative to the range of the action or to the outputs of the net.
EXPORT_TOLERANCE = 1e-5

_SPREAD = 1.5


@dataclass(frozen=True)
class ExportDifference:
    """Difference between the outputs of a file and those of the checkpoint.

    Attributes:
        rows: Number of observations.
        action: Largest difference of the output `thrust`, relative to the range of the element [-].
        inputs: Largest difference of the output `action_dist_inputs`, relative to the largest output of the row, at
            least 1 [-].
        undecided: Number of rows in which the action is undecided within the tolerance, such as two levels that are
            equally likely; they are omitted from `action`.
    """

    rows: int
    action: float
    inputs: float
    undecided: int = 0

    @property
    def passes(self) -> bool:
        """Whether both differences are within `EXPORT_TOLERANCE`; False for NaN."""
        return bool(self.action <= EXPORT_TOLERANCE and self.inputs <= EXPORT_TOLERANCE)


def compare_readings(policy: OnnxPolicy, module: Any, agent: AgentSpec, readings: AnyArray) -> ExportDifference:
    """Compare a file with the checkpoint's module.

    The readings pass through the agent's observation glues before they reach the module, and the module's actions pass
    through the agent's action glues. For a recurrent policy the rows are episodes that begin at the first step; for
    other policies all steps are treated as one batch.

    Args:
        policy: The file.
        module: The module.
        agent: The agent whose glues are used.
        readings: Observations in SI units, float32, shape (T, R, O) for T steps of R rows.
    """
    steps = readings if policy.recurrent else readings.reshape(1, -1, readings.shape[-1])
    net = TrainedPolicy(module).inputs if policy.recurrent else partial(_inputs, module)
    policy.reset()
    thrust, inputs = (np.concatenate(parts) for parts in zip(*map(policy.outputs, steps), strict=True))
    policy.reset()
    wanted = np.concatenate([net(np.ascontiguousarray(_through_glues(agent, rows), np.float32)) for rows in steps])
    scale = np.maximum(np.abs(wanted).max(axis=1, keepdims=True), 1.0)
    value, sure = _commanded(policy, agent, wanted)
    low, high = (np.array([getattr(element, side) for element in policy.info.action]) for side in ("low", "high"))
    reach = np.where(np.isfinite(high - low), high - low, 1.0)
    off = np.abs(thrust - value) / reach
    return ExportDifference(
        len(wanted),
        float(off[sure].max(initial=0.0)),
        float((np.abs(inputs - wanted) / scale).max(initial=0.0)),
        int((~sure).sum()),
    )


def _inputs(module: Any, observation: AnyArray) -> AnyArray:
    """Return the inputs of the action distributions that a module without a state gives for rows of observations."""
    with torch.no_grad():
        outputs = module.forward_inference({Columns.OBS: torch.from_numpy(observation)})
    return np.asarray(outputs[Columns.ACTION_DIST_INPUTS].numpy())


def random_readings(agent: AgentSpec, steps: int, rows: int, seed: int = 0) -> AnyArray:
    """Sample readings that the glues map to the whole range of the net's inputs, float32, shape (steps, rows, O)."""
    generator = np.random.default_rng(seed)
    parts = []
    for glue in agent.observation_glues:
        low, high = glue.bounds(agent.parts)
        bounded = np.isfinite(low) & np.isfinite(high)
        low, high = np.where(bounded, low, 0.0), np.where(bounded, high, 0.0)
        size = (steps * rows, len(low))
        values = np.where(bounded, generator.uniform(low, high, size), _SPREAD * generator.standard_normal(size))
        if isinstance(glue, ObserveSensor):
            scale, normalizer, *limits = glue.prepared(sensor_of(agent.parts, glue.sensor))
            values = (values if normalizer is None else normalizer.inverse(values, *limits)) / scale
        parts.append(values)
    return np.concatenate(parts, axis=1).astype(np.float32).reshape(steps, rows, -1)


def flown_readings(policy: OnnxPolicy, spec: EnvironmentSpec, episodes: int = 16, seed: int = 0) -> AnyArray:
    """Return the observations of rollouts of the file in SI units, float32, shape (T, R, O); other agents coast."""
    mine = [agent.name for agent in spec.agents if agent.name in policy.info.agents and agent.scripted_policy is None]
    others = [agent.name for agent in spec.agents if agent.name not in mine and agent.scripted_policy is None]
    raw = policy.prepare(spec, mine)
    seen: list[AnyArray] = []

    def fly(observation: AnyArray) -> FloatArray:
        seen.append(observation)
        return policy(observation)

    task = with_scripted(raw, "zero-thrust", others) if others else raw
    rollout(task, fly, episodes=episodes, seed=seed, num_envs=episodes)
    return np.stack(seen)


def _through_glues(agent: AgentSpec, readings: AnyArray) -> FloatArray:
    """Return the observation that the agent's glues compute from readings, shape (R, O)."""
    parts, first = [], 0
    for glue in agent.observation_glues:
        size = len(glue.names(agent.parts))
        part = readings[:, first : first + size].astype(np.float64)
        if isinstance(glue, ObserveSensor):
            view: Any = SimpleNamespace(group=SimpleNamespace(sensors=agent.sensors), reading=_Reading(part))
            part = glue(view)
        parts.append(part)
        first += size
    return np.concatenate(parts, axis=1)


@dataclass(frozen=True, eq=False)
class _Reading:
    """Replacement for `View.reading` with fixed values."""

    values: FloatArray

    def __call__(self, sensor: str) -> FloatArray:
        return self.values


def _commanded(policy: OnnxPolicy, agent: AgentSpec, inputs: AnyArray) -> tuple[FloatArray, AnyArray]:
    """Return the commands of the controllers for outputs of the net, and which rows are decided.

    Returns:
        Commands, shape (R, A), and a mask of the rows whose action does not change within the tolerance, shape (R,).
    """
    sure = np.ones(len(inputs), dtype=np.bool_)
    layout = action_layout(agent)
    action = np.empty((len(inputs), layout.size))
    numbers = sum(not element.levels for element in policy.info.action)
    gates = policy.info.distribution == "hurdle"
    burns = inputs[:, 0] > 0.0 if gates else sure
    if gates:
        sure &= np.abs(inputs[:, 0]) > EXPORT_TOLERANCE
    mean = np.where(burns[:, None], inputs[:, gates : gates + numbers].astype(np.float64), 0.0)
    action[:, :numbers] = np.minimum(np.maximum(mean, layout.low[:numbers]), layout.high[:numbers])
    first = gates + 2 * numbers
    for column, element in enumerate(policy.info.action[numbers:], numbers):
        logits = inputs[:, first : first + len(element.levels)]
        ordered = np.sort(logits, axis=1)
        if len(element.levels) > 1:
            sure &= ordered[:, -1] - ordered[:, -2] > EXPORT_TOLERANCE * np.maximum(np.abs(ordered).max(axis=1), 1.0)
        action[:, column] = np.argmax(logits, axis=1)
        first += len(element.levels)
    values, first = [], 0
    for glue in (leaf for outer in agent.action_glues for leaf in outer.leaves()):
        size = len(glue.names(agent.parts))
        part = action[:, first : first + size]
        if isinstance(glue, (DiscreteControllerGlue, CoastGlue)):
            part = glue.table[part.astype(np.int64)].astype(np.float64)
        elif isinstance(glue, ControllerGlue) and glue.normalization.active is not None:
            part = glue.normalization.active.inverse(part, *controller_of(agent.parts, glue.controller).limits)
        values.append(part)
        first += size
    return np.concatenate(values, axis=1), sure


def worst(first: ExportDifference, *others: ExportDifference) -> ExportDifference:
    """Return the largest of each difference, over all rows together."""
    for other in others:
        first = replace(
            first,
            rows=first.rows + other.rows,
            action=float(np.maximum(first.action, other.action)),
            inputs=float(np.maximum(first.inputs, other.inputs)),
            undecided=first.undecided + other.undecided,
        )
    return first
