"""The command ``safe-inspect``: train, evaluate and draw policies, check experiments and safety filters."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

from safe_inspect.cli.common import Parser, run_command
from safe_inspect.compiling import announce_compiling
from safe_inspect.version import __version__

_ABOUT = "Train, evaluate and draw policies, check experiments and safety filters."
_EXIT_CODES = "Exit codes: 0 success; 1 negative result; 2 mistake in the input; 128 + N after signal N (130: Ctrl-C)."


class _Command(NamedTuple):
    """The help of a command.

    Attributes:
        module: The module of `cli.commands` with the arguments and the function of the command.
        about: Description in the list of commands.
        more: Further description.
        example: A command line.
    """

    module: str
    about: str
    more: str
    example: str


_COMMANDS = {
    "list": _Command(
        "catalogue", "list tasks, policies, or plugins with their fields, defaults and units",
        "Without arguments it lists the plugins of every kind.", "safe-inspect list reward ObservedPointsReward",
    ),
    "validate": _Command(
        "catalogue", "check an experiment file without loading Ray",
        "All mistakes are reported together, each with file, line and a suggestion.",
        "safe-inspect validate configs/docking/experiment.yml lr=1e-4",
    ),
    "schema": _Command(
        "catalogue", "write the JSON schema of a configuration file, for editors",
        "Editors use it for completion and for checks while you type.",
        "safe-inspect schema agent --output agent.schema.json",
    ),
    "train": _Command(
        "train", "train a policy; the same as python -m safe_inspect.train_rl",
        "Progress, checkpoints, progress.csv and TensorBoard logs go to a new run folder.",
        "safe-inspect train configs/docking/experiment-recipe.yml lr=1e-4",
    ),
    "warm": _Command(
        "warm", "compile ahead what environments need, for a container image or CI",
        "Machine code serves the processor that it is compiled on; for others set NUMBA_CPU_NAME=generic for both.",
        "safe-inspect warm safe_inspect/FilteredTranslationalInspection-v1",
    ),
    "safety": _Command(
        "safety", "run adversaries against the safety filter and count violations",
        "Constraints are checked at the steps and at moments between them.",
        "safe-inspect safety configs/docking/experiment.yml --steps 20000",
    ),
    "bounds": _Command(
        "bounds", "print what disturbs the motion that the safety filter assumes, and whether it tolerates that",
        "Orbits, thrusters and estimates declare bounds, which are added up; exits with 1 if the filter needs more.",
        "safe-inspect bounds configs/translational-inspection/experiment-burn-and-coast-orbits.yml",
    ),
    "acceptance": _Command(
        "safety", "print the share of random initial states that is safe",
        "It also prints which constraint refuses the others, which of them `alone`, and how many have no backup plan "
        "(`recoverable`).",
        "safe-inspect acceptance configs/translational-inspection/experiment.yml",
    ),
    "evaluate": _Command(
        "evaluate", "run episodes of policies and print what they achieve",
        "An interrupted evaluation with --output continues where it stopped.",
        "safe-inspect evaluate --policy docking --episodes 100 --output results/docking",
    ),
    "compare": _Command(
        "evaluate", "compare policies on the same episodes",
        "Differences are paired by episode and have bootstrap intervals.",
        "safe-inspect compare results/docking zero-thrust",
    ),
    "leaderboard": _Command(
        "leaderboard", "run baselines, trained policies and yours on the same episodes, and write a table",
        "Rows that have not changed since the last call are not run again.",
        "safe-inspect leaderboard --episodes 100 --output leaderboard.md",
    ),
    "baseline": _Command(
        "baseline", "optimise open-loop plans, or run a scripted policy",
        "The optimiser gives the minimum delta-v of each episode with full knowledge of it.",
        "safe-inspect baseline optimiser --episodes 100 --output optimum.json",
    ),
    "rendezvous": _Command(
        "rendezvous", "fly to a point on a tumbling target",
        "Prints the course of the mission and its result; `evaluate` flies many.",
        "safe-inspect rendezvous configs/tumbling-rendezvous/experiment-truth.yml --output output/mission",
    ),
    "record-log": _Command(
        "rendezvous", "record depth images and inertial samples of a simulated tumbling target",
        "The log is the input of `characterise`; docs/rendezvous.md describes its format.",
        "safe-inspect record-log configs/tumbling-rendezvous/experiment.yml --output output/log --seconds 30",
    ),
    "characterise": _Command(
        "rendezvous", "estimate from a sensor log how a target tumbles",
        "Works on simulated logs and on your own, with or without a model of the target.",
        "safe-inspect characterise output/log --target configs/tumbling-rendezvous/experiment.yml",
    ),
    "draw": _Command(
        "figures", "draw an episode: the trajectory and its quantities over time",
        "Writes a PNG, PDF or SVG file.", "safe-inspect draw inspector --seed 1 --output episode.png",
    ),
    "film": _Command(
        "figures", "write an animation of an episode (GIF or MP4)",
        "MP4 needs the extra [film].", "safe-inspect film inspector --seed 1 --output episode.gif",
    ),
    "view": _Command(
        "figures", "write an episode as an interactive HTML page",
        "The page opens without a server and without a network.",
        "safe-inspect view inspector --seed 1 --output episode.html",
    ),
    "curves": _Command(
        "figures", "draw learning curves with bands over training seeds",
        "Runs that differ only in their seed become one curve.",
        "safe-inspect curves output/RUN_1 output/RUN_2 --output curves.png",
    ),
    "export": _Command(
        "export", "write a trained policy as an ONNX file",
        "The file contains the network, the normalizers and the configuration.",
        "safe-inspect export output/RUN --output policy.onnx",
    ),
}  # fmt: skip


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code, which is 0, or 2 for a mistake of the user."""
    with suppress(FileNotFoundError):  # as `python -m` does, for modules with plugins next to the configuration
        sys.path.insert(0, os.getcwd())
    announce_compiling()
    return run_command(command_parser(), argv)


def command_parser() -> Parser:
    """Return the parser of all commands."""
    parser = Parser(
        prog="safe-inspect", description=_ABOUT, formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=f"`safe-inspect COMMAND --help` shows the options of a command and an example.\n\n{_EXIT_CODES}",
    )  # fmt: skip
    parser.add_argument("--version", action="version", version=f"safe_inspect {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (module, about, more, example) in _COMMANDS.items():
        commands.add_parser(
            name, help=about, command=(module, name), formatter_class=argparse.RawDescriptionHelpFormatter,
            description=f"{about[0].upper()}{about[1:]}.\n{more}",
            epilog=f"Example:\n  {example}\n\n{_EXIT_CODES}\nDocumentation: docs/cli.md#{name}",
        )  # fmt: skip
    return parser


if __name__ == "__main__":
    sys.exit(main())
