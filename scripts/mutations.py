"""Small faults that can be planted in a Python source file: the mutations that `scripts/mutants.py` draws from."""

from __future__ import annotations

import ast
import itertools
from dataclasses import dataclass

_COMPARISONS = {
    ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
    ast.In: "not in", ast.NotIn: "in", ast.Is: "is not", ast.IsNot: "is",
}  # fmt: skip
_REVERSED = {ast.Lt: ">", ast.LtE: ">=", ast.Gt: "<", ast.GtE: "<="}
_OPERATORS = {
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "*", ast.Mod: "*", ast.Pow: "*",
    ast.BitAnd: "|", ast.BitOr: "&", ast.LShift: ">>", ast.RShift: "<<", ast.BitXor: "&", ast.MatMult: "*",
}  # fmt: skip
#: Functions for which the order of two arguments means nothing.
_SYMMETRIC = {"max", "min", "hypot", "maximum", "minimum", "logical_and", "logical_or"}
_Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Mutation:
    """One fault.

    Attributes:
        kind: What kind of fault it is.
        line: The line of the source where it starts, from 1.
        start: First byte of the source that is replaced.
        end: First byte after it.
        text: What replaces it.
    """

    kind: str
    line: int
    start: int
    end: int
    text: str

    def applied(self, source: str) -> str:
        """Return the source with the fault."""
        data = source.encode()
        return (data[: self.start] + self.text.encode() + data[self.end :]).decode()

    def compiles(self, source: str) -> bool:
        """Return whether the source with the fault is Python."""
        try:
            compile(self.applied(source), "<mutant>", "exec")
        except SyntaxError:
            return False
        return True

    def replaced(self, source: str) -> str:
        """Return the text that the fault replaces."""
        return source.encode()[self.start : self.end].decode()


def mutations(source: str) -> list[Mutation]:
    """Return the faults that can be planted in a source file, in the order of its text.

    Docstrings, annotations, imports, decorators and texts are left alone.
    """
    finder = _Finder(source)
    finder.visit(ast.parse(source))
    return sorted(finder.found, key=lambda one: (one.start, one.end, one.kind, one.text))


class _Finder(ast.NodeVisitor):
    """Collects the mutations of a syntax tree."""

    def __init__(self, source: str) -> None:
        self._source = source.encode()
        self._starts = [0]
        for line in self._source.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))
        self.found: list[Mutation] = []

    def _span(self, node: ast.AST) -> tuple[int, int]:
        assert isinstance(node, ast.expr | ast.stmt)
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._starts[node.lineno - 1] + node.col_offset, self._starts[node.end_lineno - 1] + node.end_col_offset

    def _text(self, node: ast.AST) -> str:
        start, end = self._span(node)
        return self._source[start:end].decode()

    def _add(self, kind: str, node: ast.expr | ast.stmt, text: str) -> None:
        start, end = self._span(node)
        if self._source[start:end].decode() != text:
            self.found.append(Mutation(kind, node.lineno, start, end, text))

    def _between(self, kind: str, left: ast.expr, right: ast.expr, text: str) -> None:
        """Replace what is between two operands, but for brackets and white space."""
        start, end = self._span(left)[1], self._span(right)[0]
        between = self._source[start:end].decode()
        symbol = between.strip().strip("()").strip()
        if symbol and "#" not in between and "\\" not in between:
            offset = start + len(between[: between.index(symbol)].encode())
            line = left.end_lineno or left.lineno
            self.found.append(Mutation(kind, line, offset, offset + len(symbol.encode()), text))

    # -- statements

    def _visit_body(self, node: ast.AST) -> None:
        body = list(getattr(node, "body", []))
        if body and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant):
            body = body[1:]  # the docstring
        for child in body:
            self.visit(child)

    def visit_Module(self, node: ast.Module) -> None:
        self._visit_body(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._visit_body(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        for default in [*node.args.defaults, *(value for value in node.args.kw_defaults if value is not None)]:
            self.visit(default)
        self._visit_body(node)
        if isinstance(node.returns, ast.Constant) and node.returns.value is None:
            for child in node.body[1:]:
                start, _ = self._span(child)
                self.found.append(Mutation("early return", child.lineno, start, start, "return; "))

    visit_AsyncFunctionDef = visit_FunctionDef  # type: ignore[assignment]  # noqa: N815

    def visit_Import(self, node: ast.Import) -> None:
        """Leave imports alone."""

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        """Leave imports alone."""

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_Assign(self, node: ast.Assign) -> None:
        if any(isinstance(target, ast.Subscript | ast.Attribute) for target in node.targets):
            self._add("dropped update", node, "pass")
        self.visit(node.value)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._add("dropped update", node, "pass")
        self.visit(node.value)

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self._add("dropped call", node, "pass")
        self.visit(node.value)

    def visit_If(self, node: ast.If) -> None:
        if not (isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"):
            self._add("dropped condition", node.test, "True")
            self._add("dropped condition", node.test, "False")
            self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._add("dropped condition", node.test, "True")
        self._add("dropped condition", node.test, "False")
        self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        self._add("dropped refusal", node, "pass")

    def visit_Assert(self, node: ast.Assert) -> None:
        """Leave assertions alone."""

    def visit_Break(self, node: ast.Break) -> None:
        self._add("break and continue", node, "continue")

    def visit_Continue(self, node: ast.Continue) -> None:
        self._add("break and continue", node, "break")

    # -- expressions

    def visit_Compare(self, node: ast.Compare) -> None:
        for left, operator, right in zip(
            [node.left, *node.comparators], node.ops, [*node.comparators, node.left], strict=False
        ):
            self._between("comparison", left, right, _COMPARISONS[type(operator)])
            if type(operator) in _REVERSED:
                self._between("comparison", left, right, _REVERSED[type(operator)])
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if not (isinstance(node.left, ast.Constant) and isinstance(node.left.value, str)):
            self._between("operator", node.left, node.right, _OPERATORS[type(node.op)])
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        self._add("dropped sign", node, f"({self._text(node.operand)})")
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        other = "or" if isinstance(node.op, ast.And) else "and"
        for left, right in itertools.pairwise(node.values):
            self._between("and, or", left, right, other)
        for value in node.values:
            self._add("dropped condition", value, "True" if isinstance(node.op, ast.And) else "False")
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        plain = [argument for argument in node.args if not isinstance(argument, ast.Starred)]
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if len(plain) == len(node.args) and len(plain) > 1 and name not in _SYMMETRIC:
            for left, right in itertools.pairwise(plain):
                if self._text(left) != self._text(right):
                    start, end = self._span(left)[0], self._span(right)[1]
                    between = self._source[self._span(left)[1] : self._span(right)[0]].decode()
                    text = f"{self._text(right)}{between}{self._text(left)}"
                    self.found.append(Mutation("exchanged arguments", left.lineno, start, end, text))
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self._add("constant", node, str(not value))
        elif isinstance(value, int):
            self._add("constant", node, str(value + 1))
        elif isinstance(value, float):
            self._add("constant", node, repr(1.5 * value) if value else "1.0")

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Leave texts alone: their parts have no reliable positions."""
