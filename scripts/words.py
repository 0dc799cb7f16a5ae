"""List the words and phrases that texts of the project do not use, with their places.

python scripts/words.py            # all files of the repository
python scripts/words.py FILE ...   # these files

Exits with 1 when there are any. Code, in backticks or fenced blocks of Markdown, is not text. In Python files the
docstrings, comments and strings are text.
"""

from __future__ import annotations

import io
import re
import subprocess
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
#: Files that list the words themselves.
LISTS = ("scripts/words.py", "tests/documentation/test_words.py")
#: Names of files that are text throughout, besides Python, whose strings and comments are.
TEXTS = (".md", ".yml", ".yaml", ".sh", ".cfg", ".toml", ".html", ".js", ".css", ".txt")
_MARKDOWN_CODE = re.compile(r"^```.*?^```|`[^`\n]+`|\]\([^)]*\)|^ {4}[^\n]*$", re.MULTILINE | re.DOTALL)


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the texts of a file, each with its line."""
    source = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        yield 1, _MARKDOWN_CODE.sub(lambda code: "\n" * code[0].count("\n"), source)
    elif path.suffix != ".py":
        yield 1, source
    else:
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


def project_files() -> list[Path]:
    """Return the files of the repository that contain text, without those of `LISTS`."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True)
    names = [name for name in listed.stdout.split("\0") if name and name not in LISTS]
    return [ROOT / name for name in names if name.endswith((*TEXTS, ".py")) or name.startswith(".ci/")]


if __name__ == "__main__":
    places = [place for path in map(Path, sys.argv[1:]) for place in found(path)]
    if not sys.argv[1:]:
        places = [place for path in project_files() for place in found(path)]
    print("\n".join(places))
    sys.exit(bool(places))
