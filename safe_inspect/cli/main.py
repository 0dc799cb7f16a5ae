"""The command ``safe-inspect``: train, evaluate and draw policies, check experiments and safety filters."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress

from safe_inspect.cli.common import EXIT_CODES, Parser, run_command
from safe_inspect.compiling import announce_compiling
from safe_inspect.version import __version__

_ABOUT = "Train, evaluate and draw policies, check experiments and safety filters."

#: Description of each command; the docstring of ``run`` in its module of `cli.commands` describes it further.
_COMMANDS = {
    "list": "list tasks, policies, or plugins with their fields, defaults and units",
    "validate": "check an experiment file without loading Ray",
    "schema": "write the JSON schema of a configuration file, for editors",
    "train": "train a policy; the same as python -m safe_inspect.train_rl",
    "warm": "compile ahead what environments need, for a container image or CI",
    "safety": "run adversaries against the safety filter and count violations",
    "bounds": "print what disturbs the motion that the safety filter assumes, and whether that is tolerated",
    "acceptance": "print the share of random initial states that is safe",
    "evaluate": "run episodes of policies and print what they achieve",
    "compare": "compare policies on the same episodes",
    "leaderboard": "run baselines, trained policies and yours on the same episodes, and write a table",
    "baseline": "optimise open-loop plans",
    "rendezvous": "fly to a point on a tumbling target",
    "record-log": "record depth images and inertial samples of a simulated tumbling target",
    "characterise": "estimate from a sensor log how a target tumbles",
    "draw": "draw an episode: the trajectory and its quantities over time",
    "film": "write an animation of an episode (GIF or MP4)",
    "view": "write an episode as an interactive HTML page",
    "curves": "draw learning curves with bands over training seeds",
    "export": "write a trained policy as an ONNX file",
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code, which is 0, or 2 for a mistake of the user."""
    with suppress(FileNotFoundError):  # as `python -m` does, for modules with plugins next to the configuration
        sys.path.insert(0, os.getcwd())
    announce_compiling()
    return run_command(command_parser(), argv)


def command_parser() -> Parser:
    """Return the parser of all commands."""
    epilog = f"`safe-inspect COMMAND --help` shows the options of a command and an example.\n\n{EXIT_CODES}"
    parser = Parser(prog="safe-inspect", description=_ABOUT, epilog=epilog)
    parser.add_argument("--version", action="version", version=f"safe_inspect {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, about in _COMMANDS.items():
        commands.add_parser(name, help=about, command=name)
    return parser


if __name__ == "__main__":
    sys.exit(main())
