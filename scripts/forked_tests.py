"""Run pytest again and again, each time in a fork of a process that has loaded the libraries but not the package.

`scripts/mutants.py` starts it in a copy of the repository and writes one request a line to its standard input, a JSON
object with ``names`` (the files of tests), ``output`` (the file that their output goes to), ``limit`` (when to stop
[s]) and ``reach`` (the file to which `Reach` writes, or null). The answer is a line with the exit code, or "timeout".
"""

from __future__ import annotations

import ast
import atexit
import contextlib
import functools
import gc
import importlib
import json
import os
import signal
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

_LIBRARIES = (
    "numba", "scipy.stats", "scipy.optimize", "scipy.integrate", "scipy.spatial", "matplotlib.pyplot", "pydantic",
    "gymnasium", "pettingzoo", "yaml", "hypothesis", "PIL.ImageDraw", "torch", "onnxruntime",
)  # fmt: skip
#: The context of what runs outside the files of tests, such as fixtures of the session.
_SHARED = ""


class Reach:
    """A plugin of pytest that notes which functions each file of tests runs in its process, and for how long.

    Args:
        package: Folder of the package, which must not be imported yet.
    """

    def __init__(self, package: Path) -> None:
        import coverage

        self._coverage = coverage.Coverage(data_file=None, source=[str(package)], config_file=False)
        self._coverage.start()
        self._package, self._file, self._since = package, _SHARED, time.monotonic()
        self._seconds: defaultdict[str, float] = defaultdict(float)

    def _switch(self, file: str) -> None:
        if file != self._file:
            now = time.monotonic()
            self._seconds[self._file] += now - self._since
            self._file, self._since = file, now
            self._coverage.switch_context(file)

    @pytest.hookimpl(hookwrapper=True)
    def pytest_make_collect_report(self, collector: pytest.Collector) -> Iterator[None]:
        """Count what a file of tests runs while it is imported as run by it."""
        self._switch(collector.nodeid.split("::")[0] if isinstance(collector, pytest.Module) else _SHARED)
        yield

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> Iterator[None]:
        """Count what a test runs as run by its file; what the package keeps is forgotten between files."""
        file = item.nodeid.split("::")[0]
        if file != self._file:
            self._switch(_SHARED)
            for one in gc.get_objects():
                if type(one) is functools._lru_cache_wrapper and str(one.__module__).startswith("safe_inspect."):
                    one.cache_clear()
            self._switch(file)
        yield

    @pytest.hookimpl(hookwrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any, request: Any) -> Iterator[None]:
        """Count what fixtures of the session run as run by every file."""
        file = self._file
        if fixturedef.scope in ("session", "package"):
            self._switch(_SHARED)
        yield
        self._switch(file)

    def write(self, path: Path) -> None:
        """Write for each file of tests how long it takes and which functions it runs, by module and line."""
        self._switch("end")
        self._coverage.stop()
        data = self._coverage.get_data()
        reached: defaultdict[str, dict[str, list[int]]] = defaultdict(dict)
        for measured in data.measured_files():
            module = Path(measured).relative_to(self._package.parent).as_posix()
            functions = functions_of(Path(measured).read_text(encoding="utf-8"))
            found = defaultdict(set)
            for line, files in data.contexts_by_lineno(measured).items():
                for file in files:
                    found[file].add(functions.get(line, 0))
            for file, starts in found.items():
                reached[file][module] = sorted(starts - {0})
        record = {file: {"seconds": self._seconds[file], "functions": reached[file]} for file in self._seconds}
        path.write_text(json.dumps(record), encoding="utf-8")


def functions_of(source: str) -> dict[int, int]:
    """Return for each line in the body of a function the line of the innermost function's ``def``."""
    lines: dict[int, int] = {}
    for node in ast.walk(ast.parse(source)):  # outer functions come first
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            lines.update(dict.fromkeys(range(node.body[0].lineno, (node.end_lineno or 0) + 1), node.lineno))
    return lines


def _run(request: dict[str, Any]) -> int:
    """Run tests in this process, and return the exit code."""
    with open(request["output"], "w", encoding="utf-8") as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    reach = Reach(Path.cwd() / "safe_inspect") if request["reach"] else None
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:randomly", "-m", "not slow and not long"]
    code = int(pytest.main([*options, *request["names"]], plugins=[reach] if reach else None))
    if reach:
        reach.write(Path(request["reach"]))
    return code


def _forked(request: dict[str, Any]) -> int | str:
    """Run tests in a fork, and return the exit code, or "timeout"."""
    parent, child = os.getppid(), os.fork()
    if not child:
        code = 1
        try:
            os.setsid()
            with open(os.devnull, encoding="utf-8") as nothing:
                os.dup2(nothing.fileno(), 0)
            code = _run(request)
            atexit._run_exitfuncs()
            sys.stdout.flush()
        finally:
            os._exit(code)
    end = time.monotonic() + request["limit"]
    answer: int | str = "timeout"
    while time.monotonic() < end and os.getppid() == parent:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            answer = os.waitstatus_to_exitcode(status)
            break
        time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    if answer == "timeout":
        os.waitpid(child, 0)
    return answer


def main() -> None:
    """Load the libraries and serve requests until standard input ends."""
    for name in _LIBRARIES:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    for line in sys.stdin:
        print(json.dumps(_forked(json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
