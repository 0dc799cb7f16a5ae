"""Trainings of one iteration whose weights are on record."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

from safe_inspect.config.data import configs_root

#: Each training: its experiment.
TRAININGS = {
    "one": "translational-inspection/experiment.yml",
    "one, burn and coast": "translational-inspection/experiment-burn-and-coast.yml",
    "three": "multiagent-translational-inspection/experiment.yml",
}
_SMALL = (
    "num_envs_per_env_runner=8", "train_batch_size_per_learner=512", "minibatch_size=128", "num_epochs=2",
    "learner_threads=1", "training_iteration=1", "horizon=60",
)  # fmt: skip


def weights_after(training: str, folder: Path) -> tuple[dict[str, str], dict[str, float]]:
    """Return the SHA-256 and the sum of each weight after one iteration.

    Args:
        training: Name of the training.
        folder: Where the run folder is made.
    """
    command = [sys.executable, "-m", "safe_inspect.train_rl", "--cfg", str(configs_root() / TRAININGS[training])]
    done = subprocess.run(
        [*command, *_SMALL, "--output", str(folder)], env={**os.environ, "OMP_NUM_THREADS": "1"}, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    hashes, sums = {}, {}
    for path in sorted(folder.rglob("policy.safetensors")):
        for name, array in sorted(load_file(path).items()):
            key = f"{path.parent.name}: {name}"
            hashes[key] = hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()[:16]
            sums[key] = math.fsum(array.astype(np.float64).ravel() * np.cos(np.arange(array.size)))
    assert hashes
    return hashes, sums
