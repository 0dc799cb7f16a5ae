"""The experiments of each task train, continue after SIGKILL, evaluate, export, draw and open as a page."""

from __future__ import annotations

import itertools
import signal
import subprocess
import sys

import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.experiments.runs.progress import read_progress

pytestmark = [pytest.mark.ray, pytest.mark.long]

EXPERIMENTS = [
    "weighted-translational-inspection/experiment.yml",
    "multiagent-weighted-translational-inspection/experiment.yml",
    "weighted-six-dof-inspection/experiment.yml",
    "weighted-six-dof-inspection/experiment-recipe.yml",
    "multiagent-weighted-six-dof-inspection/experiment.yml",
    "docking/experiment.yml",
    "docking/experiment-recipe.yml",
    "multiagent-docking/experiment.yml",
]
SMALL = [
    "num_envs_per_env_runner=4", "train_batch_size_per_learner=256", "minibatch_size=128", "num_epochs=1",
    "learner_threads=1", "num_env_steps_sampled_lifetime=6000", "checkpoint_frequency=1", "horizon=60",
]  # fmt: skip

#: Experiments of several agents have a policy for each.
POLICY = {"multiagent": ("--policy", "blue0_ctrl")}


def command(*arguments):
    return [sys.executable, "-m", *map(str, arguments)]


def run(*arguments):
    done = subprocess.run(command(*arguments), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_an_experiment_continues_after_a_kill_and_its_policy_flies(experiment, tmp_path):
    training = command("safe_inspect.train_rl", "--cfg", configs_root() / experiment, *SMALL, "--output", tmp_path)
    with subprocess.Popen(training, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        lines = []
        for line in process.stdout:
            lines.append(line)
            if line.startswith("iteration    3 "):
                process.send_signal(signal.SIGKILL)
                break
    assert process.returncode == -signal.SIGKILL, "".join(lines)
    (folder,) = tmp_path.iterdir()
    told = run("safe_inspect.train_rl", "--resume", folder)
    assert "finished after" in told
    rows = read_progress(folder / "progress.csv")
    assert [row["iteration"] for row in rows] == list(range(1, len(rows) + 1))
    assert all(earlier["steps"] < later["steps"] for earlier, later in itertools.pairwise(rows))
    assert rows[-1]["steps"] >= 6000
    run("safe_inspect", "evaluate", folder, "--episodes", 4, "--output", tmp_path / "evaluation")
    run(
        "safe_inspect",
        "export",
        folder,
        "--output",
        tmp_path / "policy.onnx",
        *POLICY.get(experiment.split("-")[0], ()),
    )
    assert (tmp_path / "policy.onnx").stat().st_size > 10_000
    run("safe_inspect", "draw", folder, "--output", tmp_path / "episode.png")
    run("safe_inspect", "view", folder, "--output", tmp_path / "episode.html")
    assert "</html>" in (tmp_path / "episode.html").read_text()
