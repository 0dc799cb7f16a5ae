"""Safe reinforcement learning of spacecraft inspection and rendezvous.

Importing the package registers its Gymnasium ids. `make`, `make_vec`, `make_parallel`, `make_parallel_vec`,
`load_experiment` and `load_policy` are imported when they are first used. Neither the package nor these functions load
Ray or Torch, except `load_policy` for a checkpoint.
"""

from __future__ import annotations

import importlib
from typing import Any

from safe_inspect.interrupts import stop_quietly_until_handled
from safe_inspect.version import __version__

__all__ = ["__version__", "load_experiment", "load_policy", "make", "make_parallel", "make_parallel_vec", "make_vec"]

_HOMES = {
    "load_experiment": "safe_inspect.config.experiment",
    "load_policy": "safe_inspect.experiments.modules.sources",
}
_MAKERS = "safe_inspect.environments.registration"

stop_quietly_until_handled()
importlib.import_module("safe_inspect.task_ids").register_tasks()  # loads Gymnasium


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'safe_inspect' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES.get(name, _MAKERS)), name)
