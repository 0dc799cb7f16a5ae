"""The PettingZoo façade: PettingZoo's own checks, agents that drop out, the single agent, errors."""

from __future__ import annotations

import subprocess
import sys
import warnings
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments import (
    InspectionEnv,
    InspectionVectorEnv,
    TeamEnvironment,
    make,
    make_parallel,
    make_vec,
)
from safe_inspect.environments.facades.parallel import InspectionParallelEnv
from safe_inspect.errors import SafeInspectError
from safe_inspect.policies.open_loop import RandomThrust, ZeroThrust

TASK = configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml"
ONE, FILTER_ON = "blue#_ctrl.count=1", "RTAGlueCWHInspection1v1.config.enabled=True"
NAMES = ["blue0_ctrl", "blue1_ctrl", "blue2_ctrl"]


@lru_cache
def task(*overrides: str) -> EnvironmentSpec:
    return load_experiment(TASK, overrides).spec


@lru_cache
def with_script(*overrides: str) -> EnvironmentSpec:
    """Return the task with its second agent scripted."""
    spec = task(*overrides)
    first, second, third = spec.agents
    return replace(spec, agents=(first, replace(second, scripted_policy=RandomThrust()), third))


def random_actions(env: InspectionParallelEnv) -> dict[str, np.ndarray]:
    return {agent: env.action_space(agent).sample() for agent in env.agents}


#: Thrust of 1 N for about 15 steps leads out of range.
FULL = np.array([0.0, 1.0, 0.0], dtype=np.float32)
NONE = np.zeros(3, dtype=np.float32)


@pytest.mark.parametrize(
    "spec",
    [
        pytest.param(lambda: task(), id="three"),
        pytest.param(lambda: task(ONE), id="one"),
        pytest.param(lambda: task("blue#_ctrl.count=5", "horizon=25"), id="five"),
        pytest.param(lambda: with_script("horizon=40"), id="scripted"),
        pytest.param(lambda: task(FILTER_ON, "horizon=15"), id="filtered"),
        pytest.param(lambda: with_script(FILTER_ON, "horizon=15"), id="scripted and filtered"),
    ],
)
def test_pettingzoos_checks_find_nothing(spec):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(InspectionParallelEnv(spec()), num_cycles=100)
        parallel_seed_test(lambda: InspectionParallelEnv(spec()), num_cycles=20)


def test_the_infos_of_an_agent():
    env = make_parallel(TASK, [FILTER_ON])
    assert env.possible_agents == NAMES
    assert env.render_mode is None
    observations, infos = env.reset(seed=3)
    assert list(observations) == list(infos) == env.agents == NAMES
    assert env.num_agents == env.max_num_agents == 3
    for agent in NAMES:
        assert env.observation_space(agent).shape == (11,)
        assert observations[agent] in env.observation_space(agent)
        assert infos[agent]["status"] == "running"
        assert infos[agent]["interventions"] == 0
    state = env.core.state
    assert env.state_space.contains(env.state())
    np.testing.assert_array_equal(env.state()[:9], state.position[0, :3].reshape(-1).astype(np.float32))
    np.testing.assert_array_equal(env.state()[-100:] == 1, state.points["chief"].inspector[0] >= 0)
    assert env.state().shape == (9 + 9 + 3 + 3 + 100,)
    observations, rewards, terminations, truncations, infos = env.step(dict.fromkeys(NAMES, FULL))
    for index, agent in enumerate(NAMES):
        info = infos[agent]
        assert type(rewards[agent]) is float
        assert rewards[agent] == pytest.approx(sum(v for name, v in info.items() if name.startswith("reward/")))
        assert info["own_inspected_count"] == state.points["chief"].own_count[0, index]
        assert info["delta_v"] == pytest.approx(np.abs(info["control"]).sum() * 10.0 / 12.0)
        np.testing.assert_array_equal(info["desired_control"], FULL)
        assert info["rta/intervening"] == (np.linalg.norm(info["control"] - FULL) > 0.01)
        assert info["interventions"] == int(info["rta/intervening"])
        assert set(info["rta/active"]) <= {
            "rel_vel",
            "sun",
            "r_max",
            "PSM",
            "x_vel",
            "y_vel",
            "z_vel",
            "chief_collision",
        }
        assert not terminations[agent]
        assert not truncations[agent]
    told = [info["inspected_count"] for info in infos.values()]
    assert told == [sum(info["own_inspected_count"] for info in infos.values())] * 3
    assert infos["blue0_ctrl"]["inspected_fraction"] == told[0] / 100


def test_one_agent_gets_the_infos_of_inspection_env(shipped):
    for overrides, steps in ((("horizon=20",), 50), ((FILTER_ON, "horizon=8"), 20)):
        alone = InspectionEnv(load_experiment(shipped, overrides).spec, slot=4)
        env = InspectionParallelEnv(task(ONE, *overrides), slot=4)
        thrusts = np.random.default_rng(0).uniform(-0.5, 0.5, (steps, 3)).astype(np.float32)
        seed = 9
        for thrust in thrusts:
            if not env.agents:
                observation, info = alone.reset(seed=seed)
                observations, infos = env.reset(seed=seed)
                seed = None
                np.testing.assert_array_equal(observations["blue0_ctrl"], observation)
                assert {"rejections/separation": 0, **info} == {"rejections/separation": 0, **infos["blue0_ctrl"]}
            expected = alone.step(thrust)
            found = env.step({"blue0_ctrl": thrust})
            np.testing.assert_array_equal(found[0]["blue0_ctrl"], expected[0])
            assert [part["blue0_ctrl"] for part in found[1:4]] == list(expected[1:4])
            told = found[4]["blue0_ctrl"]
            assert told.keys() == expected[4].keys()
            for name, value in expected[4].items():
                np.testing.assert_array_equal(told[name], value, err_msg=name)
            assert bool(env.agents) != (expected[2] or expected[3])


def test_who_has_ended_drops_out_while_the_others_continue():
    env = InspectionParallelEnv(task("horizon=30"))
    env.reset(seed=1)
    left, ends = [], {}
    while env.agents:
        asked = list(env.agents)
        found = env.step({agent: FULL if agent == "blue1_ctrl" else NONE for agent in asked})
        assert [list(part) for part in found] == [asked] * 5
        ends |= {agent: (found[2][agent], found[3][agent], found[4][agent]["status"]) for agent in asked}
        left.append(len(env.agents))
    assert ends == {
        "blue0_ctrl": (False, True, "draw"),
        "blue1_ctrl": (True, False, "lose"),
        "blue2_ctrl": (False, True, "draw"),
    }
    alone = left.index(2)
    assert 10 < alone < 29
    assert left == [3] * alone + [2] * (29 - alone) + [0]
    env.reset()
    assert env.agents == NAMES


def test_scripted_agents_are_part_of_the_world():
    env = InspectionParallelEnv(with_script("horizon=3"))
    observations, infos = env.reset(seed=1)
    assert env.possible_agents == list(observations) == list(infos) == ["blue0_ctrl", "blue2_ctrl"]
    for _ in range(3):
        assert env.agents
        env.step(random_actions(env))
    assert not env.agents
    assert env.core.state.delta_v[0, 1] > 0.0


def test_episodes_are_reproducible_by_their_seed():
    def fly(env, seed):
        seen = [env.reset(seed=seed)[0]]
        for step in range(45):
            actions = {agent: np.float32(0.1 * np.sin([step, index, 1.0])) for index, agent in enumerate(env.agents)}
            seen.append(env.step(actions)[0])
            if not env.agents:
                seen.append(env.reset()[0])
        return np.stack([np.stack(list(one.values())) for one in seen])

    one, two = (InspectionParallelEnv(task("horizon=20")) for _ in range(2))
    first = fly(one, 4)
    np.testing.assert_array_equal(first, fly(two, 4))
    np.testing.assert_array_equal(first, fly(one, 4))
    assert not np.array_equal(first, fly(two, 5))


class TestErrors:
    def test_stepping_needs_a_reset(self):
        env = InspectionParallelEnv(task("horizon=1"))
        with pytest.raises(SafeInspectError, match="call reset"):
            env.step(dict.fromkeys(NAMES, NONE))
        env.reset()
        env.step(dict.fromkeys(NAMES, NONE))
        with pytest.raises(SafeInspectError, match="is over; call reset"):
            env.step({})

    def test_all_mistakes_of_the_actions_are_reported_at_once(self):
        env = InspectionParallelEnv(task())
        env.reset(seed=1)
        with pytest.raises(SafeInspectError) as caught:
            env.step({"blue0_ctrl": np.zeros(4), "blue1_control": NONE, "blue2_ctrl": NONE})
        told = str(caught.value)
        assert "none is given for blue1_ctrl" in told
        assert "no controlled agent 'blue1_control', did you mean `blue1_ctrl`?" in told
        assert "blue0_ctrl has the shape (4,), expected (3,)" in told
        assert "blue2" not in told
        with pytest.raises(SafeInspectError, match="dictionary"):
            env.step(np.zeros((3, 3)))
        env.step(dict.fromkeys(NAMES, NONE))  # nothing has been taken

    def test_an_ended_agent_takes_no_action(self):
        env = InspectionParallelEnv(task())
        env.reset(seed=1)
        while "blue1_ctrl" in env.agents:
            env.step({agent: FULL if agent == "blue1_ctrl" else NONE for agent in env.agents})
        with pytest.raises(SafeInspectError, match="blue1_ctrl has ended and takes none until the next reset"):
            env.step(dict.fromkeys(NAMES, NONE))

    def test_a_scripted_agent_takes_none(self):
        env = InspectionParallelEnv(with_script())
        env.reset()
        with pytest.raises(SafeInspectError, match="there is no controlled agent 'blue1_ctrl'"):
            env.step(dict.fromkeys(NAMES, NONE))

    def test_the_single_agent_facades_name_the_one_to_use(self):
        for build in (make, make_vec):
            with pytest.raises(SafeInspectError, match=r"this task has 3 \(blue0_ctrl, .*make_parallel"):
                build(TASK)
        with pytest.raises(SafeInspectError, match=r"this task has 5 .*blue3_ctrl, \.\.\.\)"):
            InspectionVectorEnv(task("blue#_ctrl.count=5", "horizon=25"))

    def test_one_agent_with_scripted_ones_is_a_single_agent(self):
        spec = task("horizon=3")
        agents = (spec.agents[0], *(replace(agent, scripted_policy=ZeroThrust()) for agent in spec.agents[1:]))
        env = InspectionEnv(replace(spec, agents=agents))
        env.reset(seed=0)
        _, _, _, truncated, info = env.step(NONE)
        assert not truncated
        assert 0 < info["own_inspected_count"] < info["inspected_count"]
        vector = InspectionVectorEnv(replace(spec, agents=agents), 4)
        vector.reset(seed=0)
        told = vector.step(np.zeros((4, 3), dtype=np.float32))[4]
        assert (told["own_inspected_count"] < told["inspected_count"]).any()


def test_pettingzoo_is_imported_for_its_own_facade_alone():
    code = (
        "import sys, safe_inspect.environments as e; e.make_parallel_vec; assert 'pettingzoo' not in sys.modules; "
        "import safe_inspect.environments.facades.parallel; assert 'pettingzoo' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
    with pytest.raises(AttributeError, match="nothere"):
        sys.modules["safe_inspect.environments"].nothere  # noqa: B018 - reading it is the test


def test_the_core_is_untouched_by_infos():
    """What the façade adds to a step of the core is read from it alone."""
    spec = task("horizon=20")
    env, core = InspectionParallelEnv(spec), TeamEnvironment(spec, 1)
    env.reset(seed=2)
    core.reset(seed=2)
    for _ in range(20):
        env.step(dict.fromkeys(NAMES, np.float32([0.1, 0.0, -0.1])))
        core.step([np.float32([[[0.1, 0.0, -0.1]] * 3])])
    for name, array in core.state.arrays.items():
        np.testing.assert_array_equal(env.core.state.arrays[name], array, err_msg=name)


def test_what_the_environments_say_of_themselves() -> None:
    shown = {"render_modes": ["rgb_array"], "render_fps": 25}
    assert InspectionParallelEnv.metadata == {**shown, "name": "safe_inspect", "is_parallelizable": True}
    assert InspectionEnv.metadata.items() >= shown.items()  # a vector adds its autoreset_mode
