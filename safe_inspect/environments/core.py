"""`BatchedEnvironment`: the core that every façade wraps. It steps N environments as arrays; resets are asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.guard import all_finite, require_finite, require_shape
from safe_inspect.environments.layout import Layout, action_layout, observation_layout
from safe_inspect.glues.base import ActionGlue, Glue, Parts
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import GUARD, Group, Step, View
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray


@dataclass  # not frozen: one is made in every step, and freezing doubles the time that takes
class Transition:
    """What one step gives for the agents of a group; every array has N rows, and G agents where it says so.

    Attributes:
        observation: Observation at the end of the step, before any reset, float32, shape (N, G, O).
        reward: Sum of the terms [-], shape (N, G).
        terms: Reward terms by name, each of shape (N, G).
        terminated: The episode ended in the task's own way, shape (N, G).
        truncated: The episode ended by a limit of time alone, shape (N, G).
        status: `DoneStatus`, int8, shape (N, G).
        step: The step as the functors saw it.
    """

    observation: AnyArray
    reward: FloatArray
    terms: dict[str, FloatArray]
    terminated: BoolArray
    truncated: BoolArray
    status: AnyArray
    step: Step

    @cached_property
    def done(self) -> BoolArray:
        """The episode ended, shape (N, G)."""
        return self.terminated | self.truncated


class BatchedEnvironment:
    """N environments of one task. SI units, Hill's frame.

    Args:
        spec: The task.
        num_envs: Number of environments, N.
        seed: Seed of the run; the task's own unless given.
        first_slot: Global index of the first environment slot. Two environments with the same seed and slot give the
            same episodes, whatever the batch they stand in.
    """

    def __init__(
        self, spec: EnvironmentSpec, num_envs: int = 1, *, seed: int | None = None, first_slot: int = 0
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs is at least 1, not {num_envs}")
        self.spec = spec
        self.agent = spec.agents[0]
        guards = [glue for glue in self.agent.action_glues if isinstance(glue, SafetyGlue) and glue.enabled]
        self._guard = guards[0] if guards else None
        self.group = Group(self.agent.name, 0, 1, self.agent.sensors, self._guard)
        self.observation_layout: Layout = observation_layout(self.agent)
        self.action_layout: Layout = action_layout(self.agent)
        self.simulation = spec.simulator(
            masses={name: platform.mass for name, platform in spec.platforms.items()},
            groups=(self.group,),
            reset=spec.reset,
            step_size=spec.step_size,
            num_envs=num_envs,
            seed=spec.seed if seed is None else seed,
            first_slot=first_slot,
        )
        self._no_intervention = np.zeros(num_envs * self.group.size, dtype=np.bool_)
        parts = self.agent.parts
        self._commands: list[tuple[ActionGlue, slice]] = []
        first = 0
        for glue in (leaf for outer in self.agent.action_glues for leaf in outer.leaves()):
            last = first + len(glue.names(parts))
            self._commands.append((glue, slice(first, last)))
            first = last
        self._glues = self.agent.observation_glues
        self._sizes = [len(glue.names(parts)) for glue in self._glues]
        observed = {getattr(glue, "sensor", None) for glue in self._glues}
        self._unobserved = [name for name in self.agent.sensors if name not in observed]
        # A status that is written later stands: lose before win before draw.
        order = (DoneStatus.DRAW, DoneStatus.WIN, DoneStatus.LOSE)
        self._dones = sorted(self.agent.dones, key=lambda named: order.index(named.functor.status))

    @property
    def num_envs(self) -> int:
        """Number of environments, N."""
        return self.simulation.num_envs

    @property
    def state(self) -> State:
        """The current state."""
        return self.simulation.state

    def view(self) -> View:
        """Return the current state as the agents see it."""
        return self.simulation.views[0]

    def reset(self, rows: IntArray | None = None, *, seed: int | None = None) -> AnyArray:
        """Begin new episodes.

        Args:
            rows: Indices of the environments, shape (R,); all of them unless given.
            seed: Begin the run again with this seed (all rows).

        Returns:
            First observation of these rows, float32, shape (R, G, O).
        """
        if seed is not None:
            if rows is not None:
                raise ValueError("a seed begins the run of all environments again; reset them all, or give no seed")
            self.simulation.seed(seed)
        rows = np.arange(self.num_envs) if rows is None else np.asarray(rows, dtype=np.int64)
        fresh = self.simulation.reset(rows)
        for what in ("position", "velocity", "sun_angle"):
            require_finite(f"the initialiser of the {what}", fresh.arrays[what], fresh)
        return self._observe(View(fresh, self.simulation.world, self.group))

    def step(self, action: AnyArray) -> Transition:
        """Hold an action over one step.

        Args:
            action: Action of each agent in the units of `action_layout`, clipped to its bounds, shape (N, G, A).

        Raises:
            PluginValueError: A plugin gave NaN or infinity (the state that caused it is saved), or a wrong shape.
        """
        simulation, group = self.simulation, self.group
        rows = self.num_envs * group.size
        action = np.asarray(action, dtype=np.float64).reshape(rows, self.action_layout.size)
        if not all_finite(action):
            require_finite("action", action, simulation.state)
        action = np.minimum(np.maximum(action, self.action_layout.low), self.action_layout.high)
        control = self._control(action)
        if not all_finite(control):
            for glue, columns in self._commands:
                require_finite(
                    _title(glue, self.agent.parts), glue(action[:, columns], self.agent.parts), simulation.state
                )
        before, desired, filtered = simulation.views[0], control, None
        if self._guard is not None:
            filtered = self._guard.filter(desired, before)
            control = filtered.result.control
        simulation.step(control.reshape(self.num_envs, group.size, 3))
        after, step_size = simulation.views[0], simulation.world.step_size
        if filtered is None:
            step = Step(before, after, action, control, desired, self._no_intervention, step_size)
        else:
            intervening = filtered.result.intervening
            first = group.first
            simulation.state.interventions[:, first : first + group.size] += intervening.reshape(-1, group.size)
            for name, array in filtered.memory.items():
                after.memory(GUARD, name)[...] = array
            step = Step(before, after, action, control, desired, intervening, step_size, filtered.result)
        shape = (self.num_envs, group.size)
        observation = self._observe(step.after)
        terms: dict[str, FloatArray] = {}
        reward = np.zeros(rows)
        for named in self.agent.rewards:
            value = np.array(named.functor(step), dtype=np.float64)  # a copy: it may be an array of the state
            if value.shape != (rows,):
                require_shape(f"reward {named.name}", value, (rows,))
            reward += value
            terms[named.name] = value.reshape(shape)
        if not all_finite(reward):
            for name, value in terms.items():
                require_finite(f"reward {name}", value, simulation.state, simulation.before)
        terminated, truncated, status = self._ends(step, rows)
        for name in self._unobserved:
            # A NaN here would silently compare as false.
            if name in step.after.readings and not all_finite(step.after.readings[name]):
                require_finite(f"sensor {name}", step.after.readings[name], simulation.state, simulation.before)
        done = terminated | truncated
        if np.count_nonzero(done):
            simulation.end(np.asarray(done.reshape(shape).all(axis=-1)))
        return Transition(
            observation,
            reward.reshape(shape),
            terms,
            terminated.reshape(shape),
            truncated.reshape(shape),
            status.reshape(shape),
            step,
        )

    def _control(self, action: FloatArray) -> FloatArray:
        control = np.zeros((len(action), 3))
        for glue, columns in self._commands:
            control += glue(action[:, columns], self.agent.parts)
        return control

    def _observe(self, view: View) -> AnyArray:
        glues = self._glues
        parts = [glue(view) for glue in glues]
        for glue, part, size in zip(glues, parts, self._sizes, strict=True):
            if part.shape != (view.num_rows, size):
                require_shape(_title(glue, self.agent.parts), part, (view.num_rows, size))
        observation = np.concatenate(parts, axis=-1) if parts else np.zeros((view.num_rows, 0))
        if not all_finite(observation):
            for glue, part in zip(glues, parts, strict=True):
                require_finite(_title(glue, self.agent.parts), part, view.state)
        return observation.astype(np.float32).reshape(view.state.num_envs, self.group.size, observation.shape[-1])

    def _ends(self, step: Step, rows: int) -> tuple[BoolArray, BoolArray, AnyArray]:
        terminated, truncated = np.zeros(rows, dtype=np.bool_), np.zeros(rows, dtype=np.bool_)
        status = np.zeros(rows, dtype=np.int8)
        for named in self._dones:
            done = np.asarray(named.functor(step), dtype=np.bool_)
            if done.shape != (rows,):
                require_shape(f"done {named.name}", done, (rows,))
            if np.count_nonzero(done):  # several times as fast as `any` on a small array
                status[done] = named.functor.status
                ended = truncated if named.functor.truncates else terminated
                ended |= done
        return terminated, truncated & ~terminated, status


def _title(glue: Glue, parts: Parts) -> str:
    """Name a glue in a message: its class and what it observes or commands."""
    return f"glue {glue.registered_name} ({', '.join(glue.names(parts))})"
