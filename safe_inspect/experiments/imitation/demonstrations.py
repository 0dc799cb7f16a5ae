"""`fly_round`: episodes in which teachers say in every step what they would do, whoever flies."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.evaluation.rollouts.collector import EpisodeCollector
from safe_inspect.experiments.imitation.inverse import ActionInverse
from safe_inspect.experiments.sampling.sampler import AgentSlot
from safe_inspect.glues.coast_glue import CoastGlue
from safe_inspect.types import AnyArray, BoolArray, FloatArray

#: From observations, float32, shape (R, O), to actions, shape (R, A).
Act = Callable[[AnyArray], AnyArray]


@dataclass(frozen=True)
class Steps:
    """Control steps of the agents of one policy, or their decisions where these may last.

    Attributes:
        observations: What they saw, float32, shape (M, O).
        actions: What their teacher would have done, float32, shape (M, A); without a teacher what they did. A decision
            that may last does so as long as a duration allows until the teacher would burn, or the agent did.
        returns: Discounted sum of the rewards from there to the end of the episode [-], float32, shape (M,).
    """

    observations: AnyArray
    actions: AnyArray
    returns: AnyArray

    @classmethod
    def join(cls, parts: Sequence[Steps]) -> Steps:
        """Return the steps of several rounds or agents."""
        names = ("observations", "actions", "returns")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


@dataclass(frozen=True)
class FlownRound:
    """What a round came to.

    Attributes:
        steps: The steps by the name of the policy.
        success: Share of the episodes that were won [-].
        delta_v: Mean velocity change of a deputy [m/s].
    """

    steps: Mapping[str, Steps]
    success: float
    delta_v: float


def fly_round(
    environment: TeamEnvironment,
    slots: Sequence[AgentSlot],
    acting: Mapping[str, Act],
    taught: Sequence[str],
    gamma: float,
    progress: Callable[[int, int], None] = lambda done, wanted: None,
) -> FlownRound:
    """Fly one episode in every environment.

    Args:
        environment: The environments; the agents of taught policies have a teacher.
        slots: Its agents that act from outside, in order.
        acting: Policies that fly their agents; the others' are flown by their teachers.
        taught: Policies whose teachers are asked.
        gamma: Discount of a step.
        progress: Called with the numbers of ended and of all episodes.
    """
    observations = environment.reset()
    collector = EpisodeCollector(environment, ())
    inverses = {slot.group: ActionInverse(environment.acting[slot.group]) for slot in slots if slot.policy in taught}
    numbers = {index: environment.groups.index(environment.acting[index]) for index in range(len(environment.acting))}
    kept: list[list[_Moment]] = [[] for _ in slots]
    running = collector.running
    while running.any():
        wanted, asked = {}, {}
        for index, inverse in inverses.items():
            group = environment.acting[index]
            asked[index] = group.fly(environment.view(numbers[index]))
            wanted[index] = inverse(asked[index]).reshape(environment.num_envs, group.size, -1)
        due = environment.due()
        actions = [np.zeros((environment.num_envs, g.size, g.action_layout.size)) for g in environment.acting]
        for slot in slots:
            seen = np.ascontiguousarray(observations[slot.group][:, slot.member])
            act = acting.get(slot.policy)
            actions[slot.group][:, slot.member] = act(seen) if act is not None else wanted[slot.group][:, slot.member]
        flying = environment.state.finished == 0
        transition = environment.step(actions)
        for place, slot in enumerate(slots):
            told = wanted.get(slot.group, actions[slot.group])[:, slot.member]
            reward = transition.groups[numbers[slot.group]].reward[:, slot.member]
            flies = flying[:, slot.deputy] & running
            burns = _burns(environment, numbers[slot.group], slot, transition.groups[numbers[slot.group]].step.control)
            if slot.group in asked:
                burns |= _burns(environment, numbers[slot.group], slot, asked[slot.group])
            seen = observations[slot.group][:, slot.member].copy()
            decides = due[slot.group][:, slot.member].copy()
            kept[place].append(_Moment(seen, told.copy(), reward.copy(), flies, burns, decides))
        observations = tuple(transition.groups[numbers[index]].observation for index in range(len(environment.acting)))
        collector.add(transition)
        running = collector.running
        progress(int(environment.num_envs - running.sum()), environment.num_envs)
    found = collector.episodes(0, [])
    by_policy: dict[str, list[Steps]] = {}
    for place, slot in enumerate(slots):
        coast = environment.acting[slot.group].action_layout.coast if slot.policy in taught else None
        found_steps = _steps(kept[place], gamma, coast, by_teacher=slot.policy not in acting)
        by_policy.setdefault(slot.policy, []).append(found_steps)
    steps = {policy: Steps.join(parts) for policy, parts in by_policy.items()}
    return FlownRound(steps, float(found.success.mean()), float(found.delta_v.mean()))


class _Moment(NamedTuple):
    """One control step of one agent: what it saw, was told and earned; whether it flew, anyone burned, it decided."""

    observation: AnyArray
    action: AnyArray
    reward: FloatArray
    flies: BoolArray
    burns: BoolArray
    decides: BoolArray


def _burns(environment: TeamEnvironment, group: int, slot: AgentSlot, control: FloatArray) -> BoolArray:
    """Return whether the control of an agent is none of zeros, shape (N,)."""
    whole = control.reshape(environment.num_envs, environment.groups[group].size, -1)
    return np.asarray(whole[:, slot.member].any(axis=-1))


def _steps(kept: Sequence[_Moment], gamma: float, coast: CoastGlue | None, by_teacher: bool) -> Steps:
    """Return the steps of one agent in its episodes, with their returns; how long decisions last is seen afterwards.

    Of decisions that last only those are kept that follow one another. If every control step were an example, the
    policy would learn how likely a burn is in a control step, but it is asked in one of many: it would hardly burn.

    Args:
        kept: The control steps.
        gamma: Discount of a step.
        coast: How long decisions may last, where the teacher was asked for them.
        by_teacher: Whether the teacher flew, which decided anew in every step.
    """
    observations, actions, rewards, flies, burns, decides = (np.stack(column) for column in zip(*kept, strict=True))
    if coast is not None:
        later = np.full(burns.shape[1], coast.durations[-1])
        for time in reversed(range(len(burns))):
            actions[time, :, -1] = np.searchsorted(coast.table, np.maximum(later, coast.table[0]), side="right") - 1
            later = np.where(burns[time], 1, later + 1)
        if by_teacher:
            lasts, until = coast.steps(actions[..., -1]), np.zeros(burns.shape[1], dtype=np.int64)
            for time in range(len(burns)):
                decides[time] = until <= time
                until = np.where(decides[time], time + lasts[time], until)
    returns = np.zeros_like(rewards)
    later = np.zeros(rewards.shape[1])
    for time in reversed(range(len(rewards))):
        later = returns[time] = np.where(flies[time], rewards[time] + gamma * later, 0.0)
    return Steps(*(array[flies & decides].astype(np.float32) for array in (observations, actions, returns)))
