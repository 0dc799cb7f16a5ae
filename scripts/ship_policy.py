"""Put a trained policy into the package's data: ONNX files, weights, experiment and model card.

python scripts/ship_policy.py RUN translational-inspection --title "One deputy inspects every lit point." \
    --command "safe-inspect train --cfg configs/translational-inspection/experiment.yml" \
    --evaluation "The shipped task=out/evaluation.json"
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from safe_inspect.errors import SafeInspectError

_ROOT = Path(__file__).resolve().parents[1] / "safe_inspect" / "policies" / "trained"


def main() -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", help="folder of a checkpoint within its run, or of the run: its newest one")
    parser.add_argument("name", help="name of the policy")
    parser.add_argument("--title", required=True, help="what it does, one sentence")
    parser.add_argument("--command", required=True, help="command of the training, as a reader would repeat it")
    parser.add_argument(
        "--evaluation", action="append", default=[], metavar="TITLE=FILE", help="an evaluation.json; any number"
    )
    parser.add_argument("--machine", default="", help="on what it was trained (default: this machine's kind)")
    parser.add_argument("--seed-line", action="append", default=[], help="what another seed reached; any number")
    parser.add_argument("--limit", action="append", default=[], help="a limit of use of this policy; any number")
    parser.add_argument("--root", type=Path, default=_ROOT, help="where the folder is made (default: the package)")
    parser.add_argument("--force", action="store_true", help="replace the folder if this script wrote all of it")
    arguments = parser.parse_args()
    pairs = [text.rpartition("=") for text in arguments.evaluation]
    if any(not equals for _, equals, _ in pairs):
        parser.error("write --evaluation as TITLE=FILE")

    from model_cards import CardData, evaluation_content, ship  # loads Ray and Torch

    try:
        card = CardData(
            arguments.name,
            arguments.title,
            arguments.command,
            machine=arguments.machine,
            evaluations={title: evaluation_content(file) for title, _, file in pairs},
            seeds=arguments.seed_line,
            limits=arguments.limit,
        )
        shipped = ship(arguments.checkpoint, arguments.root, card, replace_old=arguments.force)
    except SafeInspectError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    size = sum(path.stat().st_size for path in shipped.folder.rglob("*") if path.is_file())
    print(f"{shipped.folder}: {size / 1024:.0f} KiB for {', '.join(shipped.onnx)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
