"""`rollout`: runs policies for an exact number of episodes, in batches; and runs of chosen episodes, recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.decisions import FlyingRows
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.evaluation.episodes import Episodes, Progress, join
from safe_inspect.evaluation.kept import KeptEpisodes
from safe_inspect.evaluation.policies import Policies, Policy, PolicyDispatcher, assign, with_scripted
from safe_inspect.evaluation.recorder import Recorder, Trajectory
from safe_inspect.evaluation.results.collector import EpisodeCollector
from safe_inspect.evaluation.results.measuring import check_metrics
from safe_inspect.metrics.base import BaseMetric
from safe_inspect.policies.base import ScriptedPolicy
from safe_inspect.policies.plan_record import Entry, flight_plan


def rollout(
    spec: EnvironmentSpec,
    policies: Policies,
    episodes: int = 100,
    seed: int = 0,
    num_envs: int = 512,
    *,
    record: int = 0,
    metrics: Sequence[BaseMetric] = (),
    progress: Progress | None = None,
    kept: KeptEpisodes | None = None,
) -> Episodes:
    """Run policies for `episodes` episodes: the first episode of the environment slots 0, 1, 2, ...

    The episodes and their figures depend neither on `num_envs` nor on the lengths of the episodes, if the policies
    treat every row in the same way. The adaptive scale of the delta-v reward has its initial value in every episode.

    Args:
        spec: The task. Its agents with a scripted policy need no other policy.
        policies: A function from observations (R, O) to actions (R, A), see `safe_inspect.evaluation.policies.Policy`;
            or a scripted policy, which runs inside the environment. Either one policy for all controlled agents, or a
            mapping from the name of each agent to its policy.
        episodes: Number of episodes.
        seed: Seed of the run.
        num_envs: Number of episodes that run at the same time.
        record: How many of the first episodes are recorded in `Episodes.trajectories`.
        metrics: Metrics that are measured in every episode in addition to the standard figures.
        progress: Called with (finished episodes, `episodes`), whenever more episodes are finished.
        kept: The batches of an earlier call with the same arguments, which are not run again; new ones are added.

    Raises:
        SafeInspectError: An agent has no policy, a policy has no agent, or one policy controls agents that differ; a
            metric refers to something that the task does not have.
        PluginValueError: A metric returned infinity, or an array of a wrong shape.
        ValueError: A number is out of range, or a policy's actions have a wrong shape.
    """
    if episodes < 1 or num_envs < 1 or record < 0:
        raise ValueError(
            f"`episodes` ({episodes}) and `num_envs` ({num_envs}) must be at least 1, `record` ({record}) at least 0"
        )
    spec, flying = assign(spec, policies)
    check_metrics(spec, metrics)
    kept = kept or KeptEpisodes()
    parts: list[Episodes] = []
    for first in range(0, episodes, num_envs):
        count = min(num_envs, episodes - first)
        known = kept.get(first, count)
        if known is not None:
            parts.append(known)
            continue
        environment = TeamEnvironment(spec, count, seed=seed, first_slot=first)
        recorded = min(max(record - first, 0), environment.num_envs)

        def finished(count: int, before: int = first) -> None:
            if progress is not None:
                progress(before + count, episodes)

        parts.append(_fly_batch(environment, flying, seed, first, recorded, metrics, finished))
        kept.add(first, parts[-1])
    return join(parts)


def _fly_batch(
    environment: TeamEnvironment,
    flying: Mapping[str, Policy],
    seed: int,
    first_slot: int,
    recorded: int,
    metrics: Sequence[BaseMetric] = (),
    finished: Callable[[int], None] | None = None,
) -> Episodes:
    """Run one episode in every row of a batch.

    If every policy has a method `decide`, only the rows whose action is used next are observed, and rows that have
    ended are dropped whenever half of them have ended, unless episodes are recorded. Otherwise a row that has ended
    continues to coast, ignored, until the last row has ended.

    Args:
        environment: The batch; it is reset first.
        flying: The policy of each controlled agent, by the agent's name.
        seed: Seed of the run.
        first_slot: Global index of the environment slot of the first row.
        recorded: How many of the first rows are recorded.
        metrics: Metrics that are measured in addition.
        finished: Called with the number of finished episodes whenever it has grown.
    """
    observations = environment.reset()
    dispatcher = PolicyDispatcher(environment, flying, first_slot)
    collector, recorder = EpisodeCollector(environment, metrics), Recorder(environment, recorded, first_slot)
    flying_rows, step = FlyingRows(environment), 0
    environment.observes_coasting = not dispatcher.selective
    while collector.running.any():
        part, rows, running = flying_rows.part, flying_rows.rows, collector.running[flying_rows.rows]
        asked = [due & running[:, None] for due in part.due()]
        transition = part.step(dispatcher(observations, asked, rows, step))
        step += 1
        observations = tuple(
            found.observation
            for group, found in zip(environment.groups, transition.groups, strict=True)
            if not group.scripted
        )
        recorder.keep()
        if not collector.add(transition):
            continue
        if finished is not None:
            finished(environment.num_envs - int(collector.running.sum()))
        if dispatcher.selective and not recorded:
            chosen = flying_rows.go_on(collector.running[rows])
            if chosen is not None:
                collector.go_on(flying_rows.part, chosen)
                observations = tuple(array[chosen] for array in observations)
    return collector.episodes(seed, recorder.trajectories(collector.length, collector.status))


def record_episode(spec: EnvironmentSpec, policies: Policies, episode: int = 0, seed: int = 0) -> Trajectory:
    """Return the episode that `rollout` with this seed runs in the environment slot `episode`.

    Args:
        spec: The task.
        policies: The policies; see `rollout`.
        episode: Number of the episode, from 0.
        seed: Seed of the run.

    Raises:
        SafeInspectError: An agent has no policy, a policy has no agent, or one policy controls agents that differ.
    """
    spec, flying = assign(spec, policies)
    environment = TeamEnvironment(spec, 1, seed=seed, first_slot=episode)
    return _fly_batch(environment, flying, seed, episode, 1).trajectories[0]


def fly_slots(
    spec: EnvironmentSpec, policy: ScriptedPolicy, episodes: int, seed: int, first_slot: int
) -> tuple[list[Entry], Sequence[Trajectory]]:
    """Run the first episode of each of some slots, as `rollout` does.

    Args:
        spec: The task.
        policy: The policy of all deputies.
        episodes: Number of slots, E.
        seed: Seed of the run.
        first_slot: The first slot.

    Returns:
        The entry of each episode for the record of plans, without the plan; and the
            recorded episodes.
    """
    environment = TeamEnvironment(with_scripted(spec, policy), episodes, seed=seed, first_slot=first_slot)
    found = _fly_batch(environment, {}, seed, first_slot, episodes)
    deputies = range(environment.simulation.world.num_deputies)
    entries = [
        Entry(
            key=int(environment.state.key[row]),
            success=bool(found.success[row]),
            delta_v=float(found.delta_v[row]),
            steps=int(found.length[row]),
            inspected=int(found.inspected_count[row]),
            burns=float(np.mean([len(flight_plan(trajectory.control[:, k, :3])) for k in deputies])),
        )
        for row, trajectory in enumerate(found.trajectories)
    ]
    return entries, found.trajectories
