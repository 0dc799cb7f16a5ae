"""The kernel that copies rows from the memory of one state to that of another."""

from __future__ import annotations

from safe_inspect.compiling import njit
from safe_inspect.types import AnyArray, IntArray


@njit
def copy_rows(
    target: AnyArray,
    target_starts: IntArray,
    target_rows: IntArray,
    source: AnyArray,
    source_starts: IntArray,
    source_rows: IntArray,
    widths: IntArray,
) -> None:
    """Copy rows of all arrays in a block of memory.

    Args:
        target: The memory to write, bytes.
        target_starts: Start of each array in it, shape (A,).
        target_rows: The rows to write, shape (R,).
        source: The memory to read, bytes.
        source_starts: Start of each array in it, shape (A,).
        source_rows: The rows to read, shape (R,).
        widths: Bytes per row of each array, shape (A,).
    """
    for a in range(len(widths)):
        width = widths[a]
        for r in range(len(target_rows)):
            to, at = target_starts[a] + target_rows[r] * width, source_starts[a] + source_rows[r] * width
            for byte in range(width):
                target[to + byte] = source[at + byte]
