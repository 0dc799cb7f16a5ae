"""What does each part of the learner gain? Update time and speed of a whole training, without each of its parts.

    python benchmarks/learner_ablation.py --iterations 8 --json ablation.json

The shipped experiment trains with

    private     this package's own passes through tanh nets and its own Adam, in learner and sampler,
    sampler     its own passes in the sampler alone; the learner as in `autograd`,
    autograd    batches as arrays, Torch's autograd, and its fused Adam,
    compiled    the same, the nets compiled by `torch.compile`,
    stock       RLlib's own learner,

each with one thread and, but for `stock`, with two (policy and value function side by side). They take turns, an
iteration each, in one process, so that the ratios hold on a machine that does other things as well.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import torch
from training import CONFIGURATION, WARM_UP, RLlibTraining, machine

from safe_inspect.config.experiment import load_experiment
from safe_inspect.errors import SafeInspectError

VARIANTS = ("private", "sampler", "autograd", "compiled", "stock")
#: What the ratios are to.
YARDSTICK = "autograd"


@contextmanager
def as_variant(variant: str) -> Iterator[None]:
    """Take away what a variant does without."""
    from safe_inspect.experiments.learning import ppo_nets
    from safe_inspect.experiments.modules import tanh_net

    with ExitStack() as stack:
        if variant not in ("private", "sampler"):
            stack.enter_context(patch.object(tanh_net, "linear_layers", lambda *_: None))
        if variant != "private":
            stack.enter_context(patch.object(ppo_nets, "linear_layers", lambda *_: None))
            stack.enter_context(patch.object(ppo_nets, "FastAdam", ppo_nets.TorchAdam))
        if variant == "compiled":
            plain = ppo_nets.AutogradPass

            def compiled(net: Any, parameters: Any) -> Any:
                key = id(parameters[0])
                if key not in _COMPILED:
                    _COMPILED[key] = torch.compile(net)
                fast = _COMPILED[key]
                # Values before the update come in batches of any size, each of which would be compiled again.
                return plain(lambda batch: (fast if torch.is_grad_enabled() else net)(batch), parameters)

            stack.enter_context(patch.object(ppo_nets, "AutogradPass", compiled))
        yield


_COMPILED: dict[int, Any] = {}


class Contestant:
    """A training of one variant, with the time of each update.

    Args:
        experiment: The experiment.
        variant: One of `VARIANTS`.
        threads: Nets that learn side by side.
    """

    def __init__(self, experiment: Any, variant: str, threads: int) -> None:
        self._variant = variant
        learner = "stock" if variant == "stock" else "fast"
        with as_variant(variant):
            self._training = RLlibTraining(experiment, learner=learner, learner_threads=threads)
        stock_learner: Any = self._training.algorithm.learner_group._learner
        self._update, stock_learner.update = stock_learner.update, self._timed
        self.update = (0.0, 0.0)

    def _timed(self, *arguments: Any, **keywords: Any) -> Any:
        clock, processor = time.perf_counter(), time.process_time()
        found = self._update(*arguments, **keywords)
        self.update = (time.perf_counter() - clock, time.process_time() - processor)
        return found

    def __call__(self) -> dict[str, float]:
        """Train for an iteration; return what it took [s] by the clock and of the processors."""
        with as_variant(self._variant):
            clock, processor = time.perf_counter(), time.process_time()
            steps = self._training()
            clock, processor = time.perf_counter() - clock, time.process_time() - processor
        return {
            "clock": clock / steps,
            "processor": processor / steps,
            "update clock": self.update[0],
            "update processor": self.update[1],
        }


def compete(contestants: dict[str, Contestant], iterations: int) -> dict[str, dict[str, list[float]]]:
    """Train everybody in turns; return all measurements of each."""
    found: dict[str, dict[str, list[float]]] = {name: {} for name in contestants}
    for iteration in range(WARM_UP + iterations):
        for name, contestant in contestants.items():
            taken = contestant()
            if iteration >= WARM_UP:
                for key, value in taken.items():
                    found[name].setdefault(key, []).append(value)
    return found


def table(found: dict[str, dict[str, list[float]]]) -> str:
    """Return a line for each contestant: medians, and the median ratios to the yardstick, turn by turn."""
    rows = [("", "update [s]", "of processors", "ratio", "steps/s", "ratio", "steps/processor s", "ratio")]
    for name, taken in found.items():
        base = found[f"{YARDSTICK}, {name.rpartition(', ')[2]}"]

        def ratio(key: str, base: Any = base, taken: Any = taken) -> str:
            pairs = zip(base[key], taken[key], strict=True)
            return f"{statistics.median(theirs / mine for theirs, mine in pairs):.2f}"

        median = {key: statistics.median(values) for key, values in taken.items()}
        rows.append(
            (
                name,
                f"{median['update clock']:.3f}",
                f"{median['update processor']:.3f}",
                ratio("update clock"),
                f"{1.0 / median['clock']:,.0f}",
                ratio("clock"),
                f"{1.0 / median['processor']:,.0f}",
                ratio("processor"),
            )
        )
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cfg", default=CONFIGURATION)
    parser.add_argument("--iterations", type=int, default=8, help="measured iterations of each")
    parser.add_argument("--variants", nargs="*", choices=VARIANTS, default=list(VARIANTS))
    parser.add_argument("--json", type=Path, help="also write the measurements to this file")
    parser.add_argument("overrides", nargs="*")
    arguments = parser.parse_args(argv)
    torch.set_num_threads(1)
    try:
        experiment = load_experiment(arguments.cfg, arguments.overrides)
    except SafeInspectError as error:
        print(error, file=sys.stderr)
        return 2
    from local_ray import local_ray

    with local_ray():
        contestants = {
            f"{variant}, {threads} thread{'s'[: threads - 1]}": Contestant(experiment, variant, threads)
            for variant in arguments.variants
            for threads in ((1,) if variant == "stock" else (1, 2))
        }
        found = compete(contestants, arguments.iterations)
    print(f"{machine()}\n{arguments.iterations} iterations of each, medians; ratios to `{YARDSTICK}`, turn by turn\n")
    print(table(found))
    if arguments.json:
        content = {"machine": machine(), "iterations": arguments.iterations, "measured": found}
        arguments.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
