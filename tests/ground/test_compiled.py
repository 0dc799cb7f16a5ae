from __future__ import annotations

import ast
import copy
import pickle
import signal
import subprocess
import sys
import time
import typing
from importlib import import_module
from pathlib import Path

import pytest

import safe_inspect
from safe_inspect.compiling.kernel import Kernel


def test_kernels_are_compiled_at_the_first_call_and_call_each_other() -> None:
    import numpy as np

    from safe_inspect.dynamics.cwh import propagate
    from safe_inspect.simulators.state import copy_rows

    for kernel in (propagate, copy_rows):
        assert isinstance(kernel, Kernel)
        assert pickle.loads(pickle.dumps(kernel)) is copy.deepcopy(kernel) is kernel
    position, velocity, out = np.ones((1, 3)), np.zeros((1, 3)), np.empty((2, 1, 3))
    propagate(position, velocity, velocity, np.eye(6), np.zeros((6, 3)), *out)
    assert out[0].tolist() == [[1.0, 1.0, 1.0]]
    assert propagate.dispatcher.signatures


@pytest.mark.slow
def test_an_interrupted_call_of_compiled_code_is_a_keyboard_interrupt():
    """What Numba does while an interrupt is pending, for each kind of result that the package's functions return."""
    code = (
        "import os, subprocess, sys, numba, numpy as np\n"
        "@numba.njit\n"
        "def work(n):\n"
        "    total = 0.0\n"
        "    for i in range(n):\n"
        "        total += np.sin(i + total)\n"
        "    return {result}\n"
        "work(10)\n"
        "def work_on():\n"  # a loop directly in the try would jump back to its NOP, which the handler does not cover
        "    while True: work(50_000_000)\n"
        "print('ready', flush=True)\n"
        "try: work_on()\n"
        "except KeyboardInterrupt: sys.exit(130)\n"
    )
    for result in ("None", "total", "(total, 1, True)", "np.full(3, total)"):
        process = subprocess.Popen([sys.executable, "-c", code.format(result=result)], stdout=subprocess.PIPE)
        assert process.stdout.readline() == b"ready\n"
        time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130, result
        process.stdout.close()


def compiled_results():
    """Yield place, name and annotated result of each compiled function that uncompiled code of the package calls."""
    root = Path(safe_inspect.__file__).parent
    texts = {
        ".".join(("safe_inspect", *path.relative_to(root).with_suffix("").parts)): path.read_text(encoding="utf-8")
        for path in sorted(root.rglob("*.py"))
    }
    with_compiled = {module for module, text in texts.items() if "@njit" in text}
    for module, text in texts.items():
        tree = ast.parse(text)
        sources = {
            alias.asname or alias.name: (node.module, alias.name)
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("safe_inspect")
            for alias in node.names
        }
        sources |= {node.name: (module, node.name) for node in tree.body if isinstance(node, ast.FunctionDef)}
        compiled = {
            inner
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef) and any("njit" in ast.unparse(each) for each in node.decorator_list)
            for inner in ast.walk(node)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and node not in compiled and getattr(node.func, "id", None) in sources:
                source, name = sources[node.func.id]
                if source not in with_compiled:
                    continue
                found = getattr(import_module(source), name, None)
                if isinstance(found, Kernel):
                    yield f"{module}:{node.lineno}", name, typing.get_type_hints(found.__wrapped__)["return"]


def test_no_compiled_function_returns_what_an_interrupt_would_break():
    results = list(compiled_results())
    assert len(results) > 20
    scalars = (int, float, bool)
    for place, name, result in results:
        if isinstance(result, type) and issubclass(result, tuple):
            pytest.fail(f"{place}: {name} returns a NamedTuple, see safe_inspect.compiling")
        if typing.get_origin(result) is tuple:
            parts = [part for part in typing.get_args(result) if part is not Ellipsis]
            assert all(part in scalars for part in parts), f"{place}: {name} returns arrays in a tuple"
