"""Train a policy: ``python -m safe_inspect.train_rl --cfg configs/translational-inspection/experiment.yml``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from safe_inspect.cli.common import Parser, command_of, parse_arguments, run_command
from safe_inspect.cli.train import add_train_arguments


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code: 0, or 2 for a mistake of the user's."""
    parser = Parser(prog="python -m safe_inspect.train_rl", description="Train a policy with RLlib.")
    add_train_arguments(parser)
    return run_command(command_of("train", "run_train"), parse_arguments(parser, argv))


if __name__ == "__main__":
    sys.exit(main())
