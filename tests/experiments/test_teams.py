"""Trainings of several agents: a policy for each, shared ones, ones from a checkpoint, and what is refused."""

from __future__ import annotations

import io
import math
import shutil

import numpy as np
import pytest
from dummy_environment import TEAM, THREE
from training_values import MAKER, QUICK

from safe_inspect.config.spec import PolicySpec
from safe_inspect.errors import CheckpointError, ConfigError
from safe_inspect.experiments.runs.progress import read_progress
from safe_inspect.experiments.runs.train import train
from safe_inspect.experiments.runs.training_run import TrainingRun, read_settings

pytestmark = pytest.mark.ray

SHARED = PolicySpec("shared", ("red", "blue"), "PPO", {"lr": 2e-3, "entropy_coeff": 0.01})
OWN = PolicySpec("own", ("green",), "PPO", {"lr": 1e-4, "model_config": {"fcnet_hiddens": [8]}})


def run_of(output, policies=(SHARED, OWN), team=TEAM, iterations=2, **more):
    return TrainingRun(
        {"team": team, "drift": 0.03},
        rllib={**QUICK, **more},
        tune={"stop": {"training_iteration": iterations}, "checkpoint_frequency": 1},
        name="team",
        output=output,
        maker=MAKER,
        policies=policies,
    )


@pytest.fixture(scope="module")
def trained(ray_session, tmp_path_factory):
    """Train two iterations, once for the tests below."""
    stream = io.StringIO()
    run = run_of(tmp_path_factory.mktemp("out"))
    result = train(run, stream)
    return result, stream.getvalue(), run


def weights(checkpoint, policy):
    from ray.rllib.core.rl_module.rl_module import RLModule

    module = RLModule.from_checkpoint(str(checkpoint / "learner_group" / "learner" / "rl_module" / policy))
    return {name: value.numpy() for name, value in module.state_dict().items()}


@pytest.mark.slow
def test_each_agent_and_the_team_are_reported(trained):
    result, printed, _ = trained
    last = read_progress(result.folder / "progress.csv")[-1]
    parts = [last[f"agents/{agent}/return"] for agent in ("red", "blue", "green")]
    assert last["return_mean"] == pytest.approx(sum(parts), abs=1e-4)
    assert last["return_mean"] == pytest.approx(last["reward/near"] + last["reward/cost"], abs=1e-4)
    assert last["delta_v"] == pytest.approx(
        np.mean([last[f"agents/{agent}/delta_v"] for agent in ("red", "blue", "green")]), rel=1e-6
    )
    assert 0.0 < last["success_rate"] <= 1.0
    for policy in ("shared", "own"):
        assert math.isfinite(last[f"policies/{policy}/policy_loss"])
    assert [line.split()[1] for line in printed.splitlines() if line.startswith("iteration")] == ["1/2", "2/2"]
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(result.folder / "tensorboard"))
    events.Reload()
    assert "env_runners/agents/green/inspected_count" in events.Tags()["scalars"]


def test_each_policy_has_its_own_settings(trained):
    result, _, _ = trained
    flat = result.metrics
    assert flat["learners/shared/default_optimizer_learning_rate"] == pytest.approx(2e-3)
    assert flat["learners/own/default_optimizer_learning_rate"] == pytest.approx(1e-4)
    assert flat["learners/shared/curr_entropy_coeff"] == pytest.approx(0.01)
    assert flat["learners/own/curr_entropy_coeff"] == 0.0
    shapes = {
        policy: {value.shape for value in weights(result.checkpoint, policy).values()} for policy in ("shared", "own")
    }
    assert (16, 11) in shapes["shared"]
    assert (8, 7) in shapes["own"]
    steps = {name: flat[f"env_runners/num_module_steps_sampled/{name}"] for name in ("shared", "own")}
    agents = {name: flat[f"env_runners/num_agent_steps_sampled/{name}"] for name in ("red", "blue", "green")}
    assert steps["shared"] == agents["red"] + agents["blue"]
    assert steps["own"] == agents["green"]


def test_a_team_continues_from_its_checkpoint(trained):
    result, _, run = trained
    stream = io.StringIO()
    fields = {**vars(run), "resume": result.folder, "tune": {"stop": {"training_iteration": 3}}}
    more = train(TrainingRun(**fields), stream)
    assert "the training continues after iteration 2" in stream.getvalue()
    assert more.iteration == 3
    assert [row["iteration"] for row in read_progress(result.folder / "progress.csv")] == [1, 2, 3]


def test_other_policies_than_the_checkpoints_are_refused(trained):
    result, _, run = trained
    fields = {
        **vars(run),
        "resume": result.folder,
        "policies": [PolicySpec("shared", ("red", "blue", "green"), "PPO", {})],
    }
    with pytest.raises(CheckpointError) as caught:
        train(TrainingRun(**fields))
    assert "policies.own: {" in str(caught.value)
    assert 'policies.shared.agents: ["red", "blue"] in the run, ["red", "blue", "green"] now' in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("runner", ["batched", pytest.param("stock", marks=pytest.mark.long)])
def test_a_policy_from_a_checkpoint_flies_and_does_not_learn(trained, tmp_path, runner):
    result, _, _ = trained
    frozen = PolicySpec("old", ("green",), "", {}, str(result.checkpoint), "own")
    found = train(run_of(tmp_path, (SHARED, frozen), iterations=1, env_runner=runner), io.StringIO())
    before, after = weights(result.checkpoint, "own"), weights(found.checkpoint, "old")
    assert before.keys() == after.keys()
    for name, value in before.items():
        np.testing.assert_array_equal(after[name], value)
    assert not any(key.startswith("learners/old/") and "loss" in key for key in found.metrics)
    assert "learners/shared/policy_loss" in found.metrics
    assert math.isfinite(found.metrics["env_runners/agents/green/return"])


def old(path, name):
    return PolicySpec("old", ("green",), "", {}, str(path), name)


def damaged(checkpoint, folder):
    copy = shutil.copytree(checkpoint, folder / "copy")
    state = next((copy / "learner_group" / "learner" / "rl_module" / "own").glob("module_state*"))
    state.write_bytes(state.read_bytes()[:-100])
    return copy


@pytest.mark.parametrize(
    ("policy", "text"),
    [
        (
            lambda path, _: PolicySpec("old", ("green",), "", {}, "/no/where", "own"),
            "/no/where: there is no such checkpoint",
        ),
        (
            lambda path, _: PolicySpec("old", ("green",), "", {}, str(path), "owm"),
            "no policy 'owm'; did you mean `own`?",
        ),
        (
            lambda path, _: PolicySpec("old", ("green",), "", {}, str(path)),
            "has the policies own, shared; name one of them",
        ),
        (
            lambda path, _: PolicySpec("old", ("green",), "", {}, str(path), "shared"),
            "the policy of green has 11 elements of observation, but the agent has 7",
        ),
        (
            lambda path, folder: PolicySpec("old", ("green",), "", {}, str(damaged(path, folder)), "own"),
            r"the checkpoint is damaged; .* is not what was saved",
        ),
    ],
)
def test_a_checkpoint_that_does_not_fit_is_refused_before_anything_is_written(trained, tmp_path, policy, text):
    result, _, _ = trained
    with pytest.raises(CheckpointError, match=text):
        train(run_of(tmp_path / "out", (SHARED, policy(result.checkpoint, tmp_path))))
    assert not (tmp_path / "out").exists()


def test_agents_that_see_different_things_cannot_share_a_policy(tmp_path):
    everyone = PolicySpec("shared", ("red", "blue", "green"), "PPO", {})
    with pytest.raises(
        ConfigError, match="red and green share the policy shared, but their observations differ: 11 and 7"
    ):
        train(run_of(tmp_path / "out", (everyone,)))
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_one_policy_for_all_is_trained(ray_session, tmp_path):
    everyone = PolicySpec("all", ("red", "blue", "green"), "PPO", {})
    result = train(run_of(tmp_path, (everyone,), THREE, iterations=1), io.StringIO())
    assert math.isfinite(result.metrics["learners/all/policy_loss"])
    agents = sum(result.metrics[f"env_runners/num_agent_steps_sampled/{agent}"] for agent in ("red", "blue", "green"))
    assert result.metrics["env_runners/num_module_steps_sampled/all"] == agents


@pytest.mark.parametrize(
    ("config", "text"),
    [
        (
            {"minibatch_size": 100},
            "`minibatch_size` applies to all policies, so own cannot have a separate value; give all",
        ),
        ({"sgd_minibatch_size": 100}, "`minibatch_size` applies to all policies"),
        ({"lrr": 1.0}, "there is no key `lrr`; did you mean `lr`?"),
        ({"lr": {"grid_search": [0.1, 0.2]}}, "only keys that are the same for all policies can be searched"),
        ({"entropy_coeff": -1.0}, "expected a number of 0 or more, got -1.0"),
    ],
)
def test_what_a_policy_cannot_have_separately(config, text):
    settings = read_settings({}, {}, {}, [SHARED, PolicySpec("own", ("green",), "PPO", config)])
    (problem,) = settings.problems
    assert problem.path.startswith("policies.own.")
    assert text in str(problem)


def test_one_agent_alone_has_the_settings_of_the_training():
    settings = read_settings({"lr": 1e-3}, {}, {}, [PolicySpec("pilot", ("pilot",), "PPO", {})])
    assert settings.policies == {}
