"""Fly the scripted inspector through one episode of a task and draw it.

The picture of the README, three deputies on their way, is drawn by

    TASK=safe_inspect/MultiagentTranslationalInspectionSeed-v0
    python examples/draw_trajectory.py --cfg $TASK --seed 4 --until 2500 --out docs/images/trajectory.png
"""

from __future__ import annotations

import argparse
import math
import sys

from safe_inspect.environments import load_spec
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation import Evaluation, evaluation_table, rollout
from safe_inspect.figures import save, trajectory_figure
from safe_inspect.policies import NaturalMotionInspector


def main() -> int:
    """Draw the episode that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", default="trajectory.png", help="file of the picture (png, pdf, svg)")
    parser.add_argument(
        "--cfg", default="safe_inspect/TranslationalInspectionSeed-v0", help="experiment file or task id"
    )
    parser.add_argument("--seed", type=int, default=1, help="seed of the run")
    parser.add_argument("--until", type=float, default=math.inf, help="draw the episode up to this time [s]")
    arguments = parser.parse_args()
    try:
        episodes = rollout(load_spec(arguments.cfg), NaturalMotionInspector(), 1, arguments.seed, record=1)
        save(trajectory_figure(episodes.trajectories[0].until(arguments.until)), arguments.out)
    except SafeInspectError as error:
        print(error, file=sys.stderr)
        return 2
    print(evaluation_table(Evaluation.of("inspector", episodes)))
    print(f"picture: {arguments.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
