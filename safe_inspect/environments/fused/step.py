"""`FusedGroup`: observations, rewards and ends of a group of agents, most of them by the kernel."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.environments.fused import codes, kernel
from safe_inspect.environments.fused.command import command
from safe_inspect.environments.fused.table import Element, Table, Translation
from safe_inspect.environments.fused.translators import elements_of, end_of, term_of
from safe_inspect.environments.group import AgentGroup, Judged
from safe_inspect.environments.guard import all_finite, require_finite, require_shape
from safe_inspect.glues.normalizers import LinearNormalizer, StandardNormalNormalizer
from safe_inspect.glues.observe_sensor import ObserveSensor
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import Step, View
from safe_inspect.simulators.world import World
from safe_inspect.types import AnyArray, BoolArray, FloatArray


class FusedGroup:
    """Works out what a step gives for a group, the same to the bit as `AgentGroup` with its plugins.

    Args:
        group: The group.
        world: What does not change.
    """

    def __init__(self, group: AgentGroup, world: World) -> None:
        self._group, self._world = group, world
        self._glues: list[tuple[Any, slice]] = []
        translation = Translation(world, group.group)
        elements = self._translate_observation(translation)
        terms = [term_of(named.functor, translation) for named in group.agent.rewards]
        ends = [end_of(named.functor, translation) for named in group.dones]
        kinds = [(int(named.functor.status), named.functor.truncates) for named in group.dones]
        self._table: Table = translation.table(
            elements, terms, [(end, *kind) for end, kind in zip(ends, kinds, strict=True)]
        )
        self._rewards = [
            (1 + index, named)
            for index, (named, term) in enumerate(zip(group.agent.rewards, terms, strict=True))
            if term.code == codes.FOREIGN
        ]
        self._dones = [
            (2 + index, named)
            for index, (named, end) in enumerate(zip(group.dones, ends, strict=True))
            if end.code == codes.FOREIGN
        ]
        self._foreign = bool(self._glues or self._rewards or self._dones)
        self._size, self._term_count, self._done_count = len(elements), len(terms), len(ends)
        self._bound: dict[int, tuple[State, tuple[Any, ...], tuple[Any, ...]]] = {}
        self._places: dict[int, AnyArray] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Leave out of copies what belongs to the memory of the states at hand."""
        return self.__dict__ | {"_bound": {}, "_places": {}}

    def command(self, action: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return the actions within their bounds, shape (R, A), and their thrusts [N], shape (R, 3).

        None when the controllers are no plain ones, or an action is not finite.

        Args:
            action: Actions of the right shape, (N, G, A), contiguous.
        """
        plain = self._group.thrusters.plain
        if plain is None:
            return None
        axes, least, most = plain
        if not action.flags.writeable:
            action = action.copy()  # another type for Numba, which would compile the kernel again
        rows = len(action) * self._group.size
        clipped, thrust = np.empty((rows, len(axes))), np.empty((rows, 3))
        layout = self._group.action_layout
        finite = command(action, layout.low, layout.high, least, most, axes, clipped, thrust)
        return (clipped, thrust) if finite else None

    def observe(self, view: View) -> AnyArray | None:
        """Return the observations, float32, shape (R, O); None when something is not finite."""
        observation = np.empty((view.num_rows, self._size), dtype=np.float32)
        self._call_glues(view, observation)
        state, table, group = view.writable, self._table, self._group
        finite = kernel.observe(
            state.floats,
            state.wholes,
            state.position,
            state.velocity,
            self._world.num_deputies,
            group.first,
            group.size,
            self._places_of(state),
            table.vectors,
            table.vector_limits,
            table.room,
            table.elements,
            table.factors,
            observation,
        )
        return observation if finite else None

    def judge(self, step: Step) -> Judged | None:
        """Return what a step gives; None when something is not finite."""
        view = step.after
        rows = view.num_rows
        observation = np.empty((rows, self._size), dtype=np.float32)
        values = np.empty((1 + self._term_count, rows))
        flags = np.empty((2 + self._done_count, rows), dtype=np.bool_)
        status = np.empty(rows, dtype=np.int8)
        if self._foreign:
            self._call(step, observation, values, flags)
        before, after = step.before.writable, view.writable
        known = self._bound.get(id(after))
        if known is None or known[0] is not after:
            known = self._bound[id(after)] = self._bind(before, after)
        _, fixed, rest = known
        work: Any = kernel.judge
        found: int = work(*fixed, step.writable_intervening, *rest, observation, values, flags, status)
        if found & kernel.NOT_FINITE:
            return None
        if self._foreign:
            self._group.check_unobserved(view, before)
        return Judged(observation, values, flags, status, bool(found & kernel.ENDED))

    def _bind(self, before: State, after: State) -> tuple[State, tuple[Any, ...], tuple[Any, ...]]:
        """Return the arguments that a step into a state has again and again."""
        group, table = self._group, self._table
        fixed = (
            after.floats,
            after.wholes,
            before.floats,
            before.wholes,
            after.position,
            after.velocity,
            after.control,
            after.finished,
            after.start("step") // 8,
            group.first,
            group.size,
        )
        rest = (
            self._places_of(after),
            table.vectors,
            table.vector_limits,
            table.room,
            table.elements,
            table.factors,
            table.terms,
            table.scales,
            table.burns,
            table.dones,
            table.limits,
        )
        return after, fixed, rest

    def _places_of(self, state: State) -> AnyArray:
        """Return where the sources lie in a state: it depends on its number of environments alone."""
        found = self._places.get(state.num_envs)
        if found is None:
            found = self._places[state.num_envs] = self._table.places(state)
        return found

    def _call(self, step: Step, observation: AnyArray, values: FloatArray, flags: BoolArray) -> None:
        """Call the plugins that the kernel does not know, and write what they give where the kernel reads it."""
        self._call_glues(step.after, observation)
        rows = (step.after.num_rows,)
        for index, named in self._rewards:
            value = np.asarray(named.functor(step), dtype=np.float64)
            if value.shape != rows:
                require_shape(f"reward {named.name}", value, rows)
            values[index] = value
        for index, ending in self._dones:
            done = np.asarray(ending.functor(step), dtype=np.bool_)
            if done.shape != rows:
                require_shape(f"done {ending.name}", done, rows)
            flags[index] = done

    def _call_glues(self, view: View, observation: AnyArray) -> None:
        for glue, columns in self._glues:
            part = glue(view)
            shape = (view.num_rows, columns.stop - columns.start)
            if part.shape != shape:
                require_shape(self._group.title(glue), part, shape)
            if not all_finite(part):
                require_finite(self._group.title(glue), part, view.state)
            observation[:, columns] = part

    def _translate_observation(self, to: Translation) -> list[tuple[int, int, bool, tuple[float, ...]]]:
        elements: list[tuple[int, int, bool, tuple[float, ...]]] = []
        for glue in () if self._group.scripted else self._group.agent.observation_glues:
            found = _observed(glue, to) if type(glue) is ObserveSensor else None
            if found is None:
                size = len(glue.names(self._group.agent.parts))
                self._glues.append((glue, slice(len(elements), len(elements) + size)))
                found = [(codes.FOREIGN, 0, False, (0.0, 0.0, 0.0, 0.0))] * size
            elements += found
        return elements


def _observed(glue: ObserveSensor, to: Translation) -> list[tuple[int, int, bool, tuple[float, ...]]] | None:
    """Return the elements of a glue with their factors; None when its sensor or its normaliser has no translation."""
    sensor = to.group.sensors[glue.sensor]
    scale, normalizer, low, high = glue.prepared(sensor)
    size = len(low)
    none = np.zeros(size)
    if normalizer is None:
        factors = (np.zeros(size), np.ones(size), none)
    elif type(normalizer) is StandardNormalNormalizer:
        mu, sigma = (np.broadcast_to(array, size) for array in normalizer.arrays)
        factors = (mu, sigma, none)
    elif type(normalizer) is LinearNormalizer:
        slope = (normalizer.maximum - normalizer.minimum) / (high - low)
        factors = (low, slope, np.full(size, normalizer.minimum))
    else:
        return None
    read: list[Element] | None = elements_of(sensor, to)
    if read is None:
        return None
    linear = type(normalizer) is LinearNormalizer
    return [
        (code, index, linear, (scale, *(float(factor[e]) for factor in factors)))
        for e, (code, index) in enumerate(read)
    ]
