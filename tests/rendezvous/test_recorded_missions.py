"""Two short missions are flown as on record: what the chaser knew and where it was, every ten seconds.

A change that is meant to change missions writes the record anew:

    RECORD_MISSIONS=1 python -m pytest -n 0 tests/rendezvous/test_recorded_missions.py
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.missions.mission import Mission

from ..golden.flights import arithmetic

RECORD = Path(__file__).with_name("missions.json")
#: A short watch that ends early, so that perception, estimation, planning and tracking fit in a quick test.
SHORT = (
    "seed=3", "mission.observe=30 s", "mission.attitude_sigma=10 deg", "mission.rate_sigma=1 deg/s",
    "mission.durations=[60 s]",
)  # fmt: skip
MISSIONS: dict[str, tuple[str, tuple[str, ...]]] = {
    "truth": ("experiment-truth.yml", ()),
    "estimated": ("experiment.yml", SHORT),
}


def _flown(name: str) -> dict[str, list[list[float]]]:
    file, overrides = MISSIONS[name]
    config = load_rendezvous(configs_root() / "tumbling-rendezvous" / file, overrides).config
    mission = Mission(config, config.seed)
    every = round(10.0 / config.mission.step)
    found: dict[str, list[list[float]]] = {"chaser": [], "target": [], "estimate": []}
    for k, step in enumerate(mission.steps()):
        if k % every == 1:
            estimate = mission.pilot.context.estimate
            known = (*estimate.translation, *estimate.target.orientation, *estimate.target.angular_velocity)
            found["chaser"].append([*step.chaser.position, *step.chaser.velocity, *step.chaser.orientation])
            found["target"].append([*step.target.orientation, *step.target.angular_velocity])
            found["estimate"].append([*map(float, known)])
    return found


@pytest.mark.parametrize("name", MISSIONS)
def test_a_mission_is_flown_as_on_record(name: str) -> None:
    found = _flown(name)
    if os.environ.get("RECORD_MISSIONS"):
        kept = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
        shown = {key: [[float(f"{v:.9g}") for v in row] for row in rows] for key, rows in found.items()}
        text = json.dumps(kept | {"arithmetic": arithmetic(), name: shown})
        RECORD.write_text(text.replace("]], ", "]],\n").replace("], [", "],\n[") + "\n", encoding="utf-8")
    record = json.loads(RECORD.read_text(encoding="utf-8"))
    # Registration turns a difference in the last bit, as another processor makes it, into one of a few millimetres.
    tolerance = 1e-6 if arithmetic() == record["arithmetic"] else 0.03
    for key, rows in record[name].items():
        np.testing.assert_allclose(found[key], rows, rtol=tolerance, atol=tolerance, err_msg=key)
