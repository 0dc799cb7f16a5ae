"""The registry: every plugin class by kind and name.

Defining a plugin class registers it (see `safe_inspect.plugins.plugin`). A name in a
configuration is, in this order, a name of the peer's (`safe_inspect.plugins.aliases`), a
registered name, or a dotted path ``package.module.Class`` that is imported.
Distributions announce their modules in the entry-point group
``safe_inspect.plugins``; they are imported when a name is looked up.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from importlib.metadata import entry_points
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
        self._load()
        known = self._classes.get(kind, {})
        name = ALIASES.get(name, name)
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
        try:
            loaded = importlib.import_module(module)
        except ModuleNotFoundError as error:
            if error.name is None or not (module == error.name or module.startswith(error.name + ".")):
                raise  # the module exists and fails by itself: its own traceback says more
            raise RegistryError(f"no module {module!r} for {kind} {name!r}; {self._suggest(kind, attribute)}") from None
        cls: Any = getattr(loaded, attribute, None)
        if cls is None:
            raise RegistryError(f"module {module!r} has no {attribute!r}; {did_you_mean(attribute, vars(loaded))}")
        if not (isinstance(cls, type) and hasattr(cls, "registered_name") and hasattr(cls, "kind")):
            raise RegistryError(f"{name!r} is no plugin; a {kind} is a subclass of safe_inspect.plugins.plugin.Plugin")
        if cls.kind != kind:
            raise RegistryError(f"{name!r} is a {cls.kind}; a {kind} is wanted here")
        return cls

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
            entry.load()


registry = Registry()
