"""Data about all deputies together: `TeamView` of one state, `TeamStep` from one state to the next.

Arrays have one row for each environment and an axis of deputies, in agent order.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from safe_inspect.geometry.neighbours import pair_distances
from safe_inspect.simulators.offers import offered
from safe_inspect.simulators.state import State
from safe_inspect.simulators.world import World
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

#: The name of the whole team in place of the name of a group of agents, in the keys of declared memory.
TEAM = "whole team"
#: The name of the team's safety filter in place of the name of a part, in the keys of declared memory.
TEAM_FILTER = "team safety filter"


class TeamView:
    """One state of N environments with D deputies. The arrays are read-only. SI units, Hill's frame.

    Attributes:
        writable: The state itself with writable arrays, for the environment and for compiled kernels.
        world: The constant data of the simulation.
    """

    def __init__(self, state: State, world: World) -> None:
        self.writable = state
        self.world = world

    def __getattr__(self, name: str) -> Any:
        """Return a value that a component of the task provides, such as ``sun_angle``."""
        return offered("team", name, self)

    @property
    def state(self) -> State:
        """The state, with read-only arrays."""
        return self.writable.read_only

    @property
    def num_envs(self) -> int:
        """Number of environments, N."""
        return self.writable.num_envs

    @property
    def position(self) -> FloatArray:
        """Position of each deputy [m], shape (N, D, 3)."""
        return self.state.position[:, : self.world.num_deputies]

    @property
    def velocity(self) -> FloatArray:
        """Velocity of each deputy [m/s], shape (N, D, 3)."""
        return self.state.velocity[:, : self.world.num_deputies]

    @property
    def control(self) -> FloatArray:
        """Thrust of each deputy held during the last step [N], shape (N, D, 3)."""
        return self.state.control

    @property
    def delta_v(self) -> FloatArray:
        """Velocity change that each deputy has spent in the episode [m/s], shape (N, D)."""
        return self.state.delta_v

    @property
    def step(self) -> IntArray:
        """Steps since the reset, shape (N,)."""
        return self.state.step

    @property
    def finished(self) -> AnyArray:
        """`DoneStatus` with which each deputy's agent has ended, 0 while it is running, int8, shape (N, D)."""
        return self.state.finished

    @cached_property
    def distance(self) -> FloatArray:
        """Distance between the deputies of every pair, in the order of `pairs` [m], shape (N, D (D - 1) / 2)."""
        deputies = self.world.num_deputies
        found = np.empty((self.num_envs, deputies * (deputies - 1) // 2))
        pair_distances(self.writable.position, deputies, found)
        found.setflags(write=False)
        return found

    @property
    def pairs(self) -> tuple[IntArray, IntArray]:
        """Indices of the deputies of every pair, as two arrays: 0-1, 0-2, ..., 1-2, ..."""
        return _pairs(self.world.num_deputies)

    def memory(self, array: str) -> AnyArray:
        """Return an array that the team's safety filter has declared, shape (N, ...)."""
        return self.state.memory[TEAM, TEAM_FILTER, array]


@dataclass
class TeamStep:
    """One step of all agents.

    Attributes:
        before: State at the start of the step.
        after: State at the end of the step, before any reset.
        fired: For each done function of the agents, by name, the mask of agents whose episode it ended in this step,
            shape (N, D).
        status: `DoneStatus` of each agent after its own done functions, including agents that ended earlier, shape (N,
            D).
        dt: Length of the step [s].
        has: For each done function of the agents, by name, the mask of agents that have it, shape (D,).
    """

    before: TeamView
    after: TeamView
    fired: Mapping[str, BoolArray]
    status: AnyArray
    dt: float
    has: Mapping[str, BoolArray]


@functools.lru_cache(maxsize=16)
def _pairs(deputies: int) -> tuple[IntArray, IntArray]:
    first, second = np.triu_indices(deputies, 1)
    first.flags.writeable = second.flags.writeable = False  # all callers share these arrays
    return first, second
