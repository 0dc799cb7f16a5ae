"""Write the golden record anew: ``python tests/golden/record.py``. Say in the commit why the numbers changed."""

from __future__ import annotations

import json
import re
from pathlib import Path

from flights import FLIGHTS, arithmetic, fly

record: dict[str, object] = {"arithmetic": arithmetic(), "flights": {}}
for flight in FLIGHTS:
    hashes, sums = fly(flight, compiled=True)
    assert hashes == fly(flight, compiled=False)[0], f"{flight}: compiled and plain terms differ"
    short = {name: [float(f"{value:.10g}") for value in values] for name, values in sums.items()}
    record["flights"][flight] = {"hashes": hashes, "sums": short}  # type: ignore[index]
text = re.sub(r"\[\s+([^\]]+?)\s+\]", lambda found: f"[{' '.join(found[1].split())}]", json.dumps(record, indent=1))
Path(__file__).with_name("record.json").write_text(text + "\n", encoding="utf-8")
