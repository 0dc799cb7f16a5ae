"""The keys of RLlib, Tune and Ray: translated, dropped or refused, before Ray is loaded."""

from __future__ import annotations

import subprocess
import sys

import pytest
import yaml

from safe_inspect.cli.checked_settings import checked_settings
from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import ConfigError
from safe_inspect.experiments.settings.translation import translate_ray, translate_rllib, translate_tune

#: As files for RLlib's old API stack write it.
OLD = """
framework: torch
horizon: 2000
rollout_fragment_length: 200
train_batch_size: 1200
sgd_minibatch_size: 300
batch_mode: complete_episodes
num_workers: 2
num_cpus_per_worker: 1
num_gpus_per_worker: 0
num_envs_per_worker: 1
custom_resources_per_worker: {}
num_cpus_for_driver: 1
num_gpus: 0
num_sgd_iter: 30
gamma: 0.968559
lambda: 0.928544
lr: 5e-5
observation_filter: NoFilter
model: {fcnet_hiddens: [64, 32], fcnet_activation: relu}
vf_share_layers: true
seed: 1
"""


def paths(translation):
    return {problem.path: str(problem) for problem in translation.problems}


def test_old_names_mean_the_new_ones():
    found = translate_rllib(yaml.safe_load(OLD))
    assert not found.problems
    expected = {
        "train_batch_size_per_learner": 1200,
        "minibatch_size": 300,
        "num_epochs": 30,
        "num_env_runners": 2,
        "num_envs_per_env_runner": 1,
        "num_cpus_for_main_process": 1,
        "lambda": 0.928544,
        "lr": 5e-5,  # YAML reads it as a text
        "seed": 1,
    }
    assert {key: found.settings[key] for key in expected} == expected
    assert found.settings["model_config"] == {
        "fcnet_hiddens": [64, 32],
        "fcnet_activation": "relu",
        "vf_share_layers": True,
    }
    gone = {"sgd_minibatch_size", "num_sgd_iter", "num_workers", "horizon", "framework", "observation_filter", "model"}
    assert not gone & set(found.settings)


def test_each_translated_key_is_reported_once():
    notes = translate_rllib({"num_workers": 1, "horizon": 10, "gamma": 0.9}).notes
    assert len(notes) == 2
    assert notes[0] == "`num_workers` is now `num_env_runners`"
    assert notes[1].startswith("`horizon` has no effect: the time limit belongs to the environment")


def test_nets_are_separate_unless_asked():
    assert translate_rllib({}).settings["model_config"] == {
        "fcnet_hiddens": [256, 256],
        "fcnet_activation": "tanh",
        "vf_share_layers": False,
    }


@pytest.mark.parametrize(
    ("mapping", "path", "text"),
    [
        ({"gama": 0.9}, "rllib_configs.gama", "did you mean `gamma`?"),
        ({"sgd_minibatch_siz": 9}, "rllib_configs.sgd_minibatch_siz", "did you mean `sgd_minibatch_size`?"),
        ({"model": {"fcnet_hidens": [4]}}, "rllib_configs.model.fcnet_hidens", "did you mean `fcnet_hiddens`?"),
        ({"gamma": 1.5}, "rllib_configs.gamma", "expected a number of 1 or less, got 1.5"),
        ({"num_epochs": 0}, "rllib_configs.num_epochs", "expected a number of 1 or more, got 0"),
        ({"num_epochs": 10**20}, "rllib_configs.num_epochs", "expected a number of 2147483647 or less"),
        ({"seed": 2**32}, "rllib_configs.seed", "expected a number of 4294967295 or less"),
        ({"lr": float("inf")}, "rllib_configs.lr", "expected a finite number"),
        ({"kl_coeff": float("inf")}, "rllib_configs.kl_coeff", "expected a finite number"),
        ({"num_epochs": 2.5}, "rllib_configs.num_epochs", "expected a whole number, got 2.5"),
        ({"num_epochs": True}, "rllib_configs.num_epochs", "expected a whole number, got 'True'"),
        ({"use_gae": "yes"}, "rllib_configs.use_gae", "expected `true` or `false`"),
        ({"lr": [[5, 0.1], [9, 0.2]]}, "rllib_configs.lr", "begin with step 0"),
        ({"lr": "fast"}, "rllib_configs.lr", "expected a number or a list"),
        ({"batch_mode": "complete"}, "rllib_configs.batch_mode", "expected 'truncate_episodes' or 'complete_episodes'"),
        ({"framework": "tf2"}, "rllib_configs.framework", "only `torch` is supported"),
        ({"observation_filter": "MeanStdFilter"}, "rllib_configs.observation_filter", "`normalization` in the glues"),
        ({"env": "CartPole-v1"}, "rllib_configs.env", "cannot be set here"),
        (
            {"callbacks_class": "x"},
            "rllib_configs.callbacks_class",
            "cannot be set here: give your class as `callbacks`",
        ),
        ({"num_workers": 1, "num_env_runners": 2}, "rllib_configs.num_env_runners", "the same key, given twice"),
        (
            {"algorithm": "SAC", "model_config": {"use_lstm": True}},
            "rllib_configs.model_config.use_lstm",
            "RLlib's SAC has no recurrent policies; remove it, or use PPO",
        ),
        (
            {"model_config": {"use_lstm": True, "free_log_std": True}},
            "rllib_configs.model_config.free_log_std",
            "RLlib's recurrent policies do not support `free_log_std`; remove it or `use_lstm`",
        ),
        ({"algorithm": "PPPO"}, "rllib_configs.algorithm", "use one of `PPO`, `APPO`"),
        ({"minibatch_size": 900, "train_batch_size": 300}, "rllib_configs.minibatch_size", "larger than the batch"),
        (
            {"rollout_fragment_length": 200, "train_batch_size": 1200, "num_envs_per_worker": 4},
            "rllib_configs.rollout_fragment_length",
            "cannot be made of fragments",
        ),
        ({"evaluation_config": {"explor": False}}, "rllib_configs.evaluation_config.explor", "did you mean `explore`?"),
        (
            {"model_config": {"fcnet_hiddens": 64}},
            "rllib_configs.model_config.fcnet_hiddens",
            "expected a list, got 64",
        ),
        (
            {"model_config": {"fcnet_activation": {"grid_search": ["tanh", "relu"]}}},
            "rllib_configs.model_config.fcnet_activation",
            "`grid_search` is only supported for the keys of `rllib_configs` themselves",
        ),
    ],
)
def test_mistakes_say_where_and_what(mapping, path, text):
    found = paths(translate_rllib(mapping))
    assert set(found) == {path}
    assert text in found[path]


def test_what_is_infinite_or_null_on_purpose_is_taken():
    found = translate_rllib({"vf_clip_param": float("inf"), "sample_timeout_s": float("inf"), "lr": None})
    assert not found.problems
    assert found.notes == ["`lr` is null, so its default is used"]
    assert not translate_tune({"stop": {"time_total_s": float("inf"), "episode_reward_mean": -3}}).problems


def test_all_mistakes_are_reported_together():
    found = translate_rllib({"gama": 1, "num_epochs": -1, "model": {"fcnet_activation": "tanhh"}, "framework": "tf"})
    assert len(found.problems) == 4


def test_default_minibatch_fits_a_small_batch():
    assert translate_rllib({"train_batch_size": 100}).settings["minibatch_size"] == 100


def test_searched_values_are_checked_one_by_one():
    good = translate_rllib({"lr": {"grid_search": [1e-4, "1e-3"]}})
    assert good.settings["lr"] == {"grid_search": [1e-4, 1e-3]}
    assert (
        "a number of 1 or less" in paths(translate_rllib({"gamma": {"grid_search": [0.9, 2.0]}}))["rllib_configs.gamma"]
    )


def test_keys_of_another_algorithm_wait_for_ray():
    found = translate_rllib({"algorithm": "SAC", "n_step": 3, "gamma": 0.9})
    assert found.settings["n_step"] == 3
    assert not found.problems
    assert "minibatch_size" not in found.settings  # PPO's defaults are PPO's


@pytest.mark.parametrize(("algorithm", "key", "meant"), [("SAC", "taus", "tau"), ("APPO", "vtrase", "vtrace")])
def test_a_key_that_an_algorithm_does_not_have_is_found_without_ray(algorithm, key, meant):
    (problem,) = translate_rllib({"algorithm": algorithm, key: 0.25}).problems
    assert problem.message == f"there is no key `{key}`"
    assert f"`{meant}`" in problem.hint


def test_tune_names_the_algorithm_and_must_agree():
    assert translate_rllib({}, "APPO").settings["algorithm"] == "APPO"
    assert "remove one" in paths(translate_rllib({"algorithm": "PPO"}, "APPO"))["rllib_configs.algorithm"]


def test_old_tune_settings():
    found = translate_tune(
        yaml.safe_load("""
        run_or_experiment: PPO
        stop: {training_iteration: 9.2e+18, episode_reward_mean: 2, timesteps_total: 10.0e+6, time_total_s: 60}
        local_dir: ./output/tune/
        restore: null
        resume: False
        checkpoint_freq: 25
        checkpoint_at_end: True
        reuse_actors: True
        keep_checkpoints_num: 5
        checkpoint_score_attr: min-episode_reward_mean
        max_failures: 5
        """)
    )
    assert not found.problems
    assert found.settings["stop"] == {
        "training_iteration": 9.2e18,
        "env_runners/episode_return_mean": 2,
        "num_env_steps_sampled_lifetime": 1e7,
        "time_total_s": 60,
    }
    expected = {
        "algorithm": "PPO",
        "storage_path": "./output/tune/",
        "checkpoint_frequency": 25,
        "num_to_keep": 5,
        "max_failures": 5,
        "checkpoint_score_attribute": "env_runners/episode_return_mean",
        "checkpoint_score_order": "min",
    }
    assert {key: found.settings[key] for key in expected} == expected


@pytest.mark.parametrize(
    ("mapping", "path", "text"),
    [
        ({"stop": {"sucess_rate": 1}}, "tune_config.stop.sucess_rate", "did you mean `success_rate`?"),
        (
            {"stop": {"training_iteration": "many"}},
            "tune_config.stop.training_iteration",
            "expected a number, got 'many'",
        ),
        (
            {"stop": {"timesteps_total": 1, "num_env_steps_sampled": 2}},
            "tune_config.stop.num_env_steps_sampled",
            "twice",
        ),
        ({"checkpoint_frq": 1}, "tune_config.checkpoint_frq", "did you mean `checkpoint_freq`?"),
        ({"restore": "/some/where"}, "tune_config.restore", "--resume RUN_FOLDER"),
        ({"scheduler": "asha"}, "tune_config.scheduler", "a dotted path"),
        ({"search_alg": "optuna"}, "tune_config.search_alg", "a dotted path `module.Class`, got 'optuna'"),
        ({"num_samples": 0}, "tune_config.num_samples", "expected a number of 1 or more"),
        (
            {"stop": {"training_iteration": -5}},
            "tune_config.stop.training_iteration",
            "expected a number of 1 or more, got -5",
        ),
        ({"stop": {"training_iteration": None}}, "tune_config.stop.training_iteration", "expected a number"),
        (
            {"stop": {"training_iteration": {"grid_search": [1, 2]}}},
            "tune_config.stop.training_iteration",
            "`grid_search` is only supported",
        ),
        ({"stop": {"timesteps_total": 0}}, "tune_config.stop.timesteps_total", "expected a number of 1 or more, got 0"),
    ],
)
def test_mistakes_of_tune(mapping, path, text):
    found = paths(translate_tune(mapping))
    assert set(found) == {path}
    assert text in found[path]


def test_ray_is_the_runs_own_unless_asked():
    assert translate_ray({}).settings["address"] == "local"
    assert translate_ray({"address": "auto"}).settings["address"] == "auto"
    old = translate_ray({"address": None, "local_mode": True, "ignore_reinit_error": True, "_temp_dir": "/tmp/ray"})
    assert not old.problems
    assert old.settings["temporary_folder"] == "/tmp/ray"
    assert any("num_env_runners: 0" in note for note in old.notes)
    assert "did you mean `num_cpus`?" in paths(translate_ray({"num_cpu": 2}))["ray_config.num_cpu"]


def test_checking_does_not_load_ray_or_torch():
    code = (
        "import sys; from safe_inspect.experiments.runs.training_run import read_settings; read_settings({}, {}, {});"
        "print(sorted({name.partition('.')[0] for name in sys.modules} & {'ray', 'torch', 'tensorboardX', 'pandas'}))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("mapping", "reason"),
    [
        ({"model": {"use_lstm": True}}, "the policy is recurrent (`use_lstm`)"),
        ({"algorithm": "SAC"}, "the batched runner supports PPO, APPO, IMPALA, not SAC"),
        ({"restart_failed_sub_environments": True}, "does not restart environments that fail"),
    ],
)
def test_the_stock_runner_takes_over_with_one_note(mapping, reason):
    found = translate_rllib(mapping)
    assert found.settings["env_runner"] == "stock"
    (note,) = [note for note in found.notes if "stock runner" in note]
    assert reason in note
    asked = translate_rllib({**mapping, "env_runner": "stock"})
    assert not any("stock runner" in note for note in asked.notes)


def test_the_runner_is_batched_unless_asked():
    assert translate_rllib({}).settings["env_runner"] == "batched"
    assert translate_rllib({"env_runner": "stock"}).settings["env_runner"] == "stock"
    wrong = paths(translate_rllib({"env_runner": "batch"}))["rllib_configs.env_runner"]
    assert "expected 'batched' or 'stock'" in wrong
    searched = translate_rllib({"env_runner": {"grid_search": ["batched", "stock"]}})
    assert "give one" in paths(searched)["rllib_configs.env_runner"]


@pytest.mark.parametrize(
    ("mapping", "reason"),
    [
        ({"model": {"use_lstm": True}}, "the policy is recurrent (`use_lstm`)"),
        ({"num_learners": 2}, "several learners share a batch (`num_learners`)"),
        ({"num_learners": {"grid_search": [1, 2]}}, "several learners share a batch (`num_learners`)"),
        ({"torch_skip_nan_gradients": False}, "each gradient must be checked"),
    ],
)
def test_the_stock_learner_takes_over_with_one_note(mapping, reason):
    found = translate_rllib(mapping)
    assert found.settings["learner"] == "stock"
    (note,) = [note for note in found.notes if "stock learner" in note]
    assert reason in note
    asked = translate_rllib({**mapping, "learner": "stock"})
    assert not any("stock learner" in note for note in asked.notes)


def test_the_learner_is_fast_unless_asked():
    assert translate_rllib({}).settings["learner"] == "fast"
    assert translate_rllib({"num_learners": 1}).settings["learner"] == "fast"
    assert translate_rllib({"num_gpus": {"grid_search": [0, 1]}}).settings["learner"] == "fast"
    assert translate_rllib({"learner": "stock"}).settings["learner"] == "stock"
    other = translate_rllib({"algorithm": "IMPALA"})
    assert other.settings["learner"] == "stock"
    assert not any("learner" in note for note in other.notes)
    searched = translate_rllib({"learner": {"grid_search": ["fast", "stock"]}})
    assert "give one" in paths(searched)["rllib_configs.learner"]


@pytest.mark.parametrize("algorithm", ["APPO", "DQN", "SAC"])
def test_the_keys_of_ppo_under_another_algorithm_are_one_mistake_that_names_its_file(algorithm):
    model = {"orthogonal": True, "initial_choice": 1, "fcnet_hiddens": [8], "initial_std": 0.1}
    (problem,) = translate_rllib({"algorithm": algorithm, "model_config": model}).problems
    assert problem.message == "only PPO has the keys `orthogonal`, `initial_choice`, `initial_std`"
    assert f"'policy=!include configs/learners/{algorithm.lower()}.yml'" in problem.hint


@pytest.mark.parametrize("address", ["http://x", "x y", "", "localhost:port", "ray://"])
def test_what_is_no_address_of_ray_is_refused(address):
    (problem,) = translate_ray({"address": address}).problems
    assert "is not the address of a Ray cluster" in problem.message


@pytest.mark.parametrize("address", ["auto", "local", "head:6379", "10.0.0.1:6379", "[::1]:6379", "ray://head:10001"])
def test_addresses_of_ray(address):
    assert translate_ray({"address": address}).settings["address"] == address


def test_a_training_that_nothing_ends_is_noted():
    for tune in ({}, {"stop": {}}):
        assert any("the training runs until it is interrupted" in note for note in translate_tune(tune).notes)
    for tune in ({"stop": {"training_iteration": 1}}, {"time_budget_s": 5}):
        assert translate_tune(tune).notes == []


@pytest.mark.parametrize("key", ["clip_param", "vf_clip_param"])
def test_a_clip_that_leaves_no_gradient_is_refused(key):
    (problem,) = translate_rllib({key: 0}).problems
    assert problem.message == "expected a number of 1e-06 or more, got 0"


@pytest.mark.parametrize("key", ["initial_weights", "fcnet_hiddens"])
def test_a_key_of_the_net_says_where_it_belongs(key):
    (problem,) = translate_rllib({key: "x"}).problems
    assert problem.message == f"`{key}` cannot be set here: it is a key of `model_config`"


def test_a_policy_without_a_reward_cannot_learn():
    experiment = load_experiment("configs/translational-inspection/experiment.yml", ["rewards=[]"])
    with pytest.raises(ConfigError, match="blue0_ctrl: no reward, so that nothing can be learned"):
        checked_settings(experiment)
