"""The commands ``safe-inspect evaluate`` and ``safe-inspect compare``."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.arguments import add_output_folder, positive, seed


def add_evaluate_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the evaluation."""
    parser.add_argument(
        "words", nargs="*", metavar="SOURCE", help="a checkpoint's or a run's folder, an ONNX file, or the name of a "
        "baseline (zero-thrust, random, inspector), of any scripted policy or of a shipped one; and KEY=VALUE to "
        "replace values",
    )  # fmt: skip
    parser.add_argument("--policy", action="append", default=[], metavar="NAME", help="a policy that the package ships")
    _add_flight_arguments(parser)
    add_output_folder(parser, "the results")
    parser.add_argument("--record", type=positive, metavar="K", help="write the trajectories of the first K episodes")
    parser.set_defaults(overrides=[])


def add_compare_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the comparison."""
    parser.add_argument(
        "words", nargs="*", metavar="SOURCE", help="the folder of an evaluation; or what `evaluate` takes, flown in "
        "the episodes of the first evaluation; the others are compared with the first",
    )  # fmt: skip
    parser.add_argument("--policy", action="append", default=[], metavar="NAME", help="a policy that the package ships")
    _add_flight_arguments(parser)
    add_output_folder(parser, "the evaluations that are flown")
    parser.set_defaults(overrides=[], record=None)


def _add_flight_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--cfg",
        metavar="CFG",
        help="experiment file or id of a task (default: the one that each policy was trained in)",
    )
    parser.add_argument("--episodes", type=positive, help="number of episodes (default: 100)")
    parser.add_argument("--seed", type=seed, help="seed of the episodes (default: 0)")
    parser.add_argument("--num-envs", type=positive, default=256, help="episodes at a time (default: 256)")
    drawn = parser.add_mutually_exclusive_group()
    drawn.add_argument(
        "--sampled",
        action="store_const",
        const=True,
        help="draw actions from the policy's distribution (as categorical policies do in any case)",
    )
    drawn.add_argument(
        "--mode", dest="sampled", action="store_const", const=False, help="take the most likely action, or the mean"
    )
    parser.add_argument(
        "--metric", action="append", default=[], metavar="METRIC", help="measure this too: a name of `safe-inspect "
        "list metric`, a dotted path, or {functor: NAME, config: {...}}",
    )  # fmt: skip
    parser.add_argument("--reference", type=Path, metavar="FILE", help="delta-v of the open-loop optimum, by episode")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to this file")
    parser.add_argument(
        "--compute-platform", default="local", metavar="NAME", help="which of the task's rllib_configs (default: local)"
    )
