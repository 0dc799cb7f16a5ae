# mypy: disable-error-code="attr-defined,misc,no-untyped-call,override,untyped-decorator"
"""Large named tuples are handed to kernels by their address.

Numba hands a tuple on by value: a model of twenty arrays is some two hundred arguments, which each call takes apart and
every function puts together. So a kernel that is called by another one is given the address of a large tuple, of which
it reads what it uses. The tuple stands on the stack of its caller, and nothing writes to it.

This file belongs to the sources of compiled functions (those with ``@njit``): a change of it removes what is cached.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.errors import TypingError
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, lower_cast, lower_getattr_generic, register_model

#: Numbers from which on a named tuple is handed on by its address.
LARGE = 32


_BYTE = ir.IntType(8)


class Address(type(_BYTE.as_pointer())):
    """Pointer to a tuple, as one to bytes."""


class TupleReference(types.Type):
    """The address of a named tuple.

    Attributes:
        target: Type of the tuple.
    """

    def __init__(self, target: types.NamedTuple) -> None:
        digest = hashlib.sha256(str(target).encode()).hexdigest()
        super().__init__(f"TupleReference({target.instance_class.__name__}, {digest[:16]})")
        self.target = target

    @property
    def key(self) -> Any:
        """What equal types have in common."""
        return self.target


def scalars_in(given: types.Type) -> int:
    """Return how many numbers a value of a type is handed on as."""
    if isinstance(given, types.BaseTuple):
        return sum(scalars_in(each) for each in given)
    return 5 + 2 * given.ndim if isinstance(given, types.Array) else 1


@functools.cache
def handed(given: types.Type) -> types.Type:
    """Return the type that a kernel sees of an argument."""
    if isinstance(given, types.NamedTuple) and scalars_in(given) >= LARGE:
        return TupleReference(given)
    return given


def require_value(returned: types.Type, name: str) -> None:
    """Raise TypingError where a kernel returns the address of a tuple, alone or in another one."""
    if isinstance(returned, TupleReference):
        raise TypingError(f"{name} returns a tuple that it is given; return what is needed of it")
    if isinstance(returned, types.BaseTuple):
        for each in returned:
            require_value(each, name)


def mark(functions: Iterable[ir.Function]) -> None:
    """Say of arguments that are addresses of tuples that nothing writes there."""
    for function in functions:
        for argument in function.args:
            if isinstance(argument.type, Address):
                argument.add_attribute("noalias")
                argument.add_attribute("nonnull")


@register_model(TupleReference)
class _ReferenceModel(models.PrimitiveModel):
    def __init__(self, manager: Any, given: TupleReference) -> None:
        super().__init__(manager, given, Address(_BYTE))


@infer_getattr
class _ReferenceFields(AttributeTemplate):
    key = TupleReference

    def generic_resolve(self, reference: TupleReference, name: str) -> types.Type | None:
        """Return the type of a field."""
        target = reference.target
        return handed(target.types[target.fields.index(name)]) if name in target.fields else None


@functools.cache
def _offset(structure: ir.Type, index: int, layout: Any) -> int:
    offset: int = structure.get_element_offset(layout, index)
    return offset


def _shifted(builder: Any, address: Any, offset: int) -> Any:
    """Return the address a number of bytes behind another one."""
    return builder.gep(address, [ir.Constant(ir.IntType(32), offset)], inbounds=True)


@lower_getattr_generic(TupleReference)
def _read_field(context: Any, builder: Any, reference: Any, address: Any, name: str) -> Any:
    index = reference.target.fields.index(name)
    place = _shifted(builder, address, _offset(context.get_value_type(reference.target), index, context.target_data))
    member = reference.target.types[index]
    if isinstance(handed(member), TupleReference):
        return place
    value = builder.load(builder.bitcast(place, context.get_value_type(member).as_pointer()))
    return impl_ret_borrowed(context, builder, member, value)


@lower_cast(types.NamedTuple, TupleReference)
def _refer(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    """Return the address of a tuple: where its variable stands, else a place on the stack where it is written to."""
    if isinstance(value, ir.LoadInstr) and _holds(value, builder.block):
        return builder.bitcast(value.operands[0], Address(_BYTE))
    place = builder.bitcast(cgutils.alloca_once(builder, value.type), Address(_BYTE))
    _write(context, builder, value, place)
    return place


def _holds(value: ir.LoadInstr, block: ir.Block) -> bool:
    """Return whether a variable on the stack has the value still at the end of a block.

    It has not in ``before = now``, ``now = ...``, ``f(before)``, nor after the last use of its name.
    """
    variable = value.operands[0]
    for each in reversed(block.instructions):
        if each is value:
            return isinstance(variable, ir.AllocaInstr)
        if isinstance(each, ir.StoreInstr) and each.operands[1] is variable:
            break
    return False


def _write(context: Any, builder: Any, value: Any, place: Any) -> None:
    """Write a value to an address, number by number."""
    layout = context.target_data
    if isinstance(value.type, ir.LiteralStructType):
        offsets = [_offset(value.type, index, layout) for index in range(len(value.type))]
    elif isinstance(value.type, ir.ArrayType):
        offsets = [index * value.type.element.get_abi_size(layout) for index in range(value.type.count)]
    else:
        builder.store(value, builder.bitcast(place, value.type.as_pointer()))
        return
    for index, offset in enumerate(offsets):
        _write(context, builder, builder.extract_value(value, index), _shifted(builder, place, offset))
