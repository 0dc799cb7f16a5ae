"""`InspectionEnv`: one environment with the interface of Gymnasium."""

from __future__ import annotations

import secrets
from typing import Any

import gymnasium

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.core import BatchedEnvironment, require_one_agent
from safe_inspect.environments.decisions import decide
from safe_inspect.environments.episodes import current_infos, info_row, step_info
from safe_inspect.environments.facades.arguments import (
    action_array,
    check_options,
    checked_gamma,
    checked_slot,
)
from safe_inspect.environments.facades.rendering import RENDER_FPS, RENDER_MODE, Rendered
from safe_inspect.environments.facades.spaces import action_space, box
from safe_inspect.errors import ArgumentError, SafeInspectError
from safe_inspect.types import Observation


class InspectionEnv(Rendered, gymnasium.Env[Observation, Any]):
    """One environment with one agent, for Gymnasium.

    The info of every step contains ``inspected_count``, ``inspected_fraction``, ``own_inspected_count``, ``delta_v``
    (of the episode [m/s]), ``status`` (the name of a `DoneStatus`, in lower case) and ``reward/NAME`` for every reward
    term. With a safety filter it also contains the values that `transition_info` lists, with ``rta/active`` as names,
    and ``desired_control`` and ``control`` [N].

    If actions set for how many control steps they hold (`CoastGlue`), a step is a decision: its reward is sum gamma^i
    r_i over its control steps, and info contains ``elapsed_steps`` and ``discount``, which is gamma^elapsed_steps.

    Args:
        spec: The task.
        slot: Global index of the environment slot.
        gamma: Discount per control step within a decision.
        render_mode: ``rgb_array``: `render` returns images; None: it raises an error.
    """

    metadata = {"render_modes": [RENDER_MODE], "render_fps": RENDER_FPS}  # noqa: RUF012 - as Gymnasium does

    def __init__(
        self, spec: EnvironmentSpec, *, slot: int = 0, gamma: float = 1.0, render_mode: str | None = None
    ) -> None:
        require_one_agent(spec, "InspectionEnv", "make_parallel")
        self.core = BatchedEnvironment(spec, 1, first_slot=checked_slot(slot, "slot"))
        self.observation_space = box(self.core.observation_layout)
        self.action_space = action_space(self.core.action_layout)
        self._seeded = self._running = False
        self._gamma = checked_gamma(gamma)
        self._draw_as(render_mode, self.core.team)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start a new episode.

        Args:
            seed: Restart with the first episode of this seed. Without a seed, the next episode of the current seed
                follows; a new environment draws a seed, `np_random_seed`.
            options: Must be None or empty; there are no options.

        Raises:
            ArgumentError: An option is given.
        """
        check_options(options)
        if seed is None and not self._seeded:
            seed = secrets.randbits(64)
        super().reset(seed=seed)
        self._seeded = True
        observation = self.core.reset(seed=seed)[0, 0]
        self._running = True
        if self._view is not None:
            self._view.begin()
        (info,) = current_infos(self.core.team)
        return observation, info_row(info | self.core.simulation.reset_info, 0)

    def close(self) -> None:
        """End the episode."""
        self._running = False

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold an action for one step, or until the decision has elapsed.

        Args:
            action: The action, shape (A,); clipped to its bounds unless it is discrete.

        Raises:
            ArgumentError: A discrete action is a fraction or out of range, or the action has the wrong shape.
            SafeInspectError: The episode has not started, is over, or was closed.
        """
        if not self._running:
            raise SafeInspectError("the episode has not begun or is over; call reset() first")
        array, mistake = action_array(action, self.action_space.shape)
        if mistake:
            raise ArgumentError(f"the action {mistake}")
        follow = None if self._view is None else self._view.follow
        decided = decide(self.core.team, (array[None, None],), self._gamma, follow=follow)
        (transition,), (infos,) = decided.groups, decided.infos
        terminated, truncated = bool(transition.terminated[0, 0]), bool(transition.truncated[0, 0])
        self._running = not (terminated or truncated)
        info = step_info(transition, infos, 0)
        return transition.observation[0, 0], float(transition.reward[0, 0]), terminated, truncated, info
