"""Train a policy: ``python -m safe_inspect.train_rl --cfg configs/translational-inspection/experiment.yml``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from safe_inspect.cli.common import Parser, run_command


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code, which is 0, or 2 for a mistake of the user."""
    parser = Parser(
        prog="python -m safe_inspect.train_rl", description="Train a policy with RLlib.", command=("train", "train")
    )
    return run_command(parser, argv)


if __name__ == "__main__":
    sys.exit(main())
