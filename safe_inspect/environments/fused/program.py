"""`Program`: the calls of the fused step's kernel for a group of agents, and the plugins that are called in Python."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.environments.fused import kernel
from safe_inspect.environments.group import AgentGroup
from safe_inspect.glues.normalizers import Affine
from safe_inspect.glues.observations import DerivedGlue, ObserveSensor
from safe_inspect.simulators import State, World
from safe_inspect.simulators.row_terms.inputs import GlueReading, Intervening, OwnArray, Scene
from safe_inspect.simulators.row_terms.loops import PlacedTerm, RowTerm, place_term
from safe_inspect.types import BoolArray, FloatArray, IntArray

_FLOAT = np.dtype(np.float64).itemsize


@njit
def _copy(number: int) -> int:
    """Return the argument."""
    return number


class TermCall(NamedTuple):
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
class PlacedProgram:
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


class Program:
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
        self._calls: list[TermCall] = [
            TermCall(kernel.STATUS, 0, RowTerm(_copy, (OwnArray("finished"),)), (np.int8, 0)),
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

    def place(self, state: State, readings: FloatArray) -> PlacedProgram:
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
        return PlacedProgram(
            np.array(calls, dtype=np.int64),
            np.array([*self._endings, (state.num_envs, len(observed))], dtype=np.int64),
            readings[:rows],
            np.zeros(rows, dtype=np.bool_) if asked else None,
            state.specs,
            tuple(terms),
        )

    def _observed(self) -> list[TermCall]:
        """Return the calls whose readings no reward or done uses, neither directly nor through another reading."""
        wanted: set[int] = set()
        observed = []
        for call in reversed(self._calls):
            if call.kind == kernel.READING and call.target not in wanted:
                observed.append(call)
            else:
                wanted |= {self._columns[reading.key].start for reading in call.term.read}
        return observed

    def _add(self, kind: int, plugins: list[Any]) -> list[int]:
        """Add rewards or dones; return the indices of those that are called in Python."""
        foreign = []
        for index, plugin in enumerate(plugins):
            term = plugin.row(self._world, self._group)
            if term is None:
                foreign.append(index)
            else:
                self._read(term)
                self._calls.append(TermCall(kind, index, term, plugin.row_result()))
        return foreign

    def _observe(self, glue: Any, columns: slice) -> None:
        """Add a glue that fills these columns of the observation."""
        self.factors[:, columns] = np.concatenate((np.ones(1), *Affine()))[:, None]
        if type(glue) is ObserveSensor:
            scale, _, low, high = glue.prepared(self._group.sensors[glue.sensor])
            affine = glue.normalization.affine(low, high)
            if affine is not None and self._call_sensor(glue.sensor, columns):
                for row, factor in enumerate((np.full(1, scale), *affine)):
                    self.factors[row, columns] = factor
                return
        if isinstance(glue, DerivedGlue):
            affine = glue.normalization.affine(*glue.limits(self._group.sensors))  # type: ignore[arg-type]
            if affine is not None and self._call_values(glue, columns):
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
                if not (is_plain and self._call_values(glue, columns)):
                    self.glues.append((glue, columns))
                self._columns[reading.key] = columns
            elif not self._call_sensor(reading.sensor, columns):
                self._columns[reading.key] = columns
                self.sensors.append((reading.sensor, columns))

    def _call_values(self, glue: DerivedGlue, columns: slice) -> bool:
        """Add the call of the row kernel of a glue's values; return whether there is one."""
        term = glue.row(self._world, self._group)
        if term is None:
            return False
        self._read(term)
        self._calls.append(TermCall(kernel.READING, columns.start, term, glue.row_result()))
        return True

    def _call_sensor(self, name: str, columns: slice) -> bool:
        """Add the call of a sensor; return whether it is defined by a row kernel."""
        sensor: Any = self._group.sensors[name]
        term = sensor.row(self._world, self._group)
        if term is None:
            return False
        self._read(term)
        self._columns.setdefault(name, columns)
        self._calls.append(TermCall(kernel.READING, columns.start, term, sensor.row_result()))
        return True

    def _take_columns(self, size: int) -> slice:
        self.width += size
        return slice(self.width - size, self.width)
