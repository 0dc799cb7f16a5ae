"""Train a team, or continue a run: ``train_dummy.py OUTPUT ITERATIONS [RUN]``; a test kills it."""

from __future__ import annotations

import sys
from pathlib import Path

from dummy_environment import TEAM
from training_values import MAKER, QUICK

from safe_inspect.config.spec import PolicySpec
from safe_inspect.errors import SafeInspectError
from safe_inspect.experiments.runs.train import train
from safe_inspect.experiments.runs.training_run import TrainingRun

if __name__ == "__main__":
    output, iterations, *resume = sys.argv[1:]
    try:
        result = train(
            TrainingRun(
                {"sleep": 0.005, "team": TEAM},
                rllib=QUICK,
                tune={"stop": {"training_iteration": int(iterations)}, "checkpoint_frequency": 1},
                name="dummy",
                output=Path(output),
                resume=Path(resume[0]) if resume else None,
                maker=MAKER,
                policies=(
                    PolicySpec("shared", ("red", "blue"), "PPO", {}),
                    PolicySpec("own", ("green",), "PPO", {"lr": 1e-4}),
                ),
            )
        )
    except SafeInspectError as error:
        sys.exit(f"{type(error).__name__}: {error}")
    print(result.iteration, result.interrupted)
