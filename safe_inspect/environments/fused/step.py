"""`FusedGroup`: observations, rewards and ends of a group of agents, computed mostly by the compiled kernel."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.environments.finite_checks import all_finite, require_finite
from safe_inspect.environments.fused import kernel
from safe_inspect.environments.fused.program import PlacedProgram, Program
from safe_inspect.environments.group import AgentGroup, StepOutcome
from safe_inspect.simulators import State, Step, View, World
from safe_inspect.simulators.row_terms.inputs import MemoryBase
from safe_inspect.simulators.row_terms.loops import address_of
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray


class FusedGroup:
    """Compiled computation of a step for a group; the results are bit-identical to those of `AgentGroup`.

    Args:
        group: The group.
        world: The constant data of the simulation.
    """

    def __init__(self, group: AgentGroup, world: World) -> None:
        self._group = group
        self._program = Program(group, world)
        self._term_count, self._done_count = len(group.agent.rewards), len(group.dones)
        self._readings = np.empty((0, self._program.width))
        self._placed: dict[int, PlacedProgram] = {}
        self._bases: dict[int, tuple[State, State, PlacedProgram, IntArray, Any]] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Exclude from copies the data that belong to the memory of this process and of the current states."""
        return self.__dict__ | {"_placed": {}, "_bases": {}, "_readings": self._readings[:0].copy()}

    @property
    def called_in_python(self) -> tuple[str, ...]:
        """Names of the rewards, dones, sensors and glues that are not defined by a row kernel."""
        program, group = self._program, self._group
        return (
            *(group.title(glue) for glue, _ in program.glues),
            *(sensor for sensor, _ in program.sensors),
            *(group.agent.rewards[index].name for index in program.rewards),
            *(group.dones[index].name for index in program.dones),
        )

    def observe(self, view: View, asked: BoolArray | None = None) -> AnyArray | None:
        """Return the observations, float32, shape (R, O); None if a value is not finite.

        Args:
            view: The state.
            asked: Mask of the requested observations, shape (R,); the others are NaN. Default: all.
        """
        state, program = view.writable, self._program
        placed = self._place(state)
        observation = np.empty((view.num_rows, program.size), dtype=np.float32)
        if program.glues or program.sensors:
            self._call_sensors(view, placed.readings)
        bases = _bases(state, state, placed)
        bases[MemoryBase.ASKED] = 0 if asked is None else address_of(asked)
        asked = np.ones(view.num_rows, dtype=np.bool_) if asked is None else asked
        finite = kernel.observe(
            placed.calls, bases, state.num_envs, program.factors, placed.readings, asked, observation
        )
        return observation if finite else None

    def evaluate_step(self, step: Step, asked: BoolArray | None = None) -> StepOutcome | None:
        """Return the result of a step; None if a value is not finite.

        Args:
            step: The step.
            asked: Mask of the requested observations, shape (R,). Those of agents that end are computed as well; the
                others are NaN. Default: all.
        """
        view, program = step.after, self._program
        rows = view.num_rows
        before, after = step.before.writable, view.writable
        known = self._bases.get(id(after))
        if known is None or known[0] is not after or known[1] is not before:
            placed = self._place(after)
            evaluate: Any = kernel.evaluate_step.dispatcher
            known = self._bases[id(after)] = after, before, placed, _bases(before, after, placed), evaluate
        _, _, placed, bases, evaluate = known
        observation = np.empty((rows, program.size), dtype=np.float32)
        values = np.empty((1 + self._term_count, rows))
        flags = np.empty((2 + self._done_count + 1, rows), dtype=np.bool_)
        flags[-1] = True if asked is None else asked
        bases[MemoryBase.ASKED] = 0 if asked is None else address_of(flags[-1])
        status = np.empty(rows, dtype=np.int8)
        if program.foreign:
            self._call(step, placed.readings, values, flags)
        if placed.intervening is not None:
            placed.intervening[:] = step.writable_intervening
        found: int = evaluate(
            placed.calls, bases, placed.endings, program.factors, placed.readings, observation, values, flags, status
        )
        if found & kernel.NOT_FINITE:
            return None
        if program.foreign:
            self._group.check_unobserved(view, before)
        return StepOutcome(observation, values, flags[:-1], status, bool(found & kernel.ENDED))

    def _place(self, state: State) -> PlacedProgram:
        """Return the program for a state; the locations of its inputs depend only on the number of environments."""
        found = self._placed.get(state.num_envs)
        if found is None or found.specs is not state.specs:
            rows = state.num_envs * self._group.size
            if len(self._readings) < rows:  # NaN, so that a reading that no kernel writes is detected
                self._readings = np.full((rows, self._program.width), np.nan)
            found = self._placed[state.num_envs] = self._program.place(state, self._readings)
        return found

    def _call(self, step: Step, readings: FloatArray, values: FloatArray, flags: BoolArray) -> None:
        """Call the plugins without a row kernel, and write their results where the kernel reads them."""
        self._call_sensors(step.after, readings)
        for index in self._program.rewards:
            values[1 + index] = self._group.term(self._group.agent.rewards[index], step)
        for index in self._program.dones:
            flags[2 + index] = self._group.fires(self._group.dones[index], step)

    def _call_sensors(self, view: View, readings: FloatArray) -> None:
        for glue, columns in self._program.glues:
            part = self._group.values(glue, view, columns.stop - columns.start)
            if not all_finite(part):
                require_finite(self._group.title(glue), part, view.state)
            readings[:, columns] = part
        for sensor, columns in self._program.sensors:
            readings[:, columns] = view.reading(sensor)


def _bases(before: State, after: State, placed: PlacedProgram) -> IntArray:
    """Return the start addresses of the memory that the terms read."""
    bases = np.zeros(len(MemoryBase), dtype=np.int64)
    bases[MemoryBase.AFTER], bases[MemoryBase.BEFORE] = address_of(after.floats), address_of(before.floats)
    bases[MemoryBase.READINGS] = address_of(placed.readings)
    if placed.intervening is not None:
        bases[MemoryBase.INTERVENING] = address_of(placed.intervening)
    return bases
