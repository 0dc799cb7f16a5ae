"""`Translation`: a group's terms become a `Table` of numbers for the kernel."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from safe_inspect.environments.fused import codes
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray, IntArray

#: Where an element of an observation comes from: a code of `codes` and the index of a source or a place in the room.
Element = tuple[int, int]


@dataclass(frozen=True)
class Source:
    """One number of every agent, or the first of several, in a state.

    Attributes:
        array: Name of the array in the state.
        start: Index of the number in the first environment and for the group's first deputy.
        per_env: How far apart the numbers of two environments lie.
        per_agent: How far apart those of two agents lie.
    """

    array: str
    start: int
    per_env: int
    per_agent: int


@dataclass(frozen=True)
class Term:
    """A term of the reward: its code, a source or a place in the room, a count, its scale and another factor.

    The factor is one number or one for each agent of the group.
    """

    code: int = codes.FOREIGN
    place: int = 0
    count: int = 0
    scale: float = 0.0
    factor: FloatArray | float = 0.0


@dataclass(frozen=True)
class End:
    """What ends an episode: its code, a source or a place in the room, a count and a limit."""

    code: int = codes.FOREIGN
    place: int = 0
    count: int = 0
    limit: float = 0.0


@dataclass(frozen=True)
class Table:
    """What the kernel needs to know of a group's terms; see `kernel.judge`. `size` is the number of its agents, G."""

    size: int
    sources: tuple[Source, ...]
    room: int
    vectors: IntArray
    vector_limits: FloatArray
    elements: IntArray
    factors: FloatArray
    terms: IntArray
    scales: FloatArray
    burns: FloatArray
    dones: IntArray
    limits: FloatArray

    def places(self, state: State) -> IntArray:
        """Return the index of every source in the memory of a state and its distances, shape (S, 3).

        Raises:
            ValueError: A source lies outside its array: the kernel would read there without checking.
        """
        found = np.empty((len(self.sources), 3), dtype=np.int64)
        for index, source in enumerate(self.sources):
            array = state.arrays[source.array]
            last = source.start + (state.num_envs - 1) * source.per_env + (self.size - 1) * source.per_agent
            if state.num_envs and not 0 <= source.start <= last < array.size:
                raise ValueError(f"the source {source} lies outside its array, which has {array.size} numbers")
            start = state.start(source.array) // array.itemsize
            found[index] = start + source.start, source.per_env, source.per_agent
        return found


@dataclass
class Translation:
    """Collects the numbers of a group's table.

    Attributes:
        world: What does not change.
        group: The agents.
    """

    world: World
    group: Group
    _sources: list[Source] = field(default_factory=list)
    _vectors: dict[tuple[int, ...], tuple[int, float]] = field(default_factory=dict)
    _room: int = 0

    def source(self, array: str, start: int, per_env: int, per_agent: int = 0) -> int:
        """Return the index of a source."""
        source = Source(array, start, per_env, per_agent)
        if source not in self._sources:
            self._sources.append(source)
        return self._sources.index(source)

    def of_environment(self, array: str) -> int:
        """Return the source of an array with one number for each environment."""
        return self.source(array, 0, 1)

    def of_body(self, array: str, name: str | None, axis: int = 0) -> int:
        """Return the source of a body's vector, shape (N, B, 3); the own deputy's for None."""
        width = 3 * len(self.world.bodies)
        if name is None:
            return self.source(array, 3 * self.group.first + axis, width, 3)
        return self.source(array, 3 * self.world.bodies[name] + axis, width)

    def remembered(self, part: str, array: str, size: int) -> int:
        """Return the source of a declared array of a sensor, with `size` numbers for each agent."""
        return self.source(f"memory/{self.group.name}/{part}/{array}", 0, self.group.size * size, size)

    def vector(self, code: int, size: int, *numbers: int, limit: float = 0.0) -> int:
        """Return the place in the row's room of what an operation writes, `size` numbers."""
        key = (code, size, *numbers)
        known = self._vectors.get(key)
        while known is not None and known[1] != limit:  # the same but for its limit
            key = (*key, -1)
            known = self._vectors.get(key)
        if known is None:
            known = self._vectors[key] = self._room, limit
            self._room += size
        return known[0]

    def range_to(self, body: str | None) -> int:
        """Return the place of the distance to a body; to the origin of Hill's frame for None."""
        reference = -1 if body is None else self.of_body("position", body)
        return self.vector(codes.RANGE, 1, self.of_body("position", None), reference)

    def table(
        self,
        elements: list[tuple[int, int, bool, tuple[float, ...]]],
        terms: list[Term],
        dones: list[tuple[End, int, bool]],
    ) -> Table:
        """Return the table.

        Args:
            elements: Of each element of the observation code, index, whether it is mapped linearly, and four factors.
            terms: The terms of the reward.
            dones: The ends, each with its status and whether it truncates.
        """
        size = self.group.size
        vectors = [
            (key[0], place, key[1], *key[2:6], *[0] * (4 - len(key[2:6])))
            for key, (place, _) in self._vectors.items()
        ]  # fmt: skip
        return Table(
            size=size,
            sources=tuple(self._sources),
            room=self._room,
            vectors=np.array(vectors, dtype=np.int64).reshape(-1, 7),
            vector_limits=np.array([limit for _, limit in self._vectors.values()]),
            elements=np.array([item[:3] for item in elements], dtype=np.int64).reshape(-1, 3),
            factors=np.array([item[3] for item in elements], dtype=np.float64).reshape(-1, 4),
            terms=np.array([(t.code, t.place, t.count) for t in terms], dtype=np.int64).reshape(-1, 3),
            scales=np.array([term.scale for term in terms], dtype=np.float64),
            burns=np.array([np.broadcast_to(t.factor, size) for t in terms], dtype=np.float64).reshape(-1, size),
            dones=np.array([(e.code, e.place, e.count, *told) for e, *told in dones], dtype=np.int64).reshape(-1, 5),
            limits=np.array([end.limit for end, *_ in dones], dtype=np.float64),
        )
