"""Write the notebooks of three tutorials, docs/tutorials/*.ipynb, from their pages.

python scripts/notebooks.py
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import nbformat
from nbformat import v4

FOLDER = Path(__file__).parents[1] / "docs" / "tutorials"
TUTORIALS = ("first-training", "own-reward", "safety")
_CODE = re.compile(r"^```(python|yaml|bash)([^\n]*)\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
_SETUP = """\
*Written from [{page}]({page}) by `scripts/notebooks.py`. Start Jupyter in the environment in which safe_inspect is
installed, and in an empty folder: the cells write files next to the notebook.*
"""


def notebook(name: str) -> str:
    """Return a tutorial as a notebook: a cell for each block of code and for the text between two of them.

    A block with a title becomes a cell that writes the file; a block of commands becomes a `%%bash` cell.
    """
    page = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    title, _, page = page.partition("\n")
    cells: list[Any] = [v4.new_markdown_cell(f"{title}\n\n{_SETUP.format(page=f'{name}.md')}".strip())]
    position = 0
    for block in _CODE.finditer(page):
        cells += _text(page[position : block.start()])
        cells.append(v4.new_code_cell(_code(*block.groups()).rstrip("\n")))
        position = block.end()
    cells += _text(page[position:])
    for number, cell in enumerate(cells):
        cell["id"] = f"{name}-{number}"  # nbformat draws one, which would differ in every file
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return str(nbformat.writes(v4.new_notebook(cells=cells, metadata={"kernelspec": kernel}))) + "\n"


def _text(text: str) -> list[Any]:
    """Return the cell of a text; none for an empty one."""
    return [v4.new_markdown_cell(text.strip())] if text.strip() else []


def _code(language: str, info: str, text: str) -> str:
    """Return the source of the cell of a block."""
    if file := re.search(r'title="([^"]+)"', info):
        return f"%%writefile {file[1]}\n{text}"
    if language == "python":
        return text
    head = "%%bash --no-raise-error\n" if "fails" in info else "%%bash\n"
    return head + text.replace("output/RUN", "output/$(ls output | tail -n 1)")


if __name__ == "__main__":
    for tutorial in TUTORIALS:
        (FOLDER / f"{tutorial}.ipynb").write_text(notebook(tutorial), encoding="utf-8")
