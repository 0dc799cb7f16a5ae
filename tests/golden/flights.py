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
from safe_inspect.rta.adversaries import adversarial_thrust
from safe_inspect.simulators.view import View

STEPS, NUM_ENVS, SEED = 500, 6, 20261122
#: Steps after which sums of the numbers are kept, for processors whose arithmetic differs in the last bit.
SAMPLED = (0, 5, 25)

_OWN = "RTAGlueCWHInspection1v1.config"
_GLUE = "agent_config.blue0_ctrl.config.config.glues.0.config"
_SIMULATOR = "config.config.env_config.simulator"
_SUN = "steps_until_update=40"
_BOUNDS = "{velocity: 1.0e-4, position_error: 0.05, velocity_error: 5.0e-4, thrust_gain: 0.02}"
_DOCKING_BOUNDS = "{velocity: 1.0e-5, position_error: 0.01, velocity_error: 1.0e-4, thrust_gain: 0.01}"


def _disturbed(bounds: str) -> str:
    return f"{{functor: BoundedDisturbance, config: {bounds}}}"


#: Each flight: the experiment and its overrides; a horizon of 60 steps makes resets part of each.
FLIGHTS: dict[str, tuple[str, tuple[str, ...]]] = {
    "one": ("translational-inspection/experiment.yml", (_SUN,)),
    "one, backup filter": (
        "translational-inspection/experiment.yml",
        (
            _SUN,
            f"{_OWN}.enabled=True",
        ),
    ),
    "one, continuous filter": (
        "translational-inspection/experiment-seed.yml",
        (_SUN, f"{_OWN}.enabled=True", f"{_GLUE}.method=continuous"),
    ),
    "one, disturbed, backup filter": (
        "translational-inspection/experiment-seed.yml",
        (
            _SUN,
            f"{_OWN}.enabled=True",
            f"{_GLUE}.disturbance={_BOUNDS}",
            f"{_SIMULATOR}.config.disturbance={_disturbed(_BOUNDS)}",
        ),
    ),
    "one, continuous thrust": ("translational-inspection/experiment-seed.yml", (_SUN,)),
    "one, seeing more": ("translational-inspection/experiment-outlook.yml", (_SUN,)),
    "one, burn and coast": ("translational-inspection/experiment-burn-and-coast.yml", (_SUN,)),
    "one, burn and coast, filtered": ("translational-inspection/experiment-burn-and-coast-filtered.yml", (_SUN,)),
    "three, filter of the team": ("multiagent-translational-inspection/experiment.yml", (_SUN,)),
    "three": ("multiagent-translational-inspection/experiment.yml", (_SUN, "rta.config.enabled=False")),
    "three, continuous thrust": ("multiagent-translational-inspection/experiment-seed.yml", (_SUN,)),
    "three, a filter each": ("multiagent-translational-inspection/experiment-seed.yml", (_SUN, f"{_OWN}.enabled=True")),
    "three, disturbed, filter of the team": (
        "multiagent-translational-inspection/experiment-seed.yml",
        (
            _SUN,
            "rta.config.enabled=True",
            f"config.config.env_config.rta.config.disturbance={_BOUNDS}",
            f"{_SIMULATOR}.config.disturbance={_disturbed(_BOUNDS)}",
        ),
    ),
    "three, seeing each other": ("multiagent-translational-inspection/experiment-see-others.yml", (_SUN,)),
    "three, burn and coast": ("multiagent-translational-inspection/experiment-burn-and-coast.yml", (_SUN,)),
    "mixed with scripted policies": ("multiagent-translational-inspection/experiment-mixed.yml", (_SUN,)),
    "weighted points": ("weighted-translational-inspection/experiment.yml", (_SUN,)),
    "weighted points, three, filter of the team": (
        "multiagent-weighted-translational-inspection/experiment-recipe.yml",
        (_SUN,),
    ),
    "weighted points, six degrees of freedom": ("weighted-six-dof-inspection/experiment.yml", (_SUN,)),
    "weighted points, six degrees of freedom, recipe": ("weighted-six-dof-inspection/experiment-recipe.yml", (_SUN,)),
    "weighted points, three, six degrees of freedom": (
        "multiagent-weighted-six-dof-inspection/experiment.yml",
        (_SUN,),
    ),
    "docking": ("docking/experiment.yml", ()),
    "docking, filtered": ("docking/experiment.yml", ("RTAGlueCWHDocking3d.config.enabled=True",)),
    "docking, disturbed, filtered": (
        "docking/experiment.yml",
        (
            "RTAGlueCWHDocking3d.config.enabled=True",
            f"RTAGlueCWHDocking3d.config.disturbance={_DOCKING_BOUNDS}",
            f"{_SIMULATOR}={{type: CWHSimulator, config: {{disturbance: {_disturbed(_DOCKING_BOUNDS)}}}}}",
        ),
    ),
    "docking, three": ("multiagent-docking/experiment.yml", ()),
    "tumbling rendezvous": ("tumbling-rendezvous-learning/experiment.yml", ()),
}
#: Of these, the flights that adversaries fly too, whom the filter must stop.
_PUSHED = (
    "one, backup filter", "one, continuous filter", "one, disturbed, backup filter",
    "three, filter of the team", "three, a filter each", "three, disturbed, filter of the team",
    "weighted points, three, filter of the team", "docking, filtered", "docking, disturbed, filtered",
)  # fmt: skip
FLIGHTS |= {f"{name}, pushed": FLIGHTS[name] for name in _PUSHED}


def fly(flight: str, *, compiled: bool) -> tuple[dict[str, str], dict[str, list[float]]]:
    """Return the SHA-256 of every quantity over a flight, and sums of it after some steps.

    Args:
        flight: Name of the flight.
        compiled: Whether one compiled call computes the terms of a step, rather than every plugin by itself.
    """
    file, overrides = FLIGHTS[flight]
    spec = load_experiment(configs_root() / file, ("horizon=60", *overrides)).spec
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
            if flight.endswith("pushed"):
                view = View(env.state, env.simulation.world, group)
                slots = np.repeat(np.arange(NUM_ENVS), group.size)
                share = 0.5 + 0.5 * adversarial_thrust(view, step, slots, SEED).reshape(shape)
            else:
                share = generator.random(shape)
            low, high = group.action_layout.low, group.action_layout.high
            action = low + share * (high - low)
            actions.append(np.rint(action) if group.action_layout.choices else action)
        found = env.step(actions)
        note(_of_step(env, found), step)
        over = np.flatnonzero(found.over)
        if len(over):
            note((("observation", observation) for observation in env.reset(over)), step)
            note((("reset", env.state.position), ("reset", env.state.velocity)), step)
    return {name: total.hexdigest()[:16] for name, total in sorted(hashes.items())}, dict(sorted(sums.items()))


def _of_step(env: TeamEnvironment, found: Any) -> Iterable[tuple[str, np.ndarray]]:
    """Yield all that a step gives."""
    for name, values in env.state.arrays.items():
        yield f"state/{name}", values
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
    """Return a fingerprint of the processor's arithmetic: NumPy and BLAS choose their code by its features.

    It contains nothing that depends on the number of threads, such as exponentials of matrices.
    """
    x = np.linspace(-3.0, 3.0, 4001)
    parts = (np.sin(x), np.cos(x), np.exp(x), np.arccos(x / 3.0), np.sqrt(x + 3.0), np.arctan2(x, 1.0), np.mod(x, 0.7))
    scalars = np.array([[math.sin(v), math.cos(v), math.acos(v / 3.0), math.hypot(v, 1.0)] for v in x.tolist()])
    squares = [np.sin(np.arange(1.0, n * n + 1.0)).reshape(n, n) for n in (3, 6, 13, 64)]
    algebra = [part for a in squares for part in (a @ a, a @ a[0], np.linalg.solve(a + 2.0 * np.eye(len(a)), a))]
    return hashlib.sha256(b"".join(part.tobytes() for part in (*parts, scalars, *algebra))).hexdigest()[:16]
