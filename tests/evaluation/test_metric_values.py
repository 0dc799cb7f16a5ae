"""What metrics say of each step is reduced to one number of an episode as NumPy reduces the raw values."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from safe_inspect.errors import ArgumentError, PluginValueError, SafeInspectError
from safe_inspect.evaluation.episodes import AgentEpisodes
from safe_inspect.evaluation.results.measuring import MetricAccumulator, check_metrics
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.metrics import Metric
from safe_inspect.metrics.base import BaseMetric
from safe_inspect.policies import RandomThrust

pytestmark = pytest.mark.usefixtures("clean_registry")

ROWS, STEPS, SIZES = 6, 25, (2, 1)
REDUCE = {"sum": np.nansum, "mean": np.nanmean, "min": np.nanmin, "max": np.nanmax, "last": lambda values: values[-1]}
TOGETHER = {**REDUCE, "last": np.nanmean}


def metrics() -> list[Metric]:
    """Return a metric for each way to reduce, and each that concludes."""

    found: list[Any] = []
    for number, way in enumerate(REDUCE):

        def call(self: Any, step: Any, number: int = number) -> Any:
            return step.values[number]

        def doubled(self: Any, value: Any, step: Any) -> Any:
            return 2.0 * value + step.extra

        own = {"__doc__": "Say.", "__module__": __name__, "reduce": way, "__call__": call}
        found += [type(Metric)(f"{way.title()}Raw", (Metric,), own)()]
        found += [type(Metric)(f"{way.title()}End", (Metric,), {**own, "conclude": doubled})()]
    return found


def flown(generator: np.random.Generator) -> dict[str, Any]:
    """Return raw values: of agents (5, T, N, D), lengths of agents and of environments."""
    agents = sum(SIZES)
    own = generator.normal(0.0, 3.0, (5, STEPS, ROWS, agents))
    own[generator.random(own.shape) < 0.3] = np.nan
    own[:, :, 2, 0] = np.nan
    lengths = generator.integers(3, STEPS, (ROWS, agents))
    return {"own": own, "lengths": lengths, "whole": lengths.max(axis=1), "extra": generator.normal(size=ROWS)}


def accumulated(raw: dict[str, Any], measured: list[Any], leaves: bool) -> MetricAccumulator:
    """Return what an accumulator makes of the values; environments that have ended leave the batch, or stay."""
    starts = np.cumsum((0, *SIZES))
    groups = [SimpleNamespace(first=int(first), size=size) for first, size in zip(starts, SIZES, strict=False)]

    def environment(rows: Any, step: int) -> Any:
        simulation = SimpleNamespace(world=SimpleNamespace(step_size=1.0), before=None)
        state = SimpleNamespace(finished=None)
        return SimpleNamespace(
            num_envs=len(rows), agents=range(sum(SIZES)), groups=groups, simulation=simulation, state=state
        )

    rows = np.arange(ROWS)
    batch = environment(rows, 0)
    found = MetricAccumulator(batch, measured)
    for step in range(STEPS):
        running = raw["whole"][rows] > step
        if leaves and step in (8, 15) and running.any():
            chosen = np.flatnonzero(running)
            rows = rows[chosen]
            batch = environment(rows, step)
            running = raw["whole"][rows] > step
        over = raw["whole"][rows] == step + 1
        parts = []
        for group in groups:
            mine = slice(group.first, group.first + group.size)
            active = raw["lengths"][rows, mine] > step
            ends = raw["lengths"][rows, mine] == step + 1
            seen = SimpleNamespace(
                values=raw["own"][:, step, rows, mine].reshape(5, -1), extra=np.repeat(raw["extra"][rows], group.size)
            )
            parts.append(SimpleNamespace(active=active, status=ends.astype(np.int8), step=seen))
        found.add(batch, rows, SimpleNamespace(groups=parts, over=over), running)
    return found


@pytest.mark.parametrize("leaves", [False, True])
def test_values_of_agents_are_reduced_as_numpy_does(leaves: bool) -> None:
    raw, own = flown(np.random.default_rng(4)), metrics()
    found = accumulated(raw, own, leaves)
    for deputy in range(sum(SIZES)):
        values = found.of_agent(deputy)
        assert list(values) == [metric.label for metric in own]
        for number, (way, reduced) in enumerate(REDUCE.items()):
            for row in range(ROWS):
                some = raw["own"][number, : raw["lengths"][row, deputy], row, deputy]
                some = some[~np.isnan(some)]
                wanted = reduced(some) if len(some) else np.nan
                concluded = 2.0 * wanted + raw["extra"][row]
                assert values[f"{way} raw"][row] == pytest.approx(wanted, nan_ok=True)
                assert values[f"{way} end"][row] == pytest.approx(concluded, nan_ok=True)
    team = found.of_team()
    for way, together in TOGETHER.items():
        each = np.stack([found.of_agent(deputy)[f"{way} raw"] for deputy in range(sum(SIZES))], axis=1)
        np.testing.assert_allclose(team[f"{way} raw"], [together(row[~np.isnan(row)]) for row in each])


@pytest.mark.parametrize("shape", [(ROWS,), (ROWS, 2), ()])
def test_a_metric_of_another_shape_or_of_infinity_is_refused(shape: tuple[int, ...]) -> None:
    class Odd(Metric):
        """Say something else."""

        reduce: ClassVar[Any] = "sum"

        def __call__(self, step):
            return np.zeros(shape)

    class Endless(Metric):
        """Say infinity."""

        reduce: ClassVar[Any] = "sum"

        def __call__(self, step):
            return np.where(np.arange(len(step.extra)) == 1, -np.inf, 0.0)

    class Calm(Metric):
        """Say nothing."""

        reduce: ClassVar[Any] = "sum"

        def __call__(self, step):
            return np.zeros(len(step.extra))

    raw = flown(np.random.default_rng(4))
    for metric, words in (
        (Odd(), f"the metric Odd gave the shape {shape}; expected (12,)"),
        (Endless(), "the metric Endless gave infinity; give NaN where there is nothing to measure"),
    ):
        with pytest.raises(PluginValueError) as caught:
            accumulated(raw, [Calm(), metric], False)
        assert str(caught.value) == words


def test_metrics_that_do_not_fit_are_refused_in_these_words(spec: Any) -> None:
    class One(Metric):
        """Say 1.

        Attributes:
            name: Its label.
        """

        reduce: ClassVar[Any] = "sum"
        name: str = "one"

        @property
        def label(self):
            return self.name

        def __call__(self, step):
            return np.ones(len(step.control))

    class Neither(BaseMetric):
        """Say nothing."""

        reduce: ClassVar[Any] = "sum"

        def __call__(self, step):
            return None

    def reduced(name, **attributes):
        members = {"__doc__": "Say one.", "__module__": __name__, "__call__": One.__call__}
        return type(name, (Metric,), members | attributes)()

    for given, kind, words in (
        (
            [reduced("Median", reduce="median")],
            SafeInspectError,
            "the `reduce` of the metric Median is 'median'; set it to one of sum, mean, min",
        ),
        (
            [reduced("Unreduced")],
            SafeInspectError,
            "the `reduce` of the metric Unreduced is None; set it to one of sum, mean",
        ),
        (
            [reduced("Together", reduce="sum", over_agents="last")],
            SafeInspectError,
            "the `over_agents` of the metric Together is 'last'; set it to one of sum",
        ),
        ([One], ArgumentError, "a metric must be an object such as ThrustingSteps(), got <class"),
        (
            [One(name="a/b")],
            SafeInspectError,
            "the label 'a/b' of a metric has a slash, which is reserved for reward terms",
        ),
        (
            [One(), One(name="two"), One()],
            SafeInspectError,
            "two metrics have the label 'one'; remove one",
        ),
        ([Neither()], SafeInspectError, "the metric Neither extends neither Metric nor TeamMetric"),
    ):
        with pytest.raises(kind) as caught:
            check_metrics(spec, given)
        assert str(caught.value).startswith(words)
    check_metrics(spec, [One(), One(name="two")])


def test_a_figure_that_no_component_offers_lists_those_that_are_there() -> None:
    def offered(**info: Any) -> AgentEpisodes:
        return AgentEpisodes(np.zeros(3), {}, np.zeros(3, int), np.zeros(3, int), np.zeros(3), info)

    some = offered(count=np.arange(3), share=np.zeros(3))
    np.testing.assert_array_equal(some.count, [0, 1, 2])
    for episodes, words in (
        (some, "the episodes of this task have no 'height'; its components report count, share"),
        (offered(), "the episodes of this task have no 'height'"),
    ):
        with pytest.raises(AttributeError) as caught:
            _ = episodes.height
        assert str(caught.value) == words
    labelled = some.labelled({"count": ("number of points", "-")})
    assert {name: values.dtype for name, values in labelled.items()} == {"number of points": float, "share": float}


def test_a_metric_of_another_package_hides_no_figure_of_the_task(spec: Any) -> None:
    class Hiding(Metric):
        """Say 1."""

        reduce: ClassVar[Any] = "sum"

        @property
        def label(self):
            return "inspected fraction"

        def __call__(self, step):
            return np.ones(len(step.control))

    with pytest.raises(SafeInspectError) as caught:
        rollout(spec, RandomThrust(), 1, seed=0, metrics=[Hiding()])
    words = "the label 'inspected fraction' is that of a standard figure; choose another label"
    assert str(caught.value) == words
