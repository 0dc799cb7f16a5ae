"""The registry: every plugin class by kind and name.

Defining a plugin class registers it (see `safe_inspect.plugins.plugin`). A name in a
configuration is looked up in this order: as a path of safe-autonomy-sims or CoRL
(see `own_name`), as a registered name, and as a dotted path
``package.module.Class``, which is imported. Other distributions list their modules in the
entry-point group ``safe_inspect.plugins``; they are imported at the first look-up.
"""

from __future__ import annotations

import importlib
import os
import re
import traceback
import warnings
from collections.abc import Iterator
from importlib.metadata import entry_points
from types import ModuleType
from typing import Any

from safe_inspect.errors import RegistryError, did_you_mean

ENTRY_POINT_GROUP = "safe_inspect.plugins"

#: Packages whose class paths mean this package's classes of the same names.
PEERS = ("corl", "safe_autonomy_sims", "safe_autonomy_simulation", "safe_autonomy_dynamics")

#: The modules that define the built-in plugins. They are imported at the first look-up.
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
        """Register a class; a class that is defined again (reloaded module, notebook cell) replaces its old version.

        Raises:
            RegistryError: The name is already registered for another class.
        """
        known = self._classes.setdefault(kind, {})
        other = known.get(name)
        if other is not None and (other.__module__, other.__qualname__) != (cls.__module__, cls.__qualname__):
            raise RegistryError(
                f"the {kind} name {name!r} of {cls.__module__}.{cls.__qualname__} is already registered for "
                f"{other.__module__}.{other.__qualname__}; give the class another name"
            )
        known[name] = cls

    def kinds(self) -> tuple[str, ...]:
        """Return the kinds that have at least one plugin, sorted."""
        self._load()
        return tuple(sorted(self._classes))

    def items(self, kind: str) -> Iterator[tuple[str, type[Any]]]:
        """Yield (name, class) of one kind, sorted by name."""
        self._load()
        yield from sorted(self._classes.get(kind, {}).items())

    def get(self, kind: str, name: str) -> type[Any]:
        """Return the class of that kind and name.

        Args:
            kind: The expected kind.
            name: A registered name, a path of safe-autonomy-sims or CoRL, or a dotted path to a class.

        Raises:
            RegistryError: There is no such class; the message suggests the most similar names.
        """
        given, name = name, own_name(name)
        found = self._classes.get(kind, {}).get(name)
        if found is not None:  # before loading: a plugin may be looked up while other built-in modules are imported
            return found
        self._load()
        known = self._classes.get(kind, {})
        if name in known:
            return known[name]
        head, dot, tail = name.rpartition(".")
        if not dot:
            hint = self._suggest(kind, name)
            if given != name:
                what = f"a path of safe-autonomy-sims or CoRL without a matching {kind} in this package"
                raise RegistryError(f"{given!r} is {what}; {hint}")
            own = f"; for a class of your own give its module too, as in my_module.{name}"
            raise RegistryError(f"unknown {kind} {name!r}; {hint}{own if hint.startswith('known') else ''}")
        return self._import(kind, name, head, tail)

    def _import(self, kind: str, name: str, module: str, attribute: str) -> type[Any]:
        where = "in the working directory, in the folders of PYTHONPATH and among installed packages"
        fix = f"correct the name, or add the folder that contains {module.partition('.')[0]!r} to PYTHONPATH"
        hint = f"modules are searched {where}; {fix}"
        loaded = import_user_module(module, f" for {kind} {name!r}; {hint}")
        cls: Any = getattr(loaded, attribute, None)
        if cls is None:
            raise RegistryError(
                f"module {module!r} has no {attribute!r}; {did_you_mean(attribute, _plugins_in(loaded))}"
            )
        if not (isinstance(cls, type) and hasattr(cls, "registered_name") and hasattr(cls, "kind")):
            raise RegistryError(
                f"{name!r} is not a plugin; {with_article(kind)} must be a subclass of {self._base(kind)}"
            )
        if not cls.registered_name:
            lacks = ", ".join(f"`{method}`" for method in sorted(getattr(cls, "__abstractmethods__", ())))
            hint = (
                f"name one of its subclasses, {self._suggest(kind, '')}" if cls.__subclasses__() else f"define {lacks}"
            )
            raise RegistryError(f"{name!r} is an abstract class; {hint}")
        if cls.kind != kind:
            raise RegistryError(f"{name!r} is {with_article(cls.kind)}; expected {with_article(kind)} here")
        return cls

    def _base(self, kind: str) -> str:
        """Return the dotted path of the base class of a kind's plugins."""
        first = next(iter(self._classes.get(kind, {}).values()))
        base = next(cls for cls in reversed(first.__mro__) if vars(cls).get("kind") == kind)
        package = base.__module__.rpartition(".")[0]
        module = package if getattr(importlib.import_module(package), base.__name__, None) is base else base.__module__
        return f"{module}.{base.__qualname__}"

    def _suggest(self, kind: str, name: str) -> str:
        for other, classes in self._classes.items():
            if other != kind and name in classes:
                return f"{name!r} is {with_article(other)}; expected {with_article(kind)} here"
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
                what = f"the plugins of {package} are not available: its module {entry.module} cannot be imported"
                warnings.warn(f"{what}: {cause_of(error)}; fix or uninstall it", RuntimeWarning, stacklevel=2)


def with_article(kind: str) -> str:
    """Return a kind with its article."""
    return f"an {kind}" if kind[0] in "aeiou" else f"a {kind}"


def own_name(name: str) -> str:
    """Return the last part of a class path of CoRL or safe-autonomy-sims; other names are unchanged."""
    head, dot, rest = name.partition(".")
    if not dot or head not in PEERS:
        return name
    last = rest.rpartition(".")[2]
    return "Sun" if last == "SunEntity" else last


def import_user_module(name: str, wanted: str = "") -> ModuleType:
    """Import and return a module that a configuration names.

    Args:
        name: Dotted path of the module.
        wanted: End of the message when the module does not exist.

    Raises:
        RegistryError: The module does not exist or cannot be imported; the message states file, line and cause.
    """
    if not all(part.isidentifier() for part in name.split(".")):
        raise RegistryError(f"{name!r} is not a module path; write it as package.module")
    try:
        return importlib.import_module(name)
    except (Exception, SystemExit) as error:
        if isinstance(error, ModuleNotFoundError) and error.name and f"{name}.".startswith(f"{error.name}."):
            remedy = "; correct the name, install the module, or start the command in the folder that contains it"
            raise RegistryError(f"no module {name!r}{wanted or remedy}") from None
        raise RegistryError(f"module {name!r} cannot be imported: {cause_of(error)}; fix the module") from error


def _plugins_in(module: Any) -> list[str]:
    """Return the names of the plugins that a module contains."""
    return [name for name, value in vars(module).items() if getattr(value, "registered_name", "") and name[0] != "_"]


def cause_of(error: BaseException) -> str:
    """Return file, line, class and message of an error that was raised by an import or by a user's class."""
    if isinstance(error, SyntaxError):
        place = f"{error.filename}:{error.lineno}"
        return f"{place}: {type(error).__name__}: {error.msg}"
    between = ("importlib", f"{os.sep}pydantic{os.sep}", os.path.dirname(__file__))  # not the user's code
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)[1:]
        if not any(x in frame.filename for x in between)
    ]
    place = f"{frames[-1].filename}:{frames[-1].lineno}: " if frames else ""
    text = str(error).partition("\n")[0]
    untyped = re.search(r"non-annotated attribute was detected: `(\w+) = ", text)
    if untyped is not None:
        name = untyped[1]
        return f"{place}`{name}` has no type; write `{name}: float` (setting) or `{name}: ClassVar[float]` (constant)"
    return f"{place}{type(error).__name__}: {text}"


registry = Registry()
