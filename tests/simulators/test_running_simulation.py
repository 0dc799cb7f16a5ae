"""A simulation with made-up components, sensors and draws: which calls each gets, when, and with which rows."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from safe_inspect.dynamics.attitude.clohessy_wiltshire_attitude import ClohessyWiltshireAttitude
from safe_inspect.dynamics.double_integrator import DoubleIntegrator
from safe_inspect.dynamics.orbit.earth import EARTH_GRAVITY
from safe_inspect.dynamics.orbit.relative_orbit import RelativeOrbit
from safe_inspect.random.streams import Streams
from safe_inspect.simulators.component import RunningComponent
from safe_inspect.simulators.resets.plan import EnvironmentDraw, ResetPlan
from safe_inspect.simulators.simulator import Simulation
from safe_inspect.simulators.state import State
from safe_inspect.simulators.view import Group, View
from safe_inspect.types import ArraySpec

ENVS, STEP, MASSES = 4, 2.0, {"red": 3.0, "blue": 5.0}


class Plan(ResetPlan):
    """Draws the positions, and counts what it draws."""

    def draw(self, streams: Streams) -> Any:
        drawn = streams.uniform("place", 9).reshape(-1, 3, 3)
        names = ("red", "blue", "chief")
        states = {name: {"position": drawn[:, k], "velocity": 10.0 * drawn[:, k]} for k, name in enumerate(names)}
        tries = (100 * drawn[:, 0, 0]).astype(np.int64)
        return states, {"deputy": {"position": drawn[:, 0], "tries/red": tries}, "scale": drawn[:, 1, 1]}


class Component(RunningComponent):
    """Keeps a number for each environment, and records its calls.

    Args:
        factor: The control is multiplied by it.
        offset: Then this is added.
    """

    def __init__(self, name: str, factor: float, offset: float) -> None:
        self.name, self.factor, self.offset, self.told = name, factor, offset, list[Any]()
        self.arrays = {f"scale_{name}": ArraySpec((), fill=-1.0), f"count_{name}": ArraySpec((), np.int64)}
        self.kept = np.zeros(ENVS)

    def reset(self, state: State, values: Mapping[str, Any]) -> None:
        state[f"scale_{self.name}"][:] = values["scale"]

    def resume(self, state: State, rows: Any) -> None:
        self.told.append(("resume", state.num_envs, rows.tolist()))

    def actuate(self, state: State, control: Any) -> Any:
        self.told.append(("actuate", state.step.tolist()))
        return self.factor * control + self.offset

    def step(self, state: State, running: Any) -> None:
        self.told.append(("step", state.step.tolist()))
        state[f"count_{self.name}"][:] += running

    def end(self, state: State, rows: Any) -> None:
        self.told.append(("end", state.num_envs, rows.tolist()))
        self.kept[rows] += 1.0

    def restart(self) -> None:
        self.told.append("restart")

    def state_dict(self) -> dict[str, Any]:
        return {"kept": self.kept.copy()} if self.factor == 2.0 else {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self.kept = np.array(state["kept"])


class Divisible(Component):
    """One that knows what it keeps of each environment."""

    def part(self, rows: Any) -> Component:
        part = Divisible(f"{self.name}", self.factor, self.offset)
        part.kept = self.kept[rows]
        return part

    def join(self, part: Any, rows: Any) -> None:
        self.kept[rows] = part.kept[: len(rows)]


class Watching(RunningComponent):
    """One that changes no control."""


class Sensor:
    """Remembers how often it was asked, and the largest position along x."""

    def memory(self, world: Any) -> Mapping[str, ArraySpec]:
        return {"asked": ArraySpec((), np.int64), "most": ArraySpec((1,), fill=-np.inf)}

    def remember(self, view: View, name: str) -> None:
        view.memory(name, "asked")[:] += 1
        most = view.memory(name, "most")
        most[:, 0] = np.maximum(most[:, 0], view.position[:, 0])


def declares(**arrays: ArraySpec) -> Any:
    return SimpleNamespace(memory=lambda world: arrays)


def made(kind: type[Component] = Component, num_envs: int = ENVS, seed: int = 5, groups: Any = None) -> Any:
    """Return a simulation with a component that doubles the control, one that watches and one that adds 1."""
    components: Any = [
        SimpleNamespace(registered_name=name, call=call)
        for name, call in (
            ("double", lambda *given: kind("double", 2.0, 0.0)), ("watching", lambda *given: Watching()),
            ("more", lambda *given: kind("more", 1.0, 1.0)),
        )
    ]  # fmt: skip

    class Named:
        estimates = False

        def __init__(self, entry: Any) -> None:
            self.registered_name, self._call = entry.registered_name, entry.call

        def __call__(self, world: Any, count: int) -> Any:
            assert count == num_envs
            return self._call()

    return Simulation(
        DoubleIntegrator(), [Named(entry) for entry in components], masses=MASSES,  # type: ignore[misc]
        groups=groups or (Group("both", 0, 2, {"eye": Sensor(), "blind": SimpleNamespace(memory=lambda world: {})}),),
        reset=Plan({}, {}, {"chief": None}), step_size=STEP, num_envs=num_envs, seed=seed, first_slot=7,  # type: ignore[dict-item]
        decimation=2,
    )  # fmt: skip


def control(rows: int = ENVS) -> np.ndarray:
    return np.arange(rows * 6.0).reshape(rows, 2, 3)


def told(simulation: Any, name: str = "double") -> list[Any]:
    found = list(simulation.components[name].told)
    simulation.components[name].told.clear()
    return found


def test_an_episode_is_drawn_from_its_seed_slot_and_number() -> None:
    simulation = made()
    fresh = simulation.reset(np.arange(ENVS))
    assert simulation.episodes.tolist() == [0] * ENVS
    assert simulation.running.all()
    streams = Streams(5, 7 + np.arange(ENVS), np.zeros(ENVS, dtype=np.int64))
    drawn = streams.uniform("place", 9).reshape(-1, 3, 3)
    np.testing.assert_array_equal(simulation.state.position, drawn)
    np.testing.assert_array_equal(simulation.state.velocity, 10.0 * drawn)
    np.testing.assert_array_equal(simulation.state.key, streams.bits("step")[:, 0])
    np.testing.assert_array_equal(simulation.state["scale_double"], drawn[:, 1, 1])
    np.testing.assert_array_equal(simulation.reset_info["tries/red"], (100 * drawn[:, 0, 0]).astype(np.int64))
    assert list(simulation.reset_info) == ["tries/red"]
    np.testing.assert_array_equal(simulation.views[0].position, drawn[:, :2].reshape(-1, 3))
    assert fresh.num_envs == ENVS
    assert told(simulation) == [("resume", ENVS, [0, 1, 2, 3])]
    before = simulation.reset_info["tries/red"].copy()
    simulation.step(control())
    simulation.running[:] = False
    rows = np.array([3, 1])
    fresh = simulation.reset(rows)
    assert simulation.running.tolist() == [False, True, False, True]
    assert (simulation.episodes.tolist(), simulation.state.step.tolist()) == ([0, 1, 0, 1], [1, 0, 1, 0])
    again = Streams(5, 7 + rows, np.ones(2, dtype=np.int64)).uniform("place", 9).reshape(-1, 3, 3)
    np.testing.assert_array_equal(simulation.state.position[rows], again)
    np.testing.assert_array_equal(fresh.position, again)
    np.testing.assert_array_equal(simulation.views[0].position[[6, 7]], again[0, :2])
    before[rows] = (100 * again[:, 0, 0]).astype(np.int64)
    np.testing.assert_array_equal(simulation.reset_info["tries/red"], before)
    assert told(simulation)[-1] == ("resume", 2, [3, 1])
    assert simulation.drawn == ("position", "velocity")
    assert (simulation.attitude, simulation.turns_thrust) == ((), False)


def test_a_step_flies_what_the_components_make_of_the_control() -> None:
    simulation = made()
    simulation.reset(np.arange(ENVS))
    start = {name: simulation.state[name].copy() for name in ("position", "velocity")}
    told(simulation)
    simulation.end(np.array([False, True, False, False]))
    simulation.step(control())
    state, flown = simulation.state, 2.0 * control() + 1.0
    np.testing.assert_array_equal(simulation.flown, flown)
    np.testing.assert_array_equal(state.control, control())
    change = np.zeros((ENVS, 3, 3))
    change[:, :2] = flown / np.array([3.0, 5.0])[:, None] * STEP
    np.testing.assert_allclose(state.velocity, start["velocity"] + change, rtol=1e-14)
    where = start["position"] + STEP * (start["velocity"] + 0.5 * change)
    np.testing.assert_allclose(state.position, where, rtol=1e-14)
    np.testing.assert_allclose(state.delta_v, np.abs(change[:, :2]).sum(axis=2), rtol=1e-14)
    assert (state.step.tolist(), state.time.tolist()) == ([1] * ENVS, [STEP] * ENVS)
    for name, array in start.items():
        np.testing.assert_array_equal(simulation.before[name], array)
    assert simulation.views[0].writable is state
    assert told(simulation) == [("end", ENVS, [1]), ("actuate", [0] * ENVS), ("step", [1] * ENVS)]
    simulation.step(0.0 * control())
    np.testing.assert_allclose(simulation.before.velocity, start["velocity"] + change, rtol=1e-14)
    assert simulation.state["count_more"].tolist() == [2, 0, 2, 2]


def test_only_episodes_that_run_end_and_components_hear_of_them_once() -> None:
    simulation = made()
    simulation.reset(np.arange(ENVS))
    told(simulation)
    simulation.end(np.array([True, False, True, False]))
    simulation.end(np.array([True, True, False, False]))
    simulation.end(np.array([True, True, True, False]))
    assert simulation.running.tolist() == [False, False, False, True]
    assert told(simulation) == [("end", ENVS, [0, 2]), ("end", ENVS, [1])]


def test_another_seed_begins_with_the_first_episodes_again() -> None:
    simulation, other = made(), made(seed=9)
    simulation.reset(np.arange(ENVS))
    simulation.reset(np.array([0, 2]))
    told(simulation)
    simulation.seed(9)
    assert (simulation.episodes.tolist(), told(simulation)) == ([-1] * ENVS, ["restart"])
    for rows in (np.arange(ENVS), np.array([1, 2]), np.arange(ENVS), np.array([0])):
        np.testing.assert_array_equal(simulation.reset(rows).position, other.reset(rows).position)
        np.testing.assert_array_equal(simulation.episodes, other.episodes)
    assert simulation.episodes.tolist() == [2, 2, 2, 1]


def test_initial_states_of_another_seed_are_drawn_anew() -> None:
    simulation, fresh = made(), made(seed=9)
    simulation.reset(np.arange(ENVS))
    simulation.reset(np.array([0, 2]))  # the next episodes of seed 5 are drawn now
    simulation.seed(9)
    for rows in ([0, 2], [0, 1], [2], [0, 3], [2]):
        found, expected = (one.reset(np.array(rows)).position for one in (simulation, fresh))
        np.testing.assert_array_equal(found, expected)


class Sun(RunningComponent):
    """One with an array that a reset draws."""

    arrays = {"sun": ArraySpec(())}  # noqa: RUF012


def test_what_is_not_drawn_is_that_of_the_dynamics() -> None:
    draws: Any = [EnvironmentDraw(name, name, None) for name in ("sun", "unknown")]  # type: ignore[arg-type]
    component: Any = lambda world, count: Sun()  # noqa: E731
    component.registered_name, component.estimates = "Sun", False
    simulation = Simulation(
        ClohessyWiltshireAttitude(mean_motion=0.001), (component,), masses=MASSES, groups=(Group("red", 0, 1, {}),),
        reset=Plan({}, {}, {"chief": None}, tuple(draws)), step_size=STEP, num_envs=2, seed=0, first_slot=0,  # type: ignore[dict-item]
    )  # fmt: skip
    assert simulation.flown.shape == (2, 2, 6)
    assert simulation.views[0].writable is simulation.state
    simulation.reset(np.arange(2))
    np.testing.assert_array_equal(simulation.state["orientation"], np.tile([0.0, 0.0, 0.0, 1.0], (2, 3, 1)))
    np.testing.assert_array_equal(simulation.state["angular_velocity"], np.tile([0.0, 0.0, 0.001], (2, 3, 1)))
    assert simulation.attitude == ("orientation", "angular_velocity")
    assert simulation.turns_thrust
    assert simulation.drawn == ("position", "velocity", "orientation", "angular_velocity", "sun")


def test_the_state_has_the_arrays_that_dynamics_share_and_they_move() -> None:
    orbit = RelativeOrbit(eccentricity=0.1)
    simulation = Simulation(
        orbit, (), masses=MASSES, groups=(Group("red", 0, 1, {}),), reset=Plan({}, {}, {"chief": None}),  # type: ignore[dict-item]
        step_size=STEP, num_envs=2, seed=0, first_slot=0,
    )  # fmt: skip
    simulation.reset(np.arange(2))
    first = orbit.reset_shared({}, 2)["chief_orbit"]
    np.testing.assert_array_equal(simulation.state["chief_orbit"], first)
    simulation.step(np.zeros((2, 1, 3)))
    moved = simulation.state["chief_orbit"]
    # From the perigee, r'' = h^2 / r^3 - mu / r^2 and u' = h / r^2; the oblateness changes them by at most 2 %.
    r, h = first[:, 0], first[:, 2]
    np.testing.assert_allclose(moved[:, 4] - first[:, 4], h / r**2 * STEP, rtol=0.02)
    np.testing.assert_allclose(moved[:, 0] - r, 0.5 * (h**2 / r**3 - EARTH_GRAVITY / r**2) * STEP**2, rtol=0.02)


def test_what_was_computed_before_a_pause_is_computed_anew_after_it() -> None:
    simulation = made()
    simulation.reset(np.arange(ENVS))
    paused = simulation.pause(np.array([1]))
    before = simulation.views[0].range_to(None).copy()
    simulation.step(control())
    simulation.views[0].range_to(None)
    simulation.unpause(paused)
    found = simulation.views[0].range_to(None)
    np.testing.assert_allclose(found, np.linalg.norm(simulation.state.position[:, :2], axis=-1).ravel(), rtol=1e-14)
    np.testing.assert_array_equal(found[2:4], before[2:4])
    assert (found[:2] != before[:2]).all()


def test_what_lives_through_resets_is_kept_by_component() -> None:
    simulation, other = made(), made()
    simulation.reset(np.arange(ENVS))
    simulation.end(np.array([True, False, False, True]))
    kept = simulation.state_dict()
    assert {name: {key: array.tolist() for key, array in arrays.items()} for name, arrays in kept.items()} == {
        "double": {"kept": [1.0, 0.0, 0.0, 1.0]}
    }
    other.load_state_dict(kept)
    assert other.components["double"].kept.tolist() == [1.0, 0.0, 0.0, 1.0]
    assert other.components["more"].kept.tolist() == [0.0] * ENVS
    assert (made().divisible, made(Divisible).divisible) == (False, True)


def test_a_part_knows_where_its_environments_stand_in_the_whole() -> None:
    whole, reference = made(Divisible), made(Divisible)
    rows = np.array([3, 0])
    for simulation in (whole, reference):
        simulation.reset(np.arange(ENVS))
        simulation.step(control())
    paused = whole.pause(rows)
    assert (paused.running.tolist(), whole.running.tolist()) == ([True, True], [False, True, True, False])
    part = whole.part(2)
    part.enter(whole, paused, rows)
    told(whole)
    for _ in range(2):
        part.step(control()[rows])
        reference.step(control())
        for state in (part.state, part.before):
            assert state.whole_rows is not None
            assert state.whole_rows.tolist() == [3, 0]
        np.testing.assert_array_equal(part.state.position, reference.state.position[rows])
        np.testing.assert_array_equal(part.flown, 2.0 * control()[rows] + 1.0)
        assert part.state["count_double"].tolist() == part.state.step.tolist()
    assert whole.state.whole_rows is None
    assert told(whole) == []  # the part has its own components
    part.end(np.array([True, False]))
    part.leave(whole, rows)
    assert whole.components["double"].kept.tolist() == [0.0, 0.0, 0.0, 1.0]
    assert part.num_envs == 2
    whole.unpause(paused)
    assert whole.running.all()


def test_what_is_remembered_stands_in_the_state_by_group_part_and_name() -> None:
    groups = (
        Group("pair", 0, 2, {"eye": Sensor()}, decides=True, scripted_policy=declares(plan=ArraySpec((3,)))),
        Group(
            "one", 1, 1, {"eye": Sensor()}, declares(limit=ArraySpec((2,), np.int8, 4)),
            dones={"late": declares(since=ArraySpec((), fill=2.5))},
        ),
    )  # fmt: skip
    simulation = made(groups=groups)
    found = {
        name: (array.shape[1:], array.dtype.name, array.ravel()[0])
        for name, array in simulation.state.arrays.items() if name.startswith("memory/")
    }  # fmt: skip
    assert found == {
        "memory/pair/eye/asked": ((2,), "int64", 0), "memory/pair/eye/most": ((2, 1), "float64", -np.inf),
        "memory/pair/scripted policy/plan": ((2, 3), "float64", 0.0),
        "memory/pair/decision/remaining": ((2,), "int64", 0),
        "memory/one/eye/asked": ((1,), "int64", 0), "memory/one/eye/most": ((1, 1), "float64", -np.inf),
        "memory/one/late/since": ((1,), "float64", 2.5), "memory/one/safety filter/limit": ((1, 2), "int8", 4),
    }  # fmt: skip
    simulation.reset(np.arange(ENVS))
    most = simulation.state.position[:, :2, 0].copy()
    for step in range(1, 4):
        simulation.step(-100.0 * control())
        if step == 2:
            simulation.reset(np.array([2]))
            most[2] = simulation.state.position[2, :2, 0]
        np.maximum(most, simulation.state.position[:, :2, 0], out=most)
        np.testing.assert_array_equal(simulation.state["memory/pair/eye/most"][..., 0], most)
    np.testing.assert_array_equal(simulation.state["memory/one/eye/most"][:, 0, 0], most[:, 1])
    assert simulation.state["memory/pair/eye/asked"].tolist() == [[4, 4], [4, 4], [2, 2], [4, 4]]
    assert all(view.remembering is None for view in simulation.views)


def test_a_filter_of_the_team_remembers_once_for_all() -> None:
    simulation = Simulation(
        DoubleIntegrator(), (), masses=MASSES, groups=(), reset=Plan({}, {}, {}), step_size=STEP, num_envs=2, seed=0,
        first_slot=0, team_filter=declares(left=ArraySpec((2,), fill=3.0)),
    )  # fmt: skip
    (name,) = [name for name in simulation.state.arrays if name.startswith("memory/")]
    assert name.endswith("/left")
    np.testing.assert_array_equal(simulation.state[name], np.full((2, 1, 2), 3.0))
    assert simulation.trace == {}
