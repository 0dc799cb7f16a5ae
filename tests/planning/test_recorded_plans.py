"""Plans are those on record: each is a function of the task, the seed and the slot alone.

A change that is meant to change plans writes the record anew:

    RECORD_PLANS=1 python -m pytest -n 0 tests/planning/test_recorded_plans.py
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.environments import load_spec
from safe_inspect.evaluation.baselines.flight import fly_slots
from safe_inspect.evaluation.baselines.optimiser import EFFORTS, optimise
from safe_inspect.policies import NaturalMotionInspector

RECORD = Path(__file__).with_name("plans.json")
SEED = 11


def _optimised(task: str, *overrides: str) -> list[float]:
    entries = optimise(load_spec(f"safe_inspect/{task}", overrides), 2, SEED, 0, EFFORTS["quick"])
    numbers: list[float] = []
    for entry in entries:
        assert entry.plan is not None
        numbers += [entry.planned or 0.0, entry.delta_v, entry.steps, len(entry.plan)]
        numbers += [value for burn in entry.plan for value in (burn.step, burn.steps, *burn.thrust)]
    return numbers


def _inspected(task: str, clearance: float = 0.0) -> list[float]:
    policy = NaturalMotionInspector(clearance=clearance) if clearance else NaturalMotionInspector()
    flown = fly_slots(load_spec(f"safe_inspect/{task}"), policy, 2, SEED, 0)
    numbers = [*flown.delta_v, *flown.steps, *flown.inspected]
    for trajectory in flown.trajectories:
        control = trajectory.control
        weights = 1.0 + np.arange(control.size).reshape(control.shape) % 97
        numbers += [np.count_nonzero(control), (control * weights).sum(), *trajectory.position[-1].ravel()]
    return [float(number) for number in numbers]


PLANS: dict[str, Callable[[], list[float]]] = {
    "optimiser": lambda: _optimised("TranslationalInspectionSeed-v0"),
    "inspector": lambda: _inspected("TranslationalInspectionSeed-v0"),
    "inspector, weighted": lambda: _inspected("WeightedTranslationalInspection-v0"),
    "inspectors of a team": lambda: _inspected("MultiagentTranslationalInspectionSeed-v0"),
    "inspectors that keep apart": lambda: _inspected("MultiagentTranslationalInspectionSeed-v0", 30.0),
}


@pytest.mark.parametrize("name", PLANS)
def test_plans_are_those_on_record(name: str) -> None:
    found = PLANS[name]()
    if os.environ.get("RECORD_PLANS"):
        record = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
        RECORD.write_text(json.dumps(record | {name: [float(f"{v:.10g}") for v in found]}, indent=0) + "\n", "utf-8")
    expected = json.loads(RECORD.read_text(encoding="utf-8"))[name]
    # Another processor may round otherwise, but a plan that has changed is not that close to the former one.
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
