"""`rollout`: fly policies for an exact number of episodes, in batches."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.evaluation.policies import Policy
from safe_inspect.evaluation.results.episodes import AgentEpisodes, Episodes, join
from safe_inspect.evaluation.rollouts.crew import Crew, Policies, assign
from safe_inspect.evaluation.rollouts.gauges import check_metrics
from safe_inspect.evaluation.rollouts.recorder import Recorder
from safe_inspect.evaluation.rollouts.tally import METRIC, TERM, Tally
from safe_inspect.evaluation.rollouts.trajectory import Trajectory
from safe_inspect.metrics.base import BaseMetric
from safe_inspect.types import AnyArray

#: Told the number of finished episodes and of all of them, whenever the first has grown.
Progress = Callable[[int, int], None]


def rollout(
    spec: EnvironmentSpec,
    policies: Policies,
    episodes: int = 100,
    seed: int = 0,
    num_envs: int = 256,
    *,
    record: int = 0,
    metrics: Sequence[BaseMetric] = (),
    progress: Progress | None = None,
) -> Episodes:
    """Fly policies for `episodes` episodes: the first episode of the environment slots 0, 1, 2, ...

    Which episodes are flown, and each figure of them, does not depend on `num_envs` nor on how long the episodes
    last, as long as the policies themselves treat every row alike. The adaptive scale of the delta-v reward stands at
    its start in each of them.

    Args:
        spec: The task. Agents with a scripted policy fly themselves.
        policies: From observations (R, O) to actions (R, A), see `safe_inspect.evaluation.policies.Policy`; or a
            scripted policy, which flies inside the environment. One for all agents that act from outside, or a
            mapping from the name of each to its own.
        episodes: How many episodes.
        seed: Seed of the run.
        num_envs: Episodes that are flown at a time.
        record: How many of the first episodes are recorded in `Episodes.trajectories`.
        metrics: What is measured of every episode besides its usual figures.
        progress: Called with (finished episodes, `episodes`).

    Raises:
        SafeInspectError: An agent has no policy, a policy no agent, or one policy flies agents that differ; a metric
            names what the task does not have.
        PluginValueError: A metric gave infinity, or an array of another shape.
        ValueError: A number is out of range, or a policy's actions have another shape.
    """
    if episodes < 1 or num_envs < 1 or record < 0:
        raise ValueError(f"`episodes` ({episodes}) and `num_envs` ({num_envs}) are at least 1, `record` ({record}) 0")
    spec, flying = assign(spec, policies)
    check_metrics(spec, metrics)
    tallies: list[Tally] = []
    trajectories: list[Trajectory] = []
    for first in range(0, episodes, num_envs):
        environment = TeamEnvironment(spec, min(num_envs, episodes - first), seed=seed, first_slot=first)
        recorded = min(max(record - first, 0), environment.num_envs)

        def tell(finished: int, before: int = first) -> None:
            if progress is not None:
                progress(before + finished, episodes)

        tally, kept = _fly(environment, flying, metrics, first, recorded, tell)
        tallies.append(tally)
        trajectories += kept
    agents = {name: _agent(join([tally.agents[name] for tally in tallies])) for name in tallies[0].agents}
    return Episodes.of(
        seed,
        agents,
        trajectories=tuple(trajectories),
        metrics=join([tally.metrics for tally in tallies]),
        units={metric.label: metric.unit for metric in metrics},
        begins=join([tally.begins for tally in tallies]),
        **join([tally.whole for tally in tallies]),
    )


def _agent(figures: dict[str, AnyArray]) -> AgentEpisodes:
    def taken(start: str) -> dict[str, AnyArray]:
        return {name.removeprefix(start): figures.pop(name) for name in tuple(figures) if name.startswith(start)}

    return AgentEpisodes(terms=taken(TERM), metrics=taken(METRIC), **figures)


def _fly(
    environment: TeamEnvironment,
    flying: Mapping[str, Policy],
    metrics: Sequence[BaseMetric],
    first_slot: int,
    recorded: int,
    tell: Callable[[int], None],
) -> tuple[Tally, list[Trajectory]]:
    """Fly one episode in every row of a batch; a row that has ended coasts on, unheeded, until the last has."""
    observations = environment.reset()
    crew = Crew(environment, flying, first_slot)
    tally, recorder = Tally(environment, metrics), Recorder(environment, recorded, first_slot)
    while tally.running.any():
        transition = environment.step(crew(observations, tally.running))
        observations = tuple(
            found.observation
            for group, found in zip(environment.groups, transition.groups, strict=True)
            if not group.scripted
        )
        recorder.keep()
        if tally.add(transition):
            tell(environment.num_envs - int(tally.running.sum()))
    return tally, recorder.trajectories(tally.whole["length"], tally.whole["status"])
