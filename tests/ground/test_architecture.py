"""docs/architecture.md agrees with the tree."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "safe_inspect"
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_every_folder_of_the_page_exists_and_every_folder_is_on_it():
    picture = PAGE.split("```")[1]
    named: set[Path] = set()
    for line in picture.strip().splitlines():
        words = re.findall(r"[\w/]+", line)
        top = words[0].rstrip("/")
        for word in words:
            if word.endswith("/"):
                outer, inner = PACKAGE / word, PACKAGE / top / word
                assert outer.is_dir() or inner.is_dir(), f"{word} of docs/architecture.md does not exist"
                named.add(outer if outer.is_dir() else inner)
    folders = {path.parent for path in PACKAGE.glob("*/__init__.py")}
    assert folders <= {path.resolve() for path in named} | named, "a folder is missing in docs/architecture.md"
    for place in re.findall(r"^\|[^|]*\| ([^|]*) \|", PAGE, flags=re.M)[2:]:
        for folder in re.findall(r"`([\w/]+)/`", place):
            assert (PACKAGE / folder).is_dir(), f"{folder} of docs/architecture.md does not exist"


def test_no_folder_is_too_full_and_few_modules_are_at_the_top():
    crowded = {
        folder.relative_to(ROOT).as_posix(): count
        for folder in [PACKAGE, *(path.parent for path in PACKAGE.glob("**/__init__.py"))]
        if folder != PACKAGE / "cli/commands"  # one module a command
        and (count := len([path for path in folder.glob("*.py") if path.name != "__init__.py"])) > 15
    }
    assert crowded == {}
    assert len([path for path in PACKAGE.glob("*.py") if not path.name.startswith("__")]) <= 10
