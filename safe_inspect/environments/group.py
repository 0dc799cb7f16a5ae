"""`AgentGroup`: agents with equal parts, glues, rewards and dones, which are computed together."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from safe_inspect.config.spec import AgentSpec
from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.quaternion import rotate_back
from safe_inspect.environments.finite_checks import all_finite, require_finite, require_shape
from safe_inspect.environments.layout import Layout, action_layout, observation_layout
from safe_inspect.environments.thrust import Thrusters
from safe_inspect.errors import ArgumentError, PluginValueError, SafeInspectError
from safe_inspect.glues.base import Glue, ObservationGlue
from safe_inspect.plugins.functor import Named
from safe_inspect.policies.base import SCRIPTED_POLICY, ScriptedPolicy, ThrustLimits, shortened
from safe_inspect.rewards.base import Reward
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.simulators.arrays import read_only
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import DECISION, REMAINING, Group, Step, View
from safe_inspect.types import AnyArray, BoolArray, FloatArray


class StepOutcome(NamedTuple):
    """Result of a step for the agents of a group; values of agents that had ended before the step are 0.

    Attributes:
        observation: Observations, float32, R * O numbers.
        values: Total reward, then each reward term, shape (1 + T, R).
        flags: Terminated, truncated, then the result of each of `AgentGroup.dones`, shape (2 + K, R).
        status: Statuses, int8, shape (R,).
        ended: Whether any status is not 0.
    """

    observation: AnyArray
    values: FloatArray
    flags: BoolArray
    status: AnyArray
    ended: bool


class AgentGroup:
    """Group of G agents, consecutive in agent order, with equal parts, glues, rewards and dones.

    Attributes:
        name: Name of the group: the agent's name, or those of the first and the last agent.
        agents: Names of the agents.
        policies: Name of each agent's policy.
        first: Index of the first deputy among all deputies.
        size: Number of agents, G.
        members: Indices of its deputies among all deputies.
        safety_filter: Safety filter of the agents' thrusts, if one is enabled.
        scripted: Whether a scripted policy controls the deputies, so that the caller gives no actions for them.
        group: Description of the group for views of the state.
        observation_layout: Layout of the observation of one agent.
        action_layout: Layout of the action of one agent.
        limits: Limits of the control that the controllers of one agent can produce.
        thrusters: Map from actions to control.
        dones: Done functions in the order of increasing precedence of their status: draw, win, lose.
        fused: Compiled implementation, if it is used; its methods return None where the group computes the result.
        remembering: Done functions with memory, by the name of their memory.
    """

    def __init__(self, specs: Sequence[AgentSpec], first: int, dynamics: Dynamics) -> None:
        agent = specs[0]
        self._turns_thrust = dynamics.turns_thrust
        self.agents = tuple(spec.name for spec in specs)
        self.policies = tuple(spec.policy for spec in specs)
        self.name = self.agents[0] if len(specs) == 1 else f"{self.agents[0]} to {self.agents[-1]}"
        self.agent = agent
        filters = [glue for glue in agent.action_glues if isinstance(glue, SafetyGlue) and glue.enabled]
        self.safety_filter = filters[0] if filters else None
        self.first, self.size, self.scripted = first, len(specs), agent.scripted_policy is not None
        self.members = slice(first, first + len(specs))
        self.remembering = {
            f"done {named.name}": named.functor
            for named in agent.dones
            if type(named.functor).remember is not DoneFunction.remember
        }
        self.observation_layout: Layout = observation_layout(agent)
        self.action_layout: Layout = action_layout(agent)
        decides = self.action_layout.coast is not None and not self.scripted
        self.group = Group(
            self.name,
            first,
            self.size,
            agent.sensors,
            self.safety_filter,
            agent.scripted_policy,
            self.remembering,
            decides=decides,
        )
        self.thrusters = Thrusters(agent, dynamics.control_size)
        corners = self.thrusters(np.stack((self.action_layout.low, self.action_layout.high)))
        self.limits = ThrustLimits(read_only(corners.min(axis=0)), read_only(corners.max(axis=0)))
        self._glues = agent.observation_glues
        self._sizes = [len(glue.names(agent.parts)) for glue in self._glues]
        observed = {getattr(glue, "sensor", None) for glue in self._glues}
        self._unobserved = [name for name in agent.sensors if name not in observed]
        order = (DoneStatus.DRAW, DoneStatus.WIN, DoneStatus.LOSE)
        self.dones = sorted(agent.dones, key=lambda named: order.index(named.functor.status))
        self.fused: Any = None  # a `FusedGroup`, which this module cannot import, because it imports this one
        self._idle = np.minimum(np.maximum(0.0, self.action_layout.low), self.action_layout.high)

    def require_needed(self, view: View) -> None:
        """Check that the task provides everything that a scripted policy reads.

        Raises:
            SafeInspectError: The task does not provide all that the policy declares as needed.
        """
        pilot = self.agent.scripted_policy
        if not isinstance(pilot, ScriptedPolicy):
            return
        offered = {*view.world.offers.view, *view.world.offers.world, *view.writable.arrays}
        lacking = [f"`{name}`" for name in pilot.needed() if name not in offered]
        if lacking:
            raise SafeInspectError(
                f"{pilot.registered_name} cannot fly {self.name}: it reads {', '.join(lacking)}, which this task "
                "does not have; use another policy or another task"
            )

    def command(self, action: AnyArray, view: View) -> tuple[FloatArray, FloatArray]:
        """Return the clipped actions, shape (R, A), and the control that they command [N, N m], shape (R, C).

        Raises:
            ArgumentError: An element of a discrete action is not a valid index.
            PluginValueError: The actions or the thrusts are not finite.
            ValueError: The shape of the actions is not (N, G, A).
        """
        layout = self.action_layout
        action = np.ascontiguousarray(action, dtype=np.float64)
        wanted = (view.writable.num_envs, self.size, layout.size)
        if action.shape != wanted:
            raise ValueError(f"the actions of {self.name} have the shape {action.shape}; expected {wanted}")
        coasting: BoolArray | None = None
        if self.group.decides:
            coasting = ~self.due(view.writable)
            action = np.where(coasting[:, :, None], self._idle, action)
        elif (found := self.thrusters.clipped(action, layout.low, layout.high)) is not None:
            return found
        action = action.reshape(view.num_rows, layout.size)
        if not all_finite(action):
            bad = int(np.flatnonzero(~np.isfinite(action).all(axis=1))[0])
            require_finite(f"the action of {self.agents[bad % self.size]}", action, view.state)
        if layout.choices:
            self._require_choices(action)
        else:
            action = np.minimum(np.maximum(action, layout.low), layout.high)
        thrust = self.thrusters(action)
        if coasting is not None:
            thrust[coasting.reshape(-1)] = 0.0
        if not all_finite(thrust):
            for glue, columns in self.thrusters.commands:
                require_finite(self.title(glue), glue(action[:, columns], self.agent.parts), view.state)
        return action, thrust

    def _require_choices(self, action: FloatArray) -> None:
        """Raise an error when an element of a discrete action, finite numbers of shape (R, A), is not a valid index."""
        layout = self.action_layout
        valid = np.minimum(np.maximum(np.rint(action), 0.0), layout.last_choices) == action
        if np.count_nonzero(valid) == valid.size:
            return
        row, element = (int(index) for index in np.argwhere(~valid)[0])
        raise ArgumentError(
            f"the action of {self.agents[row % self.size]} is invalid in environment {row // self.size}: "
            f"`{layout.names[element]}` is {action[row, element]:g}, "
            f"but must be a whole number from 0 to {layout.choices[element] - 1}"
        )

    def due(self, state: State) -> BoolArray:
        """Return a mask of the agents that take an action in the next step because their decision has elapsed.

        Its shape is (N, G).
        """
        if not self.group.decides:
            return np.ones((state.num_envs, self.size), dtype=np.bool_)
        remaining = state.memory[self.name, DECISION, REMAINING]
        return np.asarray(remaining == 0).reshape(state.num_envs, self.size)

    def follow(self, step: Step, before: State, after: State) -> None:
        """Write the number of control steps that are left of each agent's decision after a step."""
        coast = self.action_layout.coast
        assert coast is not None, "only groups that decide store their decisions"
        left = before.memory[self.name, DECISION, REMAINING]
        left = np.where(left == 0, coast.steps(step.action[:, -1]), left) - 1
        left[step.writable_intervening] = 0
        after.memory[self.name, DECISION, REMAINING][...] = left

    def fly(self, view: View) -> FloatArray:
        """Return the control of the scripted policy, within the limits [N, N m], shape (R, C).

        If the thrusters turn with the body, a thrust along Hill's axes is rotated into body axes at the current
        attitude. It is then shortened rather than clipped, so that its direction is preserved.
        """
        policy, size = self.agent.scripted_policy, self.thrusters.size
        assert policy is not None, "only scripted groups have a scripted policy"
        commands, limits = size if policy.commands_attitude else 3, self.limits
        if commands < size:
            limits = ThrustLimits(limits.low[:3], limits.high[:3])
        view.remembering = SCRIPTED_POLICY
        control = np.asarray(policy(view, limits), dtype=np.float64)
        view.remembering = None
        what = f"policy {policy.registered_name} of {self.name}"
        require_shape(what, control, (view.num_rows, commands))
        require_finite(what, control, view.state)
        if commands < size:
            thrust, control = control, np.zeros((view.num_rows, size))
            if self._turns_thrust:
                thrust = shortened(rotate_back(view.per_agent(view.state["orientation"]), thrust), limits)
            control[:, :3] = thrust
        return np.minimum(np.maximum(control, self.limits.low), self.limits.high)

    def observe(self, view: View) -> AnyArray:
        """Return the observations, float32, shape (N, G, O); a scripted group has observations without elements."""
        if self.fused is not None and (found := self.fused.observe(view)) is not None:
            seen: AnyArray = found.reshape(view.writable.num_envs, self.size, found.shape[-1])
            return seen
        glues = () if self.scripted else self._glues
        parts = [self.values(glue, view, size) for glue, size in zip(glues, self._sizes, strict=False)]
        observation = np.concatenate(parts, axis=-1) if parts else np.zeros((view.num_rows, 0))
        if not all_finite(observation):
            for glue, part in zip(glues, parts, strict=True):
                require_finite(self.title(glue), part, view.state)
        return observation.astype(np.float32).reshape(view.writable.num_envs, self.size, observation.shape[-1])

    def values(self, glue: ObservationGlue, view: View, size: int) -> AnyArray:
        """Return the values of a glue after a check of their shape, (R, size)."""
        values = glue(view)
        if values.shape != (view.num_rows, size):
            require_shape(self.title(glue), values, (view.num_rows, size))
        return values

    def evaluate_step(self, step: Step) -> StepOutcome:
        """Return the result of a step by calling every plugin in Python."""
        after, before, rows = step.after, step.before, step.after.num_rows
        observation = self.observe(after)
        values, status = np.zeros((1 + len(self.agent.rewards), rows)), np.zeros(rows, dtype=np.int8)
        flags = np.zeros((2 + len(self.dones), rows), dtype=np.bool_)
        for named, value in zip(self.agent.rewards, values[1:], strict=True):
            value[:] = self.term(named, step)
            values[0] += value
        if not all_finite(values[0]):
            for named, value in zip(self.agent.rewards, values[1:], strict=True):
                require_finite(f"reward {named.name}", value, after.state, before.state)
        for done, fired in zip(self.dones, flags[2:], strict=True):
            fired[:] = self.fires(done, step)
            status[fired] = done.functor.status
            flags[int(done.functor.truncates)] |= fired
        flags[1] &= ~flags[0]
        self.check_unobserved(after, before.state)
        out = before.finished != 0
        values[:, out], flags[:, out], status[out] = 0.0, False, before.finished[out]
        return StepOutcome(observation, values, flags, status, bool(np.count_nonzero(status)))

    def term(self, named: Named[Reward], step: Step) -> FloatArray:
        """Return a reward term, float64, after a check of its shape, (R,)."""
        what, value = f"reward {named.name}", named.functor(step)
        if value is None:
            raise PluginValueError(f"{what} gave None; return an array of numbers")
        try:
            term = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise PluginValueError(f"{what} gave {str(value)[:80]!r}; expected an array of numbers") from None
        require_shape(what, term, (step.after.num_rows,))
        return term

    def fires(self, named: Named[DoneFunction], step: Step) -> BoolArray:
        """Return the result of a done function after a check of its shape, (R,)."""
        done = np.asarray(named.functor(step), dtype=np.bool_)
        require_shape(f"done {named.name}", done, (step.after.num_rows,))
        return done

    def check_unobserved(self, after: View, before: State) -> None:
        """Raise an error when a sensor that only rewards and dones read gave NaN, which silently compares as false."""
        for name in self._unobserved:
            if name in after.readings:
                require_finite(f"sensor {name}", after.readings[name], after.state, before)

    def title(self, glue: Glue) -> str:
        """Return the name of a glue for messages: its class and the elements that it observes or commands."""
        return f"glue {glue.registered_name} ({', '.join(glue.names(self.agent.parts))})"


def group_agents(agents: Sequence[AgentSpec], dynamics: Dynamics) -> tuple[AgentGroup, ...]:
    """Return the groups of agents. Consecutive agents with equal terms are computed together in one group.

    Args:
        agents: The agents.
        dynamics: Their dynamics.
    """
    starts = [k for k, agent in enumerate(agents) if k == 0 or not agents[k - 1].same_terms(agent)]
    return tuple(AgentGroup(agents[a:b], a, dynamics) for a, b in pairwise([*starts, len(agents)]))
