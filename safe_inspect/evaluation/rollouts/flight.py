"""`fly_slots`: runs and records the first episodes of some environment slots with a scripted policy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.evaluation.episodes import Trajectory
from safe_inspect.evaluation.policies import with_scripted
from safe_inspect.evaluation.rollouts.rollout import fly_batch
from safe_inspect.planning.record import Entry
from safe_inspect.policies.base import ScriptedPolicy
from safe_inspect.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class FlownSlots:
    """Recorded episodes of E environment slots.

    Attributes:
        key: Random key of each episode, uint64, shape (E,).
        success: Whether each episode was won, shape (E,).
        delta_v: Velocity change spent, mean over the deputies [m/s], shape (E,).
        steps: Number of steps, shape (E,).
        inspected: Number of points inspected, shape (E,).
        trajectories: The episodes.
    """

    key: IntArray
    success: BoolArray
    delta_v: FloatArray
    steps: IntArray
    inspected: IntArray
    trajectories: list[Trajectory]

    def entry(self, row: int, **more: Any) -> Entry:
        """Return the entry of one episode for the record of a baseline.

        Args:
            row: Row of the episode.
            more: Fields that only plans have.
        """
        return Entry(
            key=int(self.key[row]),
            success=bool(self.success[row]),
            delta_v=float(self.delta_v[row]),
            steps=int(self.steps[row]),
            inspected=int(self.inspected[row]),
            burns=_count_burns(self.trajectories[row]),
            **more,
        )


def fly_slots(spec: EnvironmentSpec, policy: ScriptedPolicy, episodes: int, seed: int, first_slot: int) -> FlownSlots:
    """Run the first episode of each of some slots, as `safe_inspect.evaluation.rollouts.rollout` does.

    Args:
        spec: The task.
        policy: The policy of all deputies.
        episodes: Number of slots, E.
        seed: Seed of the run.
        first_slot: The first slot.
    """
    scripted = with_scripted(spec, policy)
    environment = TeamEnvironment(scripted, episodes, seed=seed, first_slot=first_slot)
    collector, trajectories = fly_batch(environment, {}, (), first_slot, episodes)
    found = collector.episodes(seed, trajectories)
    return FlownSlots(
        key=environment.state.key.copy(),
        success=found.success,
        delta_v=found.delta_v,
        steps=found.length,
        inspected=found.inspected_count,
        trajectories=trajectories,
    )


def _count_burns(trajectory: Trajectory) -> float:
    """Return the number of burns, mean over the deputies; a burn is a run of steps with constant, nonzero thrust."""
    control = trajectory.control[..., :3]
    before = np.concatenate((np.zeros_like(control[:1]), control[:-1]))
    begins = (control != before).any(axis=-1) & control.any(axis=-1)
    return float(begins.sum() / control.shape[1])


def sighting_steps(trajectory: Trajectory) -> IntArray:
    """Return the step after which each point was inspected, -1 for never, shape (P,)."""
    steps = np.searchsorted(trajectory.time, trajectory.inspected_at)
    return np.where(np.isfinite(trajectory.inspected_at), steps, -1)
