"""The safety filter under disturbances: what it gives up for their bounds, and whether it holds.

    python benchmarks/disturbed_filter.py --rows 1000 --steps 450

For multiples of the bounds it prints the share of the task's starts that the undisturbed filter accepts and this one
too, and counts over flights from states that graze the limits, under adversarial thrusts and disturbances on the
surface of the bounds that push to the limits; see `safe_inspect.rta.audit`.
"""

from __future__ import annotations

import argparse
import time

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.evaluation.safety_report import acceptance
from safe_inspect.rta.audit import audit
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import NAMES, RelativeState

BOUNDS = DisturbanceBounds(
    velocity=1e-4, position_error=0.01, velocity_error=1e-4, thrust_gain=0.01, thrust_direction=0.01
)


def scaled(factor: float) -> DisturbanceBounds:
    """Return so many times the bounds."""
    return DisturbanceBounds(**{name: factor * value for name, value in BOUNDS.model_dump().items()})


def starts(draws: int) -> RelativeState:
    """Return initial states as the shipped task draws them, before any is refused."""
    spec = load_experiment(configs_root() / "translational-inspection" / "experiment.yml").spec
    drawn = acceptance(spec, draws).states
    return RelativeState(drawn["position"], drawn["velocity"], drawn["sun_angle"])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=64, help="lines of states of each kind that graze the limits")
    parser.add_argument("--steps", type=int, default=60, help="steps of a flight")
    parser.add_argument("--draws", type=int, default=20_000, help="starts of the task")
    parser.add_argument("--scales", type=float, nargs="+", default=[0.0, 1.0, 3.0], help="multiples of the bounds")
    arguments = parser.parse_args()
    state = starts(arguments.draws)
    undisturbed = BackupFilter().recoverable(state)
    print(f"{'bounds':>7} {'starts':>8} {'steps':>10} {'no plan':>8} {'violations':>10} {'intervened':>10} {'us':>6}")
    for factor in arguments.scales:
        tube = BackupFilter(None, NAMES, disturbance=scaled(factor))
        share = tube.recoverable(state).sum() / undisturbed.sum()
        begun = time.process_time()
        found = audit(0, arguments.rows, arguments.steps, seed=1, first=tube)
        spent = (time.process_time() - begun) / max(found.steps, 1)
        print(
            f"{factor:>7g} {100.0 * share:>7.2f}% {found.steps:>10,} {found.infeasible:>8,} {found.violations:>10,} "
            f"{100.0 * found.interventions / found.steps:>9.1f}% {1e6 * spent:>6.0f}",
            flush=True,
        )
        print("        least: " + ", ".join(f"{name} {value:.3g}" for name, value in found.least.items()), flush=True)


if __name__ == "__main__":
    main()
