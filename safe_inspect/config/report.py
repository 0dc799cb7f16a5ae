"""Conversion of Pydantic's validation errors to problems with file, line, path and plain words."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticCustomError

from safe_inspect.config.fields import known_keys
from safe_inspect.config.keys import by_name
from safe_inspect.config.keys.old_keys import key_hint
from safe_inspect.config.loading.located import LocatedDict, has, locate, path_text, value_at
from safe_inspect.config.loading.merge import names_of
from safe_inspect.errors import ConfigError, Location, Problem, did_you_mean
from safe_inspect.plugins.functor import errors_of

#: Expected values, each with the types of its errors; the names in braces are those of the error's context.
_WANTED = by_name(
    {
        "a whole number": "int_type int_parsing int_from_float",
        "a smaller whole number": "int_parsing_size",
        "a number": "float_type float_parsing",
        "a finite number": "finite_number",
        "`true` or `false`": "bool_type bool_parsing",
        "a string": "string_type",
        "nothing (`null`)": "none_required",
        "a list": "list_type tuple_type set_type iterable_type",
        "a mapping": "dict_type mapping_type model_type model_attributes_type dataclass_type",
        "a number above {gt}": "greater_than",
        "a number of {ge} or more": "greater_than_equal",
        "a number below {lt}": "less_than",
        "a number of {le} or less": "less_than_equal",
        "a multiple of {multiple_of}": "multiple_of",
        "at least {min_length} items": "too_short",
        "at most {max_length} items": "too_long",
        "a string of at least {min_length} characters": "string_too_short",
        "a string of at most {max_length} characters": "string_too_long",
        "{pattern}": "string_pattern_mismatch",
        "{expected}": "literal_error enum",
        "one of {expected_tags} as {discriminator}": "union_tag_invalid",
    }
)

#: Expected string by the pattern of its field.
_PATTERNS = {
    r"^[^/\s]+$": "a name without spaces and slashes",
    r"^[\w.-]+$": "a name of letters, digits, `_`, `.` and `-`",
    r"\S|^$": "a string that is not blank",
    r"^\w+(\.\w+)+$": "a dotted path `module.Class`",
}

#: Suffixes of errors about a value of another type, which may match another member of a union.
_OTHER_KIND = ("_type", "_parsing", "_required", "int_from_float", "literal_error", "enum")


def _wanted(error: Mapping[str, Any]) -> str:
    """Return a description of the expected value; empty if the error does not contain one."""
    context = error.get("ctx", {})
    limits = {name: f"{limit:.15g}" if isinstance(limit, float) else limit for name, limit in context.items()}
    if "pattern" in limits:
        pattern = limits["pattern"]
        limits["pattern"] = _PATTERNS.get(pattern, f"a string that matches the regular expression `{pattern}`")
    return _WANTED.get(error["type"], "").format_map(limits)


def text_of(error: Mapping[str, Any]) -> str:
    """Return a description of the mistake, with the hint of `message`."""
    return "; ".join(filter(None, message(error)))


def message(error: Mapping[str, Any]) -> tuple[str, str]:
    """Return a description of the mistake and a hint, which is often empty."""
    kind, said = error["type"], str(error["msg"])
    if kind == "missing":
        item = error["loc"][-1] if error.get("loc") else ""
        return f"item {item} of the list is missing" if isinstance(item, int) else "the key is missing", ""
    if kind in ("functor_key", "value_error", "assertion_error"):
        return said.removeprefix("Value error, ").removeprefix("Assertion failed, "), ""
    given = error.get("input")
    want = _wanted(error)
    if want:
        return f"expected {want}, got {shown(given)}", _nearest(error, given)
    return f"{said[:1].lower()}{said[1:]}, got {shown(given)}", ""


def functor_problems(error: PydanticCustomError) -> Iterator[tuple[tuple[Any, ...], str]]:
    """Yield path and description of each mistake in an error of `safe_inspect.plugins.functor.build`."""
    for problem in (error.context or {})["errors"]:
        yield tuple(problem["loc"]), text_of(problem)


def functor_mistakes(error: PydanticCustomError) -> str:
    """Return the mistakes of a functor without a file, from the error of `safe_inspect.plugins.functor.build`."""
    texts = [(".".join(map(str, where)), text) for where, text in functor_problems(error)]
    return "; ".join(f"{where}: {text}" if where else text for where, text in texts)


def shown(value: Any) -> str:
    """Return a value as messages print it, shortened."""
    if value is None:
        return "nothing (`null`)"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    text = repr(value)
    if len(text) <= 60:
        return text
    if isinstance(value, Mapping):
        return f"a mapping with {len(value)} keys"
    return f"a list of {len(value)}" if isinstance(value, (list, tuple)) else f"{text[:57]}..."


def _nearest(error: Mapping[str, Any], given: Any) -> str:
    """Return a hint with the most similar permitted string."""
    if error["type"] not in ("literal_error", "enum") or not isinstance(given, str):
        return ""
    hint = did_you_mean(given, str(error["ctx"]["expected"]).split("'")[1::2])
    return hint if hint.startswith("did") else ""


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


def problems_of(error: ValidationError, tree: Any, model: type[BaseModel] | None = None) -> list[Problem]:
    """Return one problem for each mistake of a validation, including those in nested functors.

    Args:
        error: The error of the validation.
        tree: The validated tree with locations.
        model: The model of the validation, for the names of its keys.
    """
    errors = errors_of(error)
    # Pydantic counts only the valid items of a list.
    holders = {found["loc"][:size] for found in errors for size in range(len(found["loc"]))}
    errors = [found for found in errors if found["type"] != "too_short" or found["loc"] not in holders]
    faults = [_Fault((), tuple(_steps(found["loc"], tree)), found) for found in errors]
    return list(dict.fromkeys(_problem(fault, tree, model) for fault in _without_unions(faults)))


class _Label(str):
    """Name of a union's member in the path of an error."""


class _Fault(NamedTuple):
    """An error with its path; `rest` starts with the first label of a union, if there is one."""

    path: tuple[Any, ...]
    rest: tuple[Any, ...]
    error: dict[str, Any]


def _next_union(fault: _Fault) -> _Fault:
    """Return an error with the path extended to the next label, or to the end."""
    count = next((i for i, step in enumerate(fault.rest) if isinstance(step, _Label)), len(fault.rest))
    return _Fault(fault.path + fault.rest[:count], fault.rest[count:], fault.error)


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
    unions: dict[tuple[Any, ...], dict[str, list[_Fault]]] = defaultdict(lambda: defaultdict(list))
    for path, rest, error in map(_next_union, faults):
        if rest:
            unions[path][rest[0]].append(_Fault(path, rest[1:], error))
        else:
            kept.append(_Fault(path, rest, error))
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
        if not any(fault.path == path and fault.error["type"].endswith(_OTHER_KIND) for fault in member)
    ]
    if fitting:
        return min(fitting, key=len)
    if len(members) == 1:
        return members[0]
    wants = dict.fromkeys(_wanted(fault.error) for member in members for fault in member if fault.path == path)
    choices = " or ".join(want for want in wants if want)
    first = members[0][0].error
    text = f"expected {choices}, got {shown(first.get('input'))}"
    return [_Fault(path, (), {**first, "type": "functor_key", "msg": text})]


def _problem(fault: _Fault, tree: Any, model: type[BaseModel] | None) -> Problem:
    where = fault.path
    if fault.error["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        known = known_keys(tree, where[:-1], model)
        if len(where) == 1 and has(tree, "agent_config"):  # the short keys of `safe_inspect.config.layers`
            agents = tree["agent_config"]
            known |= {name for entry in agents for name in names_of(entry)} if isinstance(agents, list) else set()
            known |= known_keys(tree, ("config", "config"), model)
        if len(where) == 3 and where[0] == "agent_config":  # keys that may stand next to `policy` in the short form
            known |= known_keys(tree, (*where[:2], "config", "config"), model)
        text, hint = f"unknown key `{where[-1]}`", key_hint(str(where[-1]), known) if known else ""
        if not known and not fault.error["msg"].startswith(("Extra inputs", "Unexpected keyword")):
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
