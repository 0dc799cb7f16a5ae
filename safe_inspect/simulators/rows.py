"""The kernel that copies rows from one state's memory to another's."""

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
    """Copy rows of every array that lies in a block of memory.

    Args:
        target: The memory that is written, bytes.
        target_starts: Where its arrays begin, shape (A,).
        target_rows: The rows that are written, shape (R,).
        source: The memory that is read, bytes.
        source_starts: Where its arrays begin, shape (A,).
        source_rows: The rows that are read, shape (R,).
        widths: Bytes of a row of each array, shape (A,).
    """
    for a in range(len(widths)):
        width = widths[a]
        for r in range(len(target_rows)):
            to, at = target_starts[a] + target_rows[r] * width, source_starts[a] + source_rows[r] * width
            for byte in range(width):
                target[to + byte] = source[at + byte]
