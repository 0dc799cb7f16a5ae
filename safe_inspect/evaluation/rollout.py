"""`rollout`: fly a policy for an exact number of episodes, in batches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.core import BatchedEnvironment
from safe_inspect.environments.episodes import step_facts
from safe_inspect.evaluation.policies import Flight, Policy
from safe_inspect.evaluation.recorder import Recorder
from safe_inspect.evaluation.trajectory import Episodes, Trajectory
from safe_inspect.types import AnyArray

#: Told the number of finished episodes and of all of them, whenever the first has grown.
Progress = Callable[[int, int], None]

_TERM = "reward/"


def rollout(
    spec: EnvironmentSpec,
    policy: Policy,
    episodes: int = 100,
    seed: int = 0,
    num_envs: int = 256,
    *,
    record: int = 0,
    progress: Progress | None = None,
) -> Episodes:
    """Fly a policy for `episodes` episodes: the first episode of the environment slots 0, 1, 2, ...

    Which episodes are flown, and each figure of them, does not depend on `num_envs` nor on how long the episodes
    last, as long as the policy itself treats every row alike. The adaptive scale of the delta-v reward stands at its
    start in each of them.

    Args:
        spec: The task, with one agent.
        policy: From observations (N, O) to actions (N, A); see `safe_inspect.evaluation.policies.Policy`.
        episodes: How many episodes.
        seed: Seed of the run.
        num_envs: Episodes that are flown at a time.
        record: How many of the first episodes are recorded in `Episodes.trajectories`.
        progress: Called with (finished episodes, `episodes`).

    Raises:
        ValueError: A number is out of range, or the policy's actions have another shape.
    """
    if episodes < 1 or num_envs < 1 or record < 0:
        raise ValueError(f"`episodes` ({episodes}) and `num_envs` ({num_envs}) are at least 1, `record` ({record}) 0")
    figures = _Figures()
    trajectories: list[Trajectory] = []
    for first in range(0, episodes, num_envs):
        environment = BatchedEnvironment(spec, min(num_envs, episodes - first), seed=seed, first_slot=first)
        recorded = min(max(record - first, 0), environment.num_envs)

        def tell(finished: int, before: int = first) -> None:
            if progress is not None:
                progress(before + finished, episodes)

        trajectories += _fly(environment, policy, first, recorded, figures, tell)
    return figures.episodes(seed, tuple(trajectories))


@dataclass
class _Figures:
    """The figures of the finished batches, by name."""

    batches: dict[str, list[AnyArray]] = field(default_factory=dict)

    def add(self, **figures: AnyArray) -> None:
        for name, array in figures.items():
            self.batches.setdefault(name, []).append(array)

    def episodes(self, seed: int, trajectories: tuple[Trajectory, ...]) -> Episodes:
        whole = {name: np.concatenate(arrays) for name, arrays in self.batches.items()}
        terms = {name.removeprefix(_TERM): whole.pop(name) for name in tuple(whole) if name.startswith(_TERM)}
        return Episodes(seed=seed, terms=terms, trajectories=trajectories, **whole)


def _fly(
    environment: BatchedEnvironment,
    policy: Policy,
    first_slot: int,
    recorded: int,
    figures: _Figures,
    tell: Callable[[int], None],
) -> list[Trajectory]:
    """Fly one episode in every row of a batch; a row that has ended coasts on, unheeded, until the last has."""
    rows = environment.num_envs
    observation = environment.reset()[:, 0]
    recorder = Recorder(environment, recorded, first_slot)
    begin = getattr(policy, "begin", None)
    if begin is not None:
        begin(_flight(environment, first_slot))
    running = np.ones(rows, dtype=np.bool_)
    returns, length = np.zeros(rows), np.zeros(rows, dtype=np.int64)
    sums: dict[str, AnyArray] = {}
    last: dict[str, AnyArray] = {}
    while running.any():
        action = np.asarray(policy(observation))
        if action.shape != (rows, environment.action_layout.size):
            wanted = (rows, environment.action_layout.size)
            raise ValueError(f"the policy returned actions of shape {action.shape}; {wanted} is wanted")
        transition = environment.step(np.where(running[:, None], action, 0.0)[:, None])
        observation = transition.observation[:, 0]
        returns[running] += transition.reward[running, 0]
        length += running
        facts = step_facts(transition)
        for name, array in facts.items():
            if name.startswith(_TERM):
                sums.setdefault(name, np.zeros(rows))[running] += array[running]
            else:
                last.setdefault(name, np.zeros_like(array))[running] = array[running]
        recorder.keep()
        ends = running & transition.done[:, 0]
        if ends.any():
            running &= ~ends
            tell(rows - int(running.sum()))
    figures.add(
        returns=returns,
        length=length,
        status=last["status"],
        inspected_fraction=last.get("inspected_fraction", np.zeros(rows)),
        delta_v=last["delta_v"],
        **sums,
    )
    return recorder.trajectories(length, last["status"])


def _flight(environment: BatchedEnvironment, first_slot: int) -> Flight:
    world = environment.simulation.world
    return Flight(
        slots=first_slot + np.arange(environment.num_envs),
        observation=environment.observation_layout,
        action=environment.action_layout,
        step_size=world.step_size,
        mean_motion=world.mean_motion,
        masses=world.masses,
    )
