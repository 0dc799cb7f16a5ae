"""The loggers of MLflow and of Weights & Biases, named in a configuration; both need the extra `loggers`."""

from __future__ import annotations

import io

import pytest
from ray.tune.experiment import Trial
from training_values import MAKER, QUICK

from safe_inspect.experiments.runs.train import train
from safe_inspect.experiments.runs.training_run import TrainingRun
from safe_inspect.experiments.runs.tune_objects import callbacks_of
from safe_inspect.experiments.settings.translation import translate_tune

INTEGRATIONS = "ray.air.integrations"


def test_mlflow_keeps_the_figures_of_a_trial_in_files(tmp_path, monkeypatch):
    mlflow = pytest.importorskip("mlflow", minversion="3.1", reason="pip install 'safe_inspect[loggers]'")
    monkeypatch.setenv("MLFLOW_ALLOW_FILE_STORE", "true")
    place = (tmp_path / "mlruns").as_uri()
    config = {"tracking_uri": place, "experiment_name": "inspection"}
    callback = {"functor": f"{INTEGRATIONS}.mlflow.MLflowLoggerCallback", "config": config}
    (logger,) = callbacks_of(translate_tune({"callbacks": [callback]}).settings)
    trial = Trial("trainable", config={"lr": 1e-4}, stub=True)
    logger.setup()
    logger.log_trial_start(trial)
    logger.log_trial_result(1, trial, {"training_iteration": 1, "env_runners": {"success_rate": 0.25}})
    logger.log_trial_end(trial)
    client = mlflow.MlflowClient(place)
    (run,) = client.search_runs([client.get_experiment_by_name("inspection").experiment_id])
    assert run.data.metrics["env_runners/success_rate"] == 0.25
    assert run.data.params["lr"] == "0.0001"
    assert run.info.status == "FINISHED"


@pytest.mark.ray
@pytest.mark.slow
def test_weights_and_biases_writes_a_run_without_a_network(ray_session, tmp_path, monkeypatch):
    pytest.importorskip("wandb", reason="pip install 'safe_inspect[loggers]'")
    monkeypatch.setenv("WANDB_MODE", "offline")
    config = {"project": "inspection", "mode": "offline", "dir": str(tmp_path)}
    run = TrainingRun(
        {},
        rllib=QUICK,
        tune={
            "callbacks": [{"functor": f"{INTEGRATIONS}.wandb.WandbLoggerCallback", "config": config}],
            "stop": {"training_iteration": 2},
        },
        output=tmp_path / "runs",
        maker=MAKER,
    )
    train(run, io.StringIO())
    (written,) = tmp_path.glob("wandb/offline-run-*/*.wandb")
    assert b"training_iteration" in written.read_bytes()
