"""`MetricAccumulator`: reduces what metrics say of every step to one number of each episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.environments.writers import names_writers
from safe_inspect.errors import ArgumentError, PluginValueError, SafeInspectError, did_you_mean
from safe_inspect.metrics.base import BaseMetric, Metric, Reduce, TeamMetric
from safe_inspect.simulators.team import TeamStep, TeamView
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

_TOGETHER: Mapping[str, Callable[..., FloatArray]] = {
    "sum": np.nansum,
    "mean": np.nanmean,
    "min": np.nanmin,
    "max": np.nanmax,
}


def check_metrics(spec: EnvironmentSpec, metrics: Sequence[BaseMetric]) -> None:
    """Check that metrics can be measured in a task.

    Raises:
        ArgumentError: One is no metric.
        SafeInspectError: One names something that the task does not have, or two have one label.
    """
    for metric in metrics:
        if not isinstance(metric, BaseMetric):
            raise ArgumentError(f"a metric is an object, such as InspectedPoints(), not {metric!r:.60}")
    labels = [metric.label for metric in metrics]
    for label in labels:
        if "/" in label:
            raise SafeInspectError(
                f"the label {label!r} of a metric has a slash, which columns of files have; leave it out"
            )
        if labels.count(label) > 1:
            raise SafeInspectError(f"two metrics have the label {label!r}; give one of them, or a class with another")
    for metric in metrics:
        if not isinstance(metric, (Metric, TeamMetric)):
            raise SafeInspectError(f"the metric {metric.registered_name} extends neither Metric nor TeamMetric")
        for agent in spec.agents:
            known = spec.names(agent)
            for field, kind in metric.references().items():
                value = getattr(metric, field)
                if value is not None and value not in known[kind]:
                    raise SafeInspectError(
                        f"the `{field}` of the metric {metric.registered_name}: this task has no {kind} {value!r}; "
                        f"{did_you_mean(value, known[kind])}"
                    )


class MetricAccumulator:
    """The metrics of one episode in every row of a batch.

    Args:
        environment: The batch, freshly reset.
        metrics: What is measured.
    """

    def __init__(self, environment: TeamEnvironment, metrics: Sequence[BaseMetric]) -> None:
        self._environment = environment
        self._own = [metric for metric in metrics if isinstance(metric, Metric)]
        self._team = [metric for metric in metrics if isinstance(metric, TeamMetric)]
        rows, deputies = environment.num_envs, len(environment.agents)
        self._values = {metric.label: _Value((rows, deputies), metric.reduce) for metric in self._own}
        self._values |= {metric.label: _Value((rows,), metric.reduce) for metric in self._team}

    @names_writers
    def add(self, transition: TeamTransition, running: BoolArray) -> None:
        """Measure a step in the rows whose episode runs, shape (N,)."""
        environment = self._environment
        rows = environment.num_envs
        for group, found in zip(environment.groups, transition.groups, strict=True) if self._own else ():
            mine = slice(group.first, group.first + group.size)
            counts = found.active & running[:, None]
            ends = counts & ((found.status != 0) | transition.over[:, None])
            for metric in self._own:
                value = _checked(metric, metric(found.step), rows * group.size).reshape(rows, group.size)
                kept = self._values[metric.label]
                kept.add(mine, value, counts)
                if type(metric).conclude is not Metric.conclude and ends.any():
                    final = metric.conclude(kept.result[:, mine].reshape(-1), found.step)
                    kept.settle(mine, _checked(metric, final, rows * group.size).reshape(rows, group.size), ends)
        if self._team:
            world = environment.simulation.world
            before, after = TeamView(environment.simulation.before, world), TeamView(environment.state, world)
            step = TeamStep(before, after, {}, after.finished, world.step_size, {})
            for each in self._team:
                self._values[each.label].add(slice(None), _checked(each, each(step), rows), running)

    def of_agent(self, deputy: int) -> dict[str, FloatArray]:
        """Return the metrics of an agent, by its index among all, each of shape (N,)."""
        return {metric.label: self._values[metric.label].result[:, deputy] for metric in self._own}

    def of_team(self) -> dict[str, FloatArray]:
        """Return the metrics of the environments, and those of the agents taken together, each of shape (N,)."""
        found = {}
        for metric in self._own:
            value = self._values[metric.label].result
            found[metric.label] = np.full(len(value), np.nan)
            some = ~np.isnan(value).all(axis=1)
            found[metric.label][some] = _TOGETHER[metric.team_reduce](value[some], axis=1)
        return found | {metric.label: self._values[metric.label].result for metric in self._team}


class _Value:
    """The reduced values of one metric; NaN where there was none."""

    def __init__(self, shape: tuple[int, ...], reduce: Reduce) -> None:
        self._reduce = reduce
        self._kept: FloatArray = np.full(shape, np.nan)
        self._count: IntArray = np.zeros(shape, dtype=np.int64)

    def add(self, columns: slice, value: FloatArray, counts: BoolArray) -> None:
        """Add the values of a step in the places that count."""
        place: tuple[slice, ...] = (slice(None), columns) if self._kept.ndim > 1 else (columns,)
        kept = self._kept[place]
        counts = counts & ~np.isnan(value)
        if self._reduce == "last":
            np.copyto(kept, value, where=counts)
            return
        if self._reduce in ("sum", "mean"):
            both = kept + value
            self._count[place] += counts
        else:
            both = np.minimum(kept, value) if self._reduce == "min" else np.maximum(kept, value)
        np.copyto(kept, np.where(np.isnan(kept), value, both), where=counts)

    def settle(self, columns: slice, value: FloatArray, ends: BoolArray) -> None:
        """Replace the values of episodes that have ended; nothing is added to them any more."""
        if self._reduce == "mean":
            value = value * self._count[:, columns]
        np.copyto(self._kept[:, columns], value, where=ends)

    @property
    def result(self) -> FloatArray:
        """What the steps were reduced to so far."""
        return self._kept / np.maximum(self._count, 1) if self._reduce == "mean" else self._kept


def _checked(metric: BaseMetric, value: AnyArray, rows: int) -> FloatArray:
    """Return what a metric gave.

    Raises:
        PluginValueError: It is infinite, or has another shape.
    """
    value = np.asarray(value, dtype=np.float64)
    if value.shape != (rows,):
        raise PluginValueError(f"the metric {metric.registered_name} gave the shape {value.shape}; ({rows},) is wanted")
    if np.isinf(value).any():
        raise PluginValueError(
            f"the metric {metric.registered_name} gave infinity; give NaN where there is nothing to measure"
        )
    return value
