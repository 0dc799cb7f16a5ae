"""All speeds in one table, each as a ratio to a baseline that is measured in the same run.

    python benchmarks/suite.py --json now.json
    python benchmarks/suite.py --quick --compare benchmarks/reference.json

| part | baseline |
|---|---|
| environment alone, safety filter off and on | one environment with scikit-learn's K-means at every step |
| sampling through RLlib, the batched runner | RLlib's stock runner, as many environments |
| training end to end, this package's learner | a plain PPO loop in PyTorch on the same environment |

Only ratios can be compared between machines and days, and even they differ by a third between processors. ``--compare``
fails when one of them is smaller by more than ``--tolerance`` than in an earlier report; what seems to have fallen is
measured once more, and the better measurement of each row counts.
"""

from __future__ import annotations

import argparse
import datetime
import json
import subprocess
import sys
import tempfile
from collections.abc import Collection
from operator import itemgetter
from pathlib import Path
from typing import Any

from machine import machine

HERE = Path(__file__).parent


def run(script: str, *arguments: str) -> dict[str, Any]:
    """Run a benchmark of this folder and return its report."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, str(HERE / script), *arguments, "--json", str(report)]
        print(f"... {script} {' '.join(arguments)}", file=sys.stderr, flush=True)
        done = subprocess.run(command, cwd=HERE, capture_output=True, text=True, check=False)
        if done.returncode != 0 or not report.is_file():
            print(done.stdout + done.stderr, file=sys.stderr)
            raise SystemExit(f"{script} failed with exit code {done.returncode}")
        found: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
        return found


def environment(quick: bool) -> list[dict[str, Any]]:
    """Return the rows of the environment alone."""
    sizes = ["1", "64", "1024"] if quick else ["1", "64", "1024", "4096"]
    seconds, rounds = ("1.0", "4") if quick else ("5", "10")
    cases = ("--envs", *sizes, "--deputies", "3", "--filtered", "--no-shares")
    report = run("environment.py", *cases, "--seconds", seconds, "--rounds", rounds)
    return [
        {
            "name": f"environment: {row['case']}, D={row['deputies']}, N={row['num_envs']}, {row['thrust']} thrust",
            "value": row["steps_per_cpu_second"],
            "unit": "agent-steps/s",
            "ratio": row["ratio"],
        }
        for row in report["rates"]
        if not row["case"].startswith("K-means")
    ]


def sampling(quick: bool) -> list[dict[str, Any]]:
    """Return the rows of the sampling."""
    sizes = ["64"] if quick else ["64", "256"]
    seconds, rounds = ("2", "2") if quick else ("10", "5")
    report = run("sampling.py", "--envs", *sizes, "--seconds", seconds, "--rounds", rounds)
    return [
        {
            "name": f"sampling: {row['case']}, N={row['num_envs']}",
            "value": row["agent_steps_per_cpu_second"],
            "unit": "agent-steps/s",
            "ratio": row["ratio"],
        }
        for row in report["sampling"]
        if row["runner"] == "batched"
    ]


def training(quick: bool) -> list[dict[str, Any]]:
    """Return the rows of the training, by processor time: a second processor may be busy with something else."""
    report = run("training.py", "--iterations", "3" if quick else "12")
    return [
        {
            "name": f"training: {name}",
            "value": figure["steps_per_processor_second"],
            "unit": "steps/s",
            "ratio": figure["processor_ratio"],
        }
        for name, figure in report["figures"].items()
        if name != "plain PyTorch loop"
    ]


PARTS = {"environment": environment, "sampling": sampling, "training": training}


def measure(quick: bool, parts: Collection[str]) -> list[dict[str, Any]]:
    """Return the rows of these parts, measured now."""
    return [row for part in parts for row in PARTS[part](quick)]


def fallen(rows: list[dict[str, Any]], before: dict[str, Any], tolerance: float) -> dict[str, str]:
    """Return a sentence for every row, by name, whose ratio has become too small."""
    known = {row["name"]: row["ratio"] for row in before["rows"]}
    return {
        row["name"]: f"{row['name']}: the ratio was {known[row['name']]:.2f} and is {row['ratio']:.2f}"
        for row in rows
        if row["name"] in known and row["ratio"] < (1.0 - tolerance) * known[row["name"]]
    }


def show(report: dict[str, Any]) -> None:
    """Print the table."""
    print("  ".join(f"{key} {value}" for key, value in report["machine"].items()))
    width = max(len(row["name"]) for row in report["rows"])
    for row in report["rows"]:
        print(f"{row['name']:{width}}  {row['value']:>11,.0f} {row['unit']:13}  ratio {row['ratio']:>8.2f}")


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="less precise, in about two minutes")
    parser.add_argument("--json", type=Path, help="write the report to this file")
    parser.add_argument("--compare", type=Path, metavar="FILE", help="fail when a ratio has fallen since this report")
    parser.add_argument("--tolerance", type=float, default=0.5, help="by how much a ratio may fall (default: half)")
    arguments = parser.parse_args(argv)
    before = None
    if arguments.compare is not None:
        if not arguments.compare.is_file():
            parser.error(f"{arguments.compare}: there is no such report")
        before = json.loads(arguments.compare.read_text(encoding="utf-8"))
    rows = measure(arguments.quick, PARTS)
    report = {"date": datetime.date.today().isoformat(), "machine": machine(), "rows": rows}
    show(report)
    problems = {} if before is None else fallen(rows, before, arguments.tolerance)
    if before is not None and problems:
        print("\n".join(problems.values()), file=sys.stderr)
        print("other work may have disturbed this; it is measured once more", file=sys.stderr)
        again = {row["name"]: row for row in measure(arguments.quick, {name.partition(":")[0] for name in problems})}
        report["rows"] = rows = [max(row, again.get(row["name"], row), key=itemgetter("ratio")) for row in rows]
        show(report)
        problems = fallen(rows, before, arguments.tolerance)
        print("\n".join(problems.values()), file=sys.stderr)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
