"""`TeamEnvironment`: the core behind every façade; it steps N environments with all their agents as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Any

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.finite_checks import checked_seed, names_writers, require_finite, require_shape
from safe_inspect.environments.group import AgentGroup, group_agents
from safe_inspect.environments.transition import TeamTransition, Transition
from safe_inspect.rta.base import TeamFiltered
from safe_inspect.simulators.arrays import read_only
from safe_inspect.simulators.simulator import Simulation
from safe_inspect.simulators.state import State
from safe_inspect.simulators.team import TEAM, TEAM_FILTER, TeamStep, TeamView
from safe_inspect.simulators.view import SAFETY_FILTER, Step, View
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

#: Rank of each status, for steps with several of them: lose has precedence over win, and win over draw.
_RANK = np.array([0, 2, 3, 1], dtype=np.int8)


class TeamEnvironment:
    """N environments of one task with all their agents. SI units, Hill's frame.

    Environments are not reset automatically; call `reset`. The spacecraft of an agent that has ended remains in the
    simulation without thrust, and its camera continues to inspect, until the episode is over for all agents.

    Args:
        spec: The task.
        num_envs: Number of environments, N.
        seed: Seed of the run; default: the seed of the task (the environments for Gymnasium and PettingZoo draw a fresh
            seed instead).
        first_slot: Global index of the first environment slot. Environments with the same seed and slot produce the
            same episodes, whatever batch they are part of.

    Attributes:
        num_envs: Number of environments, N.
        groups: Groups of agents with equal terms, in agent order.
        acting: Groups of controlled agents, whose actions the caller gives; the others are controlled by scripted
            policies.
        acting_indices: Their indices in `groups`.
        safety_filter: The team's safety filter; None if there is none, or if it is disabled.
        observes_coasting: Whether transitions also contain the observations of agents whose decision has not elapsed.
            If not, these are NaN, except the last observations of an episode.
    """

    def __init__(
        self, spec: EnvironmentSpec, num_envs: int = 1, *,
        seed: int | None = None, first_slot: int = 0, _fused: bool = True,
    ) -> None:  # fmt: skip
        if isinstance(num_envs, bool) or not isinstance(num_envs, int | np.integer) or num_envs < 1:
            raise ValueError(f"num_envs must be a whole number of at least 1, not {num_envs!r}")
        self.spec = spec
        self.groups: tuple[AgentGroup, ...] = group_agents(spec.agents, spec.simulator.compose()[0])
        self.acting: tuple[AgentGroup, ...] = tuple(group for group in self.groups if not group.scripted)
        self.acting_indices = [self.groups.index(group) for group in self.acting]
        self.safety_filter = spec.team_safety if spec.team_safety is not None and spec.team_safety.enabled else None
        self.simulation = Simulation(
            *spec.simulator(),
            decimation=spec.simulator.decimation,
            masses={agent.platform: spec.platforms[agent.platform].mass for agent in spec.agents},
            groups=tuple(group.group for group in self.groups),
            reset=spec.reset,
            step_size=spec.step_size,
            num_envs=num_envs,
            seed=checked_seed(spec.seed if seed is None else seed),
            first_slot=first_slot,
            team_filter=self.safety_filter,
        )
        for group, view in zip(self.groups, self.simulation.views, strict=True):
            group.require_needed(view)
        if _fused:
            from safe_inspect.environments.fused_step import FusedGroup  # imports Numba, which validation does not need

            for group in self.groups:
                group.fused = FusedGroup(group, self.simulation.world)
        self.num_envs = num_envs
        self.observes_coasting = True
        self._parts: dict[int, TeamEnvironment] = {}
        self._everyone = np.ones((num_envs, len(spec.agents)), dtype=np.bool_)
        self._everyone.flags.writeable = False  # it is returned by every step in which all agents are active
        self._idle = [np.zeros(num_envs * group.size, dtype=np.bool_) for group in self.groups]
        deciding = self.acting or self.groups
        self._deciding = np.concatenate([np.arange(group.first, group.first + group.size) for group in deciding])
        dones = [[named.name for named in agent.dones] for agent in spec.agents]
        self._has = {name: read_only(np.array([name in own for own in dones])) for each in dones for name in each}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the attributes of a copy; NumPy makes copies of read-only arrays writable."""
        self.__dict__.update(state)
        self._everyone.flags.writeable = False

    @property
    def state(self) -> State:
        """The current state."""
        return self.simulation.state

    @property
    def agents(self) -> tuple[str, ...]:
        """Names of all agents, in order."""
        return tuple(agent.name for agent in self.spec.agents)

    def view(self, group: int = 0) -> View:
        """Return the current state as seen by a group of agents."""
        return self.simulation.views[group]

    @property
    def decides(self) -> bool:
        """Whether actions of some agents can hold for several control steps; see `CoastGlue`."""
        return any(group.group.decides for group in self.acting)

    def due(self) -> tuple[BoolArray, ...]:
        """Return, for each acting group, a mask of the agents that act in the next step, (N, G); the others coast."""
        return tuple(group.due(self.state) for group in self.acting)

    def team(self) -> TeamView:
        """Return the current state as seen by all deputies together."""
        return TeamView(self.state, self.simulation.world)

    def outcome(self) -> AnyArray:
        """Return the current outcome of each episode for the team, int8, shape (N,); see `TeamTransition.outcome`."""
        return np.asarray(_STATUS[_RANK[self.state.finished].max(axis=1)])

    @names_writers
    def reset(self, rows: IntArray | None = None, *, seed: int | None = None) -> tuple[AnyArray, ...]:
        """Start new episodes.

        Args:
            rows: Indices of the environments, shape (R,); default: all of them.
            seed: Restart the run with this seed; all environments must be reset.

        Returns:
            For each acting group the first observation of these rows, float32, shape (R, G, O).

        Raises:
            ValueError: A seed is given with rows or is out of range, or a mask is given in place of indices.
        """
        if seed is not None:
            if rows is not None:
                raise ValueError("a seed restarts the run of all environments; reset all of them, or give no seed")
            self.simulation.seed(checked_seed(seed))
        rows = np.arange(self.num_envs) if rows is None else np.asarray(rows)
        if rows.dtype == np.bool_:
            raise ValueError("expected indices of environments, not a mask; use np.flatnonzero(mask)")
        fresh = self.simulation.reset(rows.astype(np.int64))
        for what in self.simulation.drawn:
            require_finite(f"the initialiser of the {what}", fresh[what], fresh)
        world = self.simulation.world
        return tuple(group.observe(View(fresh, world, group.group)) for group in self.acting)

    @names_writers
    def step(self, actions: Sequence[AnyArray]) -> TeamTransition:
        """Hold the actions for one step.

        Args:
            actions: For each acting group the actions in the units of its `action_layout`, shape (N, G, A). They are
                clipped to their bounds unless they are discrete. Actions of agents that have ended must be valid too,
                but have no effect.

        Raises:
            ArgumentError: A discrete action is a fraction or out of range.
            PluginValueError: A plugin returned NaN or infinity (the state that caused it is saved) or an array of the
                wrong shape, or wrote into an array that was passed to it.
            ValueError: The number of action arrays is not the number of acting groups, or an array has the wrong shape.
        """
        simulation, world = self.simulation, self.simulation.world
        if len(actions) != len(self.acting):
            raise ValueError(
                f"got {len(actions)} arrays of actions; expected one for each of {len(self.acting)} groups"
            )
        views = simulation.views
        given = iter(actions)
        steps: list[Step] = []
        for group, view, idle in zip(self.groups, views, self._idle, strict=True):
            if group.scripted:
                action = desired = group.fly(view)
            else:
                action, desired = group.command(next(given), view)
            steps.append(Step(view, view, action, desired, desired, idle, world.step_size))
        for group, step in zip(self.groups, steps, strict=True):
            if group.safety_filter is not None:
                result = step.filtered = group.safety_filter.filter(read_only(step.writable_control), step.before)
                step.writable_control, step.writable_intervening = result.control, result.intervening
        everyone = not np.count_nonzero(simulation.state.finished)
        active = self._everyone if everyone else simulation.state.finished == 0
        control = self._whole([step.writable_control for step in steps])
        team = None
        if self.safety_filter is not None:
            team = self._filter_team(control, steps)
            control = team.control
        elif not everyone:
            control = self._without_ended(control, active, steps)
        simulation.step(control)
        for group, step, seen in zip(self.groups, steps, simulation.views, strict=True):
            step.after, found = seen, step.filtered
            if found is not None or team is not None:
                simulation.state.interventions[:, group.members] += step.writable_intervening.reshape(-1, group.size)
            for name, array in found.memory.items() if found is not None else ():
                simulation.state.memory[group.name, SAFETY_FILTER, name][...] = array
            if group.group.decides:
                group.follow(step, simulation.before, simulation.state)
        for name, array in team.memory.items() if team is not None else ():
            simulation.state.memory[TEAM, TEAM_FILTER, name][...] = array
        return self._evaluate(steps, active, team)

    def _whole(self, parts: list[FloatArray]) -> FloatArray:
        """Return the controls of all groups as one array, shape (N, D, C)."""
        if len(parts) == 1:
            return parts[0].reshape(self.num_envs, -1, parts[0].shape[-1])
        pieces = [part.reshape(self.num_envs, group.size, -1) for part, group in zip(parts, self.groups, strict=True)]
        return np.concatenate(pieces, axis=1)

    def _filter_team(self, desired: FloatArray, steps: list[Step]) -> TeamFiltered:
        """Apply the team's filter, and write its thrusts into the groups' steps."""
        assert self.safety_filter is not None
        team = self.safety_filter(read_only(desired), self.team())
        what = f"safety filter {self.safety_filter.registered_name}"
        require_shape(what, team.control, desired.shape)
        require_finite(what, team.control, self.state)
        for group, step in zip(self.groups, steps, strict=True):
            step.writable_control = team.control[:, group.members].reshape(-1, 3)
            step.writable_intervening = team.intervening[:, group.members].reshape(-1)
        return team

    def _without_ended(self, control: FloatArray, active: BoolArray, steps: list[Step]) -> FloatArray:
        """Replace the controls of ended agents and write all controls into the groups' steps; return them.

        An ended agent keeps its last control if `ended_thrust_on` is set; otherwise its control is 0.
        """
        instead = self.state.control if self.spec.ended_thrust_on else 0.0
        control = np.where(active[:, :, None], control, instead)
        for group, step in zip(self.groups, steps, strict=True):
            step.writable_control = control[:, group.members].reshape(-1, control.shape[-1])
            step.writable_intervening = step.writable_intervening & active[:, group.members].reshape(-1)
        return control

    def _evaluate(self, steps: list[Step], active: BoolArray, team: TeamFiltered | None) -> TeamTransition:
        """Return observations, rewards and ended episodes of a step after the dynamics have been computed."""
        simulation = self.simulation
        transitions = []
        fired: dict[str, BoolArray] = {}
        ended = False
        for group, step in zip(self.groups, steps, strict=True):
            for name, done in group.remembering.items():
                step.after.remembering = name
                done.remember(step, name)
                step.after.remembering = None
            asked = None
            if not self.observes_coasting:
                asked = (group.due(simulation.state) & simulation.running[:, None]).reshape(-1)
            found = group.fused.evaluate_step(step, asked) if group.fused is not None else None
            if found is None:  # the plugins' own checks report what is wrong
                found = group.evaluate_step(step)
            shape = (self.num_envs, group.size)
            values, flags = found.values.reshape(-1, *shape), found.flags.reshape(-1, *shape)
            if self.spec.shared_dones:
                for named, said in zip(group.dones, flags[2:], strict=True):
                    fired.setdefault(named.name, np.zeros(active.shape, dtype=np.bool_))[:, group.members] = said
            ended |= found.ended
            transitions.append(
                Transition(
                    found.observation.reshape(*shape, found.observation.shape[-1]),
                    values[0],
                    {named.name: values[1 + index] for index, named in enumerate(group.agent.rewards)},
                    active if shape == active.shape else active[:, group.members],
                    flags[0],
                    flags[1],
                    found.status.reshape(shape),
                    step,
                )
            )
        if self.spec.shared_dones and self._share(transitions, active, fired):
            ended = True
            self.observe_missing(transitions)  # a shared done may end a coast
        if ended:
            finished = simulation.state.finished
            finished[...] = np.concatenate([transition.status for transition in transitions], axis=1)
            over = np.asarray((finished[:, self._deciding] != 0).all(axis=1))
            simulation.end(over)
            outcome = self.outcome()
        else:
            over, outcome = np.zeros(self.num_envs, dtype=np.bool_), np.zeros(self.num_envs, dtype=np.int8)
        return TeamTransition(tuple(transitions), over, outcome, team)

    def part(self, size: int) -> TeamEnvironment:
        """Return an environment with fewer rows, in which some of these environments continue; see `Simulation.enter`.

        The same object is returned for the same size. It computes no observations of agents whose decision has not
        elapsed, and cannot be reset.
        """
        if size not in self._parts:
            part = self._parts[size] = copy(self)
            part.simulation, part.num_envs = self.simulation.part(size), size
            part._everyone = self._everyone[:size]
            part._idle = [idle[: size * group.size] for idle, group in zip(self._idle, self.groups, strict=True)]
            part.observes_coasting = False
        return self._parts[size]

    def observe_missing(self, transitions: Sequence[Transition], rows: BoolArray | None = None) -> None:
        """Compute the observations that the last step has left out.

        Args:
            transitions: The transitions of all groups.
            rows: Mask of the environments in which they are computed, shape (N,). Default: for agents that have ended.
        """
        for group, transition in zip(self.groups, transitions, strict=True):
            wanted = transition.done if rows is None else rows[:, None]
            missing = (wanted & np.isnan(transition.observation).any(axis=2)).reshape(-1)
            if group.fused is not None and missing.any():
                view = transition.step.after
                found = group.fused.observe(view, missing)
                found = group.observe(view).reshape(len(missing), -1) if found is None else found
                transition.observation.reshape(found.shape)[missing] = found[missing]

    def _share(self, transitions: list[Transition], active: BoolArray, fired: dict[str, BoolArray]) -> bool:
        """Apply the shared done functions to all active agents; return whether any of them ends an episode."""
        world = self.simulation.world
        before, after = TeamView(self.simulation.before, world), TeamView(self.simulation.state, world)
        own = np.concatenate([transition.status for transition in transitions], axis=1)
        for array in fired.values():
            array.setflags(write=False)
        step = TeamStep(before, after, fired, read_only(own), world.step_size, self._has)
        shared = np.zeros(self.num_envs, dtype=np.int8)
        for named in self.spec.shared_dones:
            status = np.asarray(named.functor(step), dtype=np.int8)
            require_shape(f"shared done {named.name}", status, shared.shape)
            if np.count_nonzero(status):
                shared = np.where(_RANK[status] > _RANK[shared], status, shared)
        if not np.count_nonzero(shared):
            return False
        drawn = (shared == DoneStatus.DRAW)[:, None]
        for transition in transitions:
            given = np.broadcast_to(shared[:, None], transition.status.shape)
            ends = transition.active & (given != 0)
            better = ends & (_RANK[given] > _RANK[transition.status])
            transition.status[better] = given[better]
            transition.terminated |= ends & ~drawn
            transition.truncated |= ends & drawn
            transition.truncated &= ~transition.terminated
        return True


#: The status of each rank.
_STATUS = np.array([0, 3, 1, 2], dtype=np.int8)
