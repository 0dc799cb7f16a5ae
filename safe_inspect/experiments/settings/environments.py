"""The environment configuration that RLlib passes to its runners: experiment, seed and values of the run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

#: The value of `maker` that selects this package's own environments.
DEFAULT_MAKER = ""


def environment_settings(experiment: Mapping[str, Any], rllib: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """Return the environment configuration for RLlib.

    The resolved experiment is stored as JSON text, because Tune would resolve any `grid_search` inside a mapping again.

    Args:
        experiment: The resolved experiment.
        rllib: Settings of the algorithm, from which the seed and the number of Torch threads are taken.
        **more: Further values of the run.
    """
    return {
        "experiment": json.dumps(experiment),
        "seed": int(rllib.get("seed") or 0),
        "torch_num_threads": rllib["torch_num_threads"],
        **more,
    }


def experiment_in(config: Mapping[str, Any]) -> Any:
    """Return the resolved experiment from RLlib's environment configuration, which contains it as JSON text."""
    experiment = config["experiment"]
    return json.loads(experiment) if isinstance(experiment, str) else experiment
