"""Conversion of Pydantic's validation errors to problems with file, line, path and plain words."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from safe_inspect.config.keys.other_words import key_hint
from safe_inspect.config.loading.located import LocatedDict, has, locate, path_text, value_at
from safe_inspect.config.loading.merge import names_of
from safe_inspect.config.messages.messages import is_of_other_kind, message, shown, wanted
from safe_inspect.config.models.fields import known_keys
from safe_inspect.errors import ConfigError, Location, Problem
from safe_inspect.plugins.functor import errors_of

#: Path in the configuration: keys and indices.
KeyTuple = tuple[Any, ...]
#: Function that is called with the path and the message of a problem.
ReportProblem = Callable[[KeyTuple, str], None]
#: Path of the environment in an experiment.
ENVIRONMENT_PATH: KeyTuple = ("config", "config", "env_config")

_Model = TypeVar("_Model", bound=BaseModel)

#: Labels that Pydantic adds to the path of an error to distinguish the members of a union.
_LABEL = re.compile(r"(int|float|str|bool|bytes|none|list|dict|tuple|set|date|datetime)$|[A-Z]|.*[\[(-]")


def validated(model: type[_Model], tree: Any) -> _Model:
    """Return the model of a tree.

    Args:
        model: Class of the model.
        tree: The tree with the locations of its values.

    Raises:
        ConfigError: The tree is not valid; the error lists every mistake with its location.
    """
    try:
        return model.model_validate(tree)
    except ValidationError as error:
        raise ConfigError(problems_of(error, tree, model=model)) from None


def problems_of(
    error: ValidationError, tree: Any, prefix: Sequence[Any] = (), model: type[BaseModel] | None = None
) -> list[Problem]:
    """Return one problem for each mistake of a validation, including those in nested functors.

    Args:
        error: The error of the validation.
        tree: The tree with locations.
        prefix: Path of the validated value in the tree.
        model: The model of the validation, for the names of its keys.
    """
    start = value_at(tree, prefix)
    faults = [_Fault((), tuple(_steps(found["loc"], start)), found) for found in errors_of(error)]
    problems = [_problem(fault, tree, tuple(prefix), start, model) for fault in _without_unions(faults)]
    return list(dict.fromkeys(problems))


@dataclass(frozen=True)
class _Label:
    """Name of a union's member in the path of an error."""

    text: str


@dataclass(frozen=True)
class _Fault:
    """An error with its path; `rest` starts with the first label of a union, if there is one."""

    path: tuple[Any, ...]
    rest: tuple[Any, ...]
    error: dict[str, Any]

    def next_union(self) -> _Fault:
        """Return the error with the path extended to the next label, or to the end."""
        count = next((i for i, step in enumerate(self.rest) if isinstance(step, _Label)), len(self.rest))
        return _Fault(self.path + self.rest[:count], self.rest[count:], self.error)


def _steps(loc: Sequence[Any], node: Any) -> Iterator[Any]:
    """Yield the components of an error's path, with the labels of unions marked."""
    for part in loc:
        if not has(node, part) and isinstance(part, str) and _LABEL.match(part):
            yield _Label(part)
        else:
            node = node[part] if has(node, part) else None
            yield part


def _without_unions(faults: list[_Fault]) -> list[_Fault]:
    """Reduce the errors of a union's members to those of the intended member, or to one."""
    kept: list[_Fault] = []
    unions: dict[tuple[Any, ...], dict[str, list[_Fault]]] = {}
    for fault in (fault.next_union() for fault in faults):
        if not fault.rest:
            kept.append(fault)
            continue
        if fault.path not in unions:
            unions[fault.path] = {}
        label = fault.rest[0].text
        unions[fault.path].setdefault(label, []).append(_Fault(fault.path, fault.rest[1:], fault.error))
    for path, members in unions.items():
        kept += _meant(path, [_without_unions(member) for member in members.values()])
    return kept


def _meant(path: tuple[Any, ...], members: list[list[_Fault]]) -> list[_Fault]:
    """Return the errors of that member of a union type that was most likely meant.

    Of the members that accept the value's type, it is the one with the fewest errors. If there is none, a single error
    names the types that all members expect.
    """
    fitting = [
        member
        for member in members
        if not any(fault.path == path and is_of_other_kind(fault.error) for fault in member)
    ]
    if fitting:
        return min(fitting, key=len)
    if len(members) == 1:
        return members[0]
    wants = dict.fromkeys(wanted(fault.error) for member in members for fault in member if fault.path == path)
    choices = " or ".join(want for want in wants if want)
    first = members[0][0].error
    text = f"expected {choices}, got {shown(first.get('input'))}"
    return [_Fault(path, (), {**first, "type": "functor_key", "msg": text})]


def _problem(fault: _Fault, tree: Any, prefix: tuple[Any, ...], start: Any, model: type[BaseModel] | None) -> Problem:
    where = prefix + fault.path
    if fault.error["type"] == "extra_forbidden":
        known = known_keys(start, fault.path[:-1], model)
        if len(where) == 1 and has(start, "agent_config"):  # the short keys of `safe_inspect.config.layers`
            agents = start["agent_config"]
            known |= {name for entry in agents for name in names_of(entry)} if isinstance(agents, list) else set()
            known |= known_keys(start, ("config", "config"), model)
        if len(where) == 3 and where[0] == "agent_config":  # keys that may stand next to `policy` in the short form
            known |= known_keys(start, (*where[:2], "config", "config"), model)
        text, hint = f"unknown key `{fault.path[-1]}`", key_hint(str(fault.path[-1]), known) if known else ""
        if not known and not fault.error["msg"].startswith("Extra inputs"):
            text, hint = fault.error["msg"], ""  # a plugin that builds another lists the keys itself
    else:
        text, hint = message(fault.error)
    location = _newest_named(tree, where, text) if fault.error["type"] == "value_error" else None
    return Problem(text, path_text(where), location or locate(tree, where), hint)


def _newest_named(tree: Any, where: tuple[Any, ...], text: str) -> Location | None:
    """Return the location of the newest key that the mistake of a whole mapping mentions; None if there is none.

    The keys may come from several files and from the command line; their locations are in the order of writing.
    """
    holder = value_at(tree, where)
    if not isinstance(holder, LocatedDict):
        return None
    named = set(re.findall(r"\w+", text))
    return next((mark for key, mark in reversed(holder.marks.items()) if key in named), None)
