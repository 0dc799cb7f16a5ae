"""The contract of a safety constraint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from safe_inspect.platforms.base import Part
from safe_inspect.rta.constraints.base import Constraint, RelativeState
from safe_inspect.rta.filters.probes import probe_states, responds_to_thrust
from safe_inspect.testing.calls import Call, Inputs, Shape, check_call
from safe_inspect.testing.report import Report
from safe_inspect.testing.samples import sample_steps
from safe_inspect.testing.values import ROWS
from safe_inspect.types import AnyArray, BoolArray, FloatArray

#: Steps of the difference quotients, as a fraction of range and speed.
_STEP = 1e-5
#: Tolerance of the gradient as a fraction of the difference quotient. Where the quotients to both sides differ by the
#: second fraction, h has a kink and the state is not compared.
_TOLERANCE, _KINK = 1e-3, 1e-2
#: Largest fraction of the states at which h may have a kink along one axis.
_KINKS = 0.5


def check_constraint(plugin: Constraint, parts: Sequence[Part], report: Report) -> None:
    """Check a constraint: phi, h and rate (R,); gradient (R, 6), the derivative of h, which must depend on thrust."""
    view = sample_steps(None, ROWS).after

    def make(rows: AnyArray) -> Inputs:
        state = RelativeState(view.position[rows].copy(), view.velocity[rows].copy(), view.sun_angle[rows].copy())
        return Inputs((state,), {name: getattr(state, name) for name in ("position", "velocity", "sun_angle")})

    def evaluate(state: RelativeState) -> dict[str, AnyArray]:
        return dict(vars(plugin.evaluate(state)))

    shapes = {"gradient": Shape((6,), "f", "(R, 6)")}
    phi = check_call(Call("the constraint", plugin, make, ROWS), report)
    every = check_call(Call("`evaluate`", evaluate, make, ROWS, shapes=shapes), report)
    if phi is not None and every is not None:
        report.expect(
            np.array_equal(phi, every["phi"]),
            "phi",
            "the call returns another phi than `evaluate`",
            "let both give the same",
        )
    if every is not None:
        for state in (*make(np.arange(ROWS)).arguments, probe_states()):
            with report.attempt("`evaluate`", "it must work for every finite state"):
                _check_gradient(plugin, state, report)
        if plugin.half_space is not None:
            with report.attempt("`half_space`", "it must work for every finite state"):
                _check_half_space(plugin, report)
        report.expect(
            responds_to_thrust(plugin),
            "thrust",
            "the velocity part of the gradient of h is 0 everywhere, so no filter can act upon the constraint",
            "let h depend on the velocity too, for instance on the distance in which the deputy can brake",
        )


def _check_half_space(plugin: Constraint, report: Report) -> None:
    """Compare phi with the half-spaces of sampled states, at these states and at those within the half-spaces."""
    state = probe_states()
    points, phi = np.concatenate((state.position, state.velocity), axis=1), plugin.phi(state)
    kernel: Any = type(plugin).half_space
    numbers = np.array([*plugin.half_space_parameters(), 0.0])
    directions, needs = np.zeros_like(points), np.empty(len(points))
    for row, x in enumerate(points):
        needs[row] = kernel(numbers, x.copy(), directions[row])
    wrong = ~(np.isfinite(directions).all(axis=1) & np.isfinite(needs) & directions.any(axis=1))
    text = "the direction or the need is not finite, or the direction is 0"
    if not wrong.any():
        rounding = 1e-9 * (np.abs(directions) @ np.abs(points).T + np.abs(needs)[:, None])
        beyond = directions @ points.T - needs[:, None]
        unsafe = phi < -1e-9 * (1.0 + np.abs(phi))
        wrong, text = (beyond > rounding) @ unsafe, "a state with phi < 0 lies within it"
        own, clear = np.diag(beyond), np.diag(rounding)
        if not wrong.any():
            wrong, text = (own < -clear) & (phi > 0.0), "a state with phi > 0 is not within its own half-space"
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        report.add(
            "half_space",
            f"{text}, in {int(wrong.sum())} of {len(state)} states: at position {_shown(state.position[row])} m and "
            f"velocity {_shown(state.velocity[row])} m/s d is {_shown(directions[row])} and the need {needs[row]:.4g}",
            "write a direction d and return a need so that every state y with d.y >= need is safe, and x itself is "
            "safe exactly where d.x >= need",
        )


def _check_gradient(plugin: Constraint, state: RelativeState, report: Report) -> None:
    """Compare the gradient with the central difference quotients of h, at states where h has no kink."""
    gradient, quotient, doubt, smooth = _quotients(plugin, state)
    kinks = int((~smooth).sum(axis=0).max())
    if not report.expect(
        kinks <= _KINKS * len(state),
        "gradient",
        f"h has no derivative in {kinks} of {len(state)} states: its difference quotients to both sides differ",
        "let h be a smooth function of position and velocity",
    ):
        return
    wrong = smooth & (np.abs(gradient - quotient) > _TOLERANCE * _scale(gradient, quotient) + doubt)
    if wrong.any():
        row = int(np.flatnonzero(wrong.any(axis=1))[0])
        report.add(
            "gradient",
            f"the gradient is not the derivative of h in {int(wrong.any(axis=1).sum())} of {len(state)} states: at "
            f"position {_shown(state.position[row])} m and velocity {_shown(state.velocity[row])} m/s it is "
            f"{_shown(gradient[row])}, and the difference quotients of h are {_shown(quotient[row])}",
            "return the derivative of h with respect to (position, velocity)",
        )


def _quotients(plugin: Constraint, state: RelativeState) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Return the gradient, the central difference quotients, their possible errors, and where h has no kink."""
    here = plugin.evaluate(state)
    gradient = here.gradient
    sizes = (np.sqrt((array**2).sum(axis=1)) for array in (state.position, state.velocity))
    steps = np.stack([_STEP * size for size in sizes], axis=1).repeat(3, axis=1)
    before, after = np.empty_like(gradient), np.empty_like(gradient)
    for column in range(6):
        step = np.zeros_like(gradient)
        step[:, column] = steps[:, column]
        ahead, behind = (
            plugin.h(RelativeState(state.position + move[:, :3], state.velocity + move[:, 3:], state.sun_angle))
            for move in (step, -step)
        )
        after[:, column], before[:, column] = ahead - here.h, here.h - behind
    after, before = after / steps, before / steps
    quotient, apart = (after + before) / 2.0, np.abs(after - before)
    rounding = 64.0 * np.finfo(np.float64).eps * (1.0 + np.abs(here.h)[:, None]) / steps
    return gradient, quotient, apart + rounding, apart <= _KINK * _scale(gradient, quotient) + rounding


def _scale(gradient: FloatArray, quotient: FloatArray) -> FloatArray:
    """Return the larger of the two lengths in the position part and in the velocity part, shape (R, 6)."""
    lengths = [np.sqrt((array.reshape(-1, 2, 3) ** 2).sum(axis=2)) for array in (gradient, quotient)]
    return np.asarray(np.maximum(*lengths).repeat(3, axis=1))


def _shown(values: FloatArray) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in values) + ")"
