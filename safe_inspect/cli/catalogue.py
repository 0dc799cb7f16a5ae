"""The catalogue of plugins: every kind, class and field, as text."""

from __future__ import annotations

import inspect
import re
from typing import Any

from pydantic_core import PydanticUndefined

from safe_inspect.errors import RegistryError, did_you_mean
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.plugins.registry import registry

_FIELD = re.compile(r"^\s{4}(\w+): (.*(?:\n\s{8}.*)*)", re.MULTILINE)


def catalogue(kind: str | None = None, name: str | None = None) -> str:
    """Return the plugins with their fields, defaults and units, one block for each.

    Args:
        kind: Only this kind.
        name: Only the plugin of this name.

    Raises:
        RegistryError: There is no such kind or name.
    """
    kinds = registry.kinds()
    if kind is not None and kind not in kinds:
        raise RegistryError(f"unknown kind {kind!r}; {did_you_mean(kind, kinds)}")
    blocks = []
    names = set()
    for each in (kind,) if kind else kinds:
        found = [(label, cls) for label, cls in registry.items(each)]
        names |= {label for label, _ in found}
        chosen = [(label, cls) for label, cls in found if name in (None, label)]
        if chosen:
            blocks.append(f"{each}\n" + "\n".join(_block(label, cls) for label, cls in chosen))
    if not blocks:
        raise RegistryError(f"unknown plugin {name!r}; {did_you_mean(str(name), names)}")
    return "\n\n".join(blocks)


def _block(name: str, cls: type[Plugin]) -> str:
    summary = (inspect.getdoc(cls) or "").partition("\n")[0]
    documented = _documented(cls)
    lines = [f"  {name}  {summary}"]
    for field, info in cls.model_fields.items():
        about = documented.get(field, "")
        lines.append(f"      {field} = {_default(info)}" + (f"  {about}" if about else ""))
    return "\n".join(lines)


def _documented(cls: type[Plugin]) -> dict[str, str]:
    """Return what the docstrings of a class and its bases say of each field; the class's own word counts first."""
    told: dict[str, str] = {}
    for parent in cls.__mro__:
        text = (vars(parent).get("__doc__") or "").partition("Attributes:")[2]
        text = re.split(r"\n\n", text.lstrip("\n"), maxsplit=1)[0]
        for field, about in _FIELD.findall(inspect.cleandoc("x\n" + text).removeprefix("x\n").replace("\n", "\n    ")):
            told.setdefault(field, " ".join(about.split()))
        for field, about in re.findall(r"^\s+(\w+): (.*(?:\n\s{12,}.*)*)", text, re.MULTILINE):
            told.setdefault(field, " ".join(about.split()))
    return told


def _default(info: Any) -> str:
    if info.default_factory is not None:
        return repr(info.default_factory())
    if info.default is PydanticUndefined:
        return "required"
    text = repr(info.default)
    return text if len(text) <= 60 else f"{text[:57]}..."
