"""Train a policy: ``python -m safe_inspect.train_rl --cfg configs/translational-inspection/experiment.yml``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from safe_inspect.cli.main import Parser, run_command


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code: 0, 2 for a mistake of the user, else see `run_command`."""
    return run_command(Parser(prog="python -m safe_inspect.train_rl", command="train"), argv)


if __name__ == "__main__":
    sys.exit(main())
