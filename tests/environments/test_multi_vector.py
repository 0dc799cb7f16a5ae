"""The batch of several agents: against as many PettingZoo environments, in both modes of beginning again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones import DoneStatus
from safe_inspect.environments import MultiAgentVectorEnv, TeamEnvironment, make_parallel_vec
from safe_inspect.environments.episodes import team_info
from safe_inspect.environments.facades.parallel import InspectionParallelEnv
from safe_inspect.errors import SafeInspectError
from safe_inspect.policies.open_loop import RandomThrust
from safe_inspect.rta.base import TeamFiltered, TeamSafety
from safe_inspect.simulators.team import TeamView
from safe_inspect.types import BoolArray, FloatArray

TASK = configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml"
NUM_ENVS, STEPS, SEED = 5, 60, 77


class HalvedThrust(TeamSafety):
    """Let every deputy thrust half as strongly as it wants."""

    def __call__(self, desired: FloatArray, team: TeamView) -> TeamFiltered:
        changed = (desired * desired).sum(axis=-1) > 4e-4
        return TeamFiltered(desired / 2, changed, changed.all(axis=1), changed.any(axis=1))

    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        return {}

    def safety(self, states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        return {}


def task(*overrides: str) -> EnvironmentSpec:
    return load_experiment(TASK, ("horizon=25", *overrides)).spec


def variant(name: str) -> EnvironmentSpec:
    spec = task("RTAGlueCWHInspection1v1.config.enabled=True") if name == "filtered" else task()
    if name == "scripted":
        first, second, third = spec.agents
        spec = replace(spec, agents=(first, replace(second, scripted_policy=RandomThrust()), third))
    return replace(spec, team_safety=HalvedThrust()) if name == "filtered together" else spec


def thrusts(agents) -> list[dict[str, np.ndarray]]:
    """Return actions by step, that drive the last agent of the slots 1 and 3 out of range before the time is over."""
    generator = np.random.default_rng(5)
    drawn = 0.05 * generator.uniform(-1, 1, (STEPS, len(agents), NUM_ENVS, 3))
    drawn[:, -1, [1, 3], 1] = 1.0
    return [dict(zip(agents, step.astype(np.float32), strict=True)) for step in drawn]


def same_infos(one: dict, many: dict, row: int) -> None:
    """Compare the infos of PettingZoo's agents with a row of the batch."""
    for agent, told in one.items():
        for name, value in told.items():
            if name in ("desired_control", "control", "rta/active"):
                continue  # present for single environments only, or in another form
            if name == "status":
                value = DoneStatus[value.upper()]
            found = many[name] if name.startswith("rejections/") else many[name][agent]
            assert found[row] == value, (agent, name)


@pytest.mark.parametrize("name", ["plain", "scripted", "filtered", "filtered together"])
@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.DISABLED])
def test_a_batch_is_as_many_environments(mode, name):
    spec = variant(name)
    env = MultiAgentVectorEnv(spec, NUM_ENVS, autoreset_mode=mode)
    singles = [InspectionParallelEnv(spec, slot=slot) for slot in range(NUM_ENVS)]
    assert list(env.agents) == singles[0].possible_agents
    observations, infos = env.reset(seed=SEED)
    for slot, single in enumerate(singles):
        first, told = single.reset(seed=SEED)
        same_infos(told, infos, slot)
        for agent in env.agents:
            np.testing.assert_array_equal(observations[agent][slot], first[agent])
            assert infos["active"][agent][slot]
    resets = waits = 0
    for actions in thrusts(env.agents):
        observations, rewards, terminations, truncations, infos = env.step(actions)
        over = np.zeros(NUM_ENVS, dtype=bool)
        final = infos.get("final_obs", observations), infos.get("final_info", infos)
        for slot, single in enumerate(singles):
            took_part = list(single.agents)
            found = single.step({agent: actions[agent][slot] for agent in took_part})
            same_infos(found[4], final[1], slot)
            for agent in env.agents:
                given = [part[agent][slot] for part in (rewards, terminations, truncations)]
                if agent in took_part:
                    np.testing.assert_array_equal(final[0][agent][slot], found[0][agent])
                    assert given == [part[agent] for part in found[1:4]]
                else:
                    waits += 1
                    assert given == [0.0, False, False]
                    assert all(infos[key][agent][slot] == 0.0 for key in infos if key.startswith("reward/"))
                assert final[1]["active"][agent][slot] == (agent in single.agents)
            over[slot] = not single.agents
        if mode is AutoresetMode.SAME_STEP:
            assert ("final_obs" in infos) == over.any()
            np.testing.assert_array_equal(infos.get("_final_obs", over), over)
            np.testing.assert_array_equal(infos.get("_final_info", over), over)
        elif over.any():
            with pytest.raises(SafeInspectError, match=rf"\[{np.flatnonzero(over)[0]}.* are over; reset them first"):
                env.step(actions)
            before, told = observations, infos
            observations, infos = env.reset(options={"reset_mask": over})
            for agent in env.agents:
                np.testing.assert_array_equal(observations[agent][~over], before[agent][~over])
                for key in ("status", "active", "own_inspected_count"):
                    np.testing.assert_array_equal(infos[key][agent][~over], told[key][agent][~over])
        for slot in np.flatnonzero(over):
            resets += 1
            first, told = singles[slot].reset()
            same_infos(told, infos, slot)
            for agent in env.agents:
                np.testing.assert_array_equal(observations[agent][slot], first[agent])
                assert infos["active"][agent][slot]
    assert resets >= 2 * NUM_ENVS
    assert (waits > 10) == (name != "filtered")  # which keeps all in range


def test_shapes_and_spaces():
    env = make_parallel_vec(TASK, 64, ["blue#_ctrl.count=10"])
    assert env.agents == tuple(f"blue{index}_ctrl" for index in range(10))
    observations, _ = env.reset(seed=1)
    actions = {agent: space.sample() for agent, space in env.action_spaces.items()}
    given = env.step(actions)
    for agent in env.agents:
        assert env.single_observation_spaces[agent].shape == (11,)
        assert env.single_action_spaces[agent].shape == (3,)
        assert observations[agent] in env.observation_spaces[agent]
        assert given[0][agent] in env.observation_spaces[agent]
        assert [part[agent].shape for part in given[1:4]] == [(64,)] * 3
        assert given[4]["delta_v"][agent].shape == (64,)
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    env.close()


def test_an_ended_agents_action_may_be_anything():
    env = MultiAgentVectorEnv(task(), NUM_ENVS)
    env.reset(seed=SEED)
    for actions in thrusts(env.agents)[:24]:
        infos = env.step(actions)[4]
    ended = ~infos["active"]["blue2_ctrl"]
    assert ended.tolist() == [False, True, False, True, False]
    actions["blue2_ctrl"][ended] = np.nan
    env.step(actions)


def test_the_answers_are_their_callers_to_keep():
    """No array that a step gives is written by a later one."""

    def flat(told, where=()):
        for name, value in told.items() if isinstance(told, dict) else enumerate(told):
            if isinstance(value, (dict, tuple)):
                yield from flat(value, (*where, name))
            else:
                yield (*where, name), value

    for mode in (AutoresetMode.SAME_STEP, AutoresetMode.DISABLED):
        env, kept, copies = MultiAgentVectorEnv(task(), NUM_ENVS, autoreset_mode=mode), [], []

        def keep(answer, kept=kept, copies=copies):
            kept.append(answer)
            copies.append({name: array.copy() for name, array in flat(answer)})

        keep(env.reset(seed=SEED))
        for actions in thrusts(env.agents):
            keep(env.step(actions))
            if mode is AutoresetMode.DISABLED and env.core.state.finished.all(axis=1).any():
                keep(env.reset(options={"reset_mask": env.core.state.finished.all(axis=1)}))
        for answer, copy in zip(kept, copies, strict=True):
            for name, array in flat(answer):
                np.testing.assert_array_equal(array, copy[name], err_msg=str(name))


def test_the_teams_facts():
    env = TeamEnvironment(variant("filtered together"), NUM_ENVS, seed=SEED)
    env.reset()
    told = team_info(env)
    assert not told["delta_v"].any()
    assert (told["closest"] >= 10.0).all()
    actions = np.full((NUM_ENVS, 3, 3), 0.2)
    transition = env.step([actions])
    told = team_info(env)
    points = env.state.points["chief"]
    np.testing.assert_array_equal(told["inspected_count"], (points.inspector >= 0).sum(axis=1))
    np.testing.assert_array_equal(told["inspected_count"], points.own_count.sum(axis=1))
    np.testing.assert_allclose(told["inspected_fraction"], told["inspected_count"] / 100)
    np.testing.assert_allclose(told["delta_v_mean"], 0.3 / 12.0 * 10.0)  # the filter halves the thrust
    np.testing.assert_allclose(told["delta_v"], 3 * told["delta_v_mean"])
    position = env.state.position[:, :3]
    apart = [np.linalg.norm(position[:, a] - position[:, b], axis=1) for a, b in ((0, 1), (0, 2), (1, 2))]
    np.testing.assert_allclose(told["closest"], np.min(apart, axis=0))
    np.testing.assert_array_equal(told["outcome"], transition.outcome)
    alone = TeamEnvironment(task("blue#_ctrl.count=1"), 2)
    alone.reset()
    assert np.isinf(team_info(alone)["closest"]).all()


def test_the_infos_contain_the_teams_facts():
    env = MultiAgentVectorEnv(variant("filtered together"), 2)
    _, infos = env.reset(seed=SEED)
    for _ in range(2):
        for name, values in team_info(env.core).items():
            np.testing.assert_array_equal(infos[f"team/{name}"], values, err_msg=name)
        *_, infos = env.step({agent: np.full((2, 3), 0.2) for agent in env.agents})
    assert (infos["team/delta_v"] > 0.0).all()


def test_the_infos_of_a_filter_of_the_team():
    env = MultiAgentVectorEnv(variant("filtered together"), 2)
    _, infos = env.reset(seed=SEED)
    assert not infos["interventions"]["blue0_ctrl"].any()
    actions = {agent: np.zeros((2, 3)) for agent in env.agents}
    actions["blue0_ctrl"][:, 0] = 0.5
    actions["blue1_ctrl"][1, 0] = actions["blue2_ctrl"][1, 0] = 0.5
    told = env.step(actions)[4]
    assert {agent: rows.tolist() for agent, rows in told["rta/intervening"].items()} == {
        "blue0_ctrl": [True, True],
        "blue1_ctrl": [False, True],
        "blue2_ctrl": [False, True],
    }
    for agent in env.agents:
        assert told["rta/backup"][agent].tolist() == [True, True]
        assert told["rta/infeasible"][agent].tolist() == [False, True]
        np.testing.assert_array_equal(told["interventions"][agent], told["rta/intervening"][agent])


def test_mistakes():
    with pytest.raises(ValueError, match="SAME_STEP"):
        MultiAgentVectorEnv(task(), 2, autoreset_mode=AutoresetMode.NEXT_STEP)
    env = MultiAgentVectorEnv(task(), 2)
    actions = {agent: np.zeros((2, 3)) for agent in env.agents}
    with pytest.raises(SafeInspectError, match="call reset"):
        env.step(actions)
    with pytest.raises(SafeInspectError, match="reset"):
        env.reset(options={"reset_mask": np.array([True, False])})
    env.reset()
    with pytest.raises(ValueError, match="not both"):
        env.reset(seed=8, options={"reset_mask": np.array([True, False])})
    with pytest.raises(SafeInspectError, match=r"none is given for blue2_ctrl; .*blue0_ctrl has the shape \(3, 2\)"):
        env.step({"blue0_ctrl": np.zeros((3, 2)), "blue1_ctrl": np.zeros((2, 3))})
