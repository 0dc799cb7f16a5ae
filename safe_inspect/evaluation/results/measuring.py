"""`MetricAccumulator`: reduces the values of metrics at every step to one number per episode."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.finite_checks import names_writers
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.errors import ArgumentError, PluginValueError, SafeInspectError, not_named
from safe_inspect.metrics.base import BaseMetric, Metric, Reduce, TeamMetric
from safe_inspect.simulators.team import TeamStep, TeamView
from safe_inspect.simulators.view import Step
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

#: How the value of a step is combined with those of earlier steps.
_COMBINED: Mapping[Reduce, Callable[..., FloatArray]] = {
    "sum": np.add,
    "mean": np.add,
    "min": np.minimum,
    "max": np.maximum,
    "last": lambda kept, value: value,
}
_TOGETHER: Mapping[str, Callable[..., FloatArray]] = {
    "sum": np.nansum,
    "mean": np.nanmean,
    "min": np.nanmin,
    "max": np.nanmax,
}


def check_metrics(spec: EnvironmentSpec, metrics: Sequence[BaseMetric]) -> None:
    """Check that metrics can be measured in a task.

    Raises:
        ArgumentError: An object is not a metric.
        SafeInspectError: A metric has no valid reduction or refers to something that the task does not have, or two
            metrics have the same label.
    """
    for metric in metrics:
        if not isinstance(metric, BaseMetric):
            raise ArgumentError(f"a metric must be an object such as ThrustingSteps(), got {metric!r:.60}")
    labels = [metric.label for metric in metrics]
    for metric, label in zip(metrics, labels, strict=True):
        if not isinstance(metric, (Metric, TeamMetric)):
            raise SafeInspectError(
                f"the metric {metric.registered_name} extends neither Metric nor TeamMetric; derive it from one of them"
            )
        for field, allowed in (("reduce", [*_COMBINED]), ("over_agents", [None, *_TOGETHER])):
            if (value := getattr(metric, field, None)) not in allowed:
                texts = ", ".join(text for text in allowed if text)
                raise SafeInspectError(
                    f"the `{field}` of the metric {metric.registered_name} is {value!r}; set it to one of {texts}"
                )
        if "/" in label:
            raise SafeInspectError(
                f"the label {label!r} of a metric has a slash, which is reserved for reward terms; leave it out"
            )
        if labels.count(label) > 1:
            raise SafeInspectError(f"two metrics have the label {label!r}; remove one, or use a class with another")
        for agent in spec.agents:
            known = spec.names(agent)
            for field, kind in metric.references().items():
                value = getattr(metric, field)
                if value is not None and value not in known[kind]:
                    raise SafeInspectError(
                        f"the `{field}` of the metric {metric.registered_name}: {not_named(kind, value, known[kind])}"
                    )


class MetricAccumulator:
    """Accumulator of the metrics of one episode in every row of a batch.

    Args:
        environment: The batch, after a reset.
        metrics: The metrics.
    """

    def __init__(self, environment: TeamEnvironment, metrics: Sequence[BaseMetric]) -> None:
        rows, deputies = environment.num_envs, len(environment.agents)
        self._own = [_Values(metric, rows, deputies) for metric in metrics if isinstance(metric, Metric)]
        self._team = [_Values(metric, rows, 1) for metric in metrics if isinstance(metric, TeamMetric)]

    @names_writers
    def add(self, environment: TeamEnvironment, rows: IntArray, transition: TeamTransition, running: BoolArray) -> None:
        """Measure a step of the batch, or of a smaller batch of some of its rows.

        Args:
            environment: The batch that was stepped, of R rows.
            rows: Their indices in the batch after the reset, shape (R,).
            transition: The step.
            running: Mask of those whose episode is running, shape (R,).
        """
        for group, found in zip(environment.groups, transition.groups, strict=True) if self._own else ():
            mine = slice(group.first, group.first + group.size)
            counts = found.active & running[:, None]
            ends = counts & ((found.status != 0) | transition.over[:, None])
            for values in self._own:
                values.add((rows, mine), found.step, counts)
                if ends.any():
                    values.conclude((rows, mine), found.step, ends)
        if self._team:
            world = environment.simulation.world
            before, after = TeamView(environment.simulation.before, world), TeamView(environment.state, world)
            step = TeamStep(before, after, {}, after.finished, world.step_size, {})
            for values in self._team:
                values.add((rows, slice(None)), step, running[:, None])

    def of_agent(self, deputy: int) -> dict[str, FloatArray]:
        """Return the metrics of an agent, given its index among all agents, each of shape (N,)."""
        return {values.metric.label: values.reduced[:, deputy] for values in self._own}

    def of_team(self) -> dict[str, FloatArray]:
        """Return the metrics of the environments, and those of the agents combined, each of shape (N,)."""
        found = {}
        for values in self._own:
            value = values.reduced
            some, combined = ~np.isnan(value).all(axis=1), np.full(len(value), np.nan)
            combined[some] = _TOGETHER[values.metric.team_reduce](value[some], axis=1)
            found[values.metric.label] = combined
        return found | {values.metric.label: values.reduced[:, 0] for values in self._team}


class _Values:
    """Reduced values of a metric; NaN where there was no value.

    Args:
        metric: The metric.
        rows: Number of environments, N.
        columns: Number of deputies, or 1 for a metric of whole environments, D.
    """

    def __init__(self, metric: Metric | TeamMetric, rows: int, columns: int) -> None:
        self.metric = metric
        self._kept: FloatArray = np.full((rows, columns), np.nan)
        self._count: IntArray = np.zeros((rows, columns), dtype=np.int64)

    @property
    def reduced(self) -> FloatArray:
        """The reduced values so far, shape (N, D)."""
        return self._kept / np.maximum(self._count, 1) if self.metric.reduce == "mean" else self._kept

    def add(self, place: tuple[IntArray, slice], step: Any, counts: BoolArray) -> None:
        """Add the values of a step where `counts` is true, a mask of shape (R, G), given its rows and columns.

        Raises:
            PluginValueError: A value is infinite, or has a wrong shape.
        """
        value = _checked(self.metric, self.metric(step), counts.shape)
        kept, counts = self._kept[place], counts & ~np.isnan(value)
        both = _COMBINED[self.metric.reduce](kept, value)
        self._kept[place] = np.where(counts, np.where(np.isnan(kept), value, both), kept)
        self._count[place] += counts

    def conclude(self, place: tuple[IntArray, slice], step: Step, ends: BoolArray) -> None:
        """Let the metric replace the values of the episodes that end with a step, given by a mask of shape (R, G).

        Raises:
            PluginValueError: A value is infinite, or has a wrong shape.
        """
        if not isinstance(self.metric, Metric) or type(self.metric).conclude is Metric.conclude:
            return
        value = _checked(self.metric, self.metric.conclude(self.reduced[place].reshape(-1), step), ends.shape)
        if self.metric.reduce == "mean":
            value = value * self._count[place]
        self._kept[place] = np.where(ends, value, self._kept[place])


def _checked(metric: BaseMetric, value: AnyArray, shape: tuple[int, ...]) -> FloatArray:
    """Return the values of a metric in a shape, after a check.

    Raises:
        PluginValueError: A value is infinite, or their number is wrong.
    """
    value, rows = np.asarray(value, dtype=np.float64), math.prod(shape)
    if value.shape != (rows,):
        raise PluginValueError(f"the metric {metric.registered_name} gave the shape {value.shape}; expected ({rows},)")
    if np.isinf(value).any():
        raise PluginValueError(
            f"the metric {metric.registered_name} gave infinity; give NaN where there is nothing to measure"
        )
    return value.reshape(shape)
