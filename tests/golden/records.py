"""Arrays that are held against a file, for results that no second computation gives: searches and their constants."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .flights import arithmetic


def check_record(path: Path, name: str, found: Mapping[str, Any], exact: Collection[str] = ()) -> None:
    """Compare arrays with those that a file holds; with ``RECORD_RESULTS=1`` in the environment, write them there.

    On a processor whose elementary functions round otherwise a search may end elsewhere: a tenth may then differ.

    Args:
        path: The file.
        name: The name of the arrays in the file.
        found: The arrays by their names; infinite and undefined numbers are written as texts.
        exact: Names of arrays that are compared only where elementary functions round as on the recording processor,
            such as sums over many searches.
    """
    arrays = {key: np.asarray(value, np.float64).ravel() for key, value in found.items()}
    if os.environ.get("RECORD_RESULTS"):
        kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        kept |= {"arithmetic": arithmetic(), name: {key: _short(array) for key, array in arrays.items()}}
        text = json.dumps(kept, indent=1)
        text = re.sub(r"\[\s+([^\]]+?)\s+\]", lambda numbers: f"[{' '.join(numbers[1].split())}]", text)
        path.write_text(text + "\n", encoding="utf-8")
    record = json.loads(path.read_text(encoding="utf-8"))
    assert arrays.keys() == record[name].keys()
    same = arithmetic() == record["arithmetic"]
    for key, array in arrays.items():
        wanted = np.array([float(value) for value in record[name][key]])
        assert array.shape == wanted.shape, key
        if same:
            np.testing.assert_allclose(array, wanted, rtol=1e-8, atol=1e-9, err_msg=f"{name}: {key}")
        elif key not in exact:
            assert np.isclose(array, wanted, rtol=1e-4, atol=1e-6, equal_nan=True).mean() >= 0.9, key


def _short(array: np.ndarray) -> list[Any]:
    """Return numbers to ten digits, whole ones without a point."""
    return [
        str(value) if not np.isfinite(value) else int(value) if value == int(value) else float(f"{value:.10g}")
        for value in array.tolist()
    ]
