"""Bounds on the distance of a deputy from the plan that it tracks, under a bounded disturbance.

The deputy holds a thrust u, then its plan's thrust v, and then coasts on the plan's closed motion; from the start of
the plan on, it adds K (estimate - plan) to the plan's thrust. Its deviation d from the plan follows

    d' = (Phi + Gamma K) d + Gamma (K e + t) + w,

with the estimation error e, the error t of the thrust, |t| <= share |thrust|, and the velocity w, which can be added at
any moment of the hold. The deviation is therefore a sum over the past, whose terms are bounded one by one by spectral
norms. The result is a bound for every disturbance, as multiples of 1, |u| and |v|.

Source:
    Chisci, Rossiter and Zappa, "Systems with persistent disturbances: predictive control with restricted constraints",
    Automatica 2001; Mayne, Seron and Rakovic, "Robust model predictive control of constrained linear systems with
    bounded disturbances", Automatica 2005.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.dynamics.cwh import transition
from safe_inspect.dynamics.regulator import regulator
from safe_inspect.rta.backup.model import (
    CLOSED,
    CROSS,
    FINE_NODES,
    FIRST_CLOSED,
    FIRST_PLAN,
    HOLD,
    NO_TUBE,
    PLAN,
    RADIAL,
    FilterModel,
)
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.types import FloatArray

#: Weights of the regulator, of squared errors of position and velocity in units of the effect of 1 N during a hold.
#: Thrusts that follow the errors of the estimate increase the speed, slow corrections increase the distance: these
#: weights keep both margins small.
_POSITION_WEIGHT, _VELOCITY_WEIGHT = 1.0, 64.0
#: Number of moments of a hold at which deviations are computed; 1 % more than the largest bounds those between them.
_MOMENTS = 9
_MORE = 1.01
#: Number of holds after which the deviation must have settled, and the fraction of it that may remain.
_HOLDS = 400
_SETTLED = 1e-6


class _Deviations(NamedTuple):
    """Bounds on a deviation over a hold, each as multiples of (1, |u|, |v|), shape (3,).

    Attributes:
        length: Distance [m].
        speed: Size of the deviation of the velocity [m/s].
        thrust: Component that tracking adds to the thrust [N].
    """

    length: FloatArray
    speed: FloatArray
    thrust: FloatArray


class PlanTracker:
    """Controller that tracks plans under a bounded disturbance.

    Attributes:
        bounds: Bounds of the disturbances.
        gain: K, from the deviation of position and velocity to thrust [N/m, N s/m], shape (3, 6).
    """

    def __init__(self, parameters: ConstraintParameters, bounds: DisturbanceBounds) -> None:
        """Compute the gain and the response to each disturbance."""
        p = parameters
        n, mass, dt = float(p.n), float(p.m), float(p.step_size)
        weights = [_POSITION_WEIGHT * (mass / dt**2) ** 2] * 3 + [_VELOCITY_WEIGHT * (mass / dt) ** 2] * 3
        self.gain = -regulator(*transition(n, mass, dt), np.diag(weights), np.eye(3))
        self.bounds, self._share = bounds, bounds.thrust_error
        maps = [transition(n, mass, t) for t in np.linspace(0.0, dt, _MOMENTS)]
        free, input_ = np.stack([m[0] for m in maps]), np.stack([m[1] for m in maps])
        steered = input_ @ self.gain
        error, velocity = (bounds.position_error, bounds.velocity_error), bounds.velocity
        #: For each disturbance: its bound, or None for the error of the thrust; its effect in its hold and at the end.
        self._sources = {
            "first position": (error[0], free[..., :3], free[-1:, :, :3]),
            "first velocity": (error[1], free[..., 3:], free[-1:, :, 3:]),
            "position": (error[0], steered[..., :3], steered[-1:, :, :3]),
            "velocity": (error[1], steered[..., 3:], steered[-1:, :, 3:]),
            "disturbance": (velocity, free[..., 3:], free[..., 3:]),
            "thrust": (1.0, input_, input_[-1:]),
        }
        self._responses = self._respond(free + steered)

    def _respond(self, steered: FloatArray) -> dict[str, FloatArray]:
        """Return the effect of each disturbance in its hold and in those after it, shape (1 + holds, 4).

        Columns: distance, speed, size of the tracking thrust, largest component of the thrust.
        """
        responses = {}
        for name, (bound, now, end) in self._sources.items():
            rows = [[*_sizes(now), 0.0, 0.0]]
            power = end
            for _ in range(_HOLDS if bound > 0.0 else 1):
                thrust = self.gain @ power
                along = steered[:, None] @ power
                axes = np.sqrt(np.square(thrust).sum(axis=-1)).max()
                rows.append([*_sizes(along), _largest(thrust), axes])
                if rows[-1][1] < _SETTLED * rows[0][1] and rows[-1][0] < _SETTLED * max(rows[0][0], rows[1][0]):
                    break
                power = steered[-1] @ power
            response = np.zeros((_HOLDS + 1, 4))
            response[: len(rows)] = rows
            responses[name] = bound * response
        return responses

    def follow(self, planned: tuple[int, ...]) -> list[_Deviations]:
        """Return the deviations in each hold.

        Args:
            planned: For each hold from the first, the index in (1, |u|, |v|) of its planned thrust; later holds have
                none. In the first, the deputy applies what was planned for its estimate, so only its error matters.
        """
        response, found = self._responses, []
        efforts = np.zeros((_HOLDS, 3))
        whole = {name: np.cumsum(response[name], axis=0) for name in ("position", "velocity", "disturbance")}
        measured = _largest(self.gain[:, :3][None]), _largest(self.gain[:, 3:][None])
        axes = [np.sqrt(np.square(self.gain[:, part]).sum(axis=-1)).max() for part in (slice(3), slice(3, 6))]
        errors = [self._sources[name][0] for name in ("position", "velocity")]
        for hold in range(_HOLDS):
            total = np.zeros((4, 3))
            total[:, 0] = (
                response["first position"][hold] + response["first velocity"][hold] + whole["disturbance"][hold]
            )
            if hold > 0:
                for name in ("position", "velocity"):
                    total[:, 0] += whole[name][hold - 1]
                total[2, 0] += measured[0] * errors[0] + measured[1] * errors[1]
                total[3, 0] += axes[0] * errors[0] + axes[1] * errors[1]
            total += response["thrust"][hold:0:-1].T @ efforts[:hold]
            efforts[hold] = self._share * total[2]
            if hold < len(planned):
                efforts[hold, planned[hold]] += self._share
            total += np.outer(response["thrust"][0], efforts[hold])
            found.append(_Deviations(_MORE * total[0], _MORE * total[1], _MORE * total[3]))
        return found

    @property
    def settles(self) -> bool:
        """Whether deviations remain bounded: disturbances vanish after the last hold, and errors do not amplify."""
        left = max(float(response[-1].max() / max(response[0].max(), 1e-300)) for response in self._responses.values())
        feedback = self._share * self._responses["thrust"][:, 2].sum()
        return left < 1e-3 and feedback < 1.0


def _largest(blocks: FloatArray) -> float:
    """Return the largest spectral norm of a stack of matrices."""
    return float(np.linalg.norm(blocks, ord=2, axis=(-2, -1)).max())


def _sizes(blocks: FloatArray) -> tuple[float, float]:
    """Return the largest spectral norms of the position rows and of the velocity rows."""
    return _largest(blocks[..., :3, :]), _largest(blocks[..., 3:, :])


_ONE, _EFFORT, _THRUST = range(3)


def tube_of(model: FilterModel, tracker: PlanTracker, constraints: Mapping[str, Any]) -> FloatArray:
    """Compute the margins of the parts of a motion; see `FilterModel.tube`.

    Args:
        model: The task without a tube.
        tracker: Controller that tracks the plans.
        constraints: The constraints, by name.
    """
    after, first = tracker.follow((_EFFORT, _THRUST)), tracker.follow((_THRUST,))
    parts = {HOLD: after[:1], PLAN: after[1:2], CLOSED: after[1:], FIRST_PLAN: first[:1], FIRST_CLOSED: first}
    table = np.zeros_like(NO_TUBE)
    for part, holds in parts.items():
        table[part] = _margins(model, constraints, *(np.max(found, axis=0) for found in zip(*holds, strict=True)))
    return table


def _margins(
    model: FilterModel, constraints: Mapping[str, Any], length: FloatArray, speed: FloatArray, thrust: FloatArray
) -> FloatArray:  # fmt: skip
    """Return the margins that a deviation requires, shape (4, 3)."""
    coasting = model.stretch[0] * length + model.stretch[1] * speed if "PSM" in constraints else length
    # The speed limit near the chief decreases with the range.
    falls = constraints["rel_vel"].v1 * length if "rel_vel" in constraints else 0.0
    return np.stack((length, speed + falls, coasting, thrust))


def starting_tube(
    model: FilterModel, tracker: PlanTracker, tube: FloatArray, constraints: Mapping[str, Any]
) -> FloatArray:  # fmt: skip
    """Compute the tube for real initial states: with a plan in it, every estimate of a state has that plan too.

    The margins that are added bound the differences between the plans of the same index from two states that differ by
    the estimation error: in their thrust, their hold, and the closed motion after it.
    """
    phi, gamma, n = model.hold_phi[-1], model.hold_gamma[-1], model.n
    errors = tracker.bounds.position_error, tracker.bounds.velocity_error
    size = np.linalg.norm
    away = size(phi[:3, :3], 2) * errors[0] + size(phi[:3, 3:], 2) * errors[1]
    faster = size(phi[3:, :3], 2) * errors[0] + size(phi[3:, 3:], 2) * errors[1]
    radial = max(faster, n * away * (0.5 + max(map(abs, RADIAL))))
    cross = max(faster, n * away * max(map(abs, CROSS)))
    thrust = size(model.plan, 2) * size([radial + faster, 2.0 * n * away + faster, cross + faster])
    length, speed = away + size(gamma[:3], 2) * thrust, faster + size(gamma[3:], 2) * thrust
    after = size([radial, 2.0 * n * length, cross])
    turns = np.arange(FINE_NODES) * (2.0 * np.pi / (n * FINE_NODES))
    motion = np.stack([transition(n, 1.0, turn)[0] for turn in turns])
    motion[..., 0] -= 2.0 * n * motion[..., 4]  # Without drift.
    orbit = [
        1.01
        * (max(size(m[rows, :3], 2) for m in motion) * length + max(size(m[rows, 3::2], 2) for m in motion) * after)
        for rows in (slice(3), slice(3, 6))
    ]
    found = tube.copy()
    for part, deviation in ((FIRST_PLAN, (length, speed)), (FIRST_CLOSED, orbit)):
        wider = _Deviations(*(np.array([value, 0.0, 0.0]) for value in (*deviation, thrust)))
        found[part] += _margins(model, constraints, *wider) + tube[part, :, 2:] * np.array([thrust, 0.0, 0.0])
    return found


def leaves_nothing(tube: FloatArray, p: ConstraintParameters, constraints: Mapping[str, Any]) -> str | None:
    """Describe what a tube uses up entirely, even if no thrust is planned; None if there is no such quantity."""
    length, speed, coasting, _ = tube[CLOSED, :, _ONE]
    largest = np.sqrt(3.0) * p.u_max
    thrust = max(float(tube[part, 3] @ (1.0, largest, largest)) for part in (PLAN, CLOSED))
    near = max(length, coasting)
    far = constraints["r_max"].r_max if "r_max" in constraints else p.r_max
    if {"r_max", "chief_collision"} <= constraints.keys():
        gap = far - constraints["chief_collision"].collision_radius
        if near + length >= gap:
            return f"of the {gap:g} m between the `collision_radius` and `r_max`: {near + length:.3g} m are taken"
    if "rel_vel" in constraints:
        line = constraints["rel_vel"]
        limit = line.v0 + line.v1 * (far - line.v0_distance)
        if speed >= limit:
            return f"of the speed of {limit:.3g} m/s that `rel_vel` allows, from which {speed:.3g} m/s are taken"
    for name in ("x_vel", "y_vel", "z_vel"):
        if name in constraints and speed >= constraints[name].vel_limit:
            limit = constraints[name].vel_limit
            return f"of the `vel_limit` {limit:g} m/s of {name}, from which {speed:.3g} m/s are taken"
    if thrust >= p.u_max:
        return f"of the thrust `u_max` {p.u_max:g} N for plans, because tracking them takes all of it"
    return None
