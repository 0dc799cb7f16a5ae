"""`audit`: test the backup filter with random parameters, from states at the edge of what it accepts.

The expected results are computed independently, without the code of the filter: motions by a matrix exponential, the
constraints from their definitions, at moments within every hold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Any, cast

import numpy as np
from scipy.linalg import expm

from safe_inspect.rta.adversaries import DisturbanceAdversary, normalised_rows
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints.base import RelativeState
from safe_inspect.rta.constraints.sets import NAMES
from safe_inspect.types import FloatArray, IntArray

#: Number of parts of a hold at whose ends the constraints are evaluated.
_PARTS = 20
#: Step of the grid on which the least range of coasting is searched [s].
_COAST = 2.0
_BISECTIONS = 45
_GRID = 25


@dataclass
class Audit:
    """Counts over all settings.

    Attributes:
        settings: Settings that were tested.
        refused: Settings that were sampled, but rejected when the filter was built.
        starts: Initial states.
        steps: Filtered steps.
        infeasible: Steps in which the filter found no plan, although it had accepted the initial state.
        violations: Moments at which a constraint was violated.
        interventions: Steps in which the filter changed the desired thrust.
        least: The smallest safety quantity phi of each constraint.
    """

    settings: int = 0
    refused: int = 0
    starts: int = 0
    steps: int = 0
    infeasible: int = 0
    violations: int = 0
    interventions: int = 0

    def __post_init__(self) -> None:
        self.least = dict.fromkeys(NAMES, np.inf)

    def __str__(self) -> str:
        lines = [f"{field.name:<12}{getattr(self, field.name):>12,}" for field in fields(self)]
        return "\n".join([*lines, *(f"least {name:<16}{value:>12.3g}" for name, value in self.least.items())])


def settings(seed: int) -> Iterator[tuple[dict[str, float], tuple[str, ...]]]:
    """Yield random parameters and choices of constraints, endlessly; about half of them name all constraints."""
    rng = np.random.default_rng(seed)
    while True:
        speed = float(rng.choice([0.1, 0.2, 0.5, 1.0]))
        values = {
            "m": float(np.exp(rng.uniform(np.log(5.0), np.log(150.0)))),
            "u_max": float(rng.choice([0.2, 0.5, 1.0, 2.0])),
            "step_size": float(rng.choice([1.0, 5.0, 10.0, 20.0, 60.0])),
            "n": float(rng.choice([5e-4, 0.001027, 1.5e-3])),
            "r_max": float(rng.uniform(200.0, 1500.0)), "collision_radius": float(rng.uniform(5.0, 20.0)),
            "fov": float(np.deg2rad(rng.uniform(20.0, 140.0))), "v0": speed, "vel_limit": 5.0 * speed,
            "psm_horizon": float(rng.choice([50.0, 100.0, 1000.0])),
        }  # fmt: skip
        chosen = NAMES if rng.random() < 0.5 else tuple(name for name in NAMES if rng.random() < 0.5)
        if chosen:
            yield values, chosen


def audit(
    count: int,
    rows: int = 64,
    steps: int = 60,
    seed: int = 0,
    first: BackupFilter | None = None,
    progress: Callable[[Audit], None] | None = None,
) -> Audit:
    """Run the filter from states at the edge of what it accepts, with random settings.

    Args:
        count: Number of random settings.
        rows: Number of lines of states, of each of three kinds, on which a setting's initial states are searched.
        steps: Steps of each rollout.
        seed: Seed of all random numbers.
        first: A filter that is tested before the others. If it has bounds of disturbances, the others have the same
            bounds, and all rollouts are disturbed as much as these allow; see `DisturbanceAdversary`.
        progress: Called after each setting.
    """
    result = Audit()
    for number, safety_filter in enumerate(_filters(count, seed, first, result)):
        rng = np.random.default_rng([seed, number])
        fly_filtered(safety_filter, grazing_states(safety_filter, rng, rows), steps, rng, result)
        result.settings += 1
        if progress is not None:
            progress(result)
    return result


def _filters(count: int, seed: int, first: BackupFilter | None, result: Audit) -> Iterator[BackupFilter]:
    if first is not None:
        yield first
    bounds = None if first is None or first.tracker is None else first.tracker.bounds
    for values, names in settings(seed):
        if not count:
            return
        try:
            found = BackupFilter(values, names, disturbance=bounds)
        except ValueError:  # No position is safe, or the thrusters are too weak.
            result.refused += 1
            continue
        count -= 1
        yield found


def fly_filtered(run: BackupFilter, state: RelativeState, steps: int, rng: np.random.Generator, result: Audit) -> None:
    """Run the filter under kinds of desired thrust: none, small, the largest, and towards the chief.

    Disturbed rollouts have a fifth kind: the largest thrust in the direction of the disturbances.

    Args:
        run: The filter.
        state: The initial states.
        steps: Steps of each rollout.
        rng: Generator of the thrusts and disturbances.
        result: Counts, to which these rollouts are added.
    """
    if not len(state):
        return
    watch = _OracleWatch(run)
    adversary = None if run.tracker is None else DisturbanceAdversary(run.tracker.bounds, len(state), rng)
    kind = rng.integers(0, 4 if adversary is None else 5, len(state))[:, None]
    result.starts += len(state)
    memory = run.memory(len(state))
    for _ in range(steps):
        noise = rng.normal(size=state.position.shape)
        inward = -state.position / np.linalg.norm(state.position, axis=1, keepdims=True)
        seen = state if adversary is None else adversary.estimate(state, watch.look(state, result))
        pushed = noise if adversary is None else 1.8 * adversary.direction
        desired = run.parameters.u_max * np.select(
            [kind == 1, kind == 2, kind == 3, kind == 4], [0.05 * noise, noise, inward, pushed], 0.0
        )
        flown, memory = run.track(seen, desired, memory)
        result.steps += len(state)
        result.infeasible += int(flown.infeasible.sum())
        result.interventions += int(flown.intervening.sum())
        state = watch.advance(state, flown.control if adversary is None else adversary.flown(flown.control), result)
        if adversary is not None:
            state = adversary.disturbed(state)


class _OracleWatch:
    """Propagation of states and evaluation of the constraints, without any code of the filter."""

    def __init__(self, run: BackupFilter) -> None:
        p, n = run.parameters, run.parameters.n
        self._p, self._kept = p, cast("dict[str, Any]", run.constraints)
        drift = np.zeros((9, 9))  # Of position, velocity and a constant thrust.
        drift[:3, 3:6] = np.eye(3)
        drift[3, 0], drift[3, 4], drift[4, 3], drift[5, 2] = 3.0 * n * n, 2.0 * n, -2.0 * n, -n * n
        horizon = self._kept["PSM"].horizon if "PSM" in self._kept else p.psm_horizon
        coasting = np.arange(0.0, horizon + _COAST, _COAST).clip(max=horizon)
        self._coast = np.stack([expm(drift[:6, :6] * t)[:3] for t in coasting])
        drift[3:6, 6:] = np.eye(3) / p.m
        self._parts = [expm(drift * p.step_size * part / _PARTS)[:6] for part in range(1, _PARTS + 1)]

    def look(self, state: RelativeState, result: Audit) -> dict[str, FloatArray]:
        """Count the violations in states; return their safety quantities phi, except for passive safety."""
        return self._counted(self._quantities(state.position, state.velocity, state.sun_angle, False), result)

    @staticmethod
    def _counted(found: dict[str, FloatArray], result: Audit) -> dict[str, FloatArray]:
        for name, phi in found.items():
            result.least[name] = min(result.least[name], float(phi.min()))
            result.violations += int((phi < 0.0).sum())
        return found

    def advance(self, state: RelativeState, control: FloatArray, result: Audit) -> RelativeState:
        """Return the states after a hold; violations within it are counted."""
        before = np.concatenate((state.position, state.velocity, control), axis=1)
        for part, matrix in enumerate(self._parts, 1):
            x = before @ matrix.T
            sun = state.sun_angle + self._p.n * self._p.step_size * part / _PARTS
            coast = part == _PARTS  # The least range over the horizon is evaluated once for each hold.
            self._counted(self._quantities(x[:, :3], x[:, 3:], sun, coast), result)
        return RelativeState(x[:, :3], x[:, 3:], sun)

    def _quantities(self, p: FloatArray, v: FloatArray, sun: FloatArray, coast: bool) -> dict[str, FloatArray]:
        kept, distance = self._kept, np.linalg.norm(p, axis=1)
        away = np.stack((-np.cos(sun), np.sin(sun), np.zeros_like(sun)), axis=1)
        cosine = np.clip((p * away).sum(axis=1) / distance, -1.0, 1.0)
        speed = np.linalg.norm(v, axis=1)
        found: dict[str, Callable[[Any], FloatArray]] = {
            "chief_collision": lambda q: distance - q.collision_radius,
            "rel_vel": lambda q: q.v0 + q.v1 * (distance - q.v0_distance) - speed,
            "sun": lambda q: np.arccos(cosine) - 0.5 * q.fov,
            "r_max": lambda q: q.r_max - distance,
            "x_vel": lambda q: q.vel_limit - np.abs(v[:, 0]),
            "y_vel": lambda q: q.vel_limit - np.abs(v[:, 1]),
            "z_vel": lambda q: q.vel_limit - np.abs(v[:, 2]),
        }
        if coast and "PSM" in kept:
            paths = np.einsum("tij,rj->rti", self._coast, np.concatenate((p, v), axis=1))
            found["PSM"] = lambda q: np.linalg.norm(paths, axis=2).min(axis=1) - q.collision_radius
        return {name: phi(kept[name]) for name, phi in found.items() if name in kept}


def grazing_states(run: BackupFilter, rng: np.random.Generator, rows: int) -> RelativeState:
    """Return states at the edge of what the filter accepts, by bisection along lines of states.

    The lines are closed motions that pass the chief at decreasing distances, closed motions with different sun angles,
    both at a random phase, and states with increasing velocity.
    """
    n, top = run.parameters.n, (run.limit("v0", "rel_vel") if "rel_vel" in run.names else 2.0)
    near, far = run.limit("collision_radius", "chief_collision", "PSM"), run.limit("r_max", "r_max")
    fastest = run.limit("vel_limit", "x_vel", "y_vel", "z_vel")
    out, along = (normalised_rows(rng.normal(size=(rows, 3))) for _ in range(2))
    fast = normalised_rows(np.cross(out, [0.0, 1.0, 0.0])) * top * rng.uniform(0.3, 1.0, (rows, 1))
    phase, sun = rng.uniform(0.0, 2.0 * np.pi, (2, rows))
    passing = near * rng.uniform(1.01, 3.0, rows)
    radius = rng.uniform(near, far, rows)

    def closed(distance: FloatArray, angle: FloatArray, i: IntArray) -> RelativeState:
        """Return closed motions that were at the given distance from the chief one phase earlier."""
        x, y, z = (out[i] * distance[:, None]).T
        u, w = fast[i, 0] / n, fast[i, 2] / n
        c, s = np.cos(phase[i]), np.sin(phase[i])
        position = np.stack((c * x + s * u, y - 2.0 * (1.0 - c) * u - 2.0 * s * x, c * z + s * w), axis=1)
        velocity = n * np.stack((c * u - s * x, -2.0 * position[:, 0], c * w - s * z), axis=1)
        return RelativeState(position, velocity, angle + phase[i])

    lines: list[tuple[Callable[[FloatArray, IntArray], RelativeState], float, float]] = [
        (lambda g, i: closed(g, sun[i], i), 0.9 * near, 3.0 * near),
        (lambda g, i: closed(passing[i], sun[i] + g, i), 0.0, 2.0 * np.pi),
        (lambda g, i: RelativeState(out[i] * radius[i, None], along[i] * g[:, None], sun[i]), 0.0, 2.0 * fastest),
    ]
    found = [_edges(run, line, np.linspace(low, high, _GRID), rows) for line, low, high in lines]
    return RelativeState.joined(found)


def _edges(
    run: BackupFilter, line: Callable[[FloatArray, IntArray], RelativeState], grid: FloatArray, rows: int
) -> RelativeState:  # fmt: skip
    """Return the accepted states next to rejected ones along lines of states."""
    every = np.arange(rows)
    accepted = np.stack([run.recoverable(line(np.full(rows, g), every)) for g in grid])
    k, i = np.nonzero(accepted[1:] != accepted[:-1])
    later = accepted[k + 1, i]
    good, bad = np.where(later, grid[k + 1], grid[k]), np.where(later, grid[k], grid[k + 1])
    for _ in range(_BISECTIONS):
        middle = 0.5 * (good + bad)
        fits = run.recoverable(line(middle, i))
        good, bad = np.where(fits, middle, good), np.where(fits, bad, middle)
    return line(good, i)
