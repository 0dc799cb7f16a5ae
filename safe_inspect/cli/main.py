"""The command ``safe-inspect``: train, evaluate and draw policies, check experiments and safety filters."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress

from safe_inspect.cli.common import Parser, run_command
from safe_inspect.version import __version__

_ABOUT = "Train, evaluate and draw policies, check experiments and safety filters; `COMMAND --help` tells more."
#: Of each command the module of `cli.commands` that holds its arguments and what it does, and its line of ``--help``.
_COMMANDS = {
    "list": ("catalogue", "list tasks, policies, or plugins with their fields, defaults and units"),
    "validate": ("catalogue", "check an experiment file; Ray is not loaded"),
    "schema": ("catalogue", "print the JSON schema of a configuration file, for editors"),
    "train": ("train", "train a policy; the same as python -m safe_inspect.train_rl"),
    "safety": ("safety", "fly adversaries under the safety filter and count violations"),
    "acceptance": ("safety", "print which share of the drawn initial states is safe"),
    "evaluate": ("evaluate", "fly policies or baselines and print what they achieve"),
    "compare": ("evaluate", "put evaluations of the same episodes side by side"),
    "leaderboard": ("leaderboard", "fly baselines, shipped policies and yours on the same episodes; write a table"),
    "baseline": ("baseline", "optimise open-loop plans, or fly a baseline, episode by episode"),
    "rendezvous": ("rendezvous", "fly to a point of a tumbling target and print how it went"),
    "record-log": ("recording", "record depth frames and inertial samples of a simulated tumbling target"),
    "characterise": ("recording", "estimate how a target tumbles from a sensor log"),
    "draw": ("figures", "draw an episode: in space, and its figures over time"),
    "film": ("figures", "film an episode (GIF or MP4)"),
    "view": ("figures", "write an episode as an interactive page that opens without a network"),
    "curves": ("figures", "draw learning curves, with bands over training seeds"),
    "export": ("export", "write a trained policy as an ONNX file"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code: 0, or 2 for a mistake of the user's."""
    with suppress(FileNotFoundError):  # as `python -m` does: a module next to the configuration can hold plugins
        sys.path.insert(0, os.getcwd())
    return run_command(command_parser(), argv)


def command_parser() -> Parser:
    """Return the parser of all commands."""
    parser = Parser(prog="safe-inspect", description=_ABOUT)
    parser.add_argument("--version", action="version", version=f"safe_inspect {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)
    for name, (module, about) in _COMMANDS.items():
        commands.add_parser(name, help=about, command=(module, name))
    return parser


if __name__ == "__main__":
    sys.exit(main())
