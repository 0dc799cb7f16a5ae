"""Flights whose every number is on record: shipped experiments with random actions, resets and safety filters."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import TeamEnvironment

STEPS, NUM_ENVS, SEED = 500, 6, 20261122
#: Steps after which sums of the numbers are kept, for processors whose arithmetic differs in the last bit.
SAMPLED = (0, 5, 25)

_OWN = "RTAGlueCWHInspection1v1.config"
_GLUE = "agent_config.blue0_ctrl.config.config.glues.0.config"
_LIVELY = ("horizon=60", "steps_until_update=40")
#: Each flight: the experiment and its overrides.
FLIGHTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "one": ("translational-inspection/experiment.yml", ()),
    "one, backup filter": ("translational-inspection/experiment.yml", (f"{_OWN}.enabled=True",)),
    "one, continuous filter": (
        "translational-inspection/experiment-seed.yml",
        (f"{_OWN}.enabled=True", f"{_GLUE}.method=continuous"),
    ),
    "one, switching filter": (
        "translational-inspection/experiment-seed.yml",
        (f"{_OWN}.enabled=True", f"{_GLUE}.method=simplex", f"{_GLUE}.delta_v_limit=2.0"),
    ),
    "one, continuous thrust": ("translational-inspection/experiment-seed.yml", ()),
    "three, filter of the team": ("multiagent-translational-inspection/experiment.yml", ()),
    "three": ("multiagent-translational-inspection/experiment.yml", ("rta.config.enabled=False",)),
    "three, continuous thrust": ("multiagent-translational-inspection/experiment-seed.yml", ()),
    "three, a filter each": ("multiagent-translational-inspection/experiment-seed.yml", (f"{_OWN}.enabled=True",)),
    "three, seeing each other": ("multiagent-translational-inspection/experiment-see-others.yml", ()),
    "mixed with scripted policies": ("multiagent-translational-inspection/experiment-mixed.yml", ()),
}


def fly(flight: str, *, compiled: bool) -> tuple[dict[str, str], dict[str, list[float]]]:
    """Return the SHA-256 of every quantity over a flight, and sums of it after some steps.

    Args:
        flight: Name of the flight.
        compiled: Whether one compiled call computes the terms of a step, rather than every plugin by itself.
    """
    file, overrides = FLIGHTS[flight]
    spec = load_experiment(configs_root() / file, (*_LIVELY, *overrides)).spec
    env = TeamEnvironment(spec, NUM_ENVS, seed=SEED, _fused=compiled)
    hashes: dict[str, Any] = {}
    sums: dict[str, list[float]] = {}

    def note(quantities: Iterable[tuple[str, np.ndarray]], step: int) -> None:
        for name, array in quantities:
            array = np.ascontiguousarray(array)
            hashes.setdefault(name, hashlib.sha256()).update(repr((array.dtype.str, array.shape)).encode())
            hashes[name].update(array.tobytes())
            if step in SAMPLED:
                finite = array[np.isfinite(array)].astype(np.float64).ravel()
                sums.setdefault(name, []).append(math.fsum(finite * np.cos(np.arange(len(finite)))))

    note((("observation", observation) for observation in env.reset()), 0)
    generator = np.random.default_rng(SEED)
    for step in range(STEPS):
        actions = []
        for group in env.acting:
            shape = (NUM_ENVS, group.size, group.action_layout.size)
            low, high = group.action_layout.low, group.action_layout.high
            random = low + generator.random(shape) * (high - low)
            actions.append(np.rint(random) if group.action_layout.choices else random)
        found = env.step(actions)
        note(_of_step(env, found), step)
        over = np.flatnonzero(found.over)
        if len(over):
            note((("observation", observation) for observation in env.reset(over)), step)
            note((("reset", env.state.position), ("reset", env.state.velocity)), step)
    return {name: total.hexdigest()[:16] for name, total in sorted(hashes.items())}, dict(sorted(sums.items()))


def _of_step(env: TeamEnvironment, found: Any) -> Iterable[tuple[str, np.ndarray]]:
    """Yield all that a step gives."""
    state = env.state
    for name in ("time", "step", "key", "position", "velocity", "control", "delta_v", "interventions", "finished",
                 "sun_angle", "sun_direction", "delta_v_scale"):  # fmt: skip
        yield f"state/{name}", getattr(state, name)
    for body, points in state.points.items():
        for name in ("inspector", "team_count", "own_count", "weights"):
            yield f"points/{body}/{name}", getattr(points, name)
    for (_, part, array), values in state.memory.items():
        yield f"memory/{part}/{array}", values
    yield "outcome", found.outcome
    for group in found.groups:
        for name in ("observation", "reward", "active", "terminated", "truncated", "status"):
            yield name, getattr(group, name)
        for name, term in group.terms.items():
            yield f"reward/{name}", term
        step = group.step
        yield "desired_control", step.desired_control
        yield "intervening", step.intervening
        if step.filtered is not None:
            for name in ("control", "infeasible", "backup", "active", "phi"):
                yield f"filter/{name}", getattr(step.filtered, name)
    if found.filtered is not None:
        for name in ("control", "intervening", "infeasible", "backup"):
            yield f"filter of the team/{name}", getattr(found.filtered, name)


def arithmetic() -> str:
    """Return a fingerprint of the processor's elementary functions: NumPy chooses them by its features."""
    x = np.linspace(-3.0, 3.0, 4001)
    parts = (np.sin(x), np.cos(x), np.exp(x), np.arccos(x / 3.0), np.sqrt(x + 3.0), np.arctan2(x, 1.0), np.mod(x, 0.7))
    scalars = np.array([[math.sin(v), math.cos(v), math.acos(v / 3.0), math.hypot(v, 1.0)] for v in x.tolist()])
    return hashlib.sha256(b"".join(part.tobytes() for part in (*parts, scalars))).hexdigest()[:16]
