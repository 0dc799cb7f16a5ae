"""Actions that hold for several control steps: what the core does with them, and the façades that step by decisions."""

from __future__ import annotations

from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import MultiDiscrete
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test

import safe_inspect
from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import ConfigError
from safe_inspect.metrics import Decisions
from safe_inspect.simulators.view import FilterResult

ONE = configs_root() / "translational-inspection" / "experiment-burn-and-coast.yml"
LEVELS = configs_root() / "translational-inspection" / "experiment.yml"
TEAM = configs_root() / "multiagent-translational-inspection" / "experiment-burn-and-coast.yml"
GAMMA = 0.99


def coast(durations):
    return f"RTAGlueCWHInspection1v1.wrapped.3={{functor: CoastGlue, config: {{durations: {durations}}}}}"


def environment(path=ONE, *overrides, num_envs=3, seed=5, first_slot=0):
    return TeamEnvironment(load_experiment(path, overrides).spec, num_envs, seed=seed, first_slot=first_slot)


def actions_of(rng, shape, largest=5):
    return np.concatenate((rng.uniform(-1, 1, (*shape, 3)), rng.integers(0, largest + 1, (*shape, 1))), axis=-1)


def test_the_thrust_is_held_for_one_step_and_the_rest_is_coast():
    core = environment()
    core.reset()
    assert core.acting[0].action_layout.names[-1] == "coast"
    action = np.array([[[1.0, -0.5, 0.0, 0.0]], [[0.2, 0.2, 0.2, 1.0]], [[0.0, 0.0, 1.0, 2.4]]])
    held, due = [], []
    for _ in range(18):
        core.step([action])
        held.append(core.state.control[:, 0] / 0.1)
        due.append(core.due()[0][:, 0])
    for row, lasts in enumerate((4, 8, 16)):
        for time in range(18):
            wanted = action[row, 0, :3] if time % lasts == 0 else np.zeros(3)
            np.testing.assert_allclose(held[time][row], wanted, atol=1e-15)
            assert due[time][row] == ((time + 1) % lasts == 0)
    assert not core.due()[0][2, 0]
    core.reset(np.array([2]))
    assert core.due()[0][2, 0]  # a new episode begins with a decision


def test_decisions_of_one_step_are_steps():
    plain = environment(LEVELS)
    levels = ", ".join(
        f"{{functor: DiscreteControllerGlue, config: {{controller: {axis} Thrust, levels: [-0.1, 0, 0.1]}}}}"
        for axis in "XYZ"
    )
    coasts = "{functor: CoastGlue, config: {durations: [1]}}"
    same = environment(LEVELS, f"RTAGlueCWHInspection1v1.wrapped=[{levels}, {coasts}]")
    assert same.acting[0].action_layout.choices == (3, 3, 3, 1)
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(plain.reset()[0], same.reset()[0])
    for _ in range(40):
        action = rng.integers(0, 3, (3, 1, 3)).astype(float)
        found = plain.step([action]).groups[0]
        other = same.step([np.concatenate((action, np.zeros((3, 1, 1))), axis=-1)]).groups[0]
        np.testing.assert_array_equal(found.observation, other.observation)
        np.testing.assert_array_equal(found.reward, other.reward)
        assert same.due()[0].all()


def test_a_row_of_a_batch_is_the_row_alone():
    rng = np.random.default_rng(1)
    given = actions_of(rng, (60, 3, 1))
    batch = environment()
    batch.reset()
    seen = [batch.step([action]).groups[0].observation for action in given]
    for row in range(3):
        alone = environment(num_envs=1, first_slot=row)
        alone.reset()
        for action, wanted in zip(given[:, row : row + 1], seen, strict=True):
            np.testing.assert_array_equal(alone.step([action]).groups[0].observation[0], wanted[row])


def test_an_intervention_of_the_filter_is_the_end_of_a_decision():
    core = environment()
    core.reset()
    group = core.groups[0]

    def brake(desired, view):
        rows = view.step == np.array([2, 99, 0])
        control = np.where(rows[:, None], 0.01, desired)
        zeros = np.zeros((len(desired), 0))
        return FilterResult(control, rows, ~rows & False, np.zeros(3, dtype=np.int64), zeros, zeros, ())

    group.safety_filter = SimpleNamespace(filter=brake)
    action = np.tile(np.array([0.5, 0.0, 0.0, 3.0]), (3, 1, 1))
    core.step([action])
    assert core.due()[0].ravel().tolist() == [False, False, True]  # of a burn, too
    core.step([action])
    core.step([action])
    assert core.due()[0].ravel().tolist() == [True, False, False]
    core.step([action])
    assert core.state.control[0, 0, 0] == pytest.approx(0.05)
    assert core.state.control[1, 0, 0] == 0.0


def flown(action_rows, gamma=GAMMA, seed=3):
    """Return what decisions give in one environment, by control steps."""
    core = environment(num_envs=1, seed=seed)
    observation = core.reset(seed=seed)[0][0, 0]
    found = []
    for action in action_rows:
        total, discount, steps = 0.0, 1.0, 0
        while True:
            step = core.step([action[None, None]])
            group = step.groups[0]
            total += discount * group.reward[0, 0]
            discount *= gamma
            steps += 1
            over = bool(group.done[0, 0])
            if over or core.due()[0][0, 0]:
                break
        observation = group.observation[0, 0]
        found.append((observation, total, bool(group.terminated[0, 0]), bool(group.truncated[0, 0]), steps, discount))
        if over:
            return found
    return found


@pytest.fixture(scope="module")
def reference():
    rng = np.random.default_rng(2)
    rows = actions_of(rng, (400,)).astype(np.float32)
    found = flown(rows)
    assert found[-1][2] or found[-1][3]
    return rows[: len(found)], found


def test_a_step_of_gymnasium_is_a_decision(reference):
    env = safe_inspect.make(ONE, gamma=GAMMA, render_mode="rgb_array")
    env.reset(seed=3)
    for action, (observation, reward, terminated, truncated, steps, discount) in zip(*reference, strict=True):
        seen, got, ended, cut, info = env.step(action)
        np.testing.assert_array_equal(seen, observation)
        assert got == pytest.approx(reward, abs=1e-12)
        assert (ended, cut, info["elapsed_steps"]) == (terminated, truncated, steps)
        assert info["discount"] == pytest.approx(discount)
        terms = sum(value for name, value in info.items() if name.startswith("reward/"))
        assert terms == pytest.approx(reward, abs=1e-9)
    assert env.render().shape == (480, 480, 3)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_a_row_of_a_vector_waits_for_the_others(reference, mode):
    many = safe_inspect.make_vec(ONE, 3, gamma=GAMMA, autoreset_mode=mode)
    observation, _ = many.reset(seed=3)
    rng = np.random.default_rng(4)
    over = np.zeros(3, dtype=bool)
    for action, (wanted, reward, terminated, truncated, steps, _) in zip(*reference, strict=True):
        if mode == "Disabled" and over.any():
            many.reset(options={"reset_mask": over})
        given = np.concatenate((action[None], actions_of(rng, (2,))))
        observation, rewards, ended, cut, infos = many.step(given.astype(np.float32))
        over = ended | cut
        last = infos if not (mode == "SameStep" and over[0]) else infos["final_info"]
        seen = observation[0] if not (mode == "SameStep" and over[0]) else infos["final_obs"][0]
        np.testing.assert_array_equal(seen, wanted)
        assert rewards[0] == pytest.approx(reward, abs=1e-12)
        assert (ended[0], cut[0], last["elapsed_steps"][0]) == (terminated, truncated, steps)
    assert over[0]


def test_the_environments_pass_the_checks_of_their_libraries():
    check_env(safe_inspect.make(ONE), skip_render_check=True)
    parallel_api_test(safe_inspect.make_parallel(TEAM), num_cycles=40)


def test_several_agents_decide_at_their_own_times():
    env = safe_inspect.make_parallel(TEAM, gamma=GAMMA)
    env.reset(seed=1)
    batch = safe_inspect.make_parallel_vec(TEAM, 2, gamma=GAMMA)
    batch.reset(seed=1)
    core = environment(TEAM, num_envs=1)
    core.reset(seed=1)
    rng = np.random.default_rng(6)
    decides, times = dict.fromkeys(env.agents, True), set()
    for _ in range(30):
        actions = {agent: actions_of(rng, (), 4).astype(np.float32) for agent in env.agents}
        others = {agent: np.stack((action, actions_of(rng, (), 4))) for agent, action in actions.items()}
        observations, rewards, terminated, truncated, infos = env.step(actions)
        seen, got, _, _, many = batch.step(others)
        total, discount = np.zeros(3), 1.0
        due = core.due()[0][0]
        assert due.tolist() == list(decides.values())
        for _ in range(next(iter(infos.values()))["elapsed_steps"]):
            found = core.step([np.stack(list(actions.values()))[None]]).groups[0]
            total += discount * found.reward[0]
            discount *= GAMMA
        for index, agent in enumerate(actions):
            np.testing.assert_array_equal(observations[agent], found.observation[0, index])
            assert rewards[agent] == pytest.approx(total[index], abs=1e-12)
            np.testing.assert_array_equal(seen[agent][0], observations[agent])
            assert got[agent][0] == pytest.approx(rewards[agent], abs=1e-12)
            assert many["elapsed_steps"][agent][0] == infos[agent]["elapsed_steps"]
        if any(terminated.values()) or any(truncated.values()):
            break
        decides = {agent: info["decides"] for agent, info in infos.items()}
        assert any(decides.values())
        times |= {tuple(decides.values())}
    assert len(times) > 2


def test_a_metric_counts_decisions():
    from safe_inspect.evaluation.rollouts import rollout

    spec = load_experiment(ONE, ["horizon=40"]).spec
    sleep = np.array([0.0, 0.0, 0.0, 2.0])  # 16 steps
    episodes = rollout(spec, lambda seen: np.tile(sleep, (len(seen), 1)), 3, metrics=[Decisions()])
    assert episodes.metrics["decisions"].tolist() == np.ceil(episodes.length / 16).tolist()


def test_the_coast_is_one_of_a_few_choices_in_addition_to_levels():
    env = safe_inspect.make(
        LEVELS,
        ["RTAGlueCWHInspection1v1.wrapped.2={functor: CoastGlue, config: {durations: [1, 5]}}"],
    )
    assert env.action_space == MultiDiscrete([3, 3, 2])
    env.reset(seed=0)
    assert env.step(np.array([2, 1, 1]))[4]["elapsed_steps"] == 5
    assert isinstance(env, gymnasium.Env)


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        (coast([]), "is empty; give one or more"),
        (coast([0, 1]), "expected a number of 1 or more, got 0"),
        (coast([1, 4, 2]), "must be in ascending order"),
        (coast([2, 2]), "must be in ascending order"),
        (coast([1.5]), "expected a whole number, got 1.5"),
        (
            "RTAGlueCWHInspection1v1.wrapped=[{functor: CoastGlue}, "
            "{functor: ControllerGlue, config: {controller: X Thrust}}]",
            "is before the glue of a controller",
        ),
    ],
)
def test_bad_durations(override, expected):
    with pytest.raises(ConfigError, match=expected) as caught:
        load_experiment(ONE, [override])
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize("path", [ONE, TEAM])
def test_observations_amid_a_decision_may_be_left_out(path):
    cores = [environment(path, num_envs=64) for _ in range(2)]
    cores[1].observes_coasting = False
    rng = np.random.default_rng(3)
    for core in cores:
        core.reset()
    left_out = 0
    for _ in range(150):
        action = [actions_of(rng, (64, group.size)) for group in cores[0].acting]
        whole, due = (core.step(action) for core in cores)
        for expected, found, mine in zip(whole.groups, due.groups, cores[0].due(), strict=True):
            for name in ("reward", "terminated", "truncated", "status"):
                np.testing.assert_array_equal(getattr(expected, name), getattr(found, name))
            seen = mine | expected.done
            np.testing.assert_array_equal(expected.observation[seen], found.observation[seen])
            amid = ~seen & (expected.status == 0)
            assert np.isnan(found.observation[amid]).all()
            left_out += np.count_nonzero(amid)
        for core, transition in zip(cores, (whole, due), strict=True):
            if transition.over.any():
                core.reset(np.flatnonzero(transition.over))
    assert left_out > 1000
