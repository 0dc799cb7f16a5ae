"""`fly`: the first episodes of some environment slots, flown by a scripted policy and noted down for the planning."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.policies.base import ScriptedPolicy
from safe_inspect.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Flown:
    """E episodes.

    Attributes:
        key: Random key of each episode, uint64, shape (E,).
        success: Whether it was won, shape (E,).
        delta_v: Velocity change spent, mean over the deputies [m/s], shape (E,).
        steps: Number of steps, shape (E,).
        inspected: Number of points inspected, shape (E,).
        burns: Number of runs of steps with one thrust other than 0, mean over the deputies, shape (E,).
        looks: Step after which each point was inspected, -1 for never, shape (E, P).
        thrust: Thrust of the first deputy over each step [N], 0 after the end, shape (E, T, 3).
    """

    key: IntArray
    success: BoolArray
    delta_v: FloatArray
    steps: IntArray
    inspected: IntArray
    burns: FloatArray
    looks: IntArray
    thrust: FloatArray


def fly(spec: EnvironmentSpec, policy: ScriptedPolicy, episodes: int, seed: int, first_slot: int) -> Flown:
    """Fly the first episode of each of some slots, as `safe_inspect.evaluation.rollouts.rollout` does.

    Args:
        spec: The task.
        policy: Who flies all deputies.
        episodes: Number of slots, E.
        seed: Seed of the run.
        first_slot: The first of them.
    """
    flown = replace(spec, agents=tuple(replace(agent, pilot=policy) for agent in spec.agents))
    environment = TeamEnvironment(flown, episodes, seed=seed, first_slot=first_slot)
    environment.reset()
    points = list(environment.simulation.world.points)
    deputies = len(spec.agents)

    def inspectors() -> IntArray:
        found = [environment.state.points[name].inspector for name in points]
        return np.concatenate([*found, np.zeros((episodes, 0), np.int8)], axis=1)

    looks = np.where(inspectors() >= 0, 0, -1)
    running = np.ones(episodes, dtype=np.bool_)
    success, steps, delta_v = np.zeros(episodes, np.bool_), np.zeros(episodes, np.int64), np.zeros(episodes)
    burns, last = np.zeros(episodes), np.zeros((episodes, deputies, 3))
    thrusts = []
    while running.any():
        transition = environment.step(())
        control = np.where(running[:, None, None], environment.state.control[:, :deputies], 0.0)
        burns += ((control != last).any(axis=-1) & control.any(axis=-1)).sum(axis=-1) / deputies
        last = control
        thrusts.append(control[:, 0])
        steps += running
        looks[running[:, None] & (inspectors() >= 0) & (looks < 0)] = len(thrusts)
        ends = running & transition.over
        success[ends] = transition.outcome[ends] == DoneStatus.WIN
        delta_v[ends] = environment.state.delta_v[ends].sum(axis=-1) / deputies
        running &= ~ends
    return Flown(
        key=environment.state.key.copy(),
        success=success,
        delta_v=delta_v,
        steps=steps,
        inspected=(looks >= 0).sum(axis=1),
        burns=burns,
        looks=looks,
        thrust=np.stack(thrusts, axis=1),
    )
