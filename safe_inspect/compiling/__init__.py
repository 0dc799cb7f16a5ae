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

__all__ = [
    "BORROWING",
    "COMPILING_NOTE",
    "Kernel",
    "announce_compiling",
    "compiling_seconds",
    "generate",
    "njit",
]
