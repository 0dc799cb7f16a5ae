"""Write the golden record: ``python tests/golden/record.py [options] [flights] [trainings] [missions]``; else all.

Say in the commit why the numbers changed.
"""

from __future__ import annotations

import json
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import torch
from flights import FLIGHTS, arithmetic, fly
from missions import MISSIONS, figures
from options import lines
from trainings import TRAININGS, weights_after


def flown() -> dict[str, Any]:
    """Return the hashes and sums of each flight."""
    found = {}
    for flight in FLIGHTS:
        hashes, sums = fly(flight, compiled=True)
        assert hashes == fly(flight, compiled=False)[0], f"{flight}: compiled and plain terms differ"
        short = {name: [float(f"{value:.10g}") for value in values] for name, values in sums.items()}
        found[flight] = {"hashes": hashes, "sums": short}
    return found


def trained() -> dict[str, Any]:
    """Return the hashes and sums of the weights of each training."""
    found: dict[str, Any] = {"torch": torch.__version__}
    for training in TRAININGS:
        with tempfile.TemporaryDirectory() as folder:
            hashes, sums = weights_after(training, Path(folder))
        found[training] = {"hashes": hashes, "sums": {name: float(f"{value:.7g}") for name, value in sums.items()}}
    return found


PATH = Path(__file__).with_name("record.json")
PARTS = {
    "flights": flown,
    "trainings": trained,
    "missions": lambda: {mission: figures(mission) for mission in MISSIONS},
}
record = json.loads(PATH.read_text(encoding="utf-8")) if PATH.is_file() else {"arithmetic": {}}
asked = sys.argv[1:] or ["options", *PARTS]
if "options" in asked:
    PATH.with_name("options.txt").write_text("\n".join(lines()) + "\n", encoding="utf-8")
for part in asked:
    if part != "options":
        record[part] = PARTS[part]()
        record["arithmetic"][part] = arithmetic()
text = re.sub(r"\[\s+([^\]]+?)\s+\]", lambda found: f"[{' '.join(found[1].split())}]", json.dumps(record, indent=1))
PATH.write_text(text + "\n", encoding="utf-8")
