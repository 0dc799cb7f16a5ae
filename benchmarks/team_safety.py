"""`team_report`: are deputies kept safe from the chief and from each other, by filters that decide together or apart?

Flies adversaries on the equations of motion alone and looks at every constraint, at the steps and between them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from safe_inspect.random.streams import Streams
from safe_inspect.types import AnyArray, FloatArray, IntArray

if TYPE_CHECKING:
    from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState

#: How the thrusts are filtered.
FILTERS = ("none", "decentralised", "centralised")
#: The adversaries; environment r of a batch has the one of number r modulo their count.
TEAM_ADVERSARIES = (
    "to each other", "to the middle", "to the chief", "to the sun cone", "outward", "random corners", "bang-bang",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class TeamReport:
    """What came of a run of N environments with D deputies.

    Attributes:
        kind: How the thrusts were filtered, of `FILTERS`.
        names: The constraints, C of them.
        deputies: Number of deputies, D.
        steps: Environment steps.
        runs: Environments, N: so many runs, each from its own start.
        least_at_steps: Smallest plain safety quantity at the ends of the steps, shape (C,).
        least_between: Smallest between them, shape (C,).
        violations_at_steps: Environment steps with a negative quantity at their end, shape (C,).
        violations_between: Moments within holds with a negative quantity, shape (C,).
        broken_runs: Runs in which each constraint was broken at any moment, shape (C,).
        moments: Moments within holds that were looked at.
        closest: Smallest distance of any two deputies in each run [m], shape (N,).
        interventions: Deputy steps in which the filter changed the thrust, by adversary, shape (K,).
        flown: Deputy steps of each adversary, shape (K,).
        infeasible: Environment steps in which nothing was promised; for the decentralised filter, to any deputy.
        backup: Environment steps in which a backup shaped the thrust.
        seconds: Time spent in the filter [s].
    """

    kind: str
    names: tuple[str, ...]
    deputies: int
    steps: int
    runs: int
    least_at_steps: FloatArray
    least_between: FloatArray
    violations_at_steps: IntArray
    violations_between: IntArray
    broken_runs: IntArray
    moments: int
    closest: FloatArray
    interventions: IntArray
    flown: IntArray
    infeasible: int
    backup: int
    seconds: float

    @property
    def violations(self) -> int:
        """All violations, at the steps and between them."""
        return int(self.violations_at_steps.sum() + self.violations_between.sum())

    def __str__(self) -> str:
        width = max(len("constraint"), *map(len, self.names))
        lines = [
            f"{self.kind}: {self.steps:,} environment steps of {self.deputies} deputies in {self.runs:,} runs, "
            f"{self.moments:,} moments between them",
            f"{'constraint':<{width}}  smallest phi: {'at steps':>10} {'between':>10}"
            f"  violations: at steps    between  runs",
        ]
        for j, name in enumerate(self.names):
            lines.append(
                f"{name:<{width}}                {self.least_at_steps[j]:10.3g} {self.least_between[j]:10.3g}"
                f"{self.violations_at_steps[j]:>22,} {self.violations_between[j]:>10,} {self.broken_runs[j]:>5,}"
            )
        lines.append(f"closest pair: {self.closest.min():.3f} m; median of the runs {np.median(self.closest):.3f} m")
        if self.kind != "none":
            for k, kind in enumerate(TEAM_ADVERSARIES):
                if self.flown[k]:
                    share = 100.0 * self.interventions[k] / self.flown[k]
                    lines.append(f"interventions, {kind}: {share:.1f} % of deputy steps")
            lines.append(
                f"infeasible environment steps: {self.infeasible:,}; a backup shaped the thrust in {self.backup:,}; "
                f"{1e6 * self.seconds / self.steps:.1f} us in the filter for an environment step"
            )
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Return the figures as plain values, for JSON."""
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(self).items()
        }  # fmt: skip


def team_thrust(state: TeamState, step: int, slots: IntArray, seed: int) -> FloatArray:
    """Return what the adversaries want, as shares of the largest thrust in [-1, 1], Hill frame, shape (N, D, 3).

    In turn: each deputy to its nearest other; all to their middle; to the chief; to the axis of the sun's keep-out
    cone; outward; the largest thrust in random directions; along and against the velocity, for seven steps each.

    Args:
        state: The states.
        step: Number of the step, for the random and the bang-bang ones.
        slots: Index of each environment, shape (N,).
        seed: Seed of the random one.
    """
    p, v, theta = state.position, state.velocity, state.sun_angle[:, None]
    deputies = p.shape[1]
    away = p[:, None] - p[:, :, None]  # from deputy i to deputy j
    square = (away * away).sum(axis=-1)
    square[:, np.arange(deputies), np.arange(deputies)] = np.inf
    nearest = square.argmin(axis=-1)
    others = np.take_along_axis(away, nearest[:, :, None, None], axis=2)[:, :, 0]
    middle = p.mean(axis=1, keepdims=True) - p
    r = np.sqrt((p * p).sum(axis=-1, keepdims=True))
    axis = r * np.stack((-np.cos(theta), np.sin(theta), np.zeros_like(theta)), axis=-1) - p
    streams = Streams(seed, slots, np.zeros_like(slots))
    corners = np.where(streams.uniform("corners", 3 * deputies, index=step) < 0.5, -1.0, 1.0).reshape(p.shape)
    along = np.sign(v + 1e-12) * (1.0 if step // 7 % 2 else -1.0)
    choices = np.stack(
        (1.8 * _unit(others), 1.8 * _unit(middle), -1.8 * p / r, 1.8 * _unit(axis), 1.8 * p / r, corners, along)
    )
    kinds = slots % len(TEAM_ADVERSARIES)
    return np.asarray(np.clip(choices[kinds, np.arange(len(slots))], -1.0, 1.0))


def _unit(vectors: FloatArray) -> FloatArray:
    size: FloatArray = np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True)) + 1e-9
    return vectors / size


def draw_teams(
    run: TeamFilter, teams: int, deputies: int, seed: int = 0,
    ranges: tuple[float, float] = (50.0, 100.0), fastest: float = 0.3,
) -> TeamState:  # fmt: skip
    """Return starts in which every constraint is met and from which there is a joint plan.

    Directions of position and velocity are isotropic, ranges and speeds uniform.

    Args:
        run: The filter whose constraints count.
        teams: Number of environments, N.
        deputies: Number of deputies, D.
        seed: Seed of the draws.
        ranges: Smallest and largest range of a deputy [m].
        fastest: Largest speed [m/s].

    Raises:
        ValueError: After 10,000 draws of every environment some have no start: there is no room for so many deputies.
    """
    from safe_inspect.rta.team.safety_filter import TeamState

    generator = np.random.default_rng(seed)
    position, velocity = np.empty((2, teams, deputies, 3))
    sun, missing = np.empty(teams), np.arange(teams)
    for _ in range(10_000):
        size = len(missing)
        directions = _unit(generator.normal(size=(2, size, deputies, 3)))
        state = TeamState(
            directions[0] * generator.uniform(*ranges, (size, deputies, 1)),
            directions[1] * generator.uniform(0.0, fastest, (size, deputies, 1)),
            generator.uniform(0.0, 2.0 * np.pi, size),
        )
        good = np.ones(size, np.bool_)
        for phi in run.phi(state).values():
            good &= phi >= 0.0
        good[good] = run.recoverable(state[good])
        position[missing[good]], velocity[missing[good]] = state.position[good], state.velocity[good]
        sun[missing[good]] = state.sun_angle[good]
        missing = missing[~good]
        if not len(missing):
            return TeamState(position, velocity, sun)
    raise ValueError(f"no safe start was found for {deputies} deputies between {ranges} m; give them more room")


def team_report(
    kind: str, run: TeamFilter, start: TeamState, steps: int, seed: int = 0, substeps: int = 10,
    progress: Callable[[int, int], None] | None = None,
) -> TeamReport:  # fmt: skip
    """Fly the adversaries and look at every constraint.

    Args:
        kind: How the thrusts are filtered, of `FILTERS`.
        run: The filter that decides for all; the decentralised ones have its constraints.
        start: The first states, as many runs.
        steps: Environment steps, rounded up to whole steps of the batch.
        seed: Seed of the random adversary.
        substeps: Number of equal parts of every hold at which constraints are checked.
        progress: Called with the environment steps done and asked for.

    Raises:
        ValueError: `kind` is none of `FILTERS`, or a number is not positive.
    """
    from team_flight import TeamFlight

    if kind not in FILTERS:
        raise ValueError(f"the filter is one of {', '.join(FILTERS)}, not {kind!r}")
    if min(steps, substeps) < 1:
        raise ValueError(f"steps and substeps are at least 1, not {steps} and {substeps}")
    flight = TeamFlight(kind, run, start, substeps)
    runs, deputies = start.position.shape[:2]
    slots, holds = np.arange(runs), -(-steps // runs)
    kinds: AnyArray = slots % len(TEAM_ADVERSARIES)
    interventions, flown = np.zeros((2, len(TEAM_ADVERSARIES)), np.int64)
    infeasible, backup, seconds = 0, 0, 0.0
    for hold in range(holds):
        desired = team_thrust(flight.state, hold, slots, seed) * float(run.alone.parameters.u_max)
        begin = time.perf_counter()
        control, promised, shaped = flight.filtered(desired)
        seconds += time.perf_counter() - begin
        changed = np.square(control - desired).sum(axis=-1) > 1e-4
        infeasible += int((~promised).sum())
        backup += int(shaped.sum())
        flown += deputies * np.bincount(kinds, minlength=len(TEAM_ADVERSARIES))
        np.add.at(interventions, kinds, changed.sum(axis=1))
        flight.fly(control)
        if progress is not None:
            progress((hold + 1) * runs, holds * runs)
    return TeamReport(
        kind=kind, names=flight.names, deputies=deputies, steps=holds * runs, runs=runs,
        least_at_steps=flight.least_at_steps, least_between=flight.least_between,
        violations_at_steps=flight.violations_at_steps, violations_between=flight.violations_between,
        broken_runs=flight.broken.sum(axis=0), moments=holds * runs * (substeps - 1), closest=flight.closest,
        interventions=interventions, flown=flown, infeasible=infeasible, backup=backup, seconds=seconds,
    )  # fmt: skip
