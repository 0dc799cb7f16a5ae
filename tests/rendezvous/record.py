"""Comparison of results with a record: numbers, and of large arrays sums that every element changes."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from ..golden.flights import arithmetic

#: Arrays with more elements are recorded by their size and weighted sums.
_SMALL = 12
#: Relative tolerance on the processor of the record.
_EXACT = 1e-6


def machine() -> str:
    """Return a fingerprint of this processor's elementary functions and linear algebra."""
    matrix = np.random.default_rng(1).normal(size=(48, 48))
    parts = (matrix @ matrix.T, np.linalg.solve(matrix, matrix.T), *np.linalg.svd(matrix[:, :20]))
    return hashlib.sha256(arithmetic().encode() + b"".join(part.tobytes() for part in parts)).hexdigest()[:16]


def check(file: Path, name: str, found: Any, tolerance: float | None = None) -> None:
    """Compare a result with a file of records, which `RECORD_RENDEZVOUS` in the environment updates.

    Args:
        file: The JSON file.
        name: Name of the result in it.
        found: Dictionaries, lists, arrays, texts and numbers.
        tolerance: Relative tolerance on other processors than that of the record; None to compare nothing there.
    """
    shown = _shown(found)
    if os.environ.get("RECORD_RENDEZVOUS"):
        kept = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        own = json.dumps(shown).replace('], "', '],\n"').replace('}, "', '},\n"')
        kept = {key: json.dumps(value) for key, value in kept.items() if key not in ("machine", name)}
        lines = [
            f'"machine": "{machine()}"',
            *(f'"{key}":\n{text}' for key, text in sorted([*kept.items(), (name, own)])),
        ]
        file.write_text("{" + ",\n\n".join(lines) + "}\n", encoding="utf-8")
    record = json.loads(file.read_text(encoding="utf-8"))
    used = _EXACT if record["machine"] == machine() else tolerance
    if used is not None:
        _compare(name, shown, record[name], used)


def _shown(value: Any) -> Any:
    """Return what is recorded of a result."""
    if isinstance(value, dict):
        return {str(key): _shown(item) for key, item in value.items()}
    if isinstance(value, (np.bool_, np.integer, np.floating)):
        value = value.item()
    if isinstance(value, (list, tuple)) and not all(isinstance(item, (int, float)) for item in value):
        return [_shown(item) for item in value]
    if isinstance(value, (list, tuple, np.ndarray)):
        return _array(np.asarray(value, dtype=np.float64))
    return float(f"{value:.9g}") if isinstance(value, float) else value


def _array(array: np.ndarray) -> Any:
    if array.size <= _SMALL:
        return [float(f"{value:.9g}") for value in array.ravel()]
    flat = array.ravel()
    finite = np.isfinite(flat)
    values, places = flat[finite], np.flatnonzero(finite)
    sums = [float(values @ np.cos(rate * places)) for rate in (0.0, 1.0, 2.3)]
    norm = float(np.linalg.norm(values))
    return {"shape": list(array.shape), "finite": int(finite.sum()), "sums": [float(f"{v:.9g}") for v in (norm, *sums)]}


def _compare(name: str, found: Any, record: Any, tolerance: float) -> None:
    if isinstance(record, dict) and isinstance(found, dict):
        assert list(found) == list(record), name
        for key, value in record.items():
            _compare(f"{name}.{key}", found[key], value, tolerance)
    elif isinstance(record, list) and isinstance(found, list):
        assert len(found) == len(record), name
        if all(isinstance(value, float) for value in (*record, *found)):
            size = max(map(abs, (value for value in record if np.isfinite(value))), default=0.0)
            np.testing.assert_allclose(found, record, rtol=tolerance, atol=tolerance * size, err_msg=name)
            return
        for place, (one, other) in enumerate(zip(found, record, strict=True)):
            _compare(f"{name}[{place}]", one, other, tolerance)
    elif isinstance(record, float):
        np.testing.assert_allclose(found, record, rtol=tolerance, atol=1e-12, err_msg=name)
    else:
        assert found == record, name
