"""List the words and phrases that texts of the project do not use, with their places.

python scripts/words.py            # the files of CLEAN
python scripts/words.py FILE ...   # other files

Exits with 1 when there are any. Code, in backticks or fenced blocks of Markdown, is not text. In Python files the
docstrings, comments and strings are text.
"""

from __future__ import annotations

import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: Regular expression to what to write instead.
WORDS = {
    r"\banew\b": "again",
    r"\bbeside\b": "next to; in addition to; with",
    r"\bdearer\b": "more expensive",
    r"\bseldom\b": "rarely",
    r"\bmend(s|ed)?\b": "fix",
    r"\bthe peer\b|\bpeer's\b": "safe-autonomy-sims",
    r"\bwhat is wanted\b|\b(is|are) wanted\b": "expected; required",
    r"\blook(ed|s)? at (?=in|when)": "checked; evaluated",
    r"\bin the beginning\b|\bbegins? anew\b": "at the start; is reset",
    r"\bgo(es)? on\b": "continue",
    r"\b(fly|flies|flew|flown|go|goes|move|moves) round\b|\bround (the|a|its) (chief|target)\b": "around",
    r"\bto the bit\b": "bit-identical",
    r"\bof (its|their|his) own\b": "its own ...; a separate ...",
    r"\b(stands|stand|stood) (in|for|at|on|beside|below|above|still|there)\b": "is in; means; is",
    r"\btold\b|\btells\b": "says; states; shows",
    r"\bfor ever\b": "permanently; forever",
    r"\bwill do\b|\bwould not do\b": "works; is enough",
    r"\bwhat is drawn\b|\bdrawn anew\b": "sampled",
    r"\b(is|are) no plugins?\b": "is not a plugin",
}
#: Files and folders without any; the list may only grow.
CLEAN = (
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "docs",
    "examples",
    "benchmarks",
)
_MARKDOWN_CODE = re.compile(r"^```.*?^```|`[^`\n]+`|\]\([^)]*\)|^ {4}[^\n]*$", re.MULTILINE | re.DOTALL)


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the texts of a file, each with its line."""
    source = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        yield 1, _MARKDOWN_CODE.sub(lambda code: "\n" * code[0].count("\n"), source)
    elif path.suffix == ".py":
        for token in tokenize.generate_tokens(io.StringIO(source).readline):
            if token.type in (tokenize.STRING, tokenize.COMMENT):
                yield token.start[0], token.string


def found(path: Path) -> Iterator[str]:
    """Yield the place of each word of `WORDS` in a file, with what to write instead."""
    for line, text in texts(path):
        for pattern, instead in WORDS.items():
            for match in re.finditer(pattern, text, re.IGNORECASE):
                place = line + text.count("\n", 0, match.start())
                yield f"{path}:{place}: {' '.join(match[0].split())!r}; write: {instead}"


def clean_files() -> list[Path]:
    """Return the files of `CLEAN`."""
    files = [path for name in CLEAN for path in ([ROOT / name] if "." in name else sorted((ROOT / name).rglob("*.*")))]
    return [path for path in files if path.suffix in (".md", ".py")]


if __name__ == "__main__":
    places = [place for path in map(Path, sys.argv[1:]) for place in found(path)]
    if not sys.argv[1:]:
        places = [place for path in clean_files() for place in found(path)]
    print("\n".join(places))
    sys.exit(bool(places))
