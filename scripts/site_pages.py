"""Hooks of MkDocs: pages of files that stand outside docs/, and links to them.

README.md is the start page; the changelog, the examples and the benchmarks keep their text where they are. A page
`reference/MODULE.md` of the navigation shows the public names of a module. Links are those of the repository: this
module turns them into links of the site, and an unknown one fails `mkdocs build --strict`.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

_ROOT = Path(__file__).parents[1]
_LINK = re.compile(r"(?<=\]\()([^)#:\s]+)")  # the path of [text](path#anchor), but no address
#: File of the repository to page of the site.
_PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "benchmarks/README.md": "benchmarks/README.md",
    "examples/plugin_package/README.md": "examples/plugin_package/README.md",
    "examples/beacon_package/README.md": "examples/beacon_package/README.md",
    "examples/rendezvous_package/README.md": "examples/rendezvous_package/README.md",
}
_SCRIPTS = "examples/learners"
#: Folders of plugins, whose packages export only the base classes; their pages show the modules too.
_ROOMS = ("safe_inspect.rewards", "safe_inspect.dones", "safe_inspect.glues", "safe_inspect.platforms")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made of other files."""
    for source, page in _PAGES.items():
        files.append(File.generated(config, page, content=(_ROOT / source).read_text(encoding="utf-8")))
    files.append(File.generated(config, f"{_SCRIPTS}/index.md", content=_scripts()))
    for module in _modules(config.nav):
        content = f"---\nsearch:\n  boost: 0.5\n---\n\n# `{module}`\n\n::: {module}\n"
        content += "    options: {show_submodules: true}\n" if module in _ROOMS else ""
        files.append(File.generated(config, f"reference/{module}.md", content=content))
    return files


def on_page_markdown(markdown: str, *, page: Any, files: Files, **_: Any) -> str:
    """Turn links between files of the repository into links between pages."""
    uri = page.file.src_uri
    source = next((file for file, target in _PAGES.items() if target == uri), f"docs/{uri}")

    def target(match: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), match[1]))
        page_of = _page_of(path)
        return posixpath.relpath(page_of, posixpath.dirname(uri) or ".") if page_of else match[1]

    return _LINK.sub(target, markdown)


def _page_of(path: str) -> str | None:
    """Return the page of a file or folder of the repository; None where there is none."""
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    if path == _SCRIPTS or posixpath.dirname(path) == _SCRIPTS:
        return f"{_SCRIPTS}/index.md"
    return _PAGES.get(path, _PAGES.get(f"{path}/README.md"))


def _scripts() -> str:
    """Return the page that shows the scripts of the folder."""
    parts = ["# Examples of learners", f"The scripts of `{_SCRIPTS}`."]
    for file in sorted((_ROOT / _SCRIPTS).glob("*.py")):
        parts.append(f"## {file.name}\n\n```python\n{file.read_text(encoding='utf-8')}```")
    return "\n\n".join(parts) + "\n"


def _modules(nav: Any) -> list[str]:
    """Return the modules of the pages `reference/MODULE.md` in the navigation."""
    if isinstance(nav, str):
        return [nav.removeprefix("reference/").removesuffix(".md")] if nav.startswith("reference/") else []
    return [module for entry in (nav.values() if isinstance(nav, dict) else nav) for module in _modules(entry)]
