"""Terms that are defined by one row kernel: the same machine code is used for a batch call and for the fused step.

A loop over environments and agents is generated around the kernel. It depends only on the kernel and on the types of
its inputs, is compiled once and called by its address:

    loop(table, bases, out, environments, agents)

`table` contains the locations of the inputs, `bases` the start addresses of the blocks of memory that contain them, and
`out` is the address of the result. The loop of a sensor skips the rows that are not requested by `MemoryBase.ASKED`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.compiling import Kernel, generate
from safe_inspect.errors import MissingNameError, PluginValueError
from safe_inspect.simulators.row_terms import InputPlace, MemoryBase, RowInput, RowTerm, Scene, place_of
from safe_inspect.types import AnyArray

_SIGNATURE = "int64(int64, int64, int64, int64, int64)"


@dataclass(frozen=True, eq=False)
class PlacedTerm:
    """A row term whose inputs have been located in memory.

    Attributes:
        address: Address of the compiled loop.
        call: The loop, callable from Python; it returns 0 if the kernel raised an exception.
        table_address: Its first argument.
        keeps: References that keep the memory at the addresses valid: the loop, the table, and the locations of the
            inputs.
    """

    address: int
    call: Callable[..., int]
    table_address: int
    keeps: tuple[Any, ...]


def place_term(term: RowTerm, scene: Scene, dtype: type[Any], stride: int, size: int) -> PlacedTerm:
    """Return a term with its inputs located in memory.

    Args:
        term: The term.
        scene: Data in which the inputs are looked up.
        dtype: Type of the elements of the result.
        stride: Distance between the results of two rows [byte].
        size: Number of elements of the result if the kernel writes it; 0 if the kernel returns it.

    Raises:
        MissingNameError: The task does not provide an input.
        PluginValueError: The kernel does not compile for these inputs.
        ValueError: An input cannot be read by a kernel.
    """
    try:
        places = tuple(place_of(given, scene) for given in term.inputs)
    except MissingNameError as error:
        line = term.kernel.__wrapped__.__code__.co_firstlineno
        where = f"{term.kernel.__qualname__} ({term.kernel.__module__}, line {line})"
        raise MissingNameError(f"an input of the row kernel {where} is missing: {error}") from None
    numbers = [stride, size]
    for given, place in zip(term.inputs, places, strict=True):
        if size and place.base in (MemoryBase.BEFORE, MemoryBase.INTERVENING):
            raise ValueError(f"a sensor sees one state, and no step; it cannot be given {given}")
        _check(given, place, scene)
        steps = [place.strides[axis] if place.shape[axis] > 1 else 0 for axis in (0, 1)]
        numbers += [int(place.base), place.offset, *steps, *place.shape[2:]]
    inputs = tuple((place.dtype.name, len(place.shape) - 2) for place in places)
    function = _compiled(term.kernel, inputs, np.dtype(dtype).name, size > 0)
    table = np.array(numbers, dtype=np.int64)
    return PlacedTerm(function.address, function.ctypes, address_of(table), (function, table, places))


def _check(given: RowInput, place: InputPlace, scene: Scene) -> None:
    """Check that an input has a contiguous part for every row, or the same part for all rows."""
    expected = place.dtype.itemsize
    sound = all(length in (1, wanted) for length, wanted in zip(place.shape, scene.rows, strict=False))
    for length, stride in zip(place.shape[:1:-1], place.strides[:1:-1], strict=True):
        sound &= length <= 1 or stride == expected
        expected *= length
    if not sound:
        raise ValueError(f"a row kernel cannot read {given}: {place} does not fit {scene.rows} environments and agents")


@functools.cache
def _compiled(kernel: Kernel[..., Any], inputs: tuple[tuple[str, int], ...], dtype: str, writes: bool) -> Any:
    from safe_inspect.compiling.addresses import compiled_at  # imports Numba, which validation does not need

    try:
        return compiled_at(generate("loop", _source(inputs, dtype, writes), {"row": kernel}), _SIGNATURE)
    except ValueError as error:
        given = ", ".join(name + (f"[{', '.join(':' * axes)}]" if axes else "") for name, axes in inputs)
        raise PluginValueError(
            f"{kernel.__module__}.{kernel.__qualname__} does not compile as a row kernel of ({given}); use numbers, "
            f"`math` and these arrays, element by element: {error}"
        ) from None


def _source(inputs: Sequence[tuple[str, int]], dtype: str, writes: bool) -> str:
    """Return the source of the loop over environments and agents."""
    head, arguments, at = [], [], 2
    for index, (name, axes) in enumerate(inputs):
        a, e, g, d = (f"{letter}{index}" for letter in "aegd")
        head.append(f"{a} = read_number(bases + 8 * {_entry(at)}, int64) + {_entry(at + 1)}")
        head.append(f"{e}, {g} = {_entry(at + 2)}, {_entry(at + 3)}")
        head += [f"{d}_{axis} = {_entry(at + 4 + axis)}" for axis in range(axes)]
        shape = ", ".join(f"{d}_{axis}" for axis in range(axes))
        stored = "uint8" if name == "bool" else name
        there = f"{a} + n * {e} + i * {g}, {stored}"
        value = f"read_number({there})"
        arguments.append(
            f"carray(pointer({there}), ({shape},))" if axes else f"{value} != 0" if name == "bool" else value
        )
        at += 4 + axes
    here = "out + (n * agents + i) * stride"
    if writes:
        call = f"row({', '.join([*arguments, f'carray(pointer({here}, {dtype}), (size,))'])})"
        body = f"if asked == 0 or read_number(asked + n * agents + i, uint8) != 0:\n                {call}"
    else:
        value = f"row({', '.join(arguments)})"
        stored = "uint8" if dtype == "bool" else dtype
        body = f"write_number({here}, {stored}, {f'uint8(1 if {value} else 0)' if dtype == 'bool' else value})"
    head += [f"asked = read_number(bases + {8 * int(MemoryBase.ASKED)}, int64)"] * writes
    lines = "\n    ".join(head)
    return f"""from numba import carray, float32, float64, int8, int16, int32, int64, uint8, uint16, uint32, uint64

from safe_inspect.compiling.addresses import pointer, read_number, write_number


def loop(table, bases, out, environments, agents):
    stride, size = {_entry(0)}, {_entry(1)}
    {lines}
    for n in range(environments):
        for i in range(agents):
            {body}
    return 1
"""


def _entry(index: int) -> str:
    """Return the source of an element of the table."""
    return f"read_number(table + {8 * index}, int64)"


def address_of(array: AnyArray) -> int:
    """Return the address of an array's data; several times as fast as ``array.ctypes.data``."""
    address: int = array.__array_interface__["data"][0]
    return address
