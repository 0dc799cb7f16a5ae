"""Compiled functions with source that is generated from kernels at run time: loops over rows, sequences of terms."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safe_inspect.compiling.folders import digest_of, digest_of_files, installed_folder, machine_code_folder
from safe_inspect.compiling.kernel import Kernel, called_by, source_of

_functions: dict[str, Generated] = {}


class Generated(Kernel[..., Any]):
    """A kernel with generated source. A copy in another process is generated again."""

    origin: tuple[str, str, Mapping[str, Kernel[..., Any]], Mapping[str, Any]]

    def __reduce__(self) -> Any:
        """Pickle the arguments from which the kernel is generated."""
        return generate, self.origin


def generate(
    name: str, source: str, kernels: Mapping[str, Kernel[..., Any]], options: Mapping[str, Any] | None = None
) -> Generated:
    """Return a function with generated source as a `Kernel`; the same source and kernels give the same object.

    The source is written to a file, so that the machine code can be cached on disk. The name of the file contains a
    digest of the source and of every file that defines one of the kernels, or a kernel that these call, so that the
    cache cannot be out of date.

    Args:
        name: Name of the function that the source defines.
        source: The source.
        kernels: The kernels that the source calls, by their names in the source.
        options: Options of `numba.njit`.
    """
    digest = hashlib.sha256(repr((sys.version_info[:2], name, sorted((options or {}).items()), source)).encode())
    for label, kernel in sorted(kernels.items()):
        digest.update(f"{label} {kernel.__module__} {kernel.__qualname__}".encode())
    digest.update(digest_of_files(map(source_of, called_by(kernels.values()))).encode())
    key = digest.hexdigest()[:24]
    if key not in _functions:
        path = _written(f"{name}_{key}.py", source)
        spec = importlib.util.spec_from_file_location(f"safe_inspect.compiling.generated.{path.stem}", path)
        assert spec is not None, "a file with the suffix .py has a loader"
        assert spec.loader is not None, "a file with the suffix .py has a loader"
        module = importlib.util.module_from_spec(spec)
        vars(module).update(kernels)
        sys.modules[spec.name] = module  # cached machine code imports its module
        spec.loader.exec_module(module)
        made = _functions[key] = Generated(getattr(module, name), options or {})
        made.origin = (name, source, kernels, options or {})
    return _functions[key]


def _written(name: str, source: str) -> Path:
    """Return a file with the source: with the package's machine code, or in a folder for temporary files."""
    own = f"safe_inspect-{os.getuid() if hasattr(os, 'getuid') else 0}"
    chosen = machine_code_folder(digest_of())
    folders = [installed_folder(digest_of()), *([chosen] if chosen else []), Path(tempfile.gettempdir()) / own]
    for folder in folders:
        path = folder / "generated" / name
        try:
            if not path.is_file():
                path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                partial = path.with_suffix(f".{os.getpid()}")
                partial.write_text(source, encoding="utf-8")
                partial.replace(path)
            return path
        except OSError:
            continue
    raise OSError(f"neither {folders[0]} nor {tempfile.gettempdir()} can be written; compiled code needs one of them")
