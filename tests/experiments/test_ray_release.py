"""Our tables against the installed RLlib: these fail when a release of Ray changes a key."""

from __future__ import annotations

import dataclasses
import inspect
import json

import pytest
from pydantic import TypeAdapter
from training_values import MAKER

from safe_inspect.config.keys import old_keys, run_keys
from safe_inspect.config.keys import rllib_keys as keys
from safe_inspect.errors import ConfigError
from safe_inspect.experiments.settings.translation import translate_rllib, translate_tune

pytestmark = pytest.mark.ray

#: Settings of RLlib that an experiment cannot give: offline data, Python values, and those without an effect.
NOT_KEYS = """
    action_mask_key actions_in_input_normalized add_default_connectors_to_env_to_module_pipeline
    add_default_connectors_to_learner_pipeline add_default_connectors_to_module_to_env_pipeline algo_class
    broadcast_offline_eval_runner_states callbacks_on_algorithm_init callbacks_on_checkpoint_loaded
    callbacks_on_env_runners_recreated callbacks_on_environment_created callbacks_on_episode_created
    callbacks_on_episode_end callbacks_on_episode_start callbacks_on_episode_step callbacks_on_evaluate_end
    callbacks_on_evaluate_offline_end callbacks_on_evaluate_offline_start callbacks_on_evaluate_start
    callbacks_on_offline_eval_runners_recreated callbacks_on_sample_end callbacks_on_train_result
    checkpoint_trainable_policies_only count_steps_by custom_evaluation_function
    custom_resources_per_offline_eval_runner dataset_num_iters_per_eval_runner dataset_num_iters_per_learner
    eager_max_retraces enable_tf1_exec_eagerly env_runner_cls episodes_to_numpy exploration_config
    export_native_model_files extra_python_environs_for_driver extra_python_environs_for_worker fake_sampler
    gym_env_vectorize_mode ignore_final_observation ignore_offline_eval_runner_failures in_evaluation input_
    input_compress_columns input_config input_filesystem input_filesystem_kwargs input_read_batch_size
    input_read_episodes input_read_method input_read_method_kwargs input_read_sample_batches input_read_schema
    input_spaces_jsonable iter_batches_kwargs keep_per_episode_custom_metrics local_tf_session_args
    map_batches_kwargs materialize_data materialize_mapped_data max_num_offline_eval_runner_restarts
    max_requests_in_flight_per_offline_eval_runner num_cpus_per_offline_eval_runner
    num_gpus_per_offline_eval_runner num_offline_eval_runners observation_fn off_policy_estimation_methods
    offline_data_class offline_eval_batch_size_per_runner offline_eval_rl_module_inference_only
    offline_eval_runner_class offline_eval_runner_health_probe_timeout_s offline_eval_runner_restore_timeout_s
    offline_evaluation_duration offline_evaluation_interval offline_evaluation_parallel_to_training
    offline_evaluation_timeout_s offline_evaluation_type offline_loss_for_module_fn offline_sampling
    ope_split_batch_by_episode optimizer output output_compress_columns output_config output_filesystem
    output_filesystem_kwargs output_max_file_size output_max_rows_per_file output_write_episodes
    output_write_method output_write_method_kwargs output_write_remaining_data policy_map_capacity
    policy_states_are_swappable postprocess_inputs prelearner_buffer_class prelearner_buffer_kwargs
    prelearner_class prelearner_module_synch_period prelearner_use_recorded_module_states
    remote_env_batch_wait_ms remote_worker_envs replay_sequence_length restart_failed_offline_eval_runners
    sample_collector sampler_perf_stats_ema_coef shuffle_buffer_size stats_cls_lookup
    sync_filters_on_rollout_workers_timeout_s tf_session_args torch_compile_learner_what_to_compile
    update_worker_filter_stats use_worker_filter_stats validate_offline_eval_runners_after_construction
"""


@pytest.fixture(scope="module")
def ppo():
    from safe_inspect.experiments.learning.algorithm import default_config
    from safe_inspect.experiments.runs import cluster

    cluster.set_environment()
    return default_config("PPO")


def attribute(name):
    from safe_inspect.experiments.learning.algorithm import ATTRIBUTES

    return ATTRIBUTES.get(name, name)


def test_every_key_of_the_table_exists(ppo):
    from safe_inspect.experiments.learning.algorithm import attribute_names

    names = attribute_names(ppo)
    missing = [key for key in (*keys.COMMON_KEYS, *keys.PPO_KEYS) if attribute(key) not in names]
    assert not missing


@pytest.mark.parametrize("algorithm", ["SAC", "DQN"])
def test_the_keys_of_other_algorithms_exist(algorithm):
    from safe_inspect.experiments.learning.algorithm import attribute_names, default_config

    names = attribute_names(default_config(algorithm))
    assert [key for key in keys.ALGORITHM_KEYS[algorithm] if attribute(key) not in names] == []


def test_every_setting_of_rllib_is_in_a_table(ppo):
    from safe_inspect.experiments.learning.algorithm import attribute_names

    known = {attribute(key) for key in (*keys.COMMON_KEYS, *keys.PPO_KEYS)}
    known |= {*old_keys.RENAMED, *old_keys.DROPPED, *old_keys.RESERVED, *old_keys.ONLY_AT, *old_keys.SPELLINGS}
    assert sorted(attribute_names(ppo) - known) == NOT_KEYS.split()


def test_the_defaults_of_rllib_have_the_types_of_the_table(ppo):
    defaults = {name: getattr(ppo, attribute(name)) for name in (*keys.COMMON_KEYS, *keys.PPO_KEYS)}
    found = translate_rllib({name: value for name, value in defaults.items() if value is not None})
    assert not found.problems


def test_the_words_of_a_choice_are_rllibs_own(ppo):
    source = inspect.getsource(type(ppo).__mro__[1]) + inspect.getsource(type(ppo))
    for name, kind in keys.COMMON_KEYS.items():
        schema = TypeAdapter(kind).json_schema()
        for part in schema.get("anyOf", [schema]):
            for word in part.get("enum", [part.get("const", "")]):
                assert word in source, (name, word)


def test_old_names_are_gone_or_have_no_effect(ppo):
    from safe_inspect.experiments.learning.algorithm import attribute_names

    alive = attribute_names(ppo)
    # Old properties that still lead to the new attribute are as dead as removed ones.
    properties = {name for name, member in inspect.getmembers(type(ppo)) if isinstance(member, property)}
    still = {"num_gpus", "train_batch_size", "lr_schedule", "entropy_coeff_schedule", "model"}
    assert {name for name in old_keys.RENAMED if name in alive - properties} == still


def test_the_nets_of_rllib():
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    fields = {field.name for field in dataclasses.fields(DefaultModelConfig)}
    assert set(keys.MODEL_KEYS) <= fields
    assert {name for name in fields - set(keys.MODEL_KEYS) if not name.startswith(("conv_", "fusionnet_"))} == set()


def test_the_algorithms_exist():
    from safe_inspect.experiments.learning.algorithm import default_config

    for name in keys.ALGORITHMS:
        assert default_config(name).algo_class.__name__.upper() == name.upper()


def test_tune_and_ray_take_what_we_pass():
    import ray
    from ray import tune

    fields = {
        field.name for kind in (tune.TuneConfig, tune.CheckpointConfig, tune.FailureConfig, tune.RunConfig)
        for field in dataclasses.fields(kind)
    }  # fmt: skip
    assert set(run_keys.TUNE_KEYS) - {"algorithm"} <= fields
    arguments = set(inspect.signature(ray.init).parameters)
    assert set(run_keys.RAY_KEYS) - {"temporary_folder"} <= arguments


def test_the_names_of_the_release_are_those_of_the_installed_one():
    from rllib_keys import names_of_release

    assert json.loads(keys.RELEASE.read_text(encoding="utf-8")) == names_of_release()


def test_a_key_of_another_algorithm_is_checked_when_ray_is_loaded(monkeypatch):
    from safe_inspect.experiments.learning.algorithm import build_config
    from safe_inspect.experiments.settings.policies import environment_settings

    good = translate_rllib({"algorithm": "SAC", "tau": 0.25})
    assert build_config(good, environment_settings({}, good.settings, maker=MAKER)).tau == 0.25
    monkeypatch.setattr("safe_inspect.experiments.settings.translation.keys_of_release", lambda: {"SAC": ["taus"]})
    bad = translate_rllib({"algorithm": "SAC", "taus": 0.25})  # as if an older release were installed
    with pytest.raises(ConfigError, match="SAC has no key `taus`; did you mean `tau`"):
        build_config(bad, environment_settings({}, bad.settings, maker=MAKER))


def test_settings_reach_the_algorithm():
    from safe_inspect.experiments.learning.algorithm import build_config
    from safe_inspect.experiments.settings.policies import environment_settings

    found = translate_rllib(
        {"lambda": 0.9, "num_sgd_iter": 3, "train_batch_size": 640, "minibatch_size": 64, "vf_share_layers": True}
    )
    config = build_config(found, environment_settings({"a": 1}, found.settings, maker=MAKER))
    assert (config.lambda_, config.num_epochs, config.minibatch_size) == (0.9, 3, 64)
    assert config.total_train_batch_size == 640
    assert config.rl_module_spec.model_config["vf_share_layers"] is True
    assert json.loads(config.env_config["experiment"]) == {"a": 1}
    assert config.torch_skip_nan_gradients is True
    assert config.gym_env_vectorize_mode == "vector_entry_point"


def test_what_rllib_refuses_is_our_error():
    from safe_inspect.experiments.learning.algorithm import build_config
    from safe_inspect.experiments.settings.policies import environment_settings

    found = translate_rllib({"use_gae": False})
    with pytest.raises(ConfigError, match="rllib_configs: Episode truncation is not supported without a value"):
        build_config(found, environment_settings({}, found.settings, maker=MAKER))


def test_callbacks_are_named_by_their_path(tmp_path, monkeypatch):
    from safe_inspect.experiments.learning.algorithm import build_config
    from safe_inspect.experiments.settings.policies import environment_settings

    base = "from ray.rllib.callbacks.callbacks import RLlibCallback"
    (tmp_path / "own_callbacks.py").write_text(f"{base}\nclass Mine(RLlibCallback):\n    pass\nx = 3\n")
    monkeypatch.syspath_prepend(tmp_path)
    found = translate_rllib({"callbacks": "own_callbacks.Mine"})
    assert not found.problems
    assert not found.notes
    config = build_config(found, environment_settings({}, found.settings, maker=MAKER))
    assert [kind.__name__ for kind in config.callbacks_class] == ["RunCallbacks", "Mine"]
    for name, told in (("own_callbacks.x", "has no .x."), ("no_such_module.Mine", "no module")):
        found = translate_rllib({"callbacks": [name]})
        with pytest.raises(ConfigError, match=told):
            build_config(found, environment_settings({}, found.settings, maker=MAKER))
    (problem,) = translate_rllib({"callbacks": 3}).problems
    assert problem.message == "[0]: expected a string, got 3"
    (problem,) = translate_tune({"loggers": ["wandb"]}).problems
    assert "cannot be honoured" in problem.message
