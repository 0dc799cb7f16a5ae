"""Checks of safety constraints: against adversaries, at the steps and between them, and for sampled initial states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.core import BatchedEnvironment
from safe_inspect.errors import ConfigError
from safe_inspect.evaluation.episodes import Progress
from safe_inspect.random.streams import Streams
from safe_inspect.rta.adversaries import ADVERSARIES, adversarial_thrust
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.rta.rejection_sampler import RejectionSampler
from safe_inspect.simulators.resets.parameters import Draw, Value
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray


@dataclass(eq=False)
class SafetyReport:
    """Result of a run against adversaries.

    Attributes:
        names: Names of the C constraints.
        units: Unit of the plain safety quantity of each constraint.
        filtered: Whether the filter was on.
        steps: Number of steps, over all environments.
        moments: Number of moments within holds that were checked.
        step_size: Length of a step [s].
        least_at_steps: Smallest plain safety quantity at the start and end of holds, shape (C,).
        least_between: Smallest plain safety quantity at moments within holds, shape (C,).
        violations_at_steps: Number of steps with a negative quantity at their end, shape (C,).
        violations_between: Number of moments within holds with a negative quantity, shape (C,).
        interventions: Number of steps in which the filter changed the thrust, by adversary, shape (K,).
        flown: Number of steps of each adversary, shape (K,).
        ends: Number of episodes that ended, by `DoneStatus`, shape (4,).
        starts_refused: Number of initial states that violate a constraint.
        infeasible: Number of steps in which the filter could not guarantee safety.
        worst: Quantities, over the steps, of the environment that came nearest to a violation, shape (T, C).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    filtered: bool
    steps: int
    moments: int
    step_size: float
    least_at_steps: FloatArray
    least_between: FloatArray
    violations_at_steps: IntArray
    violations_between: IntArray
    interventions: IntArray
    flown: IntArray
    ends: IntArray
    starts_refused: int = 0
    infeasible: int = 0
    worst: AnyArray = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def violations(self) -> int:
        """Number of all violations, at the steps and between them."""
        return int(self.violations_at_steps.sum() + self.violations_between.sum())

    def __str__(self) -> str:
        width = max(len("constraint"), *map(len, self.names))
        flown = "filtered steps" if self.filtered else "steps without the filter"
        lines = [
            f"{self.steps:,} {flown}, {self.moments:,} moments between them",
            f"{'constraint':<{width}}  smallest phi: {'at steps':>12} {'between':>12}  violations: at steps  between",
        ]
        for j, name in enumerate(self.names):
            lines.append(
                f"{name:<{width}}                {self.least_at_steps[j]:12.3g} {self.least_between[j]:12.3g}"
                f"{self.violations_at_steps[j]:>22,} {self.violations_between[j]:>8,}"
            )
        for k, kind in enumerate(ADVERSARIES):
            if self.filtered and self.flown[k]:
                lines.append(f"interventions, {kind}: {100.0 * self.interventions[k] / self.flown[k]:.1f} % of steps")
        if self.filtered:
            lines.append(f"infeasible steps: {self.infeasible:,}; initial states refused: {self.starts_refused:,}")
        else:
            lines.append(f"initial states that violate a constraint: {self.starts_refused:,}")
        lines.append(f"episodes ended: {self.ends[1]:,} won, {self.ends[2]:,} lost, {self.ends[3]:,} out of time")
        return "\n".join(lines)


def safety_report(
    spec: EnvironmentSpec,
    steps: int = 1_000_000,
    num_envs: int = 1024,
    seed: int = 0,
    substeps: int = 10,
    progress: Progress | None = None,
) -> SafetyReport:
    """Let adversaries act under the task's safety glue and check every constraint.

    Args:
        spec: The task. Its agent must have a safety glue; if the glue is disabled, nothing is filtered.
        steps: Number of filtered steps, over all environments; rounded up to whole steps of the batch.
        num_envs: Number of environments, N.
        seed: Seed of the initial states and of the random adversary.
        substeps: Number of equal parts into which every hold is divided for the checks.
        progress: Called with the number of steps done and the number of steps requested.

    Raises:
        ConfigError: The agent has no safety glue.
        ValueError: A number is not positive.
    """
    if min(steps, num_envs, substeps) < 1:
        raise ValueError(f"`steps`, `num_envs` and `substeps` must be at least 1, got {steps}, {num_envs}, {substeps}")
    glues = [glue for glue in spec.agents[0].action_glues if isinstance(glue, SafetyGlue)]
    if not glues:
        raise ConfigError(f"the agent {spec.agents[0].name!r} has no safety glue; wrap its controllers in one")
    glue, num_envs = glues[0], min(num_envs, steps)
    holds = -(-steps // num_envs)
    environment = BatchedEnvironment(spec, num_envs, seed=seed)
    environment.reset()
    simulation, world = environment.simulation, environment.simulation.world
    names = tuple(glue.safety(glue.states(environment.state)))

    def checked(states: dict[str, FloatArray], least: FloatArray, violations: IntArray) -> FloatArray:
        """Return the quantities of some states, shape (N, C), and count the violations among them."""
        phi = np.stack(list(glue.safety(states).values()), axis=1)
        np.minimum(least, phi.min(axis=0), out=least)
        violations += (phi < 0.0).sum(axis=0)
        return phi

    count, kinds = len(names), len(ADVERSARIES)
    report = SafetyReport(
        names=names,
        units=tuple(glue.units.get(name, "-") for name in names),
        filtered=glue.enabled,
        steps=holds * num_envs,
        moments=holds * num_envs * (substeps - 1),
        step_size=spec.step_size,
        least_at_steps=np.full(count, np.inf),
        least_between=np.full(count, np.inf),
        violations_at_steps=np.zeros(count, dtype=np.int64),
        violations_between=np.zeros(count, dtype=np.int64),
        interventions=np.zeros(kinds, dtype=np.int64),
        flown=np.zeros(kinds, dtype=np.int64),
        ends=np.zeros(4, dtype=np.int64),
    )
    slots = np.arange(num_envs)
    adversary, layout = slots % kinds, environment.action_layout
    trace = np.empty((holds + 1, num_envs, count), dtype=np.float32)
    trace[0] = checked(glue.states(environment.state), report.least_at_steps, report.violations_at_steps)
    report.violations_at_steps[:] = 0  # those at the start are counted apart
    report.starts_refused = int((trace[0] < 0.0).any(axis=1).sum())
    for hold in range(holds):
        share = adversarial_thrust(environment.view(), hold, slots, seed)
        action = np.tile(layout.low, (num_envs, 1))  # the shortest coasting, where an action sets it
        thrust = action[:, : share.shape[1]]
        thrust += 0.5 * (share + 1.0) * (layout.high - layout.low)[: share.shape[1]]
        transition = environment.step((np.rint(action) if layout.choices else action)[:, None])
        for part in range(1, substeps):
            time = world.step_size * part / substeps
            within = glue.states_within(simulation.before, world, simulation.flown[:, 0], time)
            checked(within, report.least_between, report.violations_between)
        trace[hold + 1] = checked(glue.states(environment.state), report.least_at_steps, report.violations_at_steps)
        report.flown += np.bincount(adversary, minlength=kinds)
        report.interventions += np.bincount(adversary[transition.step.intervening], minlength=kinds)
        if transition.step.filtered is not None:
            report.infeasible += int(transition.step.filtered.infeasible.sum())
        done = np.flatnonzero(transition.done[:, 0])
        if len(done):
            report.ends += np.bincount(transition.status[done, 0], minlength=4)
            environment.reset(done)
        if progress is not None:
            progress((hold + 1) * num_envs, holds * num_envs)
    scale = np.median(np.abs(trace), axis=(0, 1)) + 1e-12
    report.worst = trace[:, int(np.argmin((trace / scale).min(axis=(0, 2))))]
    return report


@dataclass(frozen=True, eq=False)
class _Acceptance:
    """First samples of a rejection sampler, and which of them its constraints refuse.

    Attributes:
        parameter: Name of the reset parameter.
        states: The sampled states by name, each with R rows.
        refused: For each constraint the mask of the rows that it refuses, shape (R,).
        accepted: Mask of the rows that no constraint refuses, shape (R,).
    """

    parameter: str
    states: Mapping[str, FloatArray]
    refused: Mapping[str, BoolArray]
    accepted: BoolArray

    def __str__(self) -> str:
        count = len(self.accepted)
        width = max(map(len, ("constraint", *self.refused)))
        lines = [
            f"{self.parameter}: {100.0 * self.accepted.mean():.2f} % of {count:,} draws are accepted",
            f"{'constraint':<{width}}  refuses  alone",
        ]
        total = np.sum(list(self.refused.values()), axis=0)
        for name, rows in self.refused.items():
            alone = rows & (total == 1)
            lines.append(f"{name:<{width}}  {100.0 * rows.mean():6.2f} % {100.0 * alone.mean():6.2f} %")
        return "\n".join(lines)


def acceptance(spec: EnvironmentSpec, draws: int = 100_000, seed: int = 0) -> _Acceptance:
    """Sample initial states of the first deputy once each, without retries, and check them against the constraints.

    As in an environment, these are the constraints of the rejection sampler and those of the enabled filters.

    Args:
        spec: The task; one of its reset parameters must be a rejection sampler.
        draws: Number of samples, R.
        seed: Seed of the samples.

    Raises:
        ConfigError: The task has no rejection sampler.
        ValueError: `draws` is not positive.
    """
    if draws < 1:
        raise ValueError(f"`draws` must be at least 1, got {draws}")
    streams = Streams(seed, np.arange(draws), np.zeros(draws, dtype=np.int64))
    values: dict[str, Value] = {}
    deputy = next(iter(spec.reset.deputies.values()), None)
    for name, parameter in spec.reset.parameters.items():
        draw = Draw(streams, name, values=values)
        if deputy is not None and name in deputy.sources:
            draw = spec.reset.tested(draw)
        if isinstance(parameter, RejectionSampler):
            states, refused = parameter.candidates(draw)
            accepted = ~np.any([np.zeros(draws, dtype=np.bool_), *refused.values()], axis=0)
            return _Acceptance(name, states, refused, accepted)
        values[name] = parameter(draw)
    raise ConfigError(
        "no reset parameter of this task is a RejectionSampler, so all samples are accepted and there is no share; "
        "wrap the initializer in one (docs/safety.md, Initial states), or use translational-inspection"
    )
