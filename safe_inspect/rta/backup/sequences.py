"""Generated functions that call the row kernels of all constraints of `CERTIFIED`.

The first argument of each is c, the numbers of all constraints. Constraints that do not apply are called too: their
numbers reject nothing, so the same machine code works for every choice of constraints.
"""

from __future__ import annotations

from typing import Any

from safe_inspect.compiling import Kernel, generate
from safe_inspect.rta.constraints.rows import INLINED
from safe_inspect.rta.constraints.sets import CERTIFIED

#: Value instead of a code if nothing is rejected.
SAFE = -1


def _asked(question: str) -> dict[int, Kernel[..., Any]]:
    """Return the kernels of that name by the codes of the constraints that have one."""
    found = {code: getattr(constraint.kernels, question, None) for code, constraint in enumerate(CERTIFIED)}
    return {code: kernel for code, kernel in found.items() if kernel}


def _cost(code: int) -> int:
    kernels = CERTIFIED[code].kernels
    return 0 if kernels is None else kernels.cost


def _function(name: str, question: str, arguments: str, lines: list[str]) -> Any:
    source = "\n    ".join([f"def {name}(c, {arguments}):", *lines]) + "\n"
    return generate(name, source, {f"k{code}": kernel for code, kernel in _asked(question).items()}, INLINED)


def _first_refusal(question: str, arguments: str, *, cheap_first: bool = False) -> Any:
    """Return a function that returns the code of the first constraint whose kernel is true, or SAFE."""
    codes = sorted(_asked(question), key=_cost) if cheap_first else list(_asked(question))
    lines = [f"if k{code}(c[{code}], {arguments}): return {code}" for code in codes]
    return _function(f"first_{question}", question, arguments, [*lines, f"return {SAFE}"])


def _of_code(question: str, arguments: str, otherwise: str) -> Any:
    """Return a function that calls the kernel of the constraint with a given code."""
    lines = [f"if code == {code}: return k{code}(c[{code}], {arguments})" for code in _asked(question)]
    return _function(f"{question}_of", question, f"code, {arguments}", [*lines, f"return {otherwise}"])


def _least(question: str, arguments: str) -> Any:
    """Return a function that returns the least value over all constraints, and the code of that constraint."""
    first, *others = _asked(question)
    lines = [f"least, which = k{first}(c[{first}], {arguments}), {first}"]
    for code in others:
        lines += [f"value = k{code}(c[{code}], {arguments})", "if value < least:", f"    least, which = value, {code}"]
    return _function(f"least_{question}", question, arguments, [*lines, "return least, which"])


def bits_of(question: str) -> int:
    """Return the bits of the codes of the constraints that have the given kernel or property of `RowKernels`."""
    return sum(1 << code for code in _asked(question))


#: (c, node, margins): the code of a constraint that is violated at a node of an arc, or SAFE.
broken_at = _first_refusal("broken", "node, margins")
#: (c, cell, margins): the code of a constraint that the ends of an `ArcCell` cannot certify, or SAFE.
uncertain = _first_refusal("uncertain", "cell, margins", cheap_first=True)
#: (c, speeds, margins): the code of a constraint that a closed motion with those largest speeds violates, or SAFE.
too_fast = _first_refusal("amplitude", "speeds, margins")
#: (c, node, margins) and (c, cell, margins): the same as the first two, for a closed motion.
broken_at_closed = _first_refusal("closed_broken", "node, margins")
uncertain_closed = _first_refusal("closed_uncertain", "cell, margins", cheap_first=True)
#: (c, node): the least slack of all constraints [m], and the code of that constraint.
least_slack = _least("slack", "node")
#: (c, node): the least speed limit [m/s], and the code of that constraint.
least_allowed_speed = _least("allowed_speed", "node")
#: (c, code, node, margins, d): see `RowKernels.support`.
support_of = _of_code("support", "node, margins, d", "0.0")
#: (c, code, node): see `RowKernels.slack`.
slack_of = _of_code("slack", "node", "0.0")
#: (c, code, node): see `RowKernels.gap`.
gap_of = _of_code("gap", "node", "0.0")
#: (c, code, sun, d): see `RowKernels.turn`.
turn_of = _of_code("turn", "sun, d", "None")
