"""`decide`: hold the actions of environments whose decisions last until somebody decides anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from safe_inspect.environments.episodes import transition_info
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition, Transition
from safe_inspect.simulators.simulation import Paused
from safe_inspect.types import AnyArray, BoolArray, IntArray

#: Names in infos of the control steps that a decision took, and of the discount of what follows it.
ELAPSED, DISCOUNT, REWARD = "elapsed_steps", "discount", "reward/"
#: Rows of the smallest part of a batch: fewer take as long.
_LEAST_ROWS = 16


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

    Environments in which that happens earlier wait: the last control step of each is the one that counts for it. When
    half of a batch waits, the others go on in a smaller one.

    Args:
        environment: The environments.
        actions: As for `TeamEnvironment.step`; those of agents that coast have no effect.
        gamma: Discount of a control step.
        resting: Environments that take no part, shape (N,); their arrays in the result mean nothing.
        follow: Called after every control step with the environments that have taken it, shape (N,). All are then
            stepped in the whole batch, so that its state is theirs.
    """
    count = environment.num_envs
    flights = _Flights(environment, actions, np.ones(count, dtype=np.bool_) if resting is None else ~resting)
    flights.divisible = follow is None and environment.simulation.divisible
    elapsed, discount = np.zeros(count, dtype=np.int64), np.ones(count)
    decided: Decided | None = None
    observes_coasting, environment.observes_coasting = environment.observes_coasting, False
    try:
        while flights.running.any():
            transition, found, settled = flights.step()
            if follow is not None:
                follow(flights.running)
            flown = flights.rows[flights.running]
            if decided is None:
                infos = [_copies(transition_info(group, transition.filtered)) for group in found]
                decided = Decided(found, infos, transition.over.copy())
                for group in found:
                    for value in (group.reward, *group.terms.values()):
                        value[~flights.running] = 0.0
            else:
                _add(decided, found, flown, flights.running, discount[flown, None])
                _settle(decided, transition, found, flights.rows, settled)
            elapsed[flown] += 1
            discount[flown] *= gamma
            for info, again in zip(decided.infos, flights.part.due(), strict=True):
                mine = info.setdefault("decides", again.copy().reshape(-1)).reshape(count, again.shape[1])
                mine[flights.rows[settled]] = again[settled]
            flights.stop(settled)
    finally:
        environment.observes_coasting = observes_coasting
        flights.land()
    assert decided is not None, "somebody takes part"
    for group, info in zip(decided.groups, decided.infos, strict=True):
        info |= {f"{REWARD}{name}": value.reshape(-1) for name, value in group.terms.items()}
        size = group.reward.shape[1]
        info[ELAPSED], info[DISCOUNT] = elapsed.repeat(size), discount.repeat(size)
    return decided


class _Flights:
    """The environments that fly on, in the whole batch or in a smaller part of it.

    Args:
        whole: The whole batch.
        actions: Of all its environments.
        running: Those that take part, shape (N,).

    Attributes:
        part: What is stepped: R rows.
        rows: Indices of these in the whole batch, shape (R,).
        running: Those whose decisions go on, shape (R,).
        divisible: Whether smaller parts may be made.
    """

    def __init__(self, whole: TeamEnvironment, actions: Sequence[AnyArray], running: BoolArray) -> None:
        self._whole, self._given = whole, actions
        self.part, self._actions, self.running = whole, actions, running.copy()
        self.rows: IntArray = np.arange(whole.num_envs)
        self.divisible = False
        self._acting = [whole.groups.index(group) for group in whole.acting]
        self._paused: list[Paused] = []
        if not running.all():
            self._paused.append(whole.simulation.pause(np.flatnonzero(~running)))

    def step(self) -> tuple[TeamTransition, list[Transition], BoolArray]:
        """Take a control step; return what it gave, for the acting groups too, and who decides anew, shape (R,)."""
        transition = self.part.step(self._actions)
        found = [transition.groups[index] for index in self._acting]
        settled = transition.over.copy()
        for group, again in zip(found, self.part.due(), strict=True):
            flying = group.active & ~group.done
            settled |= (group.done | (flying & again)).any(axis=1)
        settled &= self.running
        self.part.observe_missing(transition, settled)
        return transition, found, settled

    def stop(self, settled: BoolArray) -> None:
        """Let environments wait, a mask of shape (R,), and go on in a smaller part when half of them do."""
        self.running &= ~settled
        count = int(np.count_nonzero(self.running))
        if settled.any() and (count or self.part is not self._whole):
            paused = self.part.simulation.pause(np.flatnonzero(settled))
            self._paused.append(paused._replace(rows=self.rows[settled]))
        size = _LEAST_ROWS
        while size < count:
            size *= 2
        if self.divisible and count > 0 and size < len(self.running):
            self._go_on(size, count)

    def _go_on(self, size: int, count: int) -> None:
        """Move those that fly on, and some that fill the rows, to a part of another size."""
        waiting = np.flatnonzero(~self.running)[: size - count]
        chosen = np.concatenate((np.flatnonzero(self.running), waiting))
        paused = self.part.simulation.pause(chosen)
        self._leave()
        self.part, self.rows = self._whole.part(size), self.rows[chosen]
        self._members, self.running = self.rows[:count], np.arange(size) < count
        self.part.simulation.enter(self._whole.simulation, paused, self.rows)
        self._actions = [action[self.rows] for action in self._given]

    def _leave(self) -> None:
        if self.part is not self._whole:
            self.part.simulation.leave(self._whole.simulation, self._members)

    def land(self) -> None:
        """Write the states of all environments into the whole batch, each as it was when it stopped."""
        self.stop(self.running.copy())
        self._leave()
        for each in self._paused:
            self._whole.simulation.unpause(each)


def _copies(info: dict[str, AnyArray]) -> dict[str, AnyArray]:
    return {name: np.array(array) for name, array in info.items()}


def _add(decided: Decided, found: list[Transition], rows: IntArray, running: BoolArray, weights: AnyArray) -> None:
    """Add the rewards of a control step to those of some environments, with weights of shape (F, 1).

    Args:
        decided: Takes the rewards.
        found: What the step gave, R rows.
        rows: The environments that took it, shape (F,).
        running: Which of the R rows they are, shape (R,).
        weights: Discounts, shape (F, 1).
    """
    for total, group in zip(decided.groups, found, strict=True):
        total.reward[rows] += weights * group.reward[running]
        for name, value in group.terms.items():
            total.terms[name][rows] += weights * value[running]


def _settle(
    decided: Decided, transition: TeamTransition, found: list[Transition], rows: IntArray, settled: BoolArray
) -> None:
    """Take what a control step gave for the environments that decide anew with it.

    Args:
        decided: Takes it.
        transition: The step, R rows.
        found: Its acting groups.
        rows: Indices of the rows in the whole batch, shape (R,).
        settled: The rows that decide anew, shape (R,).
    """
    if not settled.any():
        return
    whole = rows[settled]
    decided.over[whole] = transition.over[settled]
    for index, (kept, group) in enumerate(zip(decided.groups, found, strict=True)):
        for name in ("observation", "terminated", "truncated", "status"):
            getattr(kept, name)[whole] = getattr(group, name)[settled]
        kept.step = group.step
        fresh, size = transition_info(group, transition.filtered), group.reward.shape[1]
        for name, array in decided.infos[index].items():
            if name in fresh:
                array.reshape(-1, size)[whole] = fresh[name].reshape(-1, size)[settled]
