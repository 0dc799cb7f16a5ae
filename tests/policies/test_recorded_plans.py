"""Plans match the record: each is a function of the task, the seed and the slot alone.

A change that is meant to change plans has to update the record:

    RECORD_PLANS=1 python -m pytest -n 0 tests/policies/test_recorded_plans.py
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from safe_inspect.environments import load_spec
from safe_inspect.evaluation.optimiser import EFFORTS, optimise
from safe_inspect.evaluation.rollouts import fly_slots
from safe_inspect.policies import NaturalMotionInspector

from ..golden.flights import arithmetic

RECORD = Path(__file__).with_name("plans.json")
SEED = 11


class Plans(NamedTuple):
    """Plans of two episodes: what each costs [m/s], and further numbers of them."""

    delta_v: list[float]
    numbers: list[float]


def _optimised(task: str) -> Plans:
    entries = optimise(load_spec(f"safe_inspect/{task}"), 2, SEED, 0, EFFORTS["quick"])
    numbers: list[float] = []
    for entry in entries:
        assert entry.plan is not None
        numbers += [entry.planned or 0.0, entry.steps, len(entry.plan)]
        numbers += [value for burn in entry.plan for value in (burn.step, burn.steps, *burn.thrust)]
    return Plans([entry.delta_v for entry in entries], numbers)


def _inspected(task: str, **options: Any) -> Plans:
    entries, flown = fly_slots(load_spec(f"safe_inspect/{task}"), NaturalMotionInspector(**options), 2, SEED, 0)
    numbers = [*(entry.steps for entry in entries), *(entry.inspected for entry in entries)]
    for trajectory in flown:
        control = trajectory.control
        weights = 1.0 + np.arange(control.size).reshape(control.shape) % 97
        numbers += [np.count_nonzero(control), (control * weights).sum(), *trajectory.position[-1].ravel()]
    return Plans([entry.delta_v for entry in entries], [float(number) for number in numbers])


PLANS: dict[str, Callable[[], Plans]] = {
    "optimiser": lambda: _optimised("TranslationalInspectionSeed-v0"),
    "inspector": lambda: _inspected("TranslationalInspectionSeed-v0"),
    "inspector, weighted": lambda: _inspected("WeightedTranslationalInspection-v0"),
    "inspectors of a team": lambda: _inspected("MultiagentTranslationalInspectionSeed-v0"),
    "inspectors that keep apart": lambda: _inspected("MultiagentTranslationalInspectionSeed-v0", clearance=30.0),
}


@pytest.mark.parametrize("name", PLANS)
def test_plans_match_the_record(name: str) -> None:
    found = PLANS[name]()
    if os.environ.get("RECORD_PLANS"):
        kept = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
        digits = {key: [float(f"{v:.10g}") for v in values] for key, values in found._asdict().items()}
        text = json.dumps(kept | {"arithmetic": arithmetic(), name: digits}, indent=1)
        RECORD.write_text(text + "\n", encoding="utf-8")
    record = json.loads(RECORD.read_text(encoding="utf-8"))
    if arithmetic() == record["arithmetic"]:
        np.testing.assert_allclose(found.delta_v, record[name]["delta_v"], rtol=1e-6)
        np.testing.assert_allclose(found.numbers, record[name]["numbers"], rtol=1e-6, atol=1e-9)
    else:  # another processor rounds otherwise, and an annealer then may find another plan
        np.testing.assert_allclose(found.delta_v, record[name]["delta_v"], rtol=0.1)
