"""What RLlib hands to the environments of its runners: the resolved experiment, the seed, and the run's own."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

#: Names the maker of this package's own environments.
DEFAULT_MAKER = ""


def environment_settings(experiment: Mapping[str, Any], rllib: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """Return what RLlib hands to the environments: the resolved configuration, the seed, and the run's own.

    The configuration is JSON text, as Tune would resolve a `grid_search` within a mapping once more.
    """
    return {
        "experiment": json.dumps(experiment),
        "seed": int(rllib.get("seed") or 0),
        "torch_num_threads": rllib["torch_num_threads"],
        **more,
    }


def experiment_in(config: Mapping[str, Any]) -> Any:
    """Return the resolved experiment of RLlib's environment configuration, which holds it as text."""
    experiment = config["experiment"]
    return json.loads(experiment) if isinstance(experiment, str) else experiment
