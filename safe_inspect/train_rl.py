"""Train a policy: ``python -m safe_inspect.train_rl --cfg configs/translational-inspection/experiment.yml``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from safe_inspect.cli.common import guarded, parse
from safe_inspect.cli.train import add_train_arguments, run_train


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code: 0, or 2 for a mistake of the user's."""
    parser = argparse.ArgumentParser(prog="python -m safe_inspect.train_rl", description=__doc__)
    add_train_arguments(parser)
    return guarded(run_train, parse(parser, argv))


if __name__ == "__main__":
    sys.exit(main())
