"""Extension of Griffe: the reference shows a Pydantic class with its fields, types and defaults as its signature."""

from __future__ import annotations

from typing import Any

from griffe import Class, Extension, Function, Module, Parameter, ParameterKind, Parameters

_BASE = "pydantic.BaseModel"


class FieldsAsSignature(Extension):
    """Gives each subclass of Pydantic's `BaseModel` the `__init__` that Pydantic makes of its fields."""

    def on_package(self, *, pkg: Module, **_: Any) -> None:
        """Give it to all classes of the package, when the bases of all are known."""
        for cls in list(_classes(pkg)):
            fields = _fields(cls)
            if fields and "__init__" not in cls.members:
                parameters = (
                    Parameter(name, annotation=field.annotation, default=field.value, kind=ParameterKind.keyword_only)
                    for name, field in fields.items()
                )
                init = Function("__init__", parameters=Parameters(Parameter("self"), *parameters), parent=cls)
                cls.set_member("__init__", init)


def _classes(within: Module | Class) -> Any:
    for member in within.members.values():
        if not member.is_alias and (member.is_module or member.is_class):
            if member.is_class:
                yield member
            yield from _classes(member)


def _fields(cls: Class) -> dict[str, Any]:
    """Return the fields of a Pydantic class, those of its bases first; nothing for another class."""
    line = [cls, *cls.mro()]
    if not any(str(getattr(base, "canonical_path", base)) == _BASE for each in line for base in each.bases):
        return {}
    return {
        name: member
        for each in reversed(line)
        for name, member in each.members.items()
        if member.is_attribute and "instance-attribute" in member.labels and member.annotation is not None
        and not name.startswith("_")
    }  # fmt: skip
