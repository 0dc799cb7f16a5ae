"""Random tumbles of a target, each measured in a separate process: the arguments of two benchmarks, and the loop."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from safe_inspect.errors import ConfigError
from safe_inspect.rendezvous.experiment import load_rendezvous

FOLDER = "configs/tumbling-rendezvous"
#: Overrides, number of the tumble, seconds.
Job = tuple[tuple[str, ...], int, float]


def parsed(description: str, seconds: float | None, tumbles: int) -> argparse.Namespace:
    """Return the arguments of the command line, with these defaults; without seconds there is no such argument."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    targets = sorted(path.stem for path in Path(FOLDER, "targets").glob("*.yml"))
    parser.add_argument("overrides", nargs="*", metavar="OVERRIDE")
    parser.add_argument("--target", choices=targets, help="Envisat by default")
    parser.add_argument("--tumbles", type=int, default=tumbles)
    if seconds is not None:
        parser.add_argument("--seconds", type=float, default=seconds)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    arguments = parser.parse_args()
    check_overrides(parser, _overrides(arguments))
    return arguments


def check_overrides(parser: argparse.ArgumentParser, overrides: tuple[str, ...]) -> None:
    """End with a message if the experiment cannot be read with these overrides."""
    try:
        load_rendezvous(f"{FOLDER}/experiment.yml", overrides)
    except ConfigError as error:
        parser.error(str(error))


def _overrides(arguments: argparse.Namespace) -> tuple[str, ...]:
    target = [f"target=!include {FOLDER}/targets/{arguments.target}.yml"] if arguments.target else []
    return ("tumble={functor: RandomTumble}", f"seed={arguments.seed}", *target, *arguments.overrides)


def measured(measure: Callable[[Job], Any], arguments: argparse.Namespace) -> Iterator[Any]:
    """Yield the measurement of each tumble, in order."""
    overrides = _overrides(arguments)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    jobs = [(overrides, number, getattr(arguments, "seconds", 0.0)) for number in range(arguments.tumbles)]
    with get_context("spawn").Pool(arguments.workers) as pool:
        yield from pool.imap(measure, jobs)
