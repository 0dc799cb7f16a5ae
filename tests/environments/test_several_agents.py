"""Several agents in one environment: their rows, their ends, their beginnings; one agent is the case D = 1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.spec import AgentSpec, EnvironmentSpec
from safe_inspect.dones import DoneStatus
from safe_inspect.dones.limits import EpisodeLengthDone
from safe_inspect.dones.motion import MaxDistanceDoneFunction
from safe_inspect.dones.shared import SetAllDoneFunction
from safe_inspect.environments import BatchedEnvironment, TeamEnvironment, team
from safe_inspect.environments.group import AgentGroup
from safe_inspect.errors import PluginValueError
from safe_inspect.glues.observations import ObserveSensor
from safe_inspect.plugins.functor import Named
from safe_inspect.policies.inspector import NaturalMotionInspector
from safe_inspect.policies.open_loop import RandomThrust, ZeroThrust
from safe_inspect.random.streams import Streams
from safe_inspect.rewards.delta_v import InspectionDeltaVReward
from safe_inspect.rewards.inspection import ObservedPointsReward
from safe_inspect.simulators.resets.initializers import PositionVelocityInitializer
from safe_inspect.simulators.resets.parameters import ConstantParameter
from safe_inspect.simulators.resets.plan import BodyReset, EnvironmentDraw

RUNNING, WIN, LOSE, DRAW = DoneStatus
SEED = 20231029
MEAN_MOTION, MASS, STEP = 0.001027, 12.0, 10.0
FILTER_ON = "RTAGlueCWHInspection1v1.config.enabled=True"
#: Short episodes and a delta-v scale that moves, so that a few hundred steps hold every kind of memory.
LIVELY = (
    "horizon=60",
    "env_config.simulator.config.steps_until_update=40",
    "env_config.simulator.config.delta_v_scale_step=-0.01",
    "env_config.simulator.config.inspected_points_update_bounds=[0.2, 0.3]",
)
#: A camera that sees a disc of 6 m from 60 m, so that deputies on different sides share no points.
NARROW = "config.config.env_config.simulator.config.field_of_view=0.1"
#: Three deputies at rest about the chief, a third of a turn apart.
ABOUT = [[60.0, 0.0, 5.0], [-30.0, 52.0, 0.0], [-30.0, -52.0, -5.0]]


@lru_cache
def single(*overrides: str) -> EnvironmentSpec:
    return load_experiment(configs_root() / "translational-inspection" / "experiment-seed.yml", overrides).spec


@lru_cache
def several(*overrides: str) -> EnvironmentSpec:
    return load_experiment(
        configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml", overrides
    ).spec


def begun(spec: EnvironmentSpec, position: Sequence, velocity: Sequence | None = None) -> EnvironmentSpec:
    """Return the task with every episode begun from given states of the deputies, one row each."""
    velocity = np.zeros_like(position) if velocity is None else velocity
    bodies = {
        name: BodyReset(
            PositionVelocityInitializer(),
            {
                axis + dot: ConstantParameter(value=float(value))
                for dot, state in (("", position[index]), ("_dot", velocity[index]))
                for axis, value in zip("xyz", state, strict=True)
            },
        )
        for index, name in enumerate(spec.reset.deputies)
    }
    return replace(spec, reset=replace(spec.reset, deputies=bodies))


def with_agents(spec: EnvironmentSpec, *changes: Mapping) -> EnvironmentSpec:
    """Return the task with some fields of its agents changed, one mapping each."""
    return replace(spec, agents=tuple(replace(a, **dict(c)) for a, c in zip(spec.agents, changes, strict=True)))


def thrusts_of(agents: Sequence[str], steps: int, num_envs: int, seed: int = 1) -> dict[str, np.ndarray]:
    """Return thrusts by agent, (steps, num_envs, 3), of which some make a deputy drift and others leave the range."""
    generator = np.random.default_rng(seed)
    shape = (len(agents), 1, num_envs, 1)
    strength = generator.choice([0.02, 0.2, 1.0], size=shape)
    steady = generator.uniform(-1, 1, (len(agents), 1, num_envs, 3))
    noise = generator.normal(0.0, 0.5, (len(agents), steps, num_envs, 3))
    return dict(zip(agents, strength * np.clip(steady + noise, -1, 1), strict=True))


def at_rest(agents: Sequence[str], steps: int, num_envs: int = 1) -> dict[str, np.ndarray]:
    return {agent: np.zeros((steps, num_envs, 3)) for agent in agents}


def fly(env: TeamEnvironment, thrusts: Mapping[str, np.ndarray], rows: Sequence[int] | None = None):
    """Return what every agent shows in each step, by its name, and under "" what concerns all.

    Each array is of shape (steps, rows, ...). Environments that are over are reset at once.
    """
    rows = list(range(env.num_envs)) if rows is None else list(rows)
    seen: dict[str, dict[str, list[np.ndarray]]] = {}

    def note(agent: str, **told: np.ndarray) -> None:
        for name, array in told.items():
            seen.setdefault(agent, {}).setdefault(name, []).append(array[rows].copy())

    for group, observation in zip(env.acting, env.reset(), strict=True):
        for member, agent in enumerate(group.agents):
            note(agent, first=observation[:, member])
    for time in range(len(next(iter(thrusts.values())))):
        transition = env.step([np.stack([thrusts[a][time] for a in group.agents], axis=1) for group in env.acting])
        state = env.state
        for group, found in zip(env.groups, transition.groups, strict=True):
            for member, agent in enumerate(group.agents):
                index = group.first + member
                fields = ("observation", "reward", "active", "terminated", "truncated", "status")
                note(agent, **{name: getattr(found, name)[:, member] for name in fields})
                note(agent, **{f"term {name}": value[:, member] for name, value in found.terms.items()})
                note(agent, own=state.points["chief"].own_count[:, index])
                for name in ("position", "velocity", "control", "delta_v", "interventions", "finished"):
                    note(agent, **{name: getattr(state, name)[:, index]})
        points = state.points["chief"]
        note("", over=transition.over, outcome=transition.outcome, count=points.team_count, inspector=points.inspector)
        note("", sun=state.sun_angle, scale=state.delta_v_scale)
        if transition.over.any():
            env.reset(np.flatnonzero(transition.over))
    return {agent: {name: np.stack(array) for name, array in told.items()} for agent, told in seen.items()}


def same(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray], where: str = "") -> None:
    assert one.keys() == other.keys()
    for name, array in one.items():
        assert array.dtype == other[name].dtype
        assert array.tobytes() == other[name].tobytes(), f"{where} {name}"


def equal(one, other) -> None:
    assert one.keys() == other.keys()
    for agent in one:
        same(one[agent], other[agent], agent)


def coasted(position: np.ndarray, velocity: np.ndarray, time: float) -> np.ndarray:
    """Return where a body is that coasts from a state: the closed form of Clohessy and Wiltshire (1960)."""
    (x, y, z), (u, v, w) = position, velocity
    n = MEAN_MOTION
    s, c = np.sin(n * time), np.cos(n * time)
    return np.array(
        [
            (4 - 3 * c) * x + s / n * u + 2 / n * (1 - c) * v,
            6 * (s - n * time) * x + y - 2 / n * (1 - c) * u + (4 * s - 3 * n * time) / n * v,
            z * c + w / n * s,
        ]
    )


@pytest.mark.parametrize("overrides", [LIVELY, (FILTER_ON, "horizon=25")])
def test_one_of_several_is_the_single_agent_bit_for_bit(overrides):
    steps, num_envs = (240, 6) if overrides is LIVELY else (60, 3)
    thrusts = thrusts_of(["blue0_ctrl"], steps, num_envs)
    alone, one = single(*overrides), several("blue#_ctrl.count=1", *overrides)
    assert one.shared_dones
    assert not alone.shared_dones
    first, second = (fly(TeamEnvironment(spec, num_envs, seed=SEED), thrusts) for spec in (alone, one))
    equal(first, second)
    assert first[""]["over"].sum(axis=0).min() >= 2
    # the batch of a single group is the same core without the tuples
    env = BatchedEnvironment(one, num_envs, seed=SEED)
    np.testing.assert_array_equal(env.reset()[:, 0], first["blue0_ctrl"]["first"][0])
    transition = env.step(thrusts["blue0_ctrl"][0][:, None])
    np.testing.assert_array_equal(transition.observation[:, 0], first["blue0_ctrl"]["observation"][0])


@pytest.mark.parametrize("overrides", [LIVELY, (FILTER_ON, "horizon=25")])
def test_a_row_of_a_batch_is_the_environment_alone(overrides):
    steps, num_envs = (150, 64) if overrides is LIVELY else (30, 16)
    spec = several(*overrides)
    names = [agent.name for agent in spec.agents]
    thrusts = thrusts_of(names, steps, num_envs)
    rows = [0, 1, num_envs // 2, num_envs - 1]
    batch = fly(TeamEnvironment(spec, num_envs, seed=SEED), thrusts, rows)
    assert batch[""]["over"].sum(axis=0).min() >= 1
    if overrides is LIVELY:
        assert not all(batch[name]["active"].all() for name in names)  # some end before the others
        assert batch["blue0_ctrl"]["terminated"].any()
        assert batch["blue0_ctrl"]["truncated"].any()
        assert len(np.unique(batch[""]["scale"])) > 2
    for index, row in enumerate(rows):
        own = {name: array[:, row : row + 1] for name, array in thrusts.items()}
        alone = fly(TeamEnvironment(spec, 1, seed=SEED, first_slot=row), own)
        equal({agent: {n: a[:, index : index + 1] for n, a in told.items()} for agent, told in batch.items()}, alone)


@pytest.mark.parametrize("order", [(2, 0, 1), (1, 0, 2)])
def test_permuting_equal_agents_permutes_the_results(order):
    """A point that two deputies see first in one step goes to the first in agent order.

    So they begin on different sides with narrow cameras, where no point is seen by two of them; the map of the points
    to their inspectors shows that there was none.
    """
    spec = several(NARROW)
    names = [agent.name for agent in spec.agents]
    velocity = np.array([[0.0, -0.1, 0.0], [0.25, -0.43, 0.0], [0.0, 0.0, 0.1]])  # the second crashes soon
    thrusts = {name: 0.02 * array for name, array in thrusts_of(names, 35, 2, seed=4).items()}
    plain = fly(TeamEnvironment(begun(spec, ABOUT, velocity), 2, seed=SEED), thrusts)
    places = [order.index(index) for index in range(3)]  # the deputy `order[k]` is now at place k
    moved = {names[place]: thrusts[names[index]] for index, place in enumerate(places)}
    other = begun(spec, [ABOUT[index] for index in order], velocity[list(order)])
    permuted = fly(TeamEnvironment(other, 2, seed=SEED), moved)
    for index, place in enumerate(places):
        same(plain[names[index]], permuted[names[place]], names[index])
    expected = dict(plain[""])
    mapping = np.array([*places, -1], dtype=np.int8)  # the index -1 stays -1
    expected["inspector"] = mapping[expected["inspector"]]
    same(expected, permuted[""])
    assert set(np.unique(expected["inspector"])) == {-1, 0, 1, 2}
    assert plain["blue1_ctrl"]["status"][-1].tolist() == [LOSE, LOSE]
    assert not plain["blue1_ctrl"]["active"][-5:].any()
    assert plain["blue0_ctrl"]["active"].all()
    assert plain["blue2_ctrl"]["active"].all()


STEPS, OUTWARDS = 120, [0.0, 0.002, 0.0]


def ended_early(*overrides: str):
    """Return the flight of three deputies of which the second, thrusting outwards, soon crosses its range of 70 m.

    The others rest on the chief's far side, and the sun turns towards the second's.
    """
    spec = several("horizon=400", *overrides)
    agents = [{}, {"dones": _with_range(spec.agents[1], 70.0)}, {}]
    position = [[0.0, -150.0, 0.0], [0.0, 69.0, 0.0], [0.0, -200.0, 0.0]]
    spec = begun(with_agents(spec, *agents), position, [[0.0] * 3, [0.0, 0.02, 0.0], [0.0] * 3])
    spec = replace(
        spec,
        reset=replace(spec.reset, environment=(EnvironmentDraw("sun_angle", "sun", ConstantParameter(value=-3.1)),)),
    )
    thrusts = at_rest([agent.name for agent in spec.agents], STEPS)
    thrusts["blue1_ctrl"][:] = OUTWARDS
    return fly(TeamEnvironment(spec, 1, seed=5), thrusts)


def _with_range(agent: AgentSpec, max_distance: float):
    return tuple(
        Named(named.name, MaxDistanceDoneFunction(max_distance=max_distance))
        if isinstance(named.functor, MaxDistanceDoneFunction)
        else named
        for named in agent.dones
    )


def test_an_agent_that_ends_drops_out_while_the_others_continue():
    flown = ended_early()
    gone = flown["blue1_ctrl"]
    (end,) = np.flatnonzero(gone["terminated"][:, 0])
    assert 0 < end < 10
    assert not gone["truncated"].any()
    assert gone["active"][:, 0].tolist() == [True] * (end + 1) + [False] * (STEPS - 1 - end)
    assert gone["status"][:, 0].tolist() == [RUNNING] * end + [LOSE] * (STEPS - end)
    np.testing.assert_array_equal(gone["finished"], gone["status"])
    for name in (name for name in gone if name == "reward" or name.startswith("term ")):
        assert not gone[name][end + 1 :].any(), name
    assert gone["term InspectionDeltaVReward"][: end + 1].all()  # it had paid for its thrust before
    for name in ("blue0_ctrl", "blue2_ctrl"):
        assert flown[name]["active"].all()
        assert not flown[name]["status"].any()
    assert not flown[""]["over"].any()
    assert (flown[""]["outcome"][:, 0] == LOSE).tolist() == [False] * end + [True] * (STEPS - end)


def test_its_spacecraft_coasts_on():
    gone = ended_early()["blue1_ctrl"]
    end = int(np.flatnonzero(gone["terminated"][:, 0])[0])
    assert (gone["control"][: end + 1, 0] == OUTWARDS).all()
    assert not gone["control"][end + 1 :].any()
    assert len(np.unique(gone["delta_v"][end:])) == 1
    for later in (1, 40, STEPS - 1 - end):
        expected = coasted(gone["position"][end, 0], gone["velocity"][end, 0], later * STEP)
        np.testing.assert_allclose(gone["position"][end + later, 0], expected, rtol=1e-9, atol=1e-9)


def test_its_camera_continues_to_inspect_for_the_others():
    flown = ended_early()
    gone, other = flown["blue1_ctrl"], flown["blue0_ctrl"]
    end = int(np.flatnonzero(gone["terminated"][:, 0])[0])
    seen = np.diff(gone["own"][end:, 0])
    assert (seen >= 0).all()
    assert seen.sum() > 10
    paid = other["term ObservedPointsReward"][end + 1 :, 0]
    np.testing.assert_allclose(paid, 0.01 * np.diff(flown[""]["count"][end:, 0]))
    assert (paid >= 0.01 * seen - 1e-12).all()


def test_its_spacecraft_may_hold_its_thrust_as_in_safe_autonomy_sims():
    gone = ended_early("config.config.env_config.ended_deputies=hold_thrust")["blue1_ctrl"]
    end = int(np.flatnonzero(gone["terminated"][:, 0])[0])
    assert (gone["control"][:, 0] == OUTWARDS).all()
    np.testing.assert_allclose(np.diff(gone["delta_v"][:, 0]), OUTWARDS[1] / MASS * STEP)
    assert not gone["reward"][end + 1 :].any()
    coasting = ended_early()["blue1_ctrl"]
    np.testing.assert_array_equal(gone["position"][: end + 1], coasting["position"][: end + 1])
    # one step under a constant thrust: u T^2 / (2 m) along the axis, but for the orbit's small terms
    gap = gone["position"][end + 1, 0] - coasting["position"][end + 1, 0]
    np.testing.assert_allclose(gap, [0.0, OUTWARDS[1] / MASS * STEP**2 / 2, 0.0], atol=1e-3)


def of_another_kind(agent: AgentSpec) -> dict:
    """Return the fields of an agent that sees, earns and ends on something else."""
    seen = tuple(
        glue for glue in agent.glues if not isinstance(glue, ObserveSensor) or glue.sensor != "Sensor_SunAngle"
    )
    return {
        "glues": seen,
        "rewards": (
            Named("Points", ObservedPointsReward(scale=1.0)),
            Named("InspectionDeltaVReward", InspectionDeltaVReward(scale=-1.0)),
        ),
        "dones": (
            Named("MaxDistanceDoneFunction", MaxDistanceDoneFunction(max_distance=300.0)),
            *(named for named in agent.dones if named.name == "SuccessfulInspectionDoneFunction"),
            Named("EpisodeLengthDone", EpisodeLengthDone(horizon=20)),
        ),
    }


def test_agents_that_differ_are_computed_as_their_like_are():
    """In a mixed team every agent flies as in a team of one kind, up to the step that ends the first."""
    spec = several("horizon=40")
    names = [agent.name for agent in spec.agents]
    kind = [of_another_kind(agent) for agent in spec.agents]
    mixed = with_agents(spec, {}, kind[1], {})
    thrusts = {name: 0.02 * array for name, array in thrusts_of(names, 20, 5).items()}
    flights = [fly(TeamEnvironment(s, 5, seed=SEED), thrusts) for s in (spec, mixed, with_agents(spec, *kind))]
    plain, found, changed = flights
    same(found["blue0_ctrl"], plain["blue0_ctrl"])
    same(found["blue1_ctrl"], changed["blue1_ctrl"])
    same(found["blue2_ctrl"], plain["blue2_ctrl"])
    env = TeamEnvironment(mixed, 1)
    assert [group.agents for group in env.groups] == [(name,) for name in names]
    assert [group.observation_layout.size for group in env.groups] == [11, 10, 11]
    assert found["blue1_ctrl"]["truncated"][-1].all()
    assert not found["blue0_ctrl"]["status"].any()
    assert found["blue1_ctrl"]["reward"].any()


def test_grouping_changes_nothing(monkeypatch):
    """A group is the same agents one by one, with any other agents, through ends, resets and filters."""
    spec = several("blue#_ctrl.count=7", *LIVELY)
    other = of_another_kind(spec.agents[0])
    filtered = several("blue#_ctrl.count=7", FILTER_ON).agents[0].glues
    guarded, pilot = {"glues": filtered}, {"scripted_policy": RandomThrust()}
    spec = with_agents(spec, {}, {}, other, other, guarded, guarded, pilot)
    names = [agent.name for agent in spec.agents]
    thrusts = thrusts_of(names, 130, 4)
    together = TeamEnvironment(spec, 4, seed=SEED)
    assert [group.size for group in together.groups] == [2, 2, 2, 1]
    first = fly(together, thrusts)

    def one_each(agents, dynamics):
        return tuple(AgentGroup([agent], index, dynamics) for index, agent in enumerate(agents))

    monkeypatch.setattr(team, "group_agents", one_each)
    apart = TeamEnvironment(spec, 4, seed=SEED)
    assert [group.size for group in apart.groups] == [1] * 7
    equal(first, fly(apart, thrusts))
    assert first[""]["over"].any()
    assert first["blue4_ctrl"]["interventions"].any()


def test_a_scripted_agent_is_part_of_the_world():
    """It asks for no action and decides no end; the others fly as if it was flown so from outside."""
    spec = several("horizon=30")
    scripted = with_agents(spec, {}, {"scripted_policy": ZeroThrust(), "dones": spec.agents[1].dones[:-1]}, {})
    names = [agent.name for agent in spec.agents]
    thrusts = {name: 0.05 * array for name, array in thrusts_of(names, 45, 3).items()}
    thrusts["blue1_ctrl"][:] = 0.0
    env = TeamEnvironment(scripted, 3, seed=SEED)
    assert [group.agents for group in env.acting] == [("blue0_ctrl",), ("blue2_ctrl",)]
    with pytest.raises(ValueError, match="one for each of 2 groups"):
        env.step([np.zeros((3, 1, 3))] * 3)
    found, outside = fly(env, thrusts), fly(TeamEnvironment(spec, 3, seed=SEED), thrusts)
    for agent in ("blue0_ctrl", "blue2_ctrl"):
        same(found[agent], outside[agent], agent)
    assert found["blue1_ctrl"]["observation"].shape == (45, 3, 0)
    np.testing.assert_array_equal(found["blue1_ctrl"]["position"], outside["blue1_ctrl"]["position"])
    np.testing.assert_array_equal(found["blue1_ctrl"]["own"], outside["blue1_ctrl"]["own"])
    # without a time limit it never ends, but the episode is over with the others
    assert not found["blue1_ctrl"]["status"].any()
    np.testing.assert_array_equal(np.flatnonzero(found[""]["over"].all(axis=1)), [29])


def test_a_pilot_that_remembers_flies_alone_as_in_a_batch():
    spec = several("horizon=20")
    spec = with_agents(
        spec, {"scripted_policy": NaturalMotionInspector()}, {"scripted_policy": NaturalMotionInspector()}, {}
    )
    thrusts = thrusts_of(["blue2_ctrl"], 25, 3)
    batch = fly(TeamEnvironment(spec, 3, seed=SEED), thrusts, [2])
    own = {name: array[:, 2:3] for name, array in thrusts.items()}
    equal(batch, fly(TeamEnvironment(spec, 1, seed=SEED, first_slot=2), own))
    assert batch["blue0_ctrl"]["control"].any()
    assert not np.array_equal(batch["blue0_ctrl"]["control"], batch["blue1_ctrl"]["control"])


def last_step(spec: EnvironmentSpec, prepare=None, steps: int = 1):
    """Return (status, terminated, truncated) of each agent after some steps without thrust, the end and the outcome."""
    env = TeamEnvironment(spec, 1, seed=SEED)
    env.reset()
    if prepare is not None:
        prepare(env.state)
    for _ in range(steps):
        transition = env.step([np.zeros((1, group.size, 3)) for group in env.acting])
    told = [
        (int(found.status[0, k]), bool(found.terminated[0, k]), bool(found.truncated[0, k]))
        for found in transition.groups
        for k in range(found.status.shape[1])
    ]
    return told, bool(transition.over[0]), int(transition.outcome[0])


def inspected(state) -> None:
    """Mark every point as inspected."""
    points = state.points["chief"]
    points.inspector[:] = 0
    points.team_count[:] = points.inspector.shape[1]


TOGETHER = ([[60.0, 0.0, 0.0], [72.0, 0.0, 0.0], [0.0, 60.0, 0.0]], [[0.3, 0.0, 0.0], [-0.3, 0.0, 0.0], [0.0] * 3])


class TestSharedEnds:
    def test_a_collision_ends_all_as_lost(self):
        spec = begun(several(), *TOGETHER)
        assert last_step(spec) == ([(LOSE, True, False)] * 3, True, LOSE)

    def test_a_collision_at_the_time_limit_is_no_draw(self):
        spec = begun(several("horizon=1"), *TOGETHER)
        assert last_step(spec) == ([(LOSE, True, False)] * 3, True, LOSE)

    def test_a_collision_comes_before_success(self):
        spec = begun(several(), *TOGETHER)
        assert last_step(spec, inspected) == ([(LOSE, True, False)] * 3, True, LOSE)

    def test_deputies_whose_agents_have_ended_still_collide(self):
        spec = several()
        agents = [{}, {"dones": _with_range(spec.agents[1], 71.0)}, {}]
        position, velocity = TOGETHER
        slow = [[0.05, 0.0, 0.0], [-0.05, 0.0, 0.0], velocity[2]]
        spec = begun(with_agents(spec, *agents), position, slow)
        runs = (RUNNING, False, False)
        assert last_step(spec, steps=1) == ([runs, (LOSE, True, False), runs], False, LOSE)
        told = [(LOSE, True, False), (LOSE, False, False), (LOSE, True, False)]
        assert last_step(spec, steps=3) == (told, True, LOSE)

    def test_success_ends_those_too_who_do_not_ask_for_it(self):
        spec = several()
        without = tuple(named for named in spec.agents[2].dones if named.name != "SuccessfulInspectionDoneFunction")
        spec = begun(with_agents(spec, {}, {}, {"dones": without}), ABOUT)
        assert last_step(spec, inspected) == ([(WIN, True, False)] * 3, True, WIN)
        alone = replace(spec, shared_dones=())
        assert last_step(alone, inspected) == (
            [(WIN, True, False), (WIN, True, False), (RUNNING, False, False)], False, WIN,
        )  # fmt: skip

    def test_losing_comes_before_winning(self):
        """Who is out of range in the step of the success has lost, so not everybody has won."""
        spec = several()
        without = tuple(named for named in spec.agents[2].dones if named.name != "SuccessfulInspectionDoneFunction")
        spec = begun(with_agents(spec, {}, {}, {"dones": without}), [[900.0, 0.0, 0.0], *ABOUT[1:]])
        told = [(LOSE, True, False), (WIN, True, False), (RUNNING, False, False)]
        assert last_step(spec, inspected) == (told, False, LOSE)

    def test_the_time_limit_truncates_all(self):
        spec = begun(several("horizon=3"), ABOUT)
        assert last_step(spec, steps=3) == ([(DRAW, False, True)] * 3, True, DRAW)

    def test_success_at_the_time_limit_is_a_success(self):
        spec = begun(several("horizon=1"), ABOUT)
        assert last_step(spec, inspected) == ([(WIN, True, False)] * 3, True, WIN)

    def test_one_end_may_end_all(self):
        spec = begun(several(), [[900.0, 0.0, 0.0], *ABOUT[1:]])
        spec = replace(spec, shared_dones=(Named("SetAllDoneFunction", SetAllDoneFunction()),))
        assert last_step(spec) == ([(LOSE, True, False)] * 3, True, LOSE)


class TestBeginnings:
    @pytest.mark.parametrize("count", [3, 5, 10])
    def test_each_deputy_begins_safely_in_its_own_place(self, count):
        spec = several(f"blue#_ctrl.count={count}", "CollisionDoneFunction.config.safety_constraint=20 m")
        num_envs = 300
        env = TeamEnvironment(spec, num_envs, seed=SEED)
        env.reset()
        view = env.team()
        assert view.distance.shape == (num_envs, count * (count - 1) // 2)
        assert view.distance.min() >= 20.0
        places = view.position.reshape(-1, 3)
        assert len(np.unique(places, axis=0)) == len(places)
        sampler = spec.reset.parameters["init_state"]
        sun = np.repeat(view.sun_angle, count)
        states = {"position": places, "velocity": view.velocity.reshape(-1, 3), "sun_angle": sun}
        refused = sampler.rta.refusals({name: states[name] for name in sampler.rta.states})
        assert {name for name, rows in refused.items() if rows.any()} == set()
        safety = sampler.rta.glue.safety(states)
        assert set(safety) == {"chief_collision", "rel_vel", "sun", "r_max", "PSM", "x_vel", "y_vel", "z_vel"}
        assert min(value.min() for value in safety.values()) >= 0.0
        # the test would refuse some of these states under another environment's sun
        turned = sampler.rta.refusals({**states, "sun_angle": np.roll(sun, count)})
        assert any(rows.any() for rows in turned.values())
        transition = env.step([np.zeros((num_envs, count, 3))])
        assert not (transition.outcome == LOSE).all()

    def test_the_first_deputy_begins_as_one_alone(self):
        alone, three = TeamEnvironment(single(), 50, seed=SEED), TeamEnvironment(several(), 50, seed=SEED)
        for _ in range(2):
            alone.reset()
            three.reset()
            for name in ("position", "velocity"):
                np.testing.assert_array_equal(
                    getattr(three.state, name)[:, 0], getattr(alone.state, name)[:, 0], err_msg=name
                )
            np.testing.assert_array_equal(three.state.sun_angle, alone.state.sun_angle)

    def test_further_deputies_change_no_beginning(self):
        three, five = several(), several("blue#_ctrl.count=5")
        streams = Streams(SEED, np.arange(40), np.zeros(40, dtype=np.int64))
        few, many = (spec.reset.draw(streams)[0] for spec in (three, five))
        for name in ("blue0", "blue1", "blue2"):
            np.testing.assert_array_equal(few[name]["position"], many[name]["position"])

    def test_two_that_begin_too_near_are_drawn_again(self):
        """Without the distance the same draws come too near in some environments; only those change."""
        far = several("CollisionDoneFunction.config.safety_constraint=50 m")
        free = replace(far, reset=replace(far.reset, separation=0.0))
        near = []
        for spec in (far, free):
            env = TeamEnvironment(spec, 100, seed=SEED)
            env.reset()
            near.append((env.team().distance.min(axis=1), env.state.position.copy()))
        assert near[0][0].min() >= 50.0
        bad = near[1][0] < 50.0
        assert 10 < bad.sum() < 90
        np.testing.assert_array_equal(near[0][1][~bad], near[1][1][~bad])


def test_a_wrong_action_names_its_agent():
    env = TeamEnvironment(several(), 4, seed=SEED)
    env.reset()
    action = np.zeros((4, 3, 3))
    action[2, 1, 0] = np.nan
    with pytest.raises(PluginValueError, match=r"action of blue1_ctrl .* in environment 2"):
        env.step([action])


@pytest.mark.parametrize("shape", [(4, 9), (3, 4, 3), (36,), (4, 1, 3)])
def test_actions_of_another_shape_are_refused(shape):
    """The groups and environments of an array that only has as many elements would be mixed up."""
    env = TeamEnvironment(several(), 4, seed=SEED)
    env.reset()
    with pytest.raises(
        ValueError, match=r"the actions of blue0_ctrl to blue2_ctrl have the shape .*expected \(4, 3, 3\)"
    ):
        env.step([np.zeros(shape)])


def test_a_mask_is_no_list_of_rows():
    env = TeamEnvironment(several(), 4, seed=SEED)
    with pytest.raises(ValueError, match="flatnonzero"):
        env.reset(np.array([True, False, True, True]))


@pytest.mark.parametrize("seed", [-1, 2**64])
def test_a_seed_out_of_range_is_refused(seed):
    with pytest.raises(ValueError, match=r"from 0 to 2\*\*64 - 1"):
        TeamEnvironment(several(), 1, seed=seed)
    env = TeamEnvironment(several(), 1, seed=2**64 - 1)
    with pytest.raises(ValueError, match=str(seed)):
        env.reset(seed=seed)
    assert env.reset()[0].shape == (1, 3, 11)
