"""What RLlib's, Tune's and Ray's keys mean: settings, notes and mistakes of many mappings, compared with a record.

The record holds each mapping in a line, behind what it is: `rllib`, `tune`, `ray`, `policy ALGORITHM`, or `search N`
for the trials of N samples. The lines below are what comes of it: settings that differ from the defaults, defaults that
are gone, notes and mistakes. A case is added by its first line; what is changed on purpose is recorded again by

    RECORD_SETTINGS=1 python -m pytest -n 0 tests/experiments/test_settings_record.py
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from safe_inspect.experiments.runs.training_run import read_settings
from safe_inspect.experiments.settings.key_tables import TranslatedSettings
from safe_inspect.experiments.settings.translation import (
    translate_policy,
    translate_ray,
    translate_rllib,
    translate_tune,
)

RECORD = Path(__file__).with_name("settings_record.txt")
_TRANSLATE = {"rllib": translate_rllib, "tune": translate_tune, "ray": translate_ray}


def _json(value: Any) -> str:
    return json.dumps(value, sort_keys=True, default=lambda other: float(f"{other:.6g}"))


def _told(found: TranslatedSettings, usual: Mapping[str, Any]) -> Iterator[str]:
    differing = {key: value for key, value in found.settings.items() if key not in usual or usual[key] != value}
    if differing:
        yield f"settings {_json(differing)}"
    if set(usual) - set(found.settings):
        yield f"without {', '.join(sorted(set(usual) - set(found.settings)))}"
    if found.given:
        yield f"given {', '.join(sorted(found.given))}"
    yield from (f"note {note}" for note in found.notes)
    yield from (f"mistake {problem}" for problem in found.problems)


def _outcome(case: str) -> list[str]:
    kind, _, text = case.partition(" {")
    given = yaml.safe_load(f"{{{text}")
    if kind.startswith("policy "):
        return list(_told(translate_policy(given, "red", kind.removeprefix("policy ")), {}))
    if kind.startswith("search "):
        found = read_settings(given, {"num_samples": int(kind.removeprefix("search "))}, {})
        lines = [f"single {found.single}", *(f"mistake {problem}" for problem in found.problems)]
        for trial in found.trials:
            values = {name: float(f"{x:.6g}") if isinstance(x, float) else x for name, x in trial.values.items()}
            lines.append(f"{trial.name} seed {trial.seed} {_json(values)}")
        return lines
    translate = _TRANSLATE[kind]
    return list(_told(translate(given), translate({}).settings if given else {}))


def test_mappings_mean_what_the_record_says() -> None:
    recorded = RECORD.read_text(encoding="utf-8").splitlines()
    cases = [line for line in recorded if not line.startswith(" ")]
    lines = [line for case in cases for line in (case, *(f"    {shown}" for shown in _outcome(case)))]
    if os.environ.get("RECORD_SETTINGS"):
        RECORD.write_text("\n".join(lines) + "\n", encoding="utf-8")
        pytest.skip("recorded")
    assert lines == recorded
