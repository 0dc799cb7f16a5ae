"""The command ``safe-inspect warm``."""

from __future__ import annotations

import argparse
import time

import numpy as np

from safe_inspect.compiling import compiling_seconds
from safe_inspect.compiling.kernel import kept_in
from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import SafeInspectError
from safe_inspect.task_ids import ALL_TASKS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``warm``."""
    parser.add_argument(
        "files", nargs="*", metavar="FILE", help="experiment file, or id of a task (default: all shipped tasks)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Compile ahead what environments need, for a container image or CI.

    Machine code serves the processor that it is compiled on; for others set NUMBA_CPU_NAME=generic for both.

    Example:
        safe-inspect warm safe_inspect/FilteredTranslationalInspection-v1
    """
    folder = kept_in()
    if folder is None:
        raise SafeInspectError("the folder for machine code cannot be written; set another with NUMBA_CACHE_DIR")
    names = arguments.files or list(ALL_TASKS)
    specs = [load_experiment(name).spec for name in names]
    for index, (name, spec) in enumerate(zip(names, specs, strict=True), 1):
        print(f"[{index}/{len(names)}] {name} ", end="", flush=True)
        begin, compiled = time.monotonic(), compiling_seconds()
        _step(spec)
        wall, compiled = time.monotonic() - begin, compiling_seconds() - compiled
        print(f"{wall:.1f} s, {compiled:.1f} s of it compiling", flush=True)
    print(f"the machine code is in {folder}")
    return 0


def _step(spec: EnvironmentSpec) -> None:
    """Reset an environment, step it and reset it again, which calls all of its kernels."""
    environment = TeamEnvironment(spec, 1, seed=0)
    environment.reset()
    environment.step([np.zeros((1, group.size, group.action_layout.size)) for group in environment.acting])
    environment.reset(np.zeros(1, dtype=np.int64))
