"""Fly the missions of which docs/rendezvous.md has a table, and print the table.

    python benchmarks/records.py --list
    python benchmarks/records.py [NAME ...] [--episodes 100] [--seed 1] [--workers 2] --output FOLDER

Each name is a set of missions with random tumbles; without a name all are flown. A set is flown by the printed
``safe-inspect evaluate`` command, into FOLDER/NAME; missions that a run has finished before it was interrupted are not
flown again, and sets that are complete are only read. Give a new seed: no parameter was chosen by its missions.
"""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from machine import machine

from safe_inspect.evaluation.results.files import read_evaluation
from safe_inspect.evaluation.results.results import Evaluation

#: One processor for each worker, unless the environment says otherwise.
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_CONFIGS = "configs/tumbling-rendezvous"
_TUMBLE = "tumble={functor: RandomTumble}"
#: Mating points of targets of unknown shape, 3 cm farther out than those of known ones [m].
_MARKED = {
    "satellite": (-0.1, 0.0, -0.55),
    "cylinder_with_panels": (0.0, 0.0, 0.61),
    "cube_with_nook": (0.45, 0.45, 0.4),
    "rock": (0.0, 0.1, 0.63),
}
#: Arguments of ``safe-inspect evaluate --cfg`` of each set, the file first.
RECORDS: dict[str, tuple[str, ...]] = {
    "estimated": (f"{_CONFIGS}/experiment.yml", _TUMBLE),
    "uncertain": (
        f"{_CONFIGS}/experiment-truth.yml",
        "sensors.state.attitude_sigma=0.7 deg",
        "sensors.state.rate_sigma=0.07 deg/s",
        _TUMBLE,
    ),
    "truth": (f"{_CONFIGS}/experiment-truth.yml", "mission.observe=10 s", _TUMBLE),
    **{
        name: (f"{_CONFIGS}/experiment.yml", f"target=!include {_CONFIGS}/targets/{name}.yml", _TUMBLE)
        for name in ("upper_stage", "cube_with_nook", "satellite", "cylinder_with_panels", "rock")
    },
    "harsh": (
        f"{_CONFIGS}/experiment.yml",
        "sensors.camera.profile=harsh",
        "estimator.config.front_end={functor: ModelFrontEnd, config: {range_sigma: 5 mm, range_growth: 3 mm}}",
        _TUMBLE,
    ),
    "fast": (
        f"{_CONFIGS}/experiment.yml",
        "tumble={functor: RandomTumble, config: {least_rate: 6 deg/s, largest_rate: 10 deg/s}}",
    ),
    "orbit": (f"{_CONFIGS}/experiment-orbit.yml",),
    "orbit_estimated": (
        f"{_CONFIGS}/experiment-orbit-estimated.yml",
        "tumble={functor: RandomTumble, config: {least_rate: 1 deg/s, largest_rate: 3 deg/s}}",
    ),
    "unknown": (f"{_CONFIGS}/experiment-unknown.yml", _TUMBLE),
    **{
        f"unknown_{name}": (
            f"{_CONFIGS}/experiment-unknown.yml",
            f"target=!include {_CONFIGS}/targets/{name}.yml",
            f"target.config.mating_point=[{', '.join(f'{component:g} m' for component in point)}]",
            _TUMBLE,
        )
        for name, point in _MARKED.items()
    },
}  # fmt: skip
_HEAD = (
    "missions", "arrived (95 % interval)", "not arrived", "contacts", "outside of the box", "least clearance",
    "position error: median, largest", "largest gauge", "NEES: median, largest", "commit, date",
)  # fmt: skip


def command(name: str, arguments: argparse.Namespace) -> list[str]:
    """Return the command that flies a set."""
    file, *overrides = RECORDS[name]
    numbers = {"seed": arguments.seed, "episodes": arguments.episodes, "workers": arguments.workers}
    options = [text for key, value in numbers.items() for text in (f"--{key}", str(value))]
    folder = str(arguments.output / name)
    return ["safe-inspect", "evaluate", "--cfg", file, *overrides, *options, "--output", folder]


def row(name: str, found: Evaluation) -> str:
    """Return the row of the table of a set; errors at the mating point are those of the missions that arrived."""
    team, figures = found.team, found.team.figures
    arrived, interval = team.status == "win", team.success_interval
    error, nees = figures["position error at the mating point"], figures["NEES of the target's attitude and rate"]
    causes = [] if found.causes is None else found.causes[~arrived].tolist()
    gauge = figures["largest gauge of the tube"]
    outside = np.nanmax(figures["excursion from the keep-in box"])
    cells = (
        f"`{name}`",
        f"{team.wins} of {len(found)} [{100.0 * interval.low:.1f} %, {100.0 * interval.high:.1f} %]",
        ", ".join(f"{count} {cause}" for cause, count in Counter(causes).items()) or "-",
        str(np.isfinite(figures["speed at contact"]).sum()),
        "no" if outside == 0.0 else f"up to {outside:.2g} m",
        f"{100.0 * np.nanmin(figures['least clearance']):.1f} cm",
        f"{1e3 * np.nanmedian(error[arrived]):.2g}, {1e3 * np.nanmax(error[arrived]):.2g} mm" if team.wins else "-",
        f"{np.nanmax(gauge):.2f}" if np.isfinite(gauge).any() else "-",
        f"{np.nanmedian(nees):.1f}, {np.nanmax(nees):.3g}" if np.isfinite(nees).any() else "-",
        f"{(found.record['git_commit'] or 'none')[:8]}, {found.record['date'][:10]}",
    )
    return "| " + " | ".join(cells) + " |"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of {', '.join(RECORDS)}; default: all")
    parser.add_argument("--list", action="store_true", help="print the commands and fly nothing")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--output", type=Path, default=Path("output/records"))
    arguments = parser.parse_args()
    for name in arguments.names:
        if name not in RECORDS:
            parser.error(f"there are no missions {name!r}; choose from {', '.join(RECORDS)}")
    names = arguments.names or list(RECORDS)
    if arguments.list:
        for name in names:
            print(shlex.join(command(name, arguments)))
        return 0
    rows = []
    for name in names:
        folder = arguments.output / name
        if not folder.exists():
            print(shlex.join(command(name, arguments)), file=sys.stderr, flush=True)
            done = subprocess.run(command(name, arguments), stdout=subprocess.DEVNULL, env=_ONE_THREAD | os.environ)
            if not folder.exists():
                return done.returncode or 1
        rows.append(row(name, read_evaluation(folder)))
        print(rows[-1], file=sys.stderr, flush=True)
    print(f"seed {arguments.seed}; {machine()}\n")
    print("| " + " | ".join(_HEAD) + " |\n|" + "---|" * len(_HEAD))
    print("\n".join(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
