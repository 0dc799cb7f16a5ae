"""`read_reference`: reads the open-loop optimum of every episode, to which the figures of a policy are compared."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.task import differing_keys
from safe_inspect.types import FloatArray


def read_reference(path: Path, seed: int, episodes: int, task: Mapping[str, Any] | None = None) -> FloatArray:
    """Return the delta-v of the open-loop optimum of every episode [m/s], NaN where none was found, shape (episodes,).

    Args:
        path: A JSON file with the keys ``seed`` and ``delta_v``, a list with a number or null for each episode.
        seed: Seed of the episodes.
        episodes: Number of episodes.
        task: The task, see `task_of`; it must be that of the file if the file has one.

    Raises:
        SafeInspectError: The file is missing or damaged, has another seed or task, or has fewer episodes.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        values = [math.nan if value is None else float(value) for value in content["delta_v"]]
        of_seed = int(content["seed"])
    except OSError as error:
        raise SafeInspectError(f"{path}: the reference cannot be read ({error.strerror}); give another file") from None
    except (ValueError, KeyError, TypeError) as error:
        raise SafeInspectError(
            f'{path}: the reference is damaged ({error}); expected {{"seed": ..., "delta_v": [...]}}, as written by '
            "`safe-inspect baseline`"
        ) from None
    if of_seed != seed:
        raise SafeInspectError(f"{path}: the reference has seed {of_seed}, not {seed}; give --seed {of_seed}")
    apart = [] if task is None or "task" not in content else list(differing_keys(content["task"], task))
    if apart:
        raise SafeInspectError(
            f"{path}: the reference is of another task, which differs in {', '.join(apart[:3])}; compute it again with "
            "`safe-inspect baseline optimiser`"
        )
    if len(values) < episodes:
        raise SafeInspectError(
            f"{path}: the reference has {len(values)} episodes, fewer than {episodes}; give --episodes {len(values)}"
        )
    return np.array(values[:episodes])
