"""`FusedGroup`: observations, rewards and ends of a group of agents, computed mostly by one compiled kernel.

The kernel calls the row terms of the agents one after the other: a sensor, reward or done function that is defined by a
row kernel is called by the address of its loop. Every other plugin is called in Python as usual, and its result is
passed to the kernel. The numbers are bit-identical in both cases.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.environments import fused_kernel as kernel
from safe_inspect.environments.finite_checks import all_finite, require_finite
from safe_inspect.environments.group import AgentGroup, StepOutcome
from safe_inspect.glues.normalizers import Affine
from safe_inspect.glues.observations import DerivedGlue, ObserveSensor
from safe_inspect.simulators import State, Step, View, World
from safe_inspect.simulators.row_loops import PlacedTerm, address_of, place_term
from safe_inspect.simulators.row_terms import GlueReading, Intervening, MemoryBase, OwnArray, RowTerm, Scene
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

_FLOAT = np.dtype(np.float64).itemsize


@njit
def _copy(number: int) -> int:
    """Return the argument."""
    return number


class _TermCall(NamedTuple):
    """A row term that the kernel calls.

    Attributes:
        kind: Kind of its result: `kernel.READING`, `REWARD`, `DONE` or `STATUS`.
        target: Index of the first column of the readings, or of the reward or done.
        term: The term.
        result: Type of the elements of its result, and their number if its kernel writes them.
    """

    kind: int
    target: int
    term: RowTerm
    result: tuple[type[Any], int]


@dataclass(frozen=True, eq=False)
class _PlacedProgram:
    """A program for states of one size.

    Attributes:
        calls: See `kernel.evaluate_step`; likewise `endings` and `readings`.
        endings: Statuses of the dones.
        readings: The readings, shape (R, S).
        intervening: Input of the terms: mask of the rows in which a safety filter changed the thrust, shape (R,); None
            if no term reads it.
        specs: The arrays of the states.
        terms: The terms at the addresses in `calls`; the references keep the memory alive.
    """

    calls: IntArray
    endings: IntArray
    readings: FloatArray
    intervening: BoolArray | None
    specs: Any
    terms: tuple[PlacedTerm, ...]


class _Program:
    """The calculations of every step for a group.

    Args:
        group: The group.
        world: The constant data of the simulation.

    Attributes:
        size: Number of elements of an observation, O.
        width: Number of columns of the readings, S.
        factors: Scale and affine map of each element of an observation, shape (5, O).
        glues: Glues that are called in Python, and their columns.
        sensors: Sensors that are called in Python because a row term reads them, and their columns.
        rewards: Indices of the rewards that are called in Python.
        dones: Indices of the dones that are called in Python.
    """

    def __init__(self, group: AgentGroup, world: World) -> None:
        self._group, self._world = group.group, world
        self._calls: list[_TermCall] = [
            _TermCall(kernel.STATUS, 0, RowTerm(_copy, (OwnArray("finished"),)), (np.int8, 0))
        ]
        self._columns: dict[str, slice] = {}
        self.glues: list[tuple[Any, slice]] = []
        self.sensors: list[tuple[str, slice]] = []
        self.width = 0
        glues = () if group.scripted else group.agent.observation_glues
        columns = [self._take_columns(len(glue.names(group.agent.parts))) for glue in glues]
        self.size = self.width
        self.factors = np.empty((5, self.size))
        for glue, own in zip(glues, columns, strict=True):
            self._observe(glue, own)
        self.rewards = self._add(kernel.REWARD, [named.functor for named in group.agent.rewards])
        self.dones = self._add(kernel.DONE, [named.functor for named in group.dones])
        self.foreign = bool(self.glues or self.sensors or self.rewards or self.dones)
        self._endings = [(int(named.functor.status), int(named.functor.truncates)) for named in group.dones]

    def place(self, state: State, readings: FloatArray) -> _PlacedProgram:
        """Return the program for states of the same size as the given one.

        Args:
            state: A state of that size.
            readings: Memory for the readings, of shape (R, `width`) or with further rows.

        Raises:
            ValueError: An input is not in the memory of the state; the kernel reads it without a check.
        """
        scene = Scene(self._world, self._group, state, self._columns, self.width)
        rows, terms, calls = state.num_envs * self._group.size, [], []
        observed = self._observed()
        for call in sorted(self._calls, key=lambda call: call in observed):
            dtype, size = call.result
            stride = _FLOAT * self.width if call.kind == kernel.READING else np.dtype(dtype).itemsize
            placed = place_term(call.term, scene, dtype, stride, size)
            terms.append(placed)
            calls.append((call.kind, call.target, placed.address, placed.table_address))
        asked = any(isinstance(given, Intervening) for call in self._calls for given in call.term.inputs)
        return _PlacedProgram(
            np.array(calls, dtype=np.int64),
            np.array([*self._endings, (state.num_envs, len(observed))], dtype=np.int64),
            readings[:rows],
            np.zeros(rows, dtype=np.bool_) if asked else None,
            state.specs,
            tuple(terms),
        )

    def _observed(self) -> list[_TermCall]:
        """Return the calls whose readings no reward or done uses, neither directly nor through another reading."""
        wanted: set[int] = set()
        observed = []
        for call in reversed(self._calls):
            if call.kind == kernel.READING and call.target not in wanted:
                observed.append(call)
            else:
                wanted |= {self._columns[reading.key].start for reading in call.term.read}
        return observed

    def _call(self, kind: int, target: int, plugin: Any) -> bool:
        """Add the call of a plugin's row kernel, and of what it reads; return whether the plugin has one."""
        term = plugin.row(self._world, self._group)
        if term is not None:
            self._read(term)
            self._calls.append(_TermCall(kind, target, term, plugin.row_result()))
        return term is not None

    def _add(self, kind: int, plugins: list[Any]) -> list[int]:
        """Add rewards or dones; return the indices of those that are called in Python."""
        return [index for index, plugin in enumerate(plugins) if not self._call(kind, index, plugin)]

    def _observe(self, glue: Any, columns: slice) -> None:
        """Add a glue that fills these columns of the observation."""
        self.factors[:, columns] = np.concatenate((np.ones(1), *Affine()))[:, None]
        if type(glue) is ObserveSensor:
            sensor = self._group.sensors[glue.sensor]
            scale, _, low, high = glue.prepared(sensor)
            affine = glue.normalization.affine(low, high)
            if affine is not None and self._call(kernel.READING, columns.start, sensor):
                self._columns.setdefault(glue.sensor, columns)
                for row, factor in enumerate((np.full(1, scale), *affine)):
                    self.factors[row, columns] = factor
                return
        if isinstance(glue, DerivedGlue):
            affine = glue.normalization.affine(*glue.limits(self._group.sensors))  # type: ignore[arg-type]
            if affine is not None and self._call(kernel.READING, columns.start, glue):
                for row, factor in enumerate(affine, 1):
                    self.factors[row, columns] = factor
                return
        self.glues.append((glue, columns))

    def _read(self, term: RowTerm) -> None:
        """Reserve columns of the matrix of readings for what a term reads, and add the calls that fill them.

        Readings that already have columns are not computed again.
        """
        for reading in term.read:
            if reading.key in self._columns:
                continue
            columns = self._take_columns(reading.size_of(self._group))
            if isinstance(reading, GlueReading):
                glue = reading.glue
                is_plain = isinstance(glue, DerivedGlue) and glue.normalization.active is None
                if not (is_plain and self._call(kernel.READING, columns.start, glue)):
                    self.glues.append((glue, columns))
            elif not self._call(kernel.READING, columns.start, self._group.sensors[reading.sensor]):
                self.sensors.append((reading.sensor, columns))
            self._columns[reading.key] = columns

    def _take_columns(self, size: int) -> slice:
        self.width += size
        return slice(self.width - size, self.width)


class FusedGroup:
    """Compiled computation of a step for a group; the results are bit-identical to those of `AgentGroup`.

    Args:
        group: The group.
        world: The constant data of the simulation.
    """

    def __init__(self, group: AgentGroup, world: World) -> None:
        self._group = group
        self._program = _Program(group, world)
        self._term_count, self._done_count = len(group.agent.rewards), len(group.dones)
        self._readings = np.empty((0, self._program.width))
        self._placed: dict[int, _PlacedProgram] = {}
        self._bases: dict[int, tuple[State, State, _PlacedProgram, IntArray, Any]] = {}

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

    def _place(self, state: State) -> _PlacedProgram:
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


def _bases(before: State, after: State, placed: _PlacedProgram) -> IntArray:
    """Return the start addresses of the memory that the terms read."""
    bases = np.zeros(len(MemoryBase), dtype=np.int64)
    bases[MemoryBase.AFTER], bases[MemoryBase.BEFORE] = address_of(after.floats), address_of(before.floats)
    bases[MemoryBase.READINGS] = address_of(placed.readings)
    if placed.intervening is not None:
        bases[MemoryBase.INTERVENING] = address_of(placed.intervening)
    return bases
