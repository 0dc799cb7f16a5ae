"""The texts of the project are free of the words that `scripts/words.py` lists."""

from __future__ import annotations

import importlib.util
from pathlib import Path

_SPEC = importlib.util.spec_from_file_location("words", Path(__file__).parents[2] / "scripts" / "words.py")
assert _SPEC
assert _SPEC.loader
words = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(words)


def test_no_file_has_any_of_the_words() -> None:
    files = words.project_files()
    assert len(files) > 1000
    assert [place for path in files for place in words.found(path)] == []


def test_words_are_found_in_text_and_not_in_code(tmp_path: Path) -> None:
    page, module = tmp_path / "page.md", tmp_path / "module.py"
    page.write_text("It is `told anew`.\n\n    told\n\n```\nbeside\n```\nBeside it.\n")
    module.write_text('"""Begin."""\ntold = 1  # drawn anew\n')
    assert [place.removeprefix(f"{page}:").split(";")[0] for place in words.found(page)] == ["8: 'Beside'"]
    assert all(place.startswith(f"{module}:2:") for place in words.found(module))
    assert list(words.found(module))
