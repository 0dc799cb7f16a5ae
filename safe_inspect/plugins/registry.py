"""The registry: every plugin class by kind and name.

Defining a plugin class registers it (see `safe_inspect.plugins.plugin`). A name in a
configuration is, in this order, a name of the peer's (`safe_inspect.plugins.aliases`), a
registered name, or a dotted path ``package.module.Class`` that is imported.
Distributions announce their modules in the entry-point group
``safe_inspect.plugins``; they are imported when a name is looked up.
"""

from __future__ import annotations

import importlib
import os
import traceback
import warnings
from collections.abc import Iterator
from importlib.metadata import entry_points
from types import ModuleType
from typing import Any

from safe_inspect.errors import RegistryError, did_you_mean
from safe_inspect.plugins.aliases import ALIASES

ENTRY_POINT_GROUP = "safe_inspect.plugins"

#: The modules that define the plugins of this package, imported at the first look-up.
BUILT_IN = (
    "safe_inspect.dynamics",
    "safe_inspect.simulators",
    "safe_inspect.tasks",
    "safe_inspect.platforms",
    "safe_inspect.glues",
    "safe_inspect.rewards",
    "safe_inspect.dones",
    "safe_inspect.policies",
    "safe_inspect.rta",
    "safe_inspect.metrics",
    "safe_inspect.rendezvous.plugins",
)


class Registry:
    """Plugin classes by kind (``reward``, ``done``, ``part``, ...) and name."""

    def __init__(self) -> None:
        self._classes: dict[str, dict[str, type[Any]]] = {}
        self._loaded = False

    def add(self, kind: str, name: str, cls: type[Any]) -> None:
        """Register a class; the same class defined again (a reloaded module, a notebook cell) replaces itself.

        Raises:
            RegistryError: Another class has the name.
        """
        known = self._classes.setdefault(kind, {})
        other = known.get(name)
        if other is not None and (other.__module__, other.__qualname__) != (cls.__module__, cls.__qualname__):
            raise RegistryError(
                f"the {kind} name {name!r} of {cls.__module__}.{cls.__qualname__} is taken by "
                f"{other.__module__}.{other.__qualname__}; give the class another name"
            )
        known[name] = cls

    def kinds(self) -> tuple[str, ...]:
        """Return the kinds that have a plugin, sorted."""
        self._load()
        return tuple(sorted(self._classes))

    def items(self, kind: str) -> Iterator[tuple[str, type[Any]]]:
        """Yield (name, class) of one kind, sorted by name."""
        self._load()
        yield from sorted(self._classes.get(kind, {}).items())

    def get(self, kind: str, name: str) -> type[Any]:
        """Return the class of that kind and name.

        Args:
            kind: The kind that is wanted.
            name: A registered name, a path of the peer's, or a dotted path to a class.

        Raises:
            RegistryError: There is none; the message names the nearest.
        """
        name = ALIASES.get(name, name)
        found = self._classes.get(kind, {}).get(name)
        if found is not None:  # a base class that a package imports may name a plugin while others are still loaded
            return found
        self._load()
        known = self._classes.get(kind, {})
        if name in known:
            return known[name]
        head, dot, tail = name.rpartition(".")
        if not dot:
            raise RegistryError(f"unknown {kind} {name!r}; {self._suggest(kind, name)}")
        if head.split(".")[0] in ("corl", "safe_autonomy_sims", "safe_autonomy_simulation"):
            raise RegistryError(
                f"{name!r} is a path of the peer's that this package has no {kind} for; {self._suggest(kind, tail)}"
            )
        return self._import(kind, name, head, tail)

    def _import(self, kind: str, name: str, module: str, attribute: str) -> type[Any]:
        loaded = import_user_module(module, f" for {kind} {name!r}; {self._suggest(kind, attribute)}")
        cls: Any = getattr(loaded, attribute, None)
        if cls is None:
            raise RegistryError(f"module {module!r} has no {attribute!r}; {did_you_mean(attribute, vars(loaded))}")
        if not (isinstance(cls, type) and hasattr(cls, "registered_name") and hasattr(cls, "kind")):
            raise RegistryError(f"{name!r} is not a plugin; a {kind} is a subclass of {self._base(kind)}")
        if not cls.registered_name:
            lacks = ", ".join(f"`{method}`" for method in sorted(getattr(cls, "__abstractmethods__", ())))
            hint = (
                f"name one of its subclasses, {self._suggest(kind, '')}" if cls.__subclasses__() else f"give it {lacks}"
            )
            raise RegistryError(f"{name!r} is an abstract class; {hint}")
        if cls.kind != kind:
            raise RegistryError(f"{name!r} is a {cls.kind}; a {kind} is wanted here")
        return cls

    def _base(self, kind: str) -> str:
        """Return the path of the class that the plugins of a kind extend."""
        first = next(iter(self._classes.get(kind, {}).values()))
        base = next(cls for cls in reversed(first.__mro__) if vars(cls).get("kind") == kind)
        package = base.__module__.rpartition(".")[0]
        module = package if getattr(importlib.import_module(package), base.__name__, None) is base else base.__module__
        return f"{module}.{base.__qualname__}"

    def _suggest(self, kind: str, name: str) -> str:
        for other, classes in self._classes.items():
            if other != kind and name in classes:
                return f"{name!r} is a {other}; a {kind} is wanted here"
        return did_you_mean(name, self._classes.get(kind, {}))

    def _load(self) -> None:
        if self._loaded:
            return
        self._loaded = True
        for module in BUILT_IN:
            importlib.import_module(module)
        for entry in entry_points(group=ENTRY_POINT_GROUP):
            try:
                entry.load()
            except (Exception, SystemExit) as error:
                package = entry.dist.name if entry.dist is not None else entry.value
                what = f"the plugins of {package} are missing, its module {entry.module} cannot be imported"
                warnings.warn(f"{what}: {cause_of(error)}; mend or uninstall it", RuntimeWarning, stacklevel=2)


def import_user_module(name: str, wanted: str = "") -> ModuleType:
    """Return a module that a configuration names.

    Args:
        name: Its dotted path.
        wanted: What the message of a missing module ends in.

    Raises:
        RegistryError: There is none, or it cannot be imported; the message names the file, the line and the cause.
    """
    if not all(part.isidentifier() for part in name.split(".")):
        raise RegistryError(f"{name!r} is not the path of a module; write it as package.module")
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{name}.".startswith(f"{error.name}."):
            raise RegistryError(f"no module {name!r}{wanted or '; install it or mend the name'}") from None
        raise RegistryError(f"module {name!r} cannot be imported: {cause_of(error)}; mend it") from error
    except (Exception, SystemExit) as error:
        raise RegistryError(f"module {name!r} cannot be imported: {cause_of(error)}; mend it") from error


def cause_of(error: BaseException) -> str:
    """Return file, line, class and text of what an import, or a class that a user wrote, has raised."""
    if isinstance(error, SyntaxError):
        place = f"{error.filename}:{error.lineno}"
        return f"{place}: {type(error).__name__}: {error.msg}"
    between = ("importlib", f"{os.sep}pydantic{os.sep}", os.path.dirname(__file__))  # the author wrote none of these
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)[1:]
        if not any(x in frame.filename for x in between)
    ]
    place = f"{frames[-1].filename}:{frames[-1].lineno}: " if frames else ""
    text = str(error).partition("\n")[0]
    return f"{place}{type(error).__name__}: {text}"


registry = Registry()
