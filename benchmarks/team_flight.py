"""The flight of a batch of teams on the equations of motion, with a look at every constraint along the way."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState
from safe_inspect.types import BoolArray, FloatArray


class TeamFlight:
    """N environments with D deputies on their way.

    Attributes:
        names: The constraints, C of them.
        state: The present states.
        least_at_steps: Smallest plain safety quantity at the ends of the steps, shape (C,).
        least_between: Smallest between them, shape (C,).
        violations_at_steps: Environment steps with a negative quantity at their end, shape (C,).
        violations_between: Moments within holds with a negative quantity, shape (C,).
        broken: Runs in which each constraint was broken, shape (N, C).
        closest: Smallest distance of any two deputies in each run [m], shape (N,).
    """

    def __init__(self, kind: str, run: TeamFilter, start: TeamState, substeps: int) -> None:
        """Begin at the first states; see `team_report` for the arguments."""
        p = run.alone.parameters
        self._kind, self._run, self._substeps, self._n = kind, run, substeps, float(p.n)
        self._step = float(p.step_size)
        self._whole, self._part = transition(p.n, p.m, p.step_size), transition(p.n, p.m, p.step_size / substeps)
        self._plan = np.zeros(start.position.shape[:2], np.int64)
        self.names = tuple(run.phi(start))
        self.state, count = start, len(self.names)
        self.least_at_steps, self.least_between = np.full((2, count), np.inf)
        self.violations_at_steps, self.violations_between = np.zeros((2, count), np.int64)
        self.broken = np.zeros((len(start), count), np.bool_)
        self.closest = _closest(start)

    def filtered(self, desired: FloatArray) -> tuple[FloatArray, BoolArray, BoolArray]:
        """Return the thrusts to fly, which environments are promised safety, and where a backup was flown."""
        runs, deputies = desired.shape[:2]
        if self._kind == "centralised":
            result = self._run(self.state, desired, self._plan)
            self._plan = result.plan
            return result.control, ~result.infeasible, result.backup
        promised, backup = np.ones(runs, np.bool_), np.zeros(runs, np.bool_)
        if self._kind != "decentralised":
            return desired, promised, backup
        control, state = np.empty_like(desired), self.state
        for i in range(deputies):  # each assumes that the others coast
            coasting = np.ones((runs, deputies), np.bool_)
            coasting[:, i] = False
            alone = TeamState(state.position, state.velocity, state.sun_angle, coasting)
            one = self._run(alone, np.where(coasting[..., None], 0.0, desired))
            control[:, i] = one.control[:, i]
            promised &= ~one.infeasible
            backup |= one.backup
        return control, promised, backup

    def fly(self, control: FloatArray) -> None:
        """Hold the thrusts for one step, and look along it and at its end."""
        before, shape = self.state, control.shape
        flat = np.ascontiguousarray(control).reshape(-1, 3)
        p, v = before.position.reshape(-1, 3).copy(), before.velocity.reshape(-1, 3).copy()
        for part in range(1, self._substeps + 1):
            last = part == self._substeps
            if last:  # in one stride, as a simulator flies it
                p, v = before.position.reshape(-1, 3).copy(), before.velocity.reshape(-1, 3).copy()
            propagate(p, v, flat, *(self._whole if last else self._part), p, v)
            share = part * self._step / self._substeps
            now = TeamState(p.reshape(shape).copy(), v.reshape(shape).copy(), before.sun_angle + self._n * share)
            phi = np.stack(list(self._run.phi(now).values()), axis=1)
            self.broken |= phi < 0.0
            self.closest = np.minimum(self.closest, _closest(now))
            least, below = phi.min(axis=0), (phi < 0.0).sum(axis=0)
            if last:
                self.least_at_steps = np.minimum(self.least_at_steps, least)
                self.violations_at_steps += below
                self.state = now
            else:
                self.least_between = np.minimum(self.least_between, least)
                self.violations_between += below


def _closest(state: TeamState) -> FloatArray:
    """Return the smallest distance of any two deputies [m], infinite without a pair, shape (N,)."""
    first, second = np.triu_indices(state.position.shape[1], 1)
    apart = state.position[:, first] - state.position[:, second]
    if not len(first):
        return np.full(len(state), np.inf)
    return np.asarray(np.sqrt((apart * apart).sum(axis=-1)).min(axis=1))
