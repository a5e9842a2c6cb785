"""Mutations of Python source: one operator, constant, sign, bound or condition changed at a time.

What a test cannot be asked to notice is left alone: annotations, texts, decorators, and what an error says.
"""

import ast
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, zip_longest

BOUNDS = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}  # a value on the bound itself is judged otherwise
OPPOSITES = {
    ast.Lt: ">=", ast.LtE: ">", ast.Gt: "<=", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
SIGNS = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
    ast.Is: "is", ast.IsNot: "is not", ast.In: "in", ast.NotIn: "not in",
}  # fmt: skip
OPERATORS = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.Pow: "*", ast.FloorDiv: "/", ast.Mod: "*"}
OTHER_WORDS = {
    "min": "max", "max": "min", "any": "all", "all": "any", "minimum": "maximum", "maximum": "minimum",
    "argmin": "argmax", "argmax": "argmin", "floor": "ceil", "ceil": "floor",
}  # fmt: skip
TYPES = {"tuple", "list", "dict", "Callable", "Mapping", "Sequence", "Iterator", "Iterable"}  # with brackets, an alias
TEXTS = (ast.JoinedStr, ast.Raise, ast.Assert)  # what they hold is read by people


@dataclass(frozen=True)
class Mutation:
    """A piece of the source of a module, in bytes from `start` to `end`, and what takes its place."""

    kind: str
    line: int
    scope: str  # qualified name of the function around it, empty at the top of the module
    start: int
    end: int
    before: str
    after: str

    def apply(self, source: bytes) -> bytes:
        """The source with this change, and as many lines."""
        lines = "\n" * (self.before.count("\n") - self.after.count("\n"))
        after = f"{self.after[:-1]}{lines}{self.after[-1]}" if lines else self.after  # within its brackets
        return source[: self.start] + after.encode() + source[self.end :]

    def show(self, source: bytes) -> tuple[str, str]:
        """The lines around it before and after, as one line each."""
        first = source.rfind(b"\n", 0, self.start) + 1
        last = (source + b"\n").index(b"\n", self.end)
        before, head, tail = source[first:last], source[first : self.start], source[self.end : last]
        return tuple(" ".join(x.decode().split()) for x in (before, head + self.after.encode() + tail))


def find_mutations(source: bytes) -> list[Mutation]:
    """All mutations of the source of a module, in the order of its lines."""
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = []
    for scope, node in _walk(ast.parse(source), ""):
        start, end = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
        before = source[start:end].decode()
        for kind, after in _changes(node, before):
            found.append(Mutation(kind, node.lineno, scope, start, end, before, f"({after})"))
    return sorted((_without_needless_brackets(x) for x in found), key=lambda x: (x.start, x.end))


def _without_needless_brackets(mutation: Mutation) -> Mutation:
    """A name that takes the place of a name needs no brackets, and could not stand in them."""
    return replace(mutation, after=mutation.after[1:-1]) if mutation.kind == "call" else mutation


def _walk(node: ast.AST, scope: str, prefix: str = "") -> Iterator[tuple[str, ast.expr]]:
    """The expressions that are computed, with the function that holds each; `prefix` is before names defined here."""
    if isinstance(node, TEXTS):
        return
    if isinstance(node, ast.expr):
        yield scope, node
    parts = list(ast.iter_child_nodes(node))
    match node:
        case ast.Call(func=ast.Name(id="zip")):  # with other lengths than it is given, no right program differs
            parts = [x for x in parts if not (isinstance(x, ast.keyword) and x.arg == "strict")]
        case ast.FunctionDef():
            defaults = [*node.args.defaults, *filter(None, node.args.kw_defaults)]
            yield from (found for x in defaults for found in _walk(x, scope, prefix))
            scope = prefix + node.name
            parts, prefix = node.body, f"{scope}.<locals>."
        case ast.ClassDef():
            parts, prefix = node.body, f"{prefix}{node.name}."
        case ast.AnnAssign():
            parts = [node.value] if node.value else []
        case ast.Subscript(value=ast.Name(id=name)) if name in TYPES:
            return
    for part in parts:
        yield from _walk(part, scope, prefix)


def _changes(node: ast.expr, before: str) -> Iterator[tuple[str, str]]:
    """What can take the place of an expression: the kind of the change, and the text."""
    match node:
        case ast.Compare(left=left, ops=ops, comparators=others):
            values, signs = [ast.unparse(x) for x in (left, *others)], [SIGNS[type(op)] for op in ops]
            for k, op in enumerate(ops):
                if type(op) in BOUNDS:
                    yield "bound", _chain(values, [*signs[:k], BOUNDS[type(op)], *signs[k + 1 :]])
                yield "comparison", _chain(values, [*signs[:k], OPPOSITES[type(op)], *signs[k + 1 :]])
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
            yield "operator", f"({ast.unparse(left)}) {OPERATORS[type(op)]} ({ast.unparse(right)})"
        case ast.BoolOp(op=op, values=values):
            word = " or " if isinstance(op, ast.And) else " and "
            yield "condition", word.join(f"({ast.unparse(x)})" for x in values)
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield "sign" if isinstance(node.op, ast.USub) else "condition", ast.unparse(operand)
        case ast.IfExp(test=test, body=body, orelse=other):
            yield "condition", f"({ast.unparse(other)}) if ({ast.unparse(test)}) else ({ast.unparse(body)})"
        case ast.Constant(value=bool(value)):
            yield "constant", str(not value)
        case ast.Constant(value=int(value) | float(value)):
            yield "constant", f"{2 * value if value else 1}"
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in OTHER_WORDS:
            yield "call", before.replace(f"{name}(", f"{OTHER_WORDS[name]}(", 1)


def _chain(values: Sequence[str], signs: Sequence[str]) -> str:
    """A comparison of several values."""
    return " ".join(chain.from_iterable(zip_longest(values, signs, fillvalue=""))).rstrip()
