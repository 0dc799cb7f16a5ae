"""docs/task-reference.md is what `scripts/task_pages.py` writes."""

from __future__ import annotations

import runpy
from pathlib import Path


def test_the_task_reference_is_current() -> None:
    script = runpy.run_path(str(Path(__file__).parents[2] / "scripts" / "task_pages.py"))
    assert script["PAGE"].read_text(encoding="utf-8") == script["page"](), "python scripts/task_pages.py"
