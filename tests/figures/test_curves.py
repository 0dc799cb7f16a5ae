from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import CheckpointError, SafeInspectError
from safe_inspect.experiments.modules.run_folder import learning_configuration
from safe_inspect.experiments.runs.trials import one_recipe, recipes_of
from safe_inspect.experiments.settings.translation import translate_rllib
from safe_inspect.figures import learning_curves
from safe_inspect.figures.learning_curves import _band, _centre_of, curves_figure

HEADER = "iteration,steps,return_mean,success_rate,inspected_fraction,delta_v"


def write_run(folder, rows, seed=None, lr=1e-4):
    """Write the folder of a run: rows of steps and one value, and its record."""
    folder.mkdir(parents=True)
    lines = [f"{index},{steps},{value},{value},{value},{value}" for index, (steps, value) in enumerate(rows)]
    (folder / "progress.csv").write_text("\n".join([HEADER, *lines]))
    if seed is not None:
        configuration = {"experiment": {"env_config": {"seed": seed}}, "rllib_configs": {"lr": lr, "seed": seed}}
        (folder / "run.json").write_text(json.dumps({"digest": "d", "attempts": [], "configuration": configuration}))
    return folder


def test_the_mean_of_lines_on_other_grids_is_a_line():
    one = np.arange(0.0, 101.0, 10.0)
    other = np.arange(0.0, 101.0, 4.0)
    found = _band([(one, 2.0 * one), (other, 4.0 * other)])
    np.testing.assert_allclose(found.centre, 3.0 * found.steps)
    np.testing.assert_allclose(found.low, 2.0 * found.steps)  # of two seeds a resample is often twice the same one
    np.testing.assert_allclose(found.high, 4.0 * found.steps)
    assert (found.curves == 2).all()


def test_past_the_end_of_a_shorter_run_the_others_continue():
    short, long = np.array([0.0, 50.0]), np.array([10.0, 100.0])
    found = _band([(short, np.zeros(2)), (long, np.ones(2))])
    alone = found.steps > 50.0
    np.testing.assert_allclose(found.centre[alone], 1.0)
    assert np.isnan(found.low[alone]).all()
    assert (found.curves[alone] == 1).all()
    np.testing.assert_allclose(found.centre[found.steps < 10.0], 0.0)
    both = (found.steps >= 10.0) & (found.steps <= 50.0)
    np.testing.assert_allclose(found.centre[both], 0.5)
    assert {10.0, 50.0} <= set(found.steps)


def test_the_interquartile_mean_leaves_the_outer_quarters_out():
    values = np.array([[1.0], [2.0], [3.0], [100.0]])
    assert _centre_of(values, "iqm") == pytest.approx(2.5)
    assert _centre_of(values, "mean") == pytest.approx(26.5)
    assert _centre_of(values[:3], "iqm") == pytest.approx(2.0)  # three have no quarter


def test_the_band_covers_the_mean_of_the_population(monkeypatch):
    generator = np.random.default_rng(1)
    steps, covered = np.array([0.0, 1.0]), 0
    monkeypatch.setattr(learning_curves, "_POINTS", 2)
    for _ in range(200):
        found = _band(
            [(steps, np.full(2, value)) for value in generator.normal(size=20)],
        )
        covered += bool(found.low[0] <= 0.0 <= found.high[0])
    assert 0.88 <= covered / 200 <= 0.98  # the percentile bootstrap of 20 values is a little narrow


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=6), min_size=1, max_size=5),
    st.sampled_from(["mean", "iqm"]),
)
def test_the_centre_lies_in_its_band_and_among_the_seeds(runs, centre):
    curves = [(np.arange(len(values), dtype=float), np.array(values)) for values in runs]
    found = _band(curves, centre)
    assert np.isfinite(found.centre).all()
    wide = np.isfinite(found.low)
    np.testing.assert_array_equal(wide, found.curves > 1)
    assert (found.low[wide] <= found.high[wide]).all()
    values = np.concatenate([np.array(values) for values in runs])
    assert (found.centre >= values.min() - 1e-6).all()
    assert (found.centre <= values.max() + 1e-6).all()


def test_values_that_are_not_known_are_left_out():
    steps = np.array([0.0, 10.0, 20.0])
    found = _band([(steps, np.array([np.nan, 1.0, 3.0]))])
    assert found.steps[0] == 10.0
    np.testing.assert_allclose(found.centre, 1.0 + 0.2 * (found.steps - 10.0))
    assert len(_band([(steps, np.full(3, np.nan))]).steps) == 0


def test_runs_that_differ_in_their_seed_are_one_recipe(tmp_path):
    rows = [(1000, 0.1), (2000, 0.5)]
    runs = [write_run(tmp_path / f"run{i}", rows, seed=i, lr=lr) for i, lr in enumerate([1e-4, 1e-4, 3e-4])]
    recipes = recipes_of(runs)
    assert {label: len(paths) for label, paths in recipes.items()} == {"lr 0.0001": 2, "lr 0.0003": 1}
    assert list(recipes_of(runs, ["slow", "fast"])) == ["slow", "fast"]
    assert {label: len(paths) for label, paths in recipes_of(runs, ["a", "b", "a"]).items()} == {"a": 2, "b": 1}


def counts(recipes):
    return {label: len(paths) for label, paths in recipes.items()}


def write_search(folder, seeds=(1, 2), rates=(1e-4, 1e-3), rows=((1000, 0.1), (2000, 0.5))):
    trials = [(seed, lr) for seed in seeds for lr in rates]
    for index, (seed, lr) in enumerate(trials):
        write_run(folder / "trials" / f"trial_{index:05d}", rows, seed=seed, lr=lr)
    return folder


def test_the_trials_of_a_search_are_grouped_by_the_values_in_which_they_differ(tmp_path):
    search = write_search(tmp_path / "run")
    assert counts(recipes_of([search])) == {"lr 0.0001": 2, "lr 0.001": 2}
    assert counts(recipes_of(sorted(search.glob("trials/*"))[:3])) == {"lr 0.0001": 2, "lr 0.001": 1}
    assert counts(recipes_of([search], ["slow", "fast"])) == {"slow": 2, "fast": 2}
    with pytest.raises(SafeInspectError, match=r"differ in more than their seed \(lr 0\.0001; lr 0\.001\)"):
        recipes_of([search], ["both"])
    with pytest.raises(SafeInspectError, match="differ in more than their seed"):
        one_recipe(search)
    seeds = write_search(tmp_path / "seeds", rates=(1e-4,))
    assert len(one_recipe(seeds)) == 2
    assert counts(recipes_of([seeds], ["mine"])) == {"mine": 2}


def test_only_the_seeds_of_one_value_have_an_interval(tmp_path):
    alone = curves_figure(recipes_of([write_search(tmp_path / "alone", seeds=(1,))]))
    bands = [path.vertices for axes in alone.axes for band in axes.collections for path in band.get_paths()]
    assert all(np.isnan(vertices).all() for vertices in bands)
    assert [text.get_text() for text in alone.legends[0].get_texts()] == ["lr 0.0001", "lr 0.001"]
    assert alone.legends[0].get_title().get_text() == ""
    both = curves_figure(recipes_of([write_search(tmp_path / "both")]))
    assert [text.get_text() for text in both.legends[0].get_texts()] == ["lr 0.0001 (2 seeds)", "lr 0.001 (2 seeds)"]


def test_trials_whose_values_are_not_recorded_are_not_taken_for_seeds(tmp_path):
    for index in range(2):
        write_run(tmp_path / "run_2026-01-01_00-00-00" / "trials" / f"trial_{index:05d}", [(1000, 0.1)])
    found = recipes_of([tmp_path / "run_2026-01-01_00-00-00"])
    assert counts(found) == {"run trial_00000": 1, "run trial_00001": 1}


def named(tmp_path, *overrides):
    """Return the labels of runs of the shipped task, with the records that a training writes."""
    runs = []
    for index, replaced in enumerate(overrides):
        experiment = load_experiment(configs_root() / "translational-inspection" / "experiment.yml", replaced)
        settings = translate_rllib(experiment.rllib).settings
        run = write_run(tmp_path / f"run{index}_2026-01-01_00-00-00", [(1000, 0.1)])
        configuration = learning_configuration(experiment.resolved, settings)
        (run / "run.json").write_text(json.dumps({"digest": "d", "attempts": [], "configuration": configuration}))
        runs.append(run)
    return list(recipes_of(runs))


@pytest.mark.parametrize(
    ("overrides", "labels"),
    [
        ((["gamma=0.999"], ["gamma=0.99"]), ["gamma 0.999", "gamma 0.99"]),
        (([], ["lr=1e-4"]), ["lr 0.0003 to 0.0001", "lr 0.0001"]),
        ((["lambda_=0.9"], ["lambda_=0.95"]), ["lambda 0.9", "lambda 0.95"]),
        (
            (["fcnet_hiddens=[64, 64]"], ["ObservedPointsReward.config.scale=0.02"]),
            ["scale 0.01, fcnet_hiddens [64, 64]", "scale 0.02, fcnet_hiddens [256, 256]"],
        ),
    ],
)
def test_recipes_are_named_by_the_values_in_which_they_differ(tmp_path, overrides, labels):
    assert named(tmp_path, *overrides) == labels


def test_curves_of_unequal_seeds_are_drawn(tmp_path):
    rows = [[(1000 * i, 0.01 * i) for i in range(1, n)] for n in (5, 9, 30)]
    runs = [write_run(tmp_path / f"run_2026-01-0{i + 1}_00-00-00", row, seed=i) for i, row in enumerate(rows)]
    figure = curves_figure(recipes_of(runs), "iqm", each=True)
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["return [-]", "success [%]", "inspected [%]", "delta-v [m/s]"]
    for axes, factor in zip(figure.axes, (1.0, 100.0, 100.0, 1.0), strict=True):
        assert len(axes.collections) == 1  # the band
        solid = next(line for line in axes.get_lines() if line.get_linestyle() == "-" and line.get_linewidth() > 1.0)
        known = np.isfinite(solid.get_ydata())
        assert solid.get_xdata()[known].max() == pytest.approx(4.0)  # thousands of steps, where all three are known
        np.testing.assert_allclose(solid.get_ydata()[known], factor * 0.01 * solid.get_xdata()[known])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["run (3 seeds)"]


def test_a_training_without_an_ended_episode_is_said_so(tmp_path):
    run = write_run(tmp_path / "run", [(1000, "nan"), (2000, "nan")])
    figure = curves_figure(recipes_of([run]))
    assert all("no episode has ended" in [text.get_text() for text in axes.texts] for axes in figure.axes)


def test_a_task_without_points_to_inspect_is_said_so(tmp_path):
    write_run(tmp_path / "run", [])
    rows = [HEADER, "0,1000,0.1,0.1,nan,0.1", "1,2000,0.2,0.2,nan,0.2"]
    (tmp_path / "run" / "progress.csv").write_text("\n".join(rows))
    figure = curves_figure(recipes_of([tmp_path / "run"]))
    found = {axes.get_ylabel(): [text.get_text() for text in axes.texts] for axes in figure.axes}
    assert found["inspected [%]"] == ["not in this task"]
    assert sum(map(len, found.values())) == 1


def test_wrong_runs_are_one_message(tmp_path):
    run = write_run(tmp_path / "run", [(1000, 0.1)], seed=1)
    with pytest.raises(SafeInspectError, match="there is no such folder"):
        recipes_of([tmp_path / "nothing"])
    with pytest.raises(SafeInspectError, match=r"there is no progress\.csv in this folder"):
        recipes_of([tmp_path])
    with pytest.raises(SafeInspectError, match="2 labels are given for 1 runs of 1 recipes"):
        recipes_of([run], ["a", "b"])
    (run / "run.json").write_text("{")
    with pytest.raises(CheckpointError, match="damaged"):
        recipes_of([run])
    with pytest.raises(SafeInspectError, match="no learning curves"):
        curves_figure({})
