"""The trials of a search: how many, with which values and seeds, and what each of them records."""

from __future__ import annotations

import copy
import json
import shutil

import pytest
from random_checkpoint import SHIPPED, TEAM, experiment_of, single_run
from training_values import MAKER

from safe_inspect.config.experiment import build_experiment, load_experiment
from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.modules.checkpoints import find_newest
from safe_inspect.experiments.modules.run_folder import RunFolder
from safe_inspect.experiments.modules.sources import Wanted, open_candidates, open_source
from safe_inspect.experiments.runs.training_run import read_settings
from safe_inspect.experiments.settings.search import experiment_of as experiment_of_trial
from safe_inspect.experiments.settings.search import sample_seed
from safe_inspect.experiments.settings.translation import current_name, translate_rllib
from safe_inspect.train_rl import main

LR = {"grid_search": [1e-4, 1e-3]}
BATCHES = {"grid_search": [128, 256, 512]}


def searching(path=SHIPPED, num_samples=2, **keys):
    """Return an experiment whose policies have these RLlib keys."""
    tree = load_experiment(path, ["horizon=60"]).resolved
    tree["config"]["config"]["tune_config"]["num_samples"] = num_samples
    for entry in tree["agent_config"]:
        own = entry["policy"]["config"]
        for key, value in keys.items():
            own.pop(current_name(key), None)  # an old name replaces the current one
            own[key] = copy.deepcopy(value)
    return build_experiment(json.loads(json.dumps(tree)))


def settings_of(experiment):
    task = experiment.config.config.config
    rllib = {"algorithm": experiment.algorithm, **experiment.rllib}
    return read_settings(rllib, task.tune_config, task.ray_config, tuple(experiment.policies.values()))


def test_the_first_sample_has_the_seed_of_the_experiment_and_the_others_their_own():
    seeds = [sample_seed(seed, sample) for seed in (0, 1, 4900) for sample in range(50)]
    assert len(set(seeds)) == len(seeds)
    assert all(0 <= seed < 2**31 for seed in seeds)
    assert [sample_seed(4900, sample) for sample in (0, 1)] == [4900, 1521271662]  # recorded runs stay repeatable
    assert sample_seed(None, 0) is None
    assert sample_seed(None, 1) == sample_seed(0, 1)


def test_a_run_without_a_search_is_one_trial_with_its_own_settings():
    settings = settings_of(experiment_of())
    assert settings.single
    (trial,) = settings.trials
    assert trial.rllib is settings.rllib
    assert trial.values == {}


def test_every_combination_is_trained_once_for_each_sample():
    settings = settings_of(searching(lr=LR, sgd_minibatch_size=BATCHES))
    assert not settings.problems
    found = [(trial.values["lr"], trial.values["minibatch_size"], trial.seed) for trial in settings.trials]
    seeds = [sample_seed(settings.rllib.settings["seed"], sample) for sample in range(2)]
    assert found == [(lr, size, seed) for seed in seeds for lr in (1e-4, 1e-3) for size in (128, 256, 512)]
    for trial in settings.trials:
        for name, value in {**trial.values, "seed": trial.seed}.items():
            assert trial.rllib.settings[name] == value


def test_seeds_that_are_searched_are_the_seeds_of_the_first_sample():
    settings = settings_of(searching(seed={"grid_search": [3, 4]}))
    assert [trial.seed for trial in settings.trials] == [3, 4, sample_seed(3, 1), sample_seed(4, 1)]


@pytest.mark.parametrize("path", [SHIPPED, TEAM])
def test_the_configuration_of_a_trial_holds_its_own_values(path):
    experiment = searching(path, lr=LR, sgd_minibatch_size=BATCHES, seed=11)
    settings = settings_of(experiment)
    for trial in settings.trials:
        tree = experiment_of_trial(experiment.resolved, trial)
        assert "grid_search" not in json.dumps(tree)
        again = build_experiment(json.loads(json.dumps(tree)))
        alone = settings_of(again)
        assert alone.single
        assert alone.trials[0].rllib.settings == trial.rllib.settings
        assert again.spec.seed == trial.seed
    assert experiment.resolved == searching(path, lr=LR, sgd_minibatch_size=BATCHES, seed=11).resolved


def test_tune_finds_each_trial_once():
    from ray.tune.impl.placeholder import create_resolvers_map, inject_placeholders, resolve_placeholders
    from ray.tune.search.variant_generator import generate_variants

    from safe_inspect.experiments.learning.algorithm import build_config
    from safe_inspect.experiments.runs.tune_objects import search_space
    from safe_inspect.experiments.settings.policies import environment_settings

    experiment = searching(lr=LR, sgd_minibatch_size=BATCHES)
    settings = settings_of(experiment)
    configs = [
        build_config(
            trial.rllib, environment_settings(experiment_of_trial(experiment.resolved, trial), trial.rllib.settings)
        )
        for trial in settings.trials
    ]
    resolvers = create_resolvers_map()
    space = inject_placeholders(search_space(configs), resolvers)
    found = [spec["config"] for _, spec in generate_variants({"config": space})]
    assert len(found) == len(settings.trials) == 12
    for config, trial in zip(found, settings.trials, strict=True):
        resolve_placeholders(config, resolvers)
        assert (config["lr"], config["minibatch_size"], config["seed"]) == (*trial.values.values(), trial.seed)
        assert config["env_config"]["seed"] == trial.seed
        policy = json.loads(config["env_config"]["experiment"])["agent_config"][0]["policy"]["config"]
        assert (policy["lr"], policy["sgd_minibatch_size"]) == tuple(trial.values.values())


def test_tune_resolves_nothing_in_the_configuration_of_a_single_run():
    from ray.tune.search.variant_generator import generate_variants

    from safe_inspect.experiments.learning.algorithm import build_config
    from safe_inspect.experiments.settings.policies import environment_settings

    tree = {"config": {"lr": LR, "code": {"eval": "1 / 0"}}}
    found = translate_rllib({})
    config = build_config(found, environment_settings(tree, found.settings, maker=MAKER)).to_dict()
    (variant,) = generate_variants({"config": config})
    assert json.loads(variant[1]["config"]["env_config"]["experiment"]) == tree


def test_a_combination_that_does_not_fit_is_a_mistake_before_the_training():
    (problem,) = settings_of(searching(train_batch_size=256, minibatch_size=BATCHES)).problems
    assert problem.path == "rllib_configs.minibatch_size"
    assert problem.message.startswith("with minibatch_size 512: a minibatch of 512 is larger than the batch of 256")


@pytest.mark.parametrize(
    ("keys", "path", "text"),
    [
        ({"learner_config_dict": {"a": LR}}, "learner_config_dict", "`grid_search` is only supported"),
        ({"learner_config_dict": {"a": [{"eval": "1"}]}}, "learner_config_dict", "`eval` contains code"),
        ({"learner_config_dict": {"grid_search": [{"eval": "1"}]}}, "learner_config_dict", "`eval` contains code"),
        ({"algorithm": "SAC", "policy_model_config": {"a": LR}}, "policy_model_config", "`grid_search` is only"),
        ({"model": {"lstm_bias_initializer_kwargs": {"a": LR}}}, "model.lstm_bias_initializer_kwargs", "`grid_search`"),
    ],
)
def test_a_search_where_tune_alone_would_find_it_is_refused(keys, path, text):
    problems = {problem.path: problem.message for problem in reversed(translate_rllib(keys).problems)}
    assert problems[f"rllib_configs.{path}"].startswith(text)


@pytest.fixture(scope="module")
def search(tmp_path_factory):
    """Return the folder of a search of two trials, of which the first has a checkpoint."""
    folder = tmp_path_factory.mktemp("search") / "run"
    checkpoint = single_run(folder, experiment_of())
    trials = [folder / "trials" / f"trial_{number:05d}" for number in range(2)]
    for trial, lr in zip(trials, (1e-4, 1e-3), strict=True):
        trial.mkdir(parents=True)
        RunFolder(trial).write_parameters({"lr": lr}, 3)
        for name in ("experiment.resolved.yml", "run.json"):
            shutil.copy(folder / name, trial)
    shutil.move(checkpoint, trials[0])
    shutil.rmtree(folder / "tune")
    return folder


def test_the_folder_of_a_search_names_its_trials_and_one_of_them_is_flown(search):
    from safe_inspect.experiments.modules.checkpoints import newest_checkpoint

    first = search / "trials" / "trial_00000"
    for opened in (open_source, newest_checkpoint, lambda text: open_candidates([str(text)], Wanted())):
        for folder in (search, search / "trials"):
            with pytest.raises(CheckpointError) as caught:
                opened(folder)
            assert f"{folder}: this is a search with 2 trials; give the folder of one of them:" in str(caught.value)
            assert f"{first}  lr 0.0001, seed 3\n" in str(caught.value)
        opened(first)
    with pytest.raises(CheckpointError, match="no complete checkpoint"):
        open_source(search / "trials" / "trial_00001")


@pytest.mark.ray
@pytest.mark.slow
def test_a_trial_of_a_search_is_repeated_alone(ray_session, tmp_path, capsys):
    small = {"train_batch_size": 512, "minibatch_size": 256, "num_epochs": 1, "num_envs_per_env_runner": 16}
    experiment = searching(lr={"grid_search": [1e-3]}, model_config={"fcnet_hiddens": [16]}, **small)
    cfg = tmp_path / "experiment.yml"
    cfg.write_text(experiment.text)
    stop = "config.config.tune_config.stop={training_iteration: 3}"
    assert main(["--cfg", str(cfg), stop, "--output", str(tmp_path / "search")]) == 0
    (run,) = (tmp_path / "search").iterdir()
    seed = sample_seed(experiment.spec.seed, 1)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("finished: 2 trials")
    assert lines[1].split() == ["trial", "lr", "seed", "iterations", "return", "success", "checkpoint"]
    assert [line.split()[:4] for line in lines[2:4]] == [
        ["trial_00000", "0.001", str(experiment.spec.seed), "3"], ["trial_00001", "0.001", str(seed), "3"],
    ]  # fmt: skip
    assert (run / "learning_curve.png").is_file()
    trial = run / "trials" / "trial_00001"
    assert main(["--cfg", str(trial / "experiment.resolved.yml"), "--output", str(tmp_path / "alone")]) == 0
    (alone,) = (tmp_path / "alone").iterdir()
    rows = [json.loads((folder / "result.json").read_text().splitlines()[-1]) for folder in (trial, alone)]
    same = ("env_runners/episode_return_mean", "learners/default_policy/vf_loss", "env_runners/delta_v")
    assert [rows[0][key] for key in same] == [rows[1][key] for key in same]
    digests = [json.loads((folder / "run.json").read_text())["digest"] for folder in (trial, alone)]
    assert digests[0] == digests[1]
    assert main(["--resume", str(trial), "config.config.tune_config.stop={training_iteration: 4}"]) == 0
    assert find_newest(trial)[0].iteration == 4
