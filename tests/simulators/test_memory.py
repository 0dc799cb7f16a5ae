"""How states lie in memory, how rows of them are copied, kept and found by kernels, and what is refused."""

from __future__ import annotations

import pickle
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.compiling import njit
from safe_inspect.dynamics import Dynamics
from safe_inspect.simulators.arrays import for_kernel, read_only
from safe_inspect.simulators.offers import Offers, OfTeam, OfView, OwnOfView
from safe_inspect.simulators.prefetch import InitialStatePrefetcher
from safe_inspect.simulators.row_loops import _check, place_term
from safe_inspect.simulators.row_terms import (
    AgentParameter,
    BodyArray,
    EnvironmentArray,
    Intervening,
    MemoryBase,
    OwnArray,
    RowTerm,
    Scene,
    SensorMemory,
    SensorReading,
    own_estimate,
    place_of,
)
from safe_inspect.simulators.state import State, base_specs
from safe_inspect.simulators.view import Group, Step, View
from safe_inspect.simulators.world import World
from safe_inspect.types import ArraySpec

ENVS, DEPUTIES, BODIES = 5, 3, 4
SPECS = {
    **base_specs(BODIES, DEPUTIES, 6, Dynamics.arrays),
    "wide": ArraySpec((2, 3), np.float32, 7.5),
    "memory/some/sensor/seen": ArraySpec((2, 3), np.int16, -3),
    "points/chief/weights": ArraySpec((4,), np.float64, 0.25, constant=True),
    "points/chief/inspector": ArraySpec((4,), np.int8, -1),
}


def filled(count: int = ENVS, first: int = 0) -> State:
    """Return a state in which every number says its place."""
    state = State(count, SPECS)
    for index, array in enumerate(state.arrays.values()):
        array[...] = (first + index + np.arange(array.size)).reshape(array.shape) % 100
    return state


def test_every_state_has_these_arrays() -> None:
    shapes = {name: (spec.shape, np.dtype(spec.dtype).name, spec.fill, spec.constant) for name, spec in SPECS.items()}
    assert list(shapes.items())[:9] == [
        ("time", ((), "float64", 0.0, False)), ("step", ((), "int64", 0.0, False)), ("key", ((), "uint64", 0.0, True)),
        ("position", ((4, 3), "float64", 0.0, False)), ("velocity", ((4, 3), "float64", 0.0, False)),
        ("control", ((3, 6), "float64", 0.0, False)), ("delta_v", ((3,), "float64", 0.0, False)),
        ("interventions", ((3,), "int64", 0.0, False)), ("finished", ((3,), "int8", 0.0, False)),
    ]  # fmt: skip
    state = State(ENVS, SPECS)
    for name, spec in SPECS.items():
        assert state[name].shape == (ENVS, *spec.shape)
        assert (state[name] == spec.fill).all()
        assert state[name].dtype == spec.dtype


def test_arrays_lie_behind_each_other_at_multiples_of_64_bytes() -> None:
    state, start = State(ENVS, SPECS), 0
    for name, spec in SPECS.items():
        if spec.constant:
            with pytest.raises(ValueError, match=f"the array {name} does not lie in the common memory of the state"):
                state.start(name)
            continue
        assert state.start(name) == start
        start += -(-state[name].nbytes // 64) * 64
    assert (state.floats.nbytes, state.floats.dtype) == (start, np.float64)
    state.arrays["time"] = np.zeros(ENVS)
    with pytest.raises(ValueError, match="the array time does not lie in the common memory"):
        state.start("time")
    state.arrays["time"] = state.position[:, 0, 0]
    with pytest.raises(ValueError, match="the array time does not lie in the common memory"):
        state.start("time")


def test_owned_and_remembered_arrays_have_their_own_names() -> None:
    state = filled()
    assert state.points["chief"].inspector is state["points/chief/inspector"]
    assert state.wide is state["wide"]
    assert vars(state)["points"] is state.owned["points"]  # found at once, in every step
    remembered = state.memory["some", "sensor", "seen"]
    np.testing.assert_array_equal(remembered, state["memory/some/sensor/seen"].reshape(2 * ENVS, 3))
    shown = state.read_only
    assert not shown.position.flags.writeable
    assert not shown.points["chief"].inspector.flags.writeable
    assert not shown.memory["some", "sensor", "seen"].flags.writeable
    assert not shown["wide"].flags.writeable
    assert shown.num_envs == ENVS
    state.position[2, 1, 0] = -1.0
    assert shown.position[2, 1, 0] == -1.0
    for name in ("widt", "poitns"):
        with pytest.raises(AttributeError, match=f"the state of this task has no '{name}'"):
            getattr(state, name)


def same(one: State, rows: Any, other: State, their_rows: Any) -> bool:
    return all(np.array_equal(one[name][rows], other[name][their_rows]) for name in SPECS)


def test_rows_are_taken_and_put() -> None:
    whole, part = filled(), filled(2, first=50)
    before = filled()
    taken = whole.take(np.array([4, -5, 2]))
    assert same(taken, slice(None), whole, [4, 0, 2])
    again = whole.take(np.array([1, 2, 3]), taken)
    assert again is taken
    assert same(taken, slice(None), whole, [1, 2, 3])
    whole.put(np.array([-1, 1]), part)
    assert same(whole, [4, 1], part, slice(None))
    assert same(whole, [0, 2, 3], before, [0, 2, 3])
    for rows in ([5, 0], [-6, 0]):
        with pytest.raises(IndexError) as refusal:
            whole.put(np.array(rows), part)
        assert str(refusal.value) == f"there are 5 environments, numbered from 0; got {rows}"
    assert whole.take(np.zeros(0, np.int64)).num_envs == 0
    other = State(ENVS, SPECS, whole)
    assert other["points/chief/weights"] is whole["points/chief/weights"]
    other.copy_from(whole)
    assert same(other, slice(None), whole, slice(None))
    copied = pickle.loads(pickle.dumps(whole))
    assert same(copied, slice(None), whole, slice(None))
    copied.position[0] = -9.0
    assert (whole.position[0] != -9.0).all()
    assert copied.start("wide") == whole.start("wide")
    assert whole.whole_rows is None


@pytest.mark.parametrize(("count", "depth"), [(1, 32), (5, 6), (32, 1), (33, 1), (100, 1)])
def test_initial_states_are_drawn_for_some_episodes_at_a_time(count: int, depth: int) -> None:
    """Every state that is taken is that of its row and episode, whatever the order, and is drawn once."""
    drawn: list[tuple[int, int]] = []

    def draw(rows: np.ndarray, episodes: np.ndarray) -> tuple[State, dict[str, np.ndarray]]:
        drawn.extend(zip(rows.tolist(), episodes.tolist(), strict=True))
        state = State(len(rows), SPECS)
        state.time[...], state.key[...] = 1000.0 * rows + episodes, rows
        return state, {"tries": 7 * rows + episodes}

    kept, episodes = InitialStatePrefetcher(count, SPECS, draw), np.full(count, -1)
    generator, expected = np.random.default_rng(count), np.full(count, -1)
    for turn in range(12):
        rows = np.flatnonzero(generator.random(count) < 0.6) if turn else np.arange(count)
        expected[rows] += 1
        state, statistics = kept.take(rows, episodes)
        np.testing.assert_array_equal(episodes, expected)
        np.testing.assert_array_equal(state.time, 1000.0 * rows + expected[rows])
        np.testing.assert_array_equal(state.key, rows)
        np.testing.assert_array_equal(statistics["tries"], 7 * rows + expected[rows])
        if turn == 0:
            assert len(drawn) == count * depth
    assert len(set(drawn)) == len(drawn)
    assert len(drawn) >= (expected + 1).sum()
    before = len(drawn)
    kept.forget()
    kept.take(np.arange(count), episodes)
    assert len(drawn) == before + count * depth


def scene(first: int = 1, size: int = 2) -> Scene:
    names = tuple(f"blue{k}" for k in range(DEPUTIES))
    bodies = {name: k for k, name in enumerate((*names, "chief"))}
    world = World(names, bodies, np.full(DEPUTIES, 12.0), 10.0)
    return Scene(world, Group("some", first, size, {}), filled(), {"radar": slice(3, 5)}, 9)


def read(place: Any, memory: np.ndarray, env: int, agent: int) -> np.ndarray:
    """Return what a kernel reads at a place, as the generated loops do."""
    steps = [place.strides[axis] if place.shape[axis] > 1 else 0 for axis in (0, 1)]
    at, count = place.offset + env * steps[0] + agent * steps[1], int(np.prod(place.shape[2:], dtype=np.int64))
    raw = memory.view(np.uint8).ravel()[at : at + count * place.dtype.itemsize]
    return np.asarray(raw.view(place.dtype).reshape(place.shape[2:]))


@pytest.mark.parametrize(("first", "size"), [(0, 1), (1, 2), (0, 3), (2, 1)])
def test_inputs_of_a_kernel_lie_where_the_arrays_do(first: int, size: int) -> None:
    where = scene(first, size)
    state = where.state
    readings = np.arange(float(ENVS * size * 9)).reshape(ENVS * size, 9)
    for env in range(ENVS):
        for agent in range(size):
            for given, base, expected in (
                (OwnArray("position"), MemoryBase.AFTER, state.position[env, first + agent]),
                (OwnArray("control", before=True), MemoryBase.BEFORE, state.control[env, first + agent]),
                (OwnArray("finished"), MemoryBase.AFTER, state.finished[env, first + agent]),
                (BodyArray("velocity", "chief"), MemoryBase.AFTER, state.velocity[env, 3]),
                (BodyArray("velocity", "blue1", True), MemoryBase.BEFORE, state.velocity[env, 1]),
                (EnvironmentArray("time"), MemoryBase.AFTER, state.time[env]),
                (EnvironmentArray("wide", True), MemoryBase.BEFORE, state.wide[env]),
            ):
                place = place_of(given, where)
                assert place.base == base
                np.testing.assert_array_equal(read(place, state.floats, env, agent), expected)
            place = place_of(SensorReading("radar"), where)
            assert place.base == MemoryBase.READINGS
            np.testing.assert_array_equal(read(place, readings, env, agent), readings[env * size + agent, 3:5])
    place = place_of(Intervening(), where)
    assert (place.base, place.offset) == (MemoryBase.INTERVENING, 0)
    assert (place.shape, place.strides) == ((ENVS, size), (size, 1))
    own = place_of(AgentParameter(np.arange(6.0).reshape(3, 2)), where)
    assert (own.base, own.shape, own.strides[1:]) == (MemoryBase.ABSOLUTE, (1, 3, 2), (16, 8))
    for number in (2.5, True, 3, np.arange(4.0)):
        place = place_of(number, where)
        assert place.shape[:2] == (1, 1)
        np.testing.assert_array_equal(place.keeps[0, 0], number)
    seen = place_of(SensorMemory("sensor", "seen"), scene(1, 2))
    np.testing.assert_array_equal(read(seen, state.floats, 3, 1), state["memory/some/sensor/seen"][3, 1])


@njit
def _nothing(given: object) -> float:
    return 0.0


def test_inputs_that_no_kernel_can_read_are_refused() -> None:
    where = scene()
    with pytest.raises(AttributeError, match="the state of this task has no 'positon'; did you mean `position`"):
        place_of(OwnArray("positon"), where)
    with pytest.raises(ValueError, match="a sensor sees one state, and no step; it cannot be given OwnArray"):
        place_term(RowTerm(_nothing, (OwnArray("position", before=True),)), where, float, 8, 3)
    with pytest.raises(ValueError, match="a sensor sees one state, and no step; it cannot be given Intervening"):
        place_term(RowTerm(_nothing, (Intervening(),)), where, float, 8, 3)
    for values in (np.zeros((3, 2)), np.zeros((1, 2))[:, ::2].repeat(3, axis=0)):
        with pytest.raises(ValueError, match=r"(?s)a row kernel cannot read AgentPara.* does not fit \(5, 2\) env"):
            place_term(RowTerm(_nothing, (AgentParameter(values),)), where, float, 8, 0)


def test_an_axis_of_one_element_may_have_any_stride() -> None:
    where = scene()
    given = np.arange(6.0)[::6]
    assert given.strides == (48,)
    _check(given, place_of(given, where), where)
    own = OwnArray("position")
    _check(own, place_of(own, where)._replace(shape=(1, 1, 3)), where)
    for change in ({"shape": (4, 2, 3)}, {"shape": (5, 3, 3)}, {"strides": (96, 24, 16)}):
        with pytest.raises(ValueError, match="a row kernel cannot read OwnArray"):
            _check(own, place_of(own, where)._replace(**change), where)


def test_offered_names_occur_once_and_give_rows() -> None:
    world = scene().world
    giving = SimpleNamespace(
        of_world=lambda: {"rate": 1}, of_view=lambda: {"wide": OfView("wide"), "spent": OwnOfView("delta_v")},
        of_team=lambda: {"wide": OfTeam("wide")},
        of_step=lambda: {"gain": lambda step: step.after.time - step.before.time},
    )  # fmt: skip
    offers = Offers()
    offers.add(giving)
    assert offers.components == [giving]
    for kind in ("of_world", "of_view", "of_team", "of_step"):
        other = SimpleNamespace(of_world=dict, of_view=dict, of_team=dict, of_step=dict)
        setattr(other, kind, getattr(giving, kind))
        with pytest.raises(
            ValueError, match=r"two components provide the name '.*'; rename one, or remove one of the components"
        ):
            offers.add(other)
    assert offers.components == [giving]
    state = filled()
    view = View(state, World(world.platforms, world.bodies, world.masses, 10.0, offers), Group("some", 1, 2, {}))
    np.testing.assert_array_equal(view.wide, state.wide.repeat(2, axis=0))
    np.testing.assert_array_equal(view.spent, state.delta_v[:, 1:3].ravel())
    later = View(filled(first=9), view.world, view.group)
    step = Step(view, later, *np.zeros((3, 2 * ENVS, 3)), np.zeros(2 * ENVS, np.bool_), 10.0)
    np.testing.assert_array_equal(step.gain, later.time - view.time)
    assert view.range_to(None) is view.range_to(None)  # computed once
    assert OfTeam("wide")(SimpleNamespace(state=state)) is state.wide
    assert own_estimate("position", view.world) == OwnArray("position")
    view.world.offers.view["estimated_position"] = OfView("wide")
    assert own_estimate("position", view.world) == OwnArray("estimated_position")
    assert own_estimate("velocity", view.world) == OwnArray("velocity")


def test_arrays_for_kernels_are_contiguous_and_writable() -> None:
    array = np.arange(6.0).reshape(2, 3)
    assert for_kernel(array) is array
    for other in (array.T, read_only(array), array.astype(np.int32)):
        found = for_kernel(other, np.float64)
        assert found.flags.c_contiguous
        assert found.flags.writeable
        assert found.dtype == np.float64
        np.testing.assert_array_equal(found, other)
        assert not np.shares_memory(found, array)
    assert np.shares_memory(read_only(array), array)
    assert array.flags.writeable
