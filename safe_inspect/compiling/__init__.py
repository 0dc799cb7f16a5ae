"""Compiled functions: kernels, and functions with generated source that call kernels."""

from safe_inspect.compiling.kernel import (
    BORROWING,
    COMPILING_NOTE,
    Kernel,
    announce_compiling,
    compiling_seconds,
    generate,
    njit,
)
from safe_inspect.compiling.values import compiled_function

__all__ = [
    "BORROWING",
    "COMPILING_NOTE",
    "Kernel",
    "announce_compiling",
    "compiled_function",
    "compiling_seconds",
    "generate",
    "njit",
]
