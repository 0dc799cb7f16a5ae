"""`decide`: step environments whose actions last several control steps until an agent needs a new decision."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from safe_inspect.environments.episodes import transition_info
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition, Transition
from safe_inspect.simulators.simulator import Paused
from safe_inspect.types import AnyArray, BoolArray, IntArray

#: Info names of the number of control steps of a decision and of the discount after it; prefix of the reward terms.
ELAPSED, DISCOUNT, REWARD = "elapsed_steps", "discount", "reward/"
#: Rows of the smallest part of a batch; stepping fewer rows is not faster.
_LEAST_ROWS = 16


@dataclass
class _Decided:
    """Result of the control steps of N environments up to the next decision of an agent in each.

    Attributes:
        groups: For each acting group, the transition of the last control step of each environment; `reward` and `terms`
            are the sums over all its control steps, sum gamma^i r_i.
        infos: For each acting group, the infos (see `transition_info`) with the reward terms summed as above. They also
            contain ``elapsed_steps`` and ``discount``, which is gamma^elapsed_steps, of each environment repeated for
            every agent, and ``decides``: whether the action of the agent is used in the next step.
        over: Whether the episode has ended for every controlled agent, shape (N,).
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
) -> _Decided:
    """Take control steps until, in every environment, an agent needs a new decision or has ended.

    If no actions hold for several control steps, or all environments rest, this is one control step, and the infos are
    those of `transition_info` alone. Environments that reach the next decision earlier wait; their last control step is
    the one in the result. When half of a batch waits, the others continue in a smaller batch.

    Args:
        environment: The environments.
        actions: As for `TeamEnvironment.step`; the actions of agents that are coasting have no effect.
        gamma: Discount per control step.
        resting: Mask of the environments that are not stepped, shape (N,); their rows of the result are meaningless.
        follow: Called after every control step with the mask of the environments that have taken it, shape (N,). With
            it, all environments are stepped in the whole batch, so that its state is up to date at each call.
    """
    count = environment.num_envs
    if not environment.decides or (resting is not None and resting.all()):
        transition = environment.step(actions)
        if follow is not None:
            follow(np.ones(count, dtype=np.bool_))
        found = [transition.groups[index] for index in environment.acting_indices]
        return _Decided(found, [transition_info(group, transition.filtered) for group in found], transition.over)
    flights = _Flights(environment, actions, np.ones(count, dtype=np.bool_) if resting is None else ~resting)
    flights.divisible &= follow is None
    elapsed, discount = np.zeros(count, dtype=np.int64), np.ones(count)
    decided: _Decided | None = None
    observes_coasting, environment.observes_coasting = environment.observes_coasting, False
    try:
        while flights.running.any():
            transition, found, settled = flights.step()
            if follow is not None:
                follow(flights.running)
            flown = flights.rows[flights.running]
            if decided is None:
                kept = [transition_info(group, transition.filtered) for group in found]
                infos = [{name: np.array(array) for name, array in info.items()} for info in kept]
                decided = _Decided(found, infos, transition.over.copy())
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
    assert decided is not None, "at least one environment is stepped"
    for group, info in zip(decided.groups, decided.infos, strict=True):
        info |= {f"{REWARD}{name}": value.reshape(-1) for name, value in group.terms.items()}
        size = group.reward.shape[1]
        info[ELAPSED], info[DISCOUNT] = elapsed.repeat(size), discount.repeat(size)
    return decided


class FlyingRows:
    """The environments of a batch that are being stepped, in the whole batch or in a smaller part of it.

    Args:
        whole: The whole batch.

    Attributes:
        part: The batch that is stepped, of R rows.
        rows: Indices of its rows in the whole batch, shape (R,).
        divisible: Whether smaller parts may be made.
    """

    def __init__(self, whole: TeamEnvironment) -> None:
        self._whole, self.part = whole, whole
        self.rows: IntArray = np.arange(whole.num_envs)
        self.divisible = whole.simulation.divisible

    def go_on(self, running: BoolArray) -> IntArray | None:
        """Continue in a smaller part if at most half of the rows are running, a mask of shape (R,).

        Returns:
            Indices, among the rows stepped before, of those that are stepped from now on: first all that are running,
                then some that fill the part. None if nothing changes.
        """
        count, size = int(np.count_nonzero(running)), _LEAST_ROWS
        while size < count:
            size *= 2
        if not self.divisible or not count or size >= len(running):
            return None
        chosen = np.concatenate((np.flatnonzero(running), np.flatnonzero(~running)[: size - count]))
        paused = self.part.simulation.pause(chosen)
        self._leave()
        self.part, self.rows = self._whole.part(size), self.rows[chosen]
        self._members = self.rows[:count]
        self.part.simulation.enter(self._whole.simulation, paused, self.rows)
        return chosen

    def _leave(self) -> None:
        if self.part is not self._whole:
            self.part.simulation.leave(self._whole.simulation, self._members)


class _Flights(FlyingRows):
    """The environments whose decisions have not elapsed.

    Args:
        whole: The whole batch.
        actions: Actions of all its environments.
        running: Mask of the environments to step, shape (N,).

    Attributes:
        running: Mask of the rows whose decisions have not elapsed, shape (R,).
    """

    def __init__(self, whole: TeamEnvironment, actions: Sequence[AnyArray], running: BoolArray) -> None:
        super().__init__(whole)
        self._given, self._actions, self.running = actions, actions, running.copy()
        self._paused: list[Paused] = []
        if not running.all():
            self._paused.append(whole.simulation.pause(np.flatnonzero(~running)))

    def step(self) -> tuple[TeamTransition, list[Transition], BoolArray]:
        """Take a control step.

        Returns:
            The transition, the transitions of the acting groups, and the mask of the running rows in which an agent
            needs a new decision or has ended, shape (R,).
        """
        transition = self.part.step(self._actions)
        found = [transition.groups[index] for index in self._whole.acting_indices]
        settled = transition.over.copy()
        for group, again in zip(found, self.part.due(), strict=True):
            flying = group.active & ~group.done
            settled |= (group.done | (flying & again)).any(axis=1)
        settled &= self.running
        self.part.observe_missing(transition.groups, settled)
        return transition, found, settled

    def stop(self, settled: BoolArray) -> None:
        """Let a mask of rows, shape (R,), wait; continue in a smaller part when half of the rows are waiting."""
        self.running &= ~settled
        count = int(np.count_nonzero(self.running))
        if settled.any() and (count or self.part is not self._whole):
            paused = self.part.simulation.pause(np.flatnonzero(settled))
            self._paused.append(paused._replace(rows=self.rows[settled]))
        if self.go_on(self.running) is not None:
            self.running = np.arange(len(self.rows)) < count
            self._actions = [action[self.rows] for action in self._given]

    def land(self) -> None:
        """Write the states of all environments into the whole batch, each as it was when the environment stopped."""
        self.stop(self.running.copy())
        self._leave()
        for each in self._paused:
            self._whole.simulation.unpause(each)


def _add(decided: _Decided, found: list[Transition], rows: IntArray, running: BoolArray, weights: AnyArray) -> None:
    """Add the rewards of a control step to the totals of some environments, with weights of shape (F, 1).

    Args:
        decided: The totals, changed in place.
        found: Transitions of the step, R rows.
        rows: Indices of the environments that took the step, shape (F,).
        running: Mask of these environments among the R rows, shape (R,).
        weights: Discounts, shape (F, 1).
    """
    for total, group in zip(decided.groups, found, strict=True):
        total.reward[rows] += weights * group.reward[running]
        for name, value in group.terms.items():
            total.terms[name][rows] += weights * value[running]


def _settle(
    decided: _Decided, transition: TeamTransition, found: list[Transition], rows: IntArray, settled: BoolArray
) -> None:
    """Store the result of a control step for the environments that need a new decision after it.

    Args:
        decided: The result, changed in place.
        transition: The step, R rows.
        found: Transitions of its acting groups.
        rows: Indices of the rows in the whole batch, shape (R,).
        settled: Mask of the rows that need a new decision, shape (R,).
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
