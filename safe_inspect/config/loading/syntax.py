"""Parsing of YAML text to nodes with marks, with the parser's errors explained in plain words."""

from __future__ import annotations

import re
from typing import Any

import yaml

from safe_inspect.errors import ConfigError, Location, Problem

#: Numbers such as ``1e-3`` and ``5e-05``, which are strings in YAML 1.1 because they lack the point or the sign.
FLOAT = re.compile(r"[-+]?(?:[0-9][0-9_]*(?:\.[0-9_]*)?|\.[0-9][0-9_]*)[eE][-+]?[0-9]+$")

#: Largest depth of nested values.
_DEPTH = 200
#: Numbers that YAML 1.1 reads in another base than probably intended: ``1:30`` in base 60, ``0600``.
OTHER_BASE = re.compile(r"[-+]?(?:[0-9][0-9_]*:.*|0[0-7_]*[1-7][0-7_]*)")

_Parser: Any = type("_Parser", (getattr(yaml, "CSafeLoader", yaml.SafeLoader),), {})
_Parser.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+.0123456789"))

#: A part of the parser's message, and its explanation.
_PLAIN_WORDS = (
    ("mapping values are not allowed", "a `:` where no key can be; is the line indented wrongly, or a quote missing?"),
    ("that cannot start any token", "nothing in YAML begins with this character; quote the string"),
    ("expected ',' or '}'", "the braces `{` are not closed before here, or a comma is missing"),
    ("expected ',' or ']'", "the brackets `[` are not closed before here, or a comma is missing"),
    ("unexpected end of stream", "a quote is opened but not closed"),
    ("could not find expected ':'", "a key without a `:` after it"),
    ("undefined alias", "an alias `*` without an anchor `&` before it in this file"),
    ("duplicate anchor", "an anchor `&` that is already defined in this file"),
    ("another document", "a second document begins here; a file must contain only one"),
    ("expected the node content", "a value is missing here"),
    ("did not find expected node content", "a value is missing here"),
    ("did not find expected key", "no key where one must be; is the line indented wrongly?"),
    ("did not find expected '-' indicator", "no `-` where an item of the list must be; is the line indented wrongly?"),
    ("expected <block end>", "no key or item where one must be; is the line indented wrongly?"),
    ("document start>", "there is text after the end of the document; is a bracket closed too early?"),
    ("undefined tag handle", "an unknown tag; the tags are `!include FILE` and, in lists, `!include-extend`"),
)  # fmt: skip


def compose(text: str, file: str) -> Any:
    """Return the root node of one YAML document, None for an empty one.

    Raises:
        ConfigError: The text is not valid YAML.
    """
    _check_depth(text, file)
    try:
        parser = _Parser(text)
        try:
            return parser.get_single_node()
        finally:
            parser.dispose()
    except yaml.MarkedYAMLError as error:
        raise ConfigError(_problem(error, text, file)) from None
    except yaml.reader.ReaderError as error:
        where = yaml.reader.Reader.NON_PRINTABLE.search(text)
        line = text.count("\n", 0, where.start()) + 1 if where else 1
        character = f"U+{ord(where[0]):04X}" if where else error.reason
        message = f"not valid YAML: the control character {character} is not allowed"
        raise ConfigError(Problem(message, location=Location(file, line), hint="remove it")) from None


def _check_depth(text: str, file: str) -> None:
    """Raise ConfigError for deeply nested brackets, for which the parsing time grows with the square of the depth.

    Raises:
        ConfigError: The brackets are nested too deeply.
    """
    if text.count("[") + text.count("{") <= _DEPTH:
        return
    depth = 0
    try:
        for event in yaml.parse(text, Loader=_Parser):
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEPTH:
                where = Location(file, event.start_mark.line + 1)
                hint = "put a part of them into a separate file"
                raise ConfigError(Problem("the values are nested too deeply", location=where, hint=hint))
    except yaml.YAMLError:
        return  # which is reported when the text is read


def decode(data: bytes, file: str) -> str:
    """Return the text of a file.

    Raises:
        ConfigError: It is not UTF-8.
    """
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        message = f"the file is not UTF-8 text (the byte 0x{data[error.start]:02x})"
        raise ConfigError(Problem(message, location=Location(file, line), hint="save it as UTF-8")) from None


def _problem(error: Any, text: str, file: str) -> Problem:
    said = ", ".join(part for part in (error.problem, error.context) if part)
    words = next((words for part, words in _PLAIN_WORDS if part in said), "")
    mark, opened = error.problem_mark or error.context_mark, error.context_mark
    lines = text.splitlines()
    rest = lines[mark.line][mark.column :] if mark.line < len(lines) else ""
    if rest.startswith("\t"):
        words = "there is a tab here; indent with spaces"
    if opened and (not rest.strip() or "simple key" in said):
        mark, opened = opened, mark  # the unclosed start is a better location than the end of the file
    also = (
        f", see line {opened.line + 1} too" if opened and opened.line != mark.line and opened.line < len(lines) else ""
    )
    detail = f"column {mark.column + 1}{also}; the parser says: {said}"
    message = f"not valid YAML: {words} ({detail})" if words else f"not valid YAML ({detail})"
    return Problem(message, location=Location(file, mark.line + 1))
