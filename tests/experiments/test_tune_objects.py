"""Schedulers and callbacks of Tune by their dotted paths."""

from __future__ import annotations

import io
import json
import pickle

import pytest
from ray import tune
from ray.tune.schedulers import ASHAScheduler, PopulationBasedTraining
from training_values import MAKER, QUICK

from safe_inspect.errors import ConfigError
from safe_inspect.experiments.runs.train import train
from safe_inspect.experiments.runs.training_run import TrainingRun
from safe_inspect.experiments.runs.tune_objects import callbacks_of, ranking, scheduler_of
from safe_inspect.experiments.settings.translation import METRIC, translate_tune

ASHA = {"functor": "ray.tune.schedulers.ASHAScheduler", "config": {"max_t": 7, "grace_period": 2}}
PBT = {
    "functor": "ray.tune.schedulers.PopulationBasedTraining",
    "config": {
        "perturbation_interval": 1,
        "hyperparam_mutations": {
            "lr": {"functor": "ray.tune.loguniform", "config": {"lower": 1e-5, "upper": 1e-2}},
            "gamma": [0.9, 0.99],
        },
    },
}


class Noting(tune.Callback):
    """Writes a line for each result of a trial."""

    def __init__(self, file="results.txt"):
        self.file = file

    def on_trial_result(self, iteration, trials, trial, result, **_):
        with open(self.file, "a", encoding="utf-8") as stream:
            stream.write(json.dumps([trial.trial_id, result["training_iteration"], result["config"]["lr"]]) + "\n")


def settings_of(**keys):
    found = translate_tune(keys)
    assert not found.problems
    return found.settings


def test_schedulers_are_built_with_what_stands_within_their_config():
    asha = scheduler_of(settings_of(scheduler=ASHA))
    assert isinstance(asha, ASHAScheduler)
    assert asha._max_t == 7
    pbt = scheduler_of(settings_of(scheduler=PBT))
    assert isinstance(pbt, PopulationBasedTraining)
    assert isinstance(pbt._hyperparam_mutations["lr"], tune.search.sample.Domain)
    assert pbt._hyperparam_mutations["gamma"] == [0.9, 0.99]
    assert scheduler_of(settings_of()) is None


def test_trials_are_ranked_by_a_figure_that_may_have_its_short_name():
    assert ranking(settings_of()) == {}
    assert ranking(settings_of(scheduler=ASHA)) == {"metric": METRIC, "mode": "max"}
    named = settings_of(scheduler=ASHA, metric="success_rate", mode="max")
    assert ranking(named) == {"metric": "env_runners/success_rate", "mode": "max"}
    own = {**ASHA, "config": {"metric": "env_runners/success_rate", "mode": "max"}}
    assert ranking(settings_of(scheduler=own)) == {}
    assert any("neither is given" in note for note in translate_tune({"metric": "success_rate"}).notes)


def test_callbacks_are_built():
    (one,) = callbacks_of(settings_of(callbacks=f"{__name__}.Noting"))
    assert type(one).__name__ == "Noting"
    named = [{"functor": f"{__name__}.Noting", "config": {"file": "a"}}, f"{__name__}.Noting"]
    assert [each.file for each in callbacks_of(settings_of(callbacks=named))] == ["a", "results.txt"]


class Unready(tune.Callback):
    """Needs what is not there."""

    def setup(self, **_):
        raise RuntimeError("no key was found")


def test_a_callback_that_cannot_begin_is_named():
    (made,) = callbacks_of(settings_of(callbacks=f"{__name__}.Unready"))
    with pytest.raises(ConfigError, match=r"^tune_config.callbacks\[0\]: .*Unready cannot start: no key was found$"):
        pickle.loads(pickle.dumps(made)).setup(stop=None)


@pytest.mark.parametrize(
    ("keys", "shown"),
    [
        ({"scheduler": {"functor": "ray.tune.schedulers.ASHA"}}, "module 'ray.tune.schedulers' has no 'ASHA'"),
        ({"scheduler": "ray.tune.Callback"}, "'ray.tune.Callback' is not a scheduler of ray.tune"),
        ({"scheduler": {**ASHA, "config": {"max_tt": 3}}}, "ASHAScheduler rejects its `config`: .*max_tt"),
        ({"scheduler": "no_such_module.Scheduler"}, "no module 'no_such_module'"),
        ({"callbacks": [ASHA]}, r"tune_config.callbacks\[0\]: .* is not a ray.tune.Callback; give RLlib's"),
    ],
)
def test_what_cannot_be_built_is_one_message(keys, shown):
    settings = settings_of(**keys)
    with pytest.raises(ConfigError, match=shown):
        scheduler_of(settings) or callbacks_of(settings)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("asha", "functor: expected a dotted path `module.Class`, got 'asha'"),
        (3, "expected `{functor: module.Class, config: {...}}` or a dotted path, got 3"),
        ({"config": {}}, "functor: the key is missing"),
        ({"functor": "a.b", "more": 1}, "more: unknown key `more`"),
    ],
)
def test_what_is_no_object_is_refused_before_ray(value, message):
    (problem,) = translate_tune({"scheduler": value}).problems
    assert problem.message == message


@pytest.mark.ray
@pytest.mark.slow
@pytest.mark.parametrize(
    "scheduler", [pytest.param(ASHA, id="asha"), pytest.param(PBT, id="pbt", marks=pytest.mark.long)]
)
def test_a_search_trains_under_a_scheduler(scheduler, ray_session, tmp_path, monkeypatch):
    if scheduler is ASHA:
        scheduler = {**ASHA, "config": {"max_t": 2, "grace_period": 1}}
    notes = tmp_path / "results.txt"
    callback = {"functor": f"{__name__}.Noting", "config": {"file": str(notes)}}
    run = TrainingRun(
        {},
        rllib={**QUICK, "lr": {"grid_search": [1e-5, 1e-3]}},
        tune={"scheduler": scheduler, "callbacks": [callback], "stop": {"training_iteration": 30}},
        output=tmp_path,
        maker=MAKER,
    )
    train(run, io.StringIO())
    lines = [json.loads(line) for line in notes.read_text().splitlines()]
    assert len({trial for trial, _, _ in lines}) == 2
    if scheduler["functor"].endswith("ASHAScheduler"):
        assert max(iteration for _, iteration, _ in lines) <= 2  # it ends every trial there, before `stop` does
    else:
        assert len({rate for _, _, rate in lines}) > 2  # rates were changed while they trained
