"""The contract of a safety constraint."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.rta.constraints.base import Constraint, RelativeState
from safe_inspect.rta.filters import compiled, probe_states, responds_to_thrust
from safe_inspect.testing.calls import Call, SampleParts, Shape, check_call
from safe_inspect.testing.report import Report
from safe_inspect.testing.samples import sample_states
from safe_inspect.types import BoolArray, FloatArray

#: Steps of the difference quotients, as a fraction of range and speed.
_STEP = 1e-5
#: Tolerance of the gradient as a fraction of the difference quotient. Where the quotients to both sides differ by the
#: second fraction, h has a kink and the state is not compared.
_TOLERANCE, _KINK = 1e-3, 1e-2
#: Pairs of states on both sides of the boundary, steps of the search for unsafe states, and halvings of the distance.
_PAIRS, _SEARCHES, _HALVINGS = 64, 60, 30
#: Largest fraction of the states at which h may have a kink along one axis.
_KINKS = 0.5


def check_constraint(plugin: Constraint, parts: SampleParts, report: Report) -> None:
    """Check a constraint: phi, h and rate (R,); gradient (R, 6), the derivative of h, which must depend on thrust."""
    sample = RelativeState(**sample_states())
    shapes = {"gradient": Shape((6,), "f", "(R, 6)")}
    phi = check_call(Call("the constraint", plugin, {"the state": sample}), report)
    every = check_call(
        Call("`evaluate`", lambda state: vars(plugin.evaluate(state)), {"the state": sample}, shapes=shapes), report
    )
    if phi is not None and every is not None:
        report.expect(
            np.array_equal(phi, every["phi"]),
            "phi",
            "the call returns another phi than `evaluate`",
            "let both give the same",
        )
    if every is not None:
        for state in (sample, probe_states()):
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
    """Compile the half-space; compare phi with those of sampled states, at these states and at those within them."""
    state = _with_boundary(plugin, probe_states())
    points, phi = np.concatenate((state.position, state.velocity), axis=1), plugin.phi(state)
    kernel: Any = type(plugin).half_space
    compiled("backup.half_spaces").kernel(kernel)
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


def _with_boundary(plugin: Constraint, state: RelativeState) -> RelativeState:
    """Return states together with pairs of an unsafe and a safe one that are close to each other.

    Unsafe states are also searched for, from the states with the least phi, because a small unsafe region may contain
    none of the samples.
    """
    rng, phi = np.random.default_rng(17), plugin.phi(state)
    unsafe = state[np.argsort(phi)[:_PAIRS]]
    for size in np.geomspace(0.5, 5e-4, _SEARCHES):
        position, velocity = (
            array + size * np.linalg.norm(array, axis=1, keepdims=True) * rng.normal(size=array.shape)
            for array in (unsafe.position, unsafe.velocity)
        )
        tried = RelativeState(position, velocity, unsafe.sun_angle)
        unsafe = _chosen(plugin.phi(tried) < plugin.phi(unsafe), tried, unsafe)
    safe, unsafe = state[phi > 0.0], unsafe[plugin.phi(unsafe) < 0.0]
    if not (len(safe) and len(unsafe)):
        return state
    safe = safe[rng.integers(len(safe), size=len(unsafe))]
    for _ in range(_HALVINGS):
        middle = RelativeState(
            0.5 * (safe.position + unsafe.position), 0.5 * (safe.velocity + unsafe.velocity), safe.sun_angle
        )
        within = plugin.phi(middle) >= 0.0
        safe, unsafe = _chosen(within, middle, safe), _chosen(within, unsafe, middle)
    return RelativeState.joined((state, safe, unsafe))


def _chosen(first: BoolArray, one: RelativeState, other: RelativeState) -> RelativeState:
    """Return the rows of one where a mask, shape (R,), is true, and of another elsewhere."""
    pairs = zip(vars(one).values(), vars(other).values(), strict=True)
    return RelativeState(*(np.where(first.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs))


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
