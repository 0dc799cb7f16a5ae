"""`rollout`: runs policies for an exact number of episodes, in batches; and runs of chosen episodes, recorded.

`EpisodeCollector` collects the figures of the episodes of a batch; `Recorder` records the states of some.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.decisions import FlyingRows
from safe_inspect.environments.episodes import INFO, TERM, EpisodeAccumulator
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.episodes import FIGURES, AgentEpisodes, Episodes, Trajectory, join, starting
from safe_inspect.evaluation.kept import KeptEpisodes
from safe_inspect.evaluation.measuring import MetricAccumulator, check_metrics
from safe_inspect.evaluation.policies import Policies, Policy, PolicyDispatcher, assign, with_scripted
from safe_inspect.metrics.base import BaseMetric
from safe_inspect.planning.record import Entry, flight_plan
from safe_inspect.policies.base import ScriptedPolicy
from safe_inspect.tasks.docking.speed_limit import DockingRegion
from safe_inspect.types import AnyArray, FloatArray, IntArray

#: Called with the number of finished episodes and the total number, whenever more episodes are finished.
EpisodeProgress = Callable[[int, int], None]


def rollout(
    spec: EnvironmentSpec,
    policies: Policies,
    episodes: int = 100,
    seed: int = 0,
    num_envs: int = 512,
    *,
    record: int = 0,
    metrics: Sequence[BaseMetric] = (),
    progress: EpisodeProgress | None = None,
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
        progress: Called with (finished episodes, `episodes`).
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
    kept = kept or KeptEpisodes(None, "")
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

        collector, trajectories = _fly_batch(environment, flying, metrics, first, recorded, finished)
        parts.append(collector.episodes(seed, trajectories))
        kept.add(first, parts[-1])
    return join(parts)


def _fly_batch(
    environment: TeamEnvironment,
    flying: Mapping[str, Policy],
    metrics: Sequence[BaseMetric] = (),
    first_slot: int = 0,
    recorded: int = 0,
    finished: Callable[[int], None] | None = None,
) -> tuple[EpisodeCollector, list[Trajectory]]:
    """Run one episode in every row of a batch.

    If every policy has a method `decide`, only the rows whose action is used next are observed, and rows that have
    ended are dropped whenever half of them have ended, unless episodes are recorded. Otherwise a row that has ended
    continues to coast, ignored, until the last row has ended.

    Args:
        environment: The batch; it is reset first.
        flying: The policy of each controlled agent, by the agent's name.
        metrics: Metrics that are measured in addition.
        first_slot: Global index of the environment slot of the first row.
        recorded: How many of the first rows are recorded.
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
    return collector, recorder.trajectories(collector.length, collector.status)


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
    return _fly_batch(environment, flying, first_slot=episode, recorded=1)[1][0]


def fly_slots(
    spec: EnvironmentSpec, policy: ScriptedPolicy, episodes: int, seed: int, first_slot: int
) -> tuple[list[Entry], list[Trajectory]]:
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
    collector, trajectories = _fly_batch(environment, {}, (), first_slot, episodes)
    found = collector.episodes(seed)
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
        for row, trajectory in enumerate(trajectories)
    ]
    return entries, trajectories


class EpisodeCollector:
    """Collector of the figures of one episode in every row of a batch.

    Args:
        environment: The batch, after a reset.
        metrics: Metrics that are measured in addition.

    Attributes:
        running: Mask of the rows whose episode is running, shape (N,).
        length: Number of steps of each episode, shape (N,).
        status: How each episode has ended, `DoneStatus`, int8, shape (N,).

    Raises:
        SafeInspectError: A metric has the label of a standard figure, or of one that a component of the task reports.
    """

    def __init__(self, environment: TeamEnvironment, metrics: Sequence[BaseMetric] = ()) -> None:
        self._environment = environment
        self._sums = EpisodeAccumulator(environment)
        self._metrics, self._measured = metrics, MetricAccumulator(environment, metrics)
        rows, deputies = environment.num_envs, len(environment.agents)
        self.running = np.ones(rows, dtype=np.bool_)
        self.length: IntArray = np.zeros(rows, dtype=np.int64)
        self.status: AnyArray = np.zeros(rows, dtype=np.int8)
        components = environment.simulation.components.values()
        self._labels = {name: label for component in components for name, label in component.figures.items()}
        figures = {*FIGURES, *(label for label, _ in self._labels.values())}
        for metric in metrics:
            if metric.label in figures:
                raise SafeInspectError(f"the label {metric.label!r} is that of a standard figure; choose another label")
        state = environment.state
        self._initial_states: dict[str, FloatArray] = {
            "position": state.position[:, :deputies].copy(),
            "velocity": state.velocity[:, :deputies].copy(),
        }
        self._initial_states |= environment.simulation.initial_figures()
        self._initial_states |= {name: state[name].copy() for component in components for name in component.recorded}
        self._rows: IntArray = np.arange(rows)
        self._closest = environment.team().distance.min(axis=1) if deputies > 1 else None
        self._info: dict[str, AnyArray] = {}
        self._agents: dict[str, dict[str, AnyArray]] = {name: {} for name in environment.agents}

    def go_on(self, environment: TeamEnvironment, chosen: IntArray) -> None:
        """Continue with some of the current environments, which are stepped as a smaller batch from now on.

        Args:
            environment: The smaller batch, R environments.
            chosen: Their indices among the current environments, shape (R,); they include all whose episode is running.
        """
        self._environment, self._rows = environment, self._rows[chosen]
        self._sums = self._sums.part(environment, chosen)
        self._measured.go_on(environment, chosen)

    def add(self, transition: TeamTransition) -> bool:
        """Add a step and return whether it ends the episodes of some rows."""
        rows, running = self._rows, self.running[self._rows]
        self._sums.add(transition)
        self.length[rows] += running
        if self._closest is not None:
            apart = self._environment.team().distance.min(axis=1)
            self._closest[rows[running]] = np.minimum(self._closest[rows], apart)[running]
        self._measured.add(transition, running)
        ends = running & transition.over
        if not ends.any():
            return False
        ended, whole = np.flatnonzero(ends), rows[ends]
        self.status[whole] = transition.outcome[ended]
        self._keep(self._info, self._sums.info(ended), whole)
        for name, figures in self._sums.agents(ended).items():
            self._keep(self._agents[name], figures, whole)
        self.running = self.running.copy()
        self.running[whole] = False
        return True

    def episodes(self, seed: int, trajectories: Sequence[Trajectory] = ()) -> Episodes:
        """Return the episodes; call this when all rows have ended."""
        agents = {
            name: AgentEpisodes(
                returns=figures["return"],
                terms=starting(TERM, figures),
                info=starting(INFO, figures),
                metrics=self._measured.of_agent(deputy),
                **{key: figures[key] for key in ("length", "status", "delta_v")},
            )
            for deputy, (name, figures) in enumerate(self._agents.items())
        }
        return Episodes.of(
            agents,
            seed=seed,
            length=self.length,
            status=self.status,
            info=self._info,
            trajectories=tuple(trajectories),
            closest=self._closest,
            metrics=self._measured.of_team(),
            units={metric.label: metric.unit for metric in self._metrics},
            labels=self._labels,
            initial_states=self._initial_states,
        )

    def _keep(self, kept: dict[str, AnyArray], found: dict[str, AnyArray], rows: IntArray) -> None:
        """Store the figures of some rows that have just ended."""
        for name, values in found.items():
            kept.setdefault(name, np.zeros(len(self.running), values.dtype))[rows] = values


_KEPT = ("time", "position", "velocity", "control", "delta_v")


class Recorder:
    """Recorder of the first rows of a batch, from a reset on.

    Args:
        environment: The batch.
        rows: Number of recorded rows.
        first_slot: Global index of the environment slot of the first row.
    """

    def __init__(self, environment: TeamEnvironment, rows: int, first_slot: int) -> None:
        self._environment = environment
        self._rows = rows
        self._slot = first_slot
        components = environment.simulation.components.values()
        self._of_deputies = ("position", "velocity", *environment.simulation.attitude)
        of_components = (name for component in components for name in component.recorded)
        self._recorded = (*environment.simulation.attitude, *of_components)
        self._states: dict[str, list[AnyArray]] = {name: [] for name in (*_KEPT, *self._recorded)}
        points = environment.simulation.world.offers.world.get("points", {})
        self._body = next(iter(points), None)
        self._points = points[self._body].points if self._body is not None else np.zeros((0, 3))
        self._inspected_at = np.full((rows, len(self._points)), np.inf)
        self._inspector = np.full((rows, len(self._points)), -1, dtype=np.int64)
        self.keep()

    def keep(self) -> None:
        """Record the current state; `trajectories` cuts states after the end of an episode."""
        if not self._rows:
            return
        state = self._environment.state
        deputies = self._environment.simulation.world.num_deputies
        for name, kept in self._states.items():
            array = state[name][: self._rows]
            kept.append((array[:, :deputies] if name in self._of_deputies else array).copy())
        if self._body is not None:
            inspector = state.points[self._body].inspector[: self._rows]
            now = np.broadcast_to(state.time[: self._rows, None], inspector.shape)
            fresh = (inspector >= 0) & np.isinf(self._inspected_at)
            self._inspected_at[fresh] = now[fresh]
            self._inspector[fresh] = inspector[fresh]

    def trajectories(self, length: IntArray, status: AnyArray) -> list[Trajectory]:
        """Return the recorded episodes, each cut to its own number of steps."""
        if not self._rows:
            return []
        whole = {name: np.stack(kept, axis=1) for name, kept in self._states.items()}
        made = []
        for row in range(self._rows):
            states = {name: array[row, : length[row] + 1] for name, array in whole.items()}
            seen = self._inspected_at[row] <= states["time"][-1]  # not the points that it passed after the end
            made.append(
                Trajectory(
                    **{name: states[name] for name in ("time", "position", "velocity", "delta_v")},
                    control=states["control"][1:],  # the thrust held over the step that led there
                    arrays={name: states[name] for name in self._recorded},
                    points=self._points,
                    inspected_at=np.where(seen, self._inspected_at[row], np.inf),
                    inspector=np.where(seen, self._inspector[row], -1),
                    status=DoneStatus(int(status[row])),
                    slot=self._slot + row,
                    deputies=self._environment.simulation.world.platforms,
                    mean_motion=self._environment.simulation.world.offers.world.get("mean_motion", 0.0),
                    in_body_axes=self._environment.simulation.turns_thrust,
                    camera=self._environment.simulation.world.offers.world.get("camera"),
                    docking_radius=_docking_radius(self._environment.spec),
                )
            )
        return made


def _docking_radius(spec: EnvironmentSpec) -> float:
    """Return the radius of the region that the first agent must reach [m]; 0 in a task without docking."""
    regions: list[Any] = [done.functor for done in spec.agents[0].dones if isinstance(done.functor, DockingRegion)]
    return float(regions[0].docking_region_radius) if regions else 0.0
