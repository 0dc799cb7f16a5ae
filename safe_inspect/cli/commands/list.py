"""The command ``safe-inspect list``."""

from __future__ import annotations

import argparse
import inspect
import re
from collections.abc import Iterator
from typing import Any, get_args

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from safe_inspect.cli.arguments import add_option
from safe_inspect.config.data import configs_root
from safe_inspect.errors import RegistryError, SafeInspectError, did_you_mean
from safe_inspect.evaluation.policies import BASELINES
from safe_inspect.evaluation.shipped import shipped_policies, shipped_policy
from safe_inspect.plugins.plugin import Plugin, documented_fields
from safe_inspect.plugins.registry import registry
from safe_inspect.task_ids import ALL_TASKS, TASK_OVERRIDES, TEAM_TASKS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``list``."""
    kinds = ", ".join(registry.kinds())
    add_option(parser, "kind", "KIND", f"one of: tasks, policies, {kinds} (default: all plugins)", nargs="?")
    add_option(parser, "name", "NAME", "name of one plugin, or dotted path of one of your own", nargs="?")


def run(arguments: argparse.Namespace) -> int:
    """List tasks, policies, or plugins with their fields, defaults and units.

    Without arguments it lists the plugins of every kind.

    Example:
        safe-inspect list reward ObservedPointsReward
    """
    lists = {"tasks": _tasks, "policies": _policies}
    if arguments.kind in lists:
        if arguments.name is not None:
            raise SafeInspectError(f"`list {arguments.kind}` does not take a name; remove {arguments.name!r}")
        print(lists[arguments.kind]())
    else:
        print(_catalogue(arguments.kind, arguments.name))
    return 0


def _tasks() -> str:
    """Return the id of each shipped task, its file and the description in the file."""
    blocks = []
    for name, file in ALL_TASKS.items():
        path = configs_root() / file
        head = re.match(r"(#.*\n)+", path.read_text(encoding="utf-8"))
        about = re.split(r"\.\s", head[0].replace("\n#", "").lstrip("# "))[0] if head else ""
        agents = "several agents: safe_inspect.make_parallel" if name in TEAM_TASKS else "gymnasium.make"
        place = " ".join((f"configs/{file}", *TASK_OVERRIDES.get(name, ())))
        blocks.append(f"{name}  ({agents})\n    {place}\n    {about}")
    return "\n".join(blocks)


def _policies() -> str:
    """Return the name and description of each shipped policy and each scripted policy."""
    blocks = []
    for name in shipped_policies():
        about = shipped_policy(name).card.read_text(encoding="utf-8").split("\n\n")[1]
        blocks.append(f"{name}  (trained: safe-inspect evaluate --policy {name})\n    {' '.join(about.split())}")
    short = {plugin: name for name, plugin in BASELINES.items()}
    for name, cls in registry.items("policy"):
        also = f", also {short[name]}" if name in short else ""
        blocks.append(f"{name}  (scripted{also})\n    {(inspect.getdoc(cls) or '').partition(chr(10))[0]}")
    return "\n".join(blocks)


def _catalogue(kind: str | None, name: str | None) -> str:
    """Return the plugins with their fields, defaults and units, one block for each.

    Args:
        kind: If given, only plugins of this kind.
        name: If given, only the plugin with this name, or with this dotted path if a kind is given.

    Raises:
        RegistryError: There is no such kind or name.
    """
    kinds = registry.kinds()
    if kind is not None and kind not in kinds:
        raise RegistryError(f"unknown kind {kind!r}; {did_you_mean(kind, [*kinds, 'tasks', 'policies'])}")
    if kind is not None and name is not None and "." in name and name not in dict(registry.items(kind)):
        return f"{kind}\n{_block(name, registry.get(kind, name), nested=True)}"
    blocks = []
    names = set()
    for each in (kind,) if kind else kinds:
        found = [(label, cls) for label, cls in registry.items(each)]
        names |= {label for label, _ in found}
        chosen = [(label, cls) for label, cls in found if name in (None, label)]
        if chosen:
            blocks.append(f"{each}\n" + "\n".join(_block(label, cls, nested=name is not None) for label, cls in chosen))
    if not blocks:
        raise RegistryError(f"unknown plugin {name!r}; {did_you_mean(str(name), names)}")
    return "\n\n".join(blocks)


def _block(name: str, cls: type[Plugin], *, nested: bool) -> str:
    summary = (inspect.getdoc(cls) or "").partition("\n")[0]
    return "\n".join([f"  {name}  {summary}", *_fields(cls, 6, nested=nested)])


def _fields(cls: type[BaseModel], indent: int, *, nested: bool) -> Iterator[str]:
    """Yield a line for each field of a model, and with `nested` for those of the models that it takes."""
    documented = documented_fields(cls)
    for field, info in cls.model_fields.items():
        about = documented.get(field, "")
        yield f"{' ' * indent}{field} = {_default(info)}" + (f"  {about}" if about else "")
        for kind in (info.annotation, *get_args(info.annotation)) if nested else ():
            if inspect.isclass(kind) and issubclass(kind, BaseModel) and not issubclass(kind, Plugin):
                yield from _fields(kind, indent + 4, nested=True)


def _default(info: Any) -> str:
    if info.default_factory is not None:
        return repr(info.default_factory())
    if info.default is PydanticUndefined:
        return "required"
    text = repr(info.default)
    return text if len(text) <= 60 else f"{text[:57]}..."
