"""`decide`: hold the actions of environments whose decisions last until somebody decides anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from safe_inspect.environments.episodes import transition_info
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition, Transition
from safe_inspect.simulators.simulation import Paused
from safe_inspect.types import AnyArray, BoolArray

#: Names in infos of the control steps that a decision took, and of the discount of what follows it.
ELAPSED, DISCOUNT, REWARD = "elapsed_steps", "discount", "reward/"


@dataclass
class Decided:
    """What the control steps of N environments gave until an agent of each decided anew.

    Attributes:
        groups: For each acting group the transition of each environment's last control step; `reward` and `terms` are
            sums over all of them, sum gamma^i r_i.
        infos: For each acting group the infos, see `transition_info`, with those of reward terms as above. Besides
            ``elapsed_steps`` and ``discount``, gamma^elapsed_steps, by environment for every agent, and ``decides``:
            the action of the agent is taken next.
        over: The episode has ended for every agent that acts from outside, shape (N,).
    """

    groups: list[Transition]
    infos: list[dict[str, AnyArray]]
    over: BoolArray


def decide(
    environment: TeamEnvironment,
    actions: Sequence[AnyArray],
    gamma: float = 1.0,
    resting: BoolArray | None = None,
    follow: Callable[[BoolArray], None] | None = None,
) -> Decided:
    """Take control steps until in every environment an agent decides anew, or has ended.

    Environments in which that happens earlier wait: the last control step of each is the one that counts for it.

    Args:
        environment: The environments.
        actions: As for `TeamEnvironment.step`; those of agents that coast have no effect.
        gamma: Discount of a control step.
        resting: Environments that take no part, shape (N,); their arrays in the result mean nothing.
        follow: Called after every control step with the environments that have taken it, shape (N,).
    """
    count = environment.num_envs
    acting = [environment.groups.index(group) for group in environment.acting]
    running = np.ones(count, dtype=np.bool_) if resting is None else ~resting
    elapsed, discount = np.zeros(count, dtype=np.int64), np.ones(count)
    paused: list[Paused] = []
    if not running.all():
        paused.append(environment.simulation.pause(np.flatnonzero(~running)))
    decided: Decided | None = None
    while running.any():
        transition = environment.step(actions)
        if follow is not None:
            follow(running)
        found = [transition.groups[index] for index in acting]
        due = environment.due()
        settled = transition.over.copy()
        for group, again in zip(found, due, strict=True):
            flying = group.active & ~group.done
            settled |= (group.done | (flying & again)).any(axis=1)
        settled &= running
        if decided is None:
            infos = [_copies(transition_info(group, transition.filtered)) for group in found]
            decided = Decided(found, infos, transition.over.copy())
            for group in found:
                for value in (group.reward, *group.terms.values()):
                    value[~running] = 0.0
        else:
            _add(decided, found, np.where(running, discount, 0.0))
            _settle(decided, transition, found, settled)
        elapsed += running
        discount = np.where(running, discount * gamma, discount)
        for info, again in zip(decided.infos, due, strict=True):
            mine = info.setdefault("decides", again.copy().reshape(-1)).reshape(again.shape)
            mine[settled] = again[settled]
        running &= ~settled
        if running.any() and settled.any():
            paused.append(environment.simulation.pause(np.flatnonzero(settled)))
    assert decided is not None, "somebody takes part"
    for each in paused:
        environment.simulation.unpause(each)
    for group, info in zip(decided.groups, decided.infos, strict=True):
        info |= {f"{REWARD}{name}": value.reshape(-1) for name, value in group.terms.items()}
        size = group.reward.shape[1]
        info[ELAPSED], info[DISCOUNT] = elapsed.repeat(size), discount.repeat(size)
    return decided


def _copies(info: dict[str, AnyArray]) -> dict[str, AnyArray]:
    return {name: np.array(array) for name, array in info.items()}


def _add(decided: Decided, found: list[Transition], weights: AnyArray) -> None:
    """Add the rewards of a control step, with the weight of each environment, shape (N,)."""
    for total, group in zip(decided.groups, found, strict=True):
        total.reward += weights[:, None] * group.reward
        for name, value in group.terms.items():
            total.terms[name] += weights[:, None] * value


def _settle(decided: Decided, transition: TeamTransition, found: list[Transition], rows: BoolArray) -> None:
    """Take what a control step gave for the environments that decide anew with it, shape (N,)."""
    if not rows.any():
        return
    decided.over[rows] = transition.over[rows]
    for index, (kept, group) in enumerate(zip(decided.groups, found, strict=True)):
        for name in ("observation", "terminated", "truncated", "status"):
            getattr(kept, name)[rows] = getattr(group, name)[rows]
        kept.step = group.step
        fresh, size = transition_info(group, transition.filtered), group.reward.shape[1]
        for name, array in decided.infos[index].items():
            if name in fresh:
                array.reshape(len(rows), size)[rows] = fresh[name].reshape(len(rows), size)[rows]
