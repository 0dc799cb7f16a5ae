"""Functions that are compiled and called by their address, and memory that is read by its address.

A function that is called by its address is compiled once, whatever other functions are called. This file is
one of the sources of compiled functions (those with ``@njit``): a change of it invalidates the cached machine code.
"""

from __future__ import annotations

import re
from typing import Any

from llvmlite import ir
from numba import cfunc, types
from numba.core import cgutils  # public: documented in its guide to extensions, as are errors
from numba.core.errors import NumbaError, UnsupportedBytecodeError
from numba.extending import intrinsic

from safe_inspect.compiling.kernel import Kernel, cached

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")  # in the messages of Numba


@intrinsic  # type: ignore[misc,untyped-decorator]
def pointer(context: Any, address: Any, dtype: Any) -> Any:
    """Return an address as a pointer to numbers of a type."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    result: Any = types.CPointer
    return result(dtype.dtype)(types.int64, dtype), generate


@intrinsic  # type: ignore[misc,untyped-decorator]
def read_number(context: Any, address: Any, dtype: Any) -> Any:
    """Return the number of a type at an address; `carray` takes several times as long to compile."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = builder.inttoptr(arguments[0], context.get_value_type(signature.return_type).as_pointer())
        return builder.load(place)

    result: Any = dtype.dtype
    return result(types.int64, dtype), generate


@intrinsic  # type: ignore[misc,untyped-decorator]
def write_number(context: Any, address: Any, dtype: Any, value: Any) -> Any:
    """Write a number of a type to an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        wanted = signature.args[2]
        place = builder.inttoptr(arguments[0], context.get_value_type(wanted).as_pointer())
        builder.store(arguments[2], place)
        return context.get_dummy_value()

    return types.none(types.int64, dtype, dtype.dtype), generate


@intrinsic  # type: ignore[misc,untyped-decorator]
def on_stack(context: Any, numbers: Any) -> Any:
    """Return a pointer to a copy of a tuple of equal numbers, which is valid until the calling function returns."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = cgutils.alloca_once_value(builder, arguments[0])  # type: ignore[no-untyped-call]
        return builder.bitcast(place, context.get_value_type(signature.return_type))

    result: Any = types.CPointer
    return result(numbers.dtype)(numbers), generate


@intrinsic  # type: ignore[misc,untyped-decorator]
def call_at(context: Any, address: Any, dtype: Any, arguments: Any) -> Any:
    """Call the C function at an address, which returns a number of a type, with a tuple of numbers and pointers."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        given = [builder.extract_value(arguments[2], index) for index in range(len(signature.args[2]))]
        function = ir.FunctionType(context.get_value_type(signature.return_type), [each.type for each in given])
        return builder.call(builder.inttoptr(arguments[0], function.as_pointer()), given)

    result: Any = dtype.dtype
    return result(types.int64, dtype, arguments), generate


def compiled_at(kernel: Kernel[..., Any], signature: str) -> Any:
    """Return a kernel as a C function; its ``address`` and ``ctypes`` are valid as long as the object exists.

    An exception in it is printed, and 0 is returned.

    Args:
        kernel: The kernel.
        signature: Its signature, such as ``int64(int64, float64)``.

    Raises:
        ValueError: The kernel does not compile.
    """
    try:
        return cached(lambda function, cache: cfunc(signature, cache=cache, error_model="numpy")(function), kernel)
    except (NumbaError, UnsupportedBytecodeError) as error:
        raise ValueError(_COLOUR.sub("", str(error)).strip()) from None
