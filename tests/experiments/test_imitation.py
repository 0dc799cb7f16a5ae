"""Warm start: from a teacher's thrust to actions, from rounds of episodes to a policy that begins with them."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from ray.rllib.core.columns import Columns

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import TeamEnvironment
from safe_inspect.environments.facades.spaces import action_space, box
from safe_inspect.errors import SafeInspectError
from safe_inspect.experiments.imitation import warm_start as module_of_warm_start
from safe_inspect.experiments.imitation.cloning import clone, fit_values, sampling
from safe_inspect.experiments.imitation.demonstrations import Steps, fly_round
from safe_inspect.experiments.imitation.inverse import ActionInverse
from safe_inspect.experiments.imitation.warm_start import warm_start
from safe_inspect.experiments.modules.fresh_policy import policy_spec
from safe_inspect.experiments.modules.weights_file import initial_weights
from safe_inspect.experiments.runs.checkpoints import SINGLE
from safe_inspect.experiments.runs.training_run import read_settings
from safe_inspect.experiments.sampling.sampler import agent_slots
from safe_inspect.experiments.settings.imitation import Imitation
from safe_inspect.policies import DockingAutopilot, ZeroThrust

LEVELS = configs_root() / "translational-inspection" / "experiment.yml"
REAL = LEVELS.with_name("experiment-seed.yml")
TEAM = configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml"
DOCKING = configs_root() / "docking" / "experiment.yml"
SMALL = {"fcnet_hiddens": [32], "fcnet_activation": "tanh", "vf_share_layers": False}


@pytest.fixture(autouse=True)
def one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def taught(path, teacher, *overrides, num_envs: int = 4) -> TeamEnvironment:
    spec = load_experiment(path, overrides).spec
    agents = tuple(replace(agent, teacher=teacher) for agent in spec.agents)
    return TeamEnvironment(replace(spec, agents=agents), num_envs, seed=5)


def fresh(environment: TeamEnvironment, **model) -> Any:
    torch.manual_seed(0)
    group, spec = environment.acting[0], policy_spec({**SMALL, **model})
    spec.observation_space, spec.action_space = box(group.observation_layout), action_space(group.action_layout)
    return spec.build()


def inputs_of(module, observations) -> torch.Tensor:
    with torch.no_grad():
        return module.forward_train({Columns.OBS: torch.from_numpy(observations)})[Columns.ACTION_DIST_INPUTS]


class TestInverse:
    control = np.array([[0.06, -0.04, -0.3], [0.0, 0.051, 0.1]])

    def test_levels_are_the_nearest(self):
        inverse = ActionInverse(TeamEnvironment(load_experiment(LEVELS).spec, 1).groups[0])
        assert inverse(self.control).tolist() == [[2, 1, 0], [1, 2, 2]]

    def test_numbers_are_those_of_the_controller(self):
        group = TeamEnvironment(load_experiment(REAL).spec, 1).groups[0]
        action = ActionInverse(group)(self.control)
        np.testing.assert_allclose(group.thrusters(action), self.control, atol=1e-15)
        beyond = ActionInverse(group)(np.array([[5.0, -5.0, 0.0]]))
        np.testing.assert_array_equal(beyond, [[group.action_layout.high[0], group.action_layout.low[1], 0.0]])

    def test_two_elements_of_one_axis_have_none(self):
        part = "agent_config.0.config.config.parts.1.config.axis=0"
        group = TeamEnvironment(load_experiment(REAL, [part]).spec, 1).groups[0]
        with pytest.raises(SafeInspectError, match="'Y Thrust' of the action does not command one axis"):
            ActionInverse(group)


def test_a_teacher_changes_nothing_of_an_episode():
    with_one, without = taught(LEVELS, ZeroThrust()), taught(LEVELS, None)
    assert with_one.reset()[0].tobytes() == without.reset()[0].tobytes()
    for step in range(5):
        action = [np.full((4, 1, 3), step % 3.0)]
        with_one.groups[0].fly(with_one.view())
        assert with_one.step(action).groups[0].observation.tobytes() == (
            without.step(action).groups[0].observation.tobytes()
        )


class TestRounds:
    def test_the_teacher_says_what_it_would_do_whoever_flies(self):
        environments = [taught(DOCKING, DockingAutopilot(), "horizon=8") for _ in range(2)]
        slots = agent_slots(environments[0])
        policy = slots[0].policy
        pushes = {policy: lambda seen: np.ones((len(seen), 3))}
        own, others = (
            fly_round(environment, slots, acting, (policy,), 0.9)
            for environment, acting in zip(environments, ({}, pushes), strict=True)
        )
        assert len(own.steps[policy].actions) == len(others.steps[policy].actions) == 4 * 8
        first = [found.steps[policy].actions[:4] for found in (own, others)]
        np.testing.assert_array_equal(*first)  # asked in the same state
        assert not np.array_equal(own.steps[policy].actions, others.steps[policy].actions)

    def test_returns_are_the_discounted_rewards_to_the_end_of_each_episode(self):
        environment = taught(REAL, None, "horizon=40", num_envs=6)
        rewards, alive = [], []
        generator = np.random.default_rng(0)
        strength = generator.uniform(0.0, 1.0, (6, 1))
        step = environment.step

        def recorded(actions):
            alive.append(environment.state.finished[:, 0] == 0)
            found = step(actions)
            rewards.append(found.groups[0].reward[:, 0].copy())
            return found

        environment.step = recorded
        slots = agent_slots(environment, lambda agent: "p")
        found = fly_round(environment, slots, {"p": lambda seen: strength * generator.uniform(-1, 1, (6, 3))}, (), 0.9)
        wanted = []
        for time in range(len(rewards)):
            for row in range(6):
                if alive[time][row]:
                    later = range(time, len(rewards))
                    wanted.append(sum(0.9 ** (k - time) * rewards[k][row] for k in later if alive[k][row]))
        np.testing.assert_allclose(found.steps["p"].returns, wanted, rtol=1e-5, atol=1e-6)
        assert found.steps["p"].observations.dtype == np.float32


class TestCloning:
    settings = Imitation(teacher=ZeroThrust(), epochs=30, minibatch_size=100, lr=3e-3)

    def steps(self, environment, actions) -> Steps:
        seen = np.random.default_rng(0).normal(size=(600, environment.acting[0].observation_layout.size))
        seen = seen.astype(np.float32)
        return Steps(seen, actions(seen).astype(np.float32), seen[:, 1] * 2.0)

    def test_levels(self):
        environment = taught(LEVELS, None, num_envs=1)
        module = fresh(environment, initial_choice=1)
        steps = self.steps(environment, lambda seen: np.where(seen[:, :3] > 0.0, 2.0, 1.0))
        generator = torch.Generator().manual_seed(0)
        first = clone(module, steps, self.settings.model_copy(update={"epochs": 1}), generator)
        last = clone(module, steps, self.settings, generator)
        assert last < 0.5 * first
        likeliest = inputs_of(module, steps.observations).reshape(-1, 3, 3).argmax(dim=-1).numpy()
        assert (likeliest == steps.actions).mean() > 0.93
        again = sampling(module, torch.Generator().manual_seed(3))(steps.observations)
        assert again.tolist() == sampling(module, torch.Generator().manual_seed(3))(steps.observations).tolist()

    def test_real_numbers(self):
        environment = taught(REAL, None, num_envs=1)
        module = fresh(environment, initial_std=0.1)
        steps = self.steps(environment, lambda seen: 0.3 * np.tanh(seen[:, :3]))
        clone(module, steps, self.settings, torch.Generator().manual_seed(0))
        mean, deviation = inputs_of(module, steps.observations).chunk(2, dim=-1)
        assert np.abs(mean.numpy() - steps.actions).mean() < 0.06
        assert 0.03 < deviation.exp().median() < 0.3

    @pytest.mark.parametrize("shared", [False, True])
    def test_values_learn_and_actions_stay(self, shared):
        environment = taught(LEVELS, None, num_envs=1)
        module = fresh(environment, vf_share_layers=shared)
        steps = self.steps(environment, lambda seen: seen[:, :3])
        before, generator = inputs_of(module, steps.observations), torch.Generator().manual_seed(0)
        first = fit_values(module, steps, self.settings.model_copy(update={"epochs": 1}), generator)
        assert fit_values(module, steps, self.settings, generator) < 0.8 * first
        assert inputs_of(module, steps.observations).numpy().tobytes() == before.numpy().tobytes()


def settings_of(experiment) -> Any:
    task = experiment.config.config.config
    rllib = {"algorithm": experiment.algorithm, **experiment.rllib}
    return read_settings(rllib, task.tune_config, task.ray_config, tuple(experiment.policies.values()))


IMITATION = "{teacher: ZeroThrust, rounds: 2, episodes: 3, epochs: 1}"


def begun(path, folder, stream=None, **more):
    experiment = load_experiment(path, ["horizon=6", *(f"{key}={value}" for key, value in more.items())])
    settings = settings_of(experiment)
    assert not settings.problems
    trial = settings.trials[0]
    return warm_start(experiment.resolved, trial.rllib, settings.policies, folder, stream or io.StringIO())


def test_a_warm_start_is_a_checkpoint_with_which_the_policy_begins(tmp_path, monkeypatch):
    stream = io.StringIO()
    change = {"agent_config.0.policy.config.imitation": IMITATION}
    rllib, policies = begun(LEVELS, tmp_path, stream, **change)
    assert not policies
    assert rllib.settings["model_config"]["initial_weights"] == str(tmp_path / SINGLE)
    weights = initial_weights(str(tmp_path / SINGLE))
    assert weights.info is not None
    assert "pi.net.mlp.0.weight" in weights.arrays
    lines = stream.getvalue().splitlines()
    assert [line.partition(":")[0] for line in lines] == ["imitation 1/2", "imitation 2/2", "imitation, values"]
    monkeypatch.setattr(module_of_warm_start, "fly_round", lambda *_: pytest.fail("what is finished is flown again"))
    assert begun(LEVELS, tmp_path, **change)[0].settings == rllib.settings


def test_without_a_teacher_nothing_happens(tmp_path):
    rllib, _ = begun(LEVELS, tmp_path)
    assert "initial_weights" not in rllib.settings["model_config"]
    assert not list(tmp_path.iterdir())


def test_each_of_several_policies_has_its_own(tmp_path):
    _, policies = begun(TEAM, tmp_path, **{"agent_config.0.policy.config.imitation": IMITATION})
    assert len(policies) == 3
    for name, policy in policies.items():
        assert policy.settings["model_config"]["initial_weights"] == str(tmp_path / name)
    first, second = (initial_weights(str(tmp_path / name)).arrays for name in list(policies)[:2])
    assert any((array != second[name]).any() for name, array in first.items())


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("{teacher: ZeroThrst}", "did you mean `ZeroThrust`"),
        ("{rounds: 2}", "teacher"),
        ("{teacher: ZeroThrust, round: 2}", "unknown key `round` did you mean `rounds`"),
        ("{teacher: ZeroThrust, lr: 0}", "lr"),
        ("3", "a mapping"),
    ],
)
def test_mistakes_are_problems(value, message):
    experiment = load_experiment(LEVELS, [f"agent_config.0.policy.config.imitation={value}"])
    problems = settings_of(experiment).problems
    assert len(problems) == 1
    assert message in f"{problems[0].path} {problems[0].message} {problems[0].hint}"
    assert problems[0].path.startswith("rllib_configs.imitation")


def test_other_algorithms_have_no_teacher():
    algorithm = "agent_config.0.policy.algorithm=IMPALA"
    given = [algorithm, f"agent_config.0.policy.config.imitation={IMITATION}"]
    problems = settings_of(load_experiment(LEVELS, given)).problems
    assert any("only PPO has the key `imitation`" in problem.message for problem in problems)


class _BurnsNowAndThen:
    """Burns along x in steps 5, 6 and 21 of an episode."""

    commands_attitude = False
    registered_name = "BurnsNowAndThen"

    def memory(self, world):
        return {}

    def __call__(self, view, limits):
        thrust = np.zeros((view.num_rows, 3))
        thrust[np.isin(view.step, (5, 6, 21)), 0] = 0.05
        return thrust


class TestDecisions:
    task = LEVELS.with_name("experiment-burn-and-coast.yml")
    durations = "CoastGlue.config.durations=[1,2,4,8,16,32,64]"

    def flown(self, acting):
        environment = taught(self.task, _BurnsNowAndThen(), "horizon=26", self.durations, num_envs=2)
        slots = agent_slots(environment, lambda agent: "p")
        actions = fly_round(environment, slots, acting, ("p",), 0.9).steps["p"].actions
        return actions.reshape(-1, 2, 4)[:, 0]

    def test_a_decision_lasts_until_the_teacher_burns(self):
        actions = self.flown({})  # in steps 0, 4, 5, 6, 14, 18, 20 and 21, of 1, 2, 4, ... 64 steps
        assert np.flatnonzero(actions[:, 0]).tolist() == [2, 3, 7]
        assert actions[:, 3].tolist() == [2, 0, 0, 3, 2, 1, 0, 6]  # nobody knows what comes behind the end

    def test_a_decision_of_the_policy_counts_as_well(self):
        policy = {"p": lambda seen: np.tile([0.1, 0.0, 0.0, 3.0], (len(seen), 1))}  # burns in steps 0, 8, 16 and 24
        actions = self.flown(policy)
        assert actions.tolist() == [[0, 0, 0, 2], [0, 0, 0, 3], [0, 0, 0, 2], [0, 0, 0, 6]]
