"""`AgentGroup`: agents with equal parts, glues, rewards and dones, computed together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from safe_inspect.config.spec import AgentSpec
from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.dynamics.quaternion import rotate_back
from safe_inspect.environments.finite_checks import all_finite, numbers, require_choices, require_finite, require_shape
from safe_inspect.environments.layout import Layout, action_layout, observation_layout
from safe_inspect.environments.thrust import Thrusters
from safe_inspect.errors import SafeInspectError
from safe_inspect.glues.base import Glue
from safe_inspect.policies.base import SCRIPTED_POLICY, ScriptedPolicy, ThrustLimits, shortened
from safe_inspect.rta.base import Filtered, SafetyGlue
from safe_inspect.simulators.arrays import read_only
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import DECISION, REMAINING, Group, Step, View
from safe_inspect.types import AnyArray, BoolArray, FloatArray


class StepOutcome(NamedTuple):
    """What a step gives for the agents of a group; agents that had ended before count as 0.

    Attributes:
        observation: Observations, float32, R * O numbers.
        values: Rewards and terms, shape (1 + T, R).
        flags: Who is terminated, who truncated, and what each of `AgentGroup.dones` said, shape (2 + K, R).
        status: Statuses, int8, shape (R,).
        ended: Whether any status is not 0.
    """

    observation: AnyArray
    values: FloatArray
    flags: BoolArray
    status: AnyArray
    ended: bool


class CompiledGroup(Protocol):
    """Does what an `AgentGroup` does by one kernel; every method returns None where the group has to do it itself."""

    def command(self, action: FloatArray, /) -> tuple[FloatArray, FloatArray] | None:
        """As `AgentGroup.command`."""

    def observe(self, view: View, asked: BoolArray | None = None, /) -> AnyArray | None:
        """As `AgentGroup.observe`, shape (R, O); rows that are not asked for, shape (R,), are NaN."""

    def evaluate_step(self, step: Step, asked: BoolArray | None = None, /) -> StepOutcome | None:
        """As `AgentGroup.evaluate_step`; observations that are neither asked for, shape (R,), nor the last are NaN."""


class AgentGroup:
    """G agents that stand side by side in agent order and have equal terms.

    Attributes:
        name: Name of the group: its agent's, or those of its first and last agent.
        agents: Names of the agents.
        policies: Name of each agent's policy.
        first: Index of the first deputy among all.
        size: Number of agents, G.
        safety_filter: What filters the thrusts of its agents, where one is enabled.
        flies_backup: Whether an invalid action flies the backup of a safety filter instead of stopping the run.
        scripted: Whether a scripted policy flies the deputies, so that no action is taken from outside.
        group: What views of the state know of the group.
        observation_layout: Layout of one agent's observation.
        action_layout: Layout of one agent's action.
        limits: What the controllers of one agent can give.
        thrusters: From actions to thrust.
        dones: What ends an episode, in the order in which a later status stands: draw, win, lose.
        fused: What does the same by one kernel, where it is used.
        remembering: Done functions with memory, by the name under which it stands.
    """

    def __init__(self, specs: Sequence[AgentSpec], first: int, dynamics: Dynamics | None = None) -> None:
        agent, dynamics = specs[0], dynamics or ClohessyWiltshire()
        self._turns_thrust = dynamics.turns_thrust
        self.agents = tuple(spec.name for spec in specs)
        self.policies = tuple(spec.policy for spec in specs)
        self.name = self.agents[0] if len(specs) == 1 else f"{self.agents[0]} to {self.agents[-1]}"
        self.agent = agent
        filters = [glue for glue in agent.action_glues if isinstance(glue, SafetyGlue) and glue.enabled]
        self.safety_filter = filters[0] if filters else None
        self.flies_backup = self.safety_filter is not None and self.safety_filter.invalid_actions == "backup"
        self.first, self.size, self.scripted = first, len(specs), agent.scripted_policy is not None
        self.remembering = {
            f"done {named.name}": named.functor
            for named in agent.dones
            if type(named.functor).remember is not DoneFunction.remember
        }
        self.group = Group(
            self.name,
            first,
            len(specs),
            agent.sensors,
            self.safety_filter,
            agent.scripted_policy,
            self.remembering,
            decides=action_layout(agent).coast is not None and not self.scripted,
        )
        self.observation_layout: Layout = observation_layout(agent)
        self.action_layout: Layout = action_layout(agent)
        self.thrusters = Thrusters(agent, dynamics.control_size)
        self.limits = self._thrust_limits()
        self._glues = agent.observation_glues
        self._sizes = [len(glue.names(agent.parts)) for glue in self._glues]
        observed = {getattr(glue, "sensor", None) for glue in self._glues}
        self._unobserved = [name for name in agent.sensors if name not in observed]
        order = (DoneStatus.DRAW, DoneStatus.WIN, DoneStatus.LOSE)
        self.dones = sorted(agent.dones, key=lambda named: order.index(named.functor.status))
        self.fused: CompiledGroup | None = None
        self._idle = np.minimum(np.maximum(0.0, self.action_layout.low), self.action_layout.high)

    def require_needed(self, view: View) -> None:
        """Refuse a scripted policy in a task that lacks what it needs.

        Raises:
            SafeInspectError: The task does not offer all that the policy says it needs.
        """
        pilot = self.agent.scripted_policy
        if not isinstance(pilot, ScriptedPolicy):
            return
        offered = {*view.world.offers.view, *view.world.offers.world, *view.writable.arrays}
        lacking = [f"`{name}`" for name in pilot.needed() if name not in offered]
        if lacking:
            raise SafeInspectError(
                f"{pilot.registered_name} cannot fly {self.name}: it reads {', '.join(lacking)}, which this task "
                "does not have; fly another policy, or another task"
            )

    def command(self, action: AnyArray, view: View) -> tuple[FloatArray, FloatArray]:
        """Return the actions within their bounds, shape (R, A), and the control for them [N, N m], shape (R, C).

        Raises:
            ArgumentError: An element of a discrete action is no index of its values.
            PluginValueError: The actions or the thrusts are not finite.
            ValueError: The actions have another shape than (N, G, A).
        """
        layout = self.action_layout
        action = np.ascontiguousarray(action, dtype=np.float64)
        wanted = (view.writable.num_envs, self.size, layout.size)
        if action.shape != wanted:
            raise ValueError(f"the actions of {self.name} have the shape {action.shape}; {wanted} is wanted")
        coasting: BoolArray | None = None
        if self.group.decides:
            coasting = ~self.due(view.writable)
            action = np.where(coasting[:, :, None], self._idle, action)
        elif self.fused is not None:
            found = self.fused.command(action)
            if found is not None:
                return found
        action = action.reshape(view.num_rows, layout.size)
        if not all_finite(action):
            bad = int(np.flatnonzero(~np.isfinite(action).all(axis=1))[0])
            require_finite(f"the action of {self.agents[bad % self.size]}", action, view.state)
        if layout.choices:
            require_choices(self.agents, layout, action)
        else:
            action = np.minimum(np.maximum(action, layout.low), layout.high)
        thrust = self.thrusters(action)
        if coasting is not None:
            thrust[coasting.reshape(-1)] = 0.0
        if not all_finite(thrust):
            for glue, columns in self.thrusters.commands:
                require_finite(self.title(glue), glue(action[:, columns], self.agent.parts), view.state)
        return action, thrust

    def due(self, state: State) -> BoolArray:
        """Return the agents whose decision has elapsed: those that take an action in the next step, shape (N, G)."""
        if not self.group.decides:
            return np.ones((state.num_envs, self.size), dtype=np.bool_)
        remaining = state.memory[self.name, DECISION, REMAINING]
        return np.asarray(remaining == 0).reshape(state.num_envs, self.size)

    def follow(self, step: Step, before: State, after: State) -> None:
        """Write how many control steps are left of the agents' decisions behind a step."""
        coast = self.action_layout.coast
        assert coast is not None, "only groups that decide remember their decisions"
        left = before.memory[self.name, DECISION, REMAINING]
        left = np.where(left == 0, coast.steps(step.action[:, -1]), left) - 1
        left[step.writable_intervening] = 0
        after.memory[self.name, DECISION, REMAINING][...] = left

    def fly(self, view: View) -> FloatArray:
        """Return the control of the scripted policy, within the limits [N, N m], shape (R, C).

        A thrust along Hill's axes is turned into body axes, at the attitude at hand, where the thrusters turn with the
        body; it is then shortened rather than clipped, so that its direction stays.
        """
        policy, size = self.agent.scripted_policy, self.thrusters.size
        assert policy is not None, "only scripted groups fly themselves"
        commands, limits = size if policy.commands_attitude else 3, self.limits
        if commands < size:
            limits = ThrustLimits(limits.low[:3], limits.high[:3])
        view.remembering = SCRIPTED_POLICY
        control = np.asarray(policy(view, limits), dtype=np.float64)
        view.remembering = None
        what = f"policy {policy.registered_name} of {self.name}"
        if control.shape != (view.num_rows, commands):
            require_shape(what, control, (view.num_rows, commands))
        if not all_finite(control):
            require_finite(what, control, view.state)
        if commands < size:
            thrust, control = control, np.zeros((view.num_rows, size))
            if self._turns_thrust:
                thrust = shortened(rotate_back(view.per_agent(view.state["orientation"]), thrust), limits)
            control[:, :3] = thrust
        return np.minimum(np.maximum(control, self.limits.low), self.limits.high)

    def filter(self, desired: FloatArray, view: View) -> Filtered | None:
        """Return what the agents' own safety filter does to the thrust; None without one."""
        return None if self.safety_filter is None else self.safety_filter.filter(read_only(desired), view)

    def observe(self, view: View) -> AnyArray:
        """Return the observations, float32, shape (N, G, O); of no elements for a scripted group."""
        if self.fused is not None:
            found = self.fused.observe(view)
            if found is not None:
                return found.reshape(view.writable.num_envs, self.size, found.shape[-1])
        glues = () if self.scripted else self._glues
        parts = [glue(view) for glue in glues]
        for glue, part, size in zip(glues, parts, self._sizes, strict=False):
            if part.shape != (view.num_rows, size):
                require_shape(self.title(glue), part, (view.num_rows, size))
        observation = np.concatenate(parts, axis=-1) if parts else np.zeros((view.num_rows, 0))
        if not all_finite(observation):
            for glue, part in zip(glues, parts, strict=True):
                require_finite(self.title(glue), part, view.state)
        return observation.astype(np.float32).reshape(view.writable.num_envs, self.size, observation.shape[-1])

    def evaluate_step(self, step: Step) -> StepOutcome:
        """Return what a step gives, by calling every plugin."""
        after, before = step.after, step.before
        observation = self.observe(after)
        reward, terms = self.rewards(step)
        terminated, truncated, status, fired = self.ends(step)
        self.check_unobserved(after, before.state)
        values = np.stack([reward, *terms.values()])
        flags = np.stack([terminated, truncated, *fired.values()])
        out = before.finished != 0
        if np.count_nonzero(out):
            values[:, out] = 0.0
            flags[:, out] = False
            status[out] = before.finished[out]
        return StepOutcome(observation, values, flags, status, bool(np.count_nonzero(status)))

    def rewards(self, step: Step) -> tuple[FloatArray, dict[str, FloatArray]]:
        """Return the sum of the terms, shape (R,), and each term by name, shape (R,)."""
        rows = step.after.num_rows
        terms: dict[str, FloatArray] = {}
        reward = np.zeros(rows)
        for named in self.agent.rewards:
            value = numbers(f"reward {named.name}", named.functor(step)).copy()  # it may be an array of the state
            if value.shape != (rows,):
                require_shape(f"reward {named.name}", value, (rows,))
            reward += value
            terms[named.name] = value
        if not all_finite(reward):
            for name, value in terms.items():
                require_finite(f"reward {name}", value, step.after.state, step.before.state)
        return reward, terms

    def ends(self, step: Step) -> tuple[BoolArray, BoolArray, AnyArray, dict[str, BoolArray]]:
        """Return who is terminated, who truncated, the status, each of shape (R,), and what each done function said."""
        rows = step.after.num_rows
        terminated, truncated = np.zeros(rows, dtype=np.bool_), np.zeros(rows, dtype=np.bool_)
        status = np.zeros(rows, dtype=np.int8)
        fired = {}
        for named in self.dones:
            done = np.asarray(named.functor(step), dtype=np.bool_)
            if done.shape != (rows,):
                require_shape(f"done {named.name}", done, (rows,))
            fired[named.name] = done
            if np.count_nonzero(done):  # several times as fast as `any` on a small array
                status[done] = named.functor.status
                ended = truncated if named.functor.truncates else terminated
                ended |= done
                truncated &= ~terminated
        return terminated, truncated, status, fired

    def check_unobserved(self, after: View, before: State) -> None:
        """Stop when a sensor that only rewards and dones read gave NaN, which would silently compare as false."""
        for name in self._unobserved:
            if name in after.readings and not all_finite(after.readings[name]):
                require_finite(f"sensor {name}", after.readings[name], after.state, before)

    def title(self, glue: Glue) -> str:
        """Name a glue in a message: its class and what it observes or commands."""
        return f"glue {glue.registered_name} ({', '.join(glue.names(self.agent.parts))})"

    def _thrust_limits(self) -> ThrustLimits:
        corners = self.thrusters(np.stack((self.action_layout.low, self.action_layout.high)))
        return ThrustLimits(read_only(corners.min(axis=0)), read_only(corners.max(axis=0)))


def group_agents(agents: Sequence[AgentSpec], dynamics: Dynamics | None = None) -> tuple[AgentGroup, ...]:
    """Return the groups of agents: neighbours in agent order whose terms are equal are computed together.

    Args:
        agents: The agents.
        dynamics: How they move; in Clohessy-Wiltshire dynamics unless given.
    """
    runs: list[list[AgentSpec]] = []
    for agent in agents:
        if runs and runs[-1][0].same_terms(agent):
            runs[-1].append(agent)
        else:
            runs.append([agent])
    groups, first = [], 0
    for run in runs:
        groups.append(AgentGroup(run, first, dynamics))
        first += len(run)
    return tuple(groups)
