"""Values that are drawn, and those that a searcher of Tune suggests."""

from __future__ import annotations

import io
import json
import math

import pytest
from ray.tune.search import Searcher
from training_values import MAKER, QUICK

from safe_inspect.errors import ConfigError, SafeInspectError
from safe_inspect.experiments.runs.train import train
from safe_inspect.experiments.runs.training_run import TrainingRun, read_settings
from safe_inspect.experiments.runs.tune_objects import Suggestions, suggestions_of, tune_space
from safe_inspect.experiments.settings.search import searches_of
from safe_inspect.experiments.settings.translation import METRIC, translate_tune

RATES = {"loguniform": [1e-5, 1e-2]}
SEARCHED = {"lr": RATES, "gamma": {"choice": [0.9, 0.99]}, "num_epochs": {"randint": [2, 4]}}


class Ladder(Searcher):
    """Searcher that suggests larger rates one after the other and records its calls."""

    def __init__(self, file="calls.json", wrong=False, first=1e-4):
        super().__init__()
        self.file, self.wrong, self.first, self.calls = file, wrong, first, []

    def set_search_properties(self, metric, mode, config, **spec):
        self.space = dict(config)
        return not self.wrong

    def suggest(self, trial_id):
        values = {"lr": self.first * 2 ** len({trial for trial, _, _ in self.calls})}
        self.calls.append([trial_id, "suggest", values["lr"]])
        return values

    def on_trial_result(self, trial_id, result):
        self.calls.append([trial_id, "result", result[METRIC]])

    def on_trial_complete(self, trial_id, result=None, error=False):
        self.calls.append([trial_id, "complete", None if result is None else result[METRIC]])
        with open(self.file, "w", encoding="utf-8") as stream:
            json.dump(self.calls, stream)

    def save(self, checkpoint_path):
        with open(checkpoint_path, "w", encoding="utf-8") as stream:
            json.dump(self.calls, stream)

    def restore(self, checkpoint_path):
        with open(checkpoint_path, encoding="utf-8") as stream:
            self.calls = json.load(stream)


LADDER = {"functor": f"{__name__}.Ladder"}


def trials(count, seed=3, **more):
    settings = read_settings({**SEARCHED, "seed": seed, **more}, {"num_samples": count}, {})
    assert not settings.problems
    return settings.trials


def test_drawn_values_lie_in_their_ranges_and_follow_from_the_seed():
    found = trials(60)
    assert [trial.values for trial in found] == [trial.values for trial in trials(60)]
    assert found[0].values != trials(1, seed=4)[0].values
    rates = [math.log10(trial.values["lr"]) for trial in found]
    assert -5 <= min(rates) < -4.5
    assert -2.5 < max(rates) <= -2
    assert {trial.values["gamma"] for trial in found} == {0.9, 0.99}
    assert {trial.values["num_epochs"] for trial in found} == {2, 3}
    assert all(trial.rllib.settings["lr"] == trial.values["lr"] for trial in found)
    assert len({trial.seed for trial in found}) == 60
    grid = trials(2, minibatch_size={"grid_search": [512, 1024]})
    assert [trial.values["minibatch_size"] for trial in grid] == [512, 1024, 512, 1024]
    assert len({trial.values["lr"] for trial in grid}) == 4


@pytest.mark.parametrize(
    ("keys", "shown"),
    [
        ({"lr": {"uniform": 3}}, "`uniform` takes a list of two numbers"),
        ({"lr": {"uniform": [1e-4]}}, "`uniform` takes a list of two numbers"),
        ({"lr": {"uniform": [1e-3, 1e-4]}}, "`uniform` goes from 0.001 to 0.0001; the second number must be larger"),
        ({"lr": {"loguniform": [0, 1e-3]}}, "`loguniform` requires numbers above 0"),
        ({"lr": {"randint": [1, 3]}}, "`randint` is not possible here: use `uniform` or `choice`"),
        ({"gamma": {"uniform": [0.9, 1.5]}}, "expected a number of 1 or less, got 1.5"),
        ({"num_epochs": {"uniform": [1, 5]}}, "whole numbers are required; use `randint` or `choice`"),
        ({"model_config": {"fcnet_activation": {"choice": ["tanh"]}}}, "`choice` is only supported for the keys of"),
    ],
)
def test_a_wrong_range_is_one_message(keys, shown):
    (problem,) = read_settings(keys, {}, {}).problems
    assert shown in problem.message


@pytest.mark.parametrize(
    ("keys", "where", "shown"),
    [
        ({}, "tune_config.search_alg", "there is no key to search"),
        ({"lr": {"grid_search": [1e-4]}}, "rllib_configs.lr", "use `choice` instead of `grid_search`"),
    ],
)
def test_what_a_searcher_cannot_search_is_reported_before_ray(keys, where, shown):
    (problem,) = read_settings(keys, {"search_alg": LADDER}, {}).problems
    assert problem.path == where
    assert shown in problem.message


@pytest.mark.parametrize(
    ("entry", "shown"),
    [
        ("ray.tune.Callback", "'ray.tune.Callback' is not a searcher of ray.tune"),
        ({**LADDER, "config": {"step": 1}}, "Ladder rejects its `config`: .*'step'"),
        ({**LADDER, "config": {"wrong": True}}, "Ladder cannot search: it accepts no search space; remove its own"),
    ],
)
def test_what_is_no_searcher_is_one_message(entry, shown):
    with pytest.raises(ConfigError, match=rf"^tune_config.search_alg: .*{shown}"):
        suggestions_of(translate_tune({"search_alg": entry}).settings, {"lr": RATES})


def test_a_searcher_gets_what_is_known(monkeypatch):
    made = suggestions_of(translate_tune({"search_alg": LADDER}).settings, SEARCHED)
    assert isinstance(made, Suggestions)
    inner = made.searcher
    assert set(inner.space) == set(SEARCHED)
    assert (tune_space({"lr": RATES})["lr"].lower, tune_space({"lr": RATES})["lr"].upper) == (1e-5, 1e-2)

    def make(number, values):
        return {"lr": values["lr"], "env_config": {"number": number}}

    monkeypatch.setattr(Suggestions, "make", make, raising=False)
    assert made.suggest("a") == {"lr": 1e-4, "env_config": {"number": 0, "trial": 0}}
    state = made.get_state()
    assert made.suggest("b") == {"lr": 2e-4, "env_config": {"number": 1, "trial": 1}}
    made.set_state(state)
    assert made.suggest("c")["env_config"]["trial"] == 1
    made.on_trial_result("a", {METRIC: math.nan})
    made.on_trial_result("a", {})
    made.on_trial_result("a", {METRIC: 1.0})
    inner.file = "/dev/null"
    made.on_trial_complete("a", {METRIC: math.nan})
    made.on_trial_complete("b", {METRIC: 2.0})
    assert inner.calls[3:] == [["a", "result", 1.0], ["a", "complete", None], ["b", "complete", 2.0]]


@pytest.mark.ray
@pytest.mark.slow
def test_a_search_trains_what_is_suggested(ray_session, tmp_path):
    calls = tmp_path / "calls.json"
    run = TrainingRun(
        {},
        rllib={**QUICK, "lr": RATES},
        tune={
            "search_alg": {**LADDER, "config": {"file": str(calls)}},
            "num_samples": 2,
            "stop": {"training_iteration": 1},
        },
        output=tmp_path,
        maker=MAKER,
    )
    found = train(run, io.StringIO())
    assert [trial.parameters["lr"] for trial in found.trials] == [1e-4, 2e-4]
    assert [trial.folder.name for trial in found.trials] == ["trial_00000", "trial_00001"]
    assert [what for _, what, _ in json.loads(calls.read_text())].count("complete") == 2
    returns = [trial.return_mean for trial in found.trials]
    assert found.best == found.trials[returns.index(max(returns))].folder


@pytest.mark.ray
@pytest.mark.slow
def test_a_suggestion_that_cannot_train_ends_the_search_with_a_message(ray_session, tmp_path):
    run = TrainingRun(
        {},
        rllib={**QUICK, "lr": RATES},
        tune={"search_alg": {**LADDER, "config": {"first": -1.0}}, "stop": {"training_iteration": 1}},
        output=tmp_path,
        maker=MAKER,
    )
    with pytest.raises(SafeInspectError, match=r"lr -1 cannot train: .*expected a number of 0 or more, got -1\.0"):
        train(run, io.StringIO())


def test_optuna_learns_from_what_it_gets(monkeypatch):
    pytest.importorskip("optuna", reason="pip install 'safe_inspect[search]'")
    entry = {"functor": "ray.tune.search.optuna.OptunaSearch", "config": {"seed": 1}}
    made = suggestions_of(translate_tune({"search_alg": entry}).settings, {"lr": RATES})
    assert made is not None
    rates = []
    monkeypatch.setattr(Suggestions, "make", lambda number, values: {**values, "env_config": {}}, raising=False)
    for number in range(40):
        rates.append(made.suggest(str(number))["lr"])
        made.on_trial_complete(str(number), {METRIC: -abs(math.log10(rates[-1]) + 3.0)})
    far = [abs(math.log10(rate) + 3.0) for rate in rates]
    assert sum(far[-20:]) < 0.7 * sum(far[:20])
    assert all(1e-5 <= rate <= 1e-2 for rate in rates)
    assert searches_of({"lr": RATES, "gamma": 0.9}) == {"lr": RATES}
