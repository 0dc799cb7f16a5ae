"""Construction of the environments of RLlib's runners: makers, seeds and slots.

A runner w has M environments in the global slots (w - 1) M to w M - 1. An episode is a function of the seed, its slot
and its number within the slot, so it does not matter which runner executes it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from safe_inspect.environments.finite_checks import CRASH_FOLDER_VARIABLE
from safe_inspect.environments.registration import build_spec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import SafeInspectError
from safe_inspect.experiments.settings.environments import DEFAULT_MAKER, experiment_in
from safe_inspect.plugins.registry import import_user_module

#: Function that builds environments from the resolved configuration, their number, the seed and the first slot.
EnvironmentMaker: TypeAlias = Callable[[Mapping[str, Any], int, int, int], TeamEnvironment]


def require_steps(team: TeamEnvironment) -> None:
    """Check that decisions last one control step, as RLlib's stock runner requires.

    Raises:
        SafeInspectError: Decisions last several control steps.
    """
    if team.decides:
        raise SafeInspectError(
            "decisions that last several steps (CoastGlue) need the batched runner; remove the keys that select "
            "RLlib's stock runner, such as `env_runner: stock`"
        )


def first_slot(worker_index: int, num_envs: int) -> int:
    """Return the global index of a runner's first environment slot.

    Remote runners count from 1, and runner w has the slots (w - 1) M to w M - 1. A local runner, which samples only if
    there is no remote runner, has the first slots.
    """
    return max(worker_index - 1, 0) * num_envs


def stream_seed(seed: int, attempt: int = 0, evaluation: bool = False) -> int:
    """Return the seed of the environments, 0 to 2**64 - 1.

    The first attempt trains with the seed of the run. The episodes of the evaluation and of a resumed run, whose slots
    count their episodes from 0 again, use other seeds.
    """
    number = 2 * attempt + int(evaluation)
    if number == 0:
        return seed % 2**64
    # The finaliser of SplitMix64, so that neighbouring runs do not share seeds.
    mixed = (seed + number * 0x9E3779B97F4A7C15) % 2**64
    mixed = ((mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9) % 2**64
    mixed = ((mixed ^ (mixed >> 27)) * 0x94D049BB133111EB) % 2**64
    return mixed ^ (mixed >> 31)


def seed_of(config: Mapping[str, Any], evaluation: bool) -> int:
    """Return the seed of a runner's environments and actions, from RLlib's environment configuration."""
    return stream_seed(int(config.get("seed") or 0), int(config.get("attempt", 0)), evaluation)


def build_team(config: Mapping[str, Any], num_envs: int, slot: int, evaluation: bool) -> TeamEnvironment:
    """Build the environments of a runner.

    Args:
        config: RLlib's environment configuration, see `environment_settings`.
        num_envs: Number of environments.
        slot: Global index of the first environment slot.
        evaluation: Whether they are used for the evaluation.
    """
    path = config.get("maker", DEFAULT_MAKER)
    module, _, function = path.partition(":")
    maker: EnvironmentMaker | None = getattr(import_user_module(module), function) if path else None
    experiment, seed = experiment_in(config), seed_of(config, evaluation)
    with Reported(config):
        if maker is None:
            return TeamEnvironment(build_spec(experiment), num_envs, seed=seed, first_slot=slot)
        return maker(experiment, num_envs, seed, slot)


class Reported:
    """Context that writes a user's error to a file, because RLlib's remote runners end without passing it on.

    The states that caused the error are saved in the folder of that file, unless the user names another folder.

    Args:
        config: RLlib's environment configuration, whose `failure_file` names the file.
    """

    def __init__(self, config: Mapping[str, Any]) -> None:
        self._file = config.get("failure_file")
        self._names_folder = False

    def __enter__(self) -> None:
        if self._file and CRASH_FOLDER_VARIABLE not in os.environ:
            os.environ[CRASH_FOLDER_VARIABLE] = str(Path(self._file).parent)
            self._names_folder = True

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if self._names_folder:
            self._names_folder = False
            os.environ.pop(CRASH_FOLDER_VARIABLE, None)
        if self._file and isinstance(error, SafeInspectError):
            Path(self._file).write_text(json.dumps({"error": type(error).__name__, "message": str(error)}))
